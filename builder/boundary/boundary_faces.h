// The boundary of a mesh that comes in pieces: its outer faces, by the patches of the input.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "builder/sorting/external_sort.h"
#include "builder/sources/source.h"

namespace splatvol {

/// A triangle of the boundary. `patch`: index into BoundaryFaces::names().
struct BoundaryTriangle {
  std::array<dvec3, 3> corners;  // counterclockwise from outside if `has_side`
  std::uint32_t patch = 0;
  bool has_side = false;  // it is the outer face of one cell
};

/// Collects the faces of all pieces that bound the mesh: those of one cell only, and those of the patches. Faces are
/// matched by their positions, so a face that two pieces have lies inside. A face of several patches belongs to the one
/// with the fewest triangles; if two have as many, to the first.
class BoundaryFaces {
 public:
  /// The name of the patch of all faces that no patch of the input has.
  static constexpr const char* rest_name = "outer";

  /// `memory`: bytes to hold, at least least_memory(). `folder`: for faces that do not fit.
  [[nodiscard]] static Result<BoundaryFaces> create(std::size_t memory, const std::string& folder);
  [[nodiscard]] static std::size_t least_memory();

  /// Adds the outer faces and the patches of a piece.
  [[nodiscard]] Status add(const Piece& piece);

  /// Fails if there is no face so far.
  [[nodiscard]] Status check_any() const;

  /// Calls visit for each triangle, each once. Their order does not depend on memory and threads. Called once, after
  /// the last piece.
  [[nodiscard]] Status visit(const std::function<Status(const BoundaryTriangle&)>& visit);

  /// The patches so far, in the order in which they came; `rest_name` is the first, with or without faces.
  [[nodiscard]] const std::vector<std::string>& names() const { return names_; }

  /// Whether the input has a patch called `rest_name` so far. The rest belongs to it.
  [[nodiscard]] bool input_names_rest() const { return input_names_rest_; }

  /// Box round all outer faces so far.
  [[nodiscard]] const Box& box() const { return box_; }

 private:
  struct Face;
  explicit BoundaryFaces(ExternalSorter faces) : faces_(std::move(faces)) {}
  [[nodiscard]] Status add_outer(const std::vector<dvec3>& points,
                                 const std::vector<std::array<std::uint32_t, 4>>& tetrahedra);
  [[nodiscard]] Status add_patch(const Patch& patch);
  [[nodiscard]] std::uint32_t number_of(const std::string& name);
  [[nodiscard]] std::optional<BoundaryTriangle> choose(std::vector<Face>& same) const;

  ExternalSorter faces_;
  std::vector<std::string> names_ = {rest_name};
  std::map<std::string, std::uint32_t> numbers_ = {{rest_name, 0}};  // of names_
  std::vector<std::uint64_t> counts_ = {0};                          // [patch]: triangles
  bool input_names_rest_ = false;
  Box box_;
};

}  // namespace splatvol
