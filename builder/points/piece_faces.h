// The outer faces of a mesh that comes in pieces.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <utility>

#include "base/error.h"
#include "base/math.h"
#include "builder/points/boundary_corners.h"
#include "builder/points/point_records.h"
#include "builder/sorting/external_sort.h"
#include "builder/sources/source.h"

namespace splatvol {

/// Collects the outer faces of all pieces. A face that two pieces have lies inside of the mesh.
class PieceFaces {
 public:
  /// `memory`: bytes to hold, at least least_memory(). `folder`: for faces that do not fit.
  PieceFaces(const PointRecords& layout, std::size_t memory, std::string folder)
      : layout_(layout), memory_(memory), folder_(std::move(folder)) {}

  [[nodiscard]] static std::size_t least_memory();

  /// Returns hash_values of a point's record, by its index in the piece. Called for points with finite positions only,
  /// on several threads.
  using HashOfPoint = std::function<std::uint64_t(std::size_t point)>;

  /// Adds a piece with tetrahedra. `outer_faces`: find_outer_faces.
  [[nodiscard]] Status add(const Piece& piece, std::span<const OuterFace> outer_faces, const HashOfPoint& hash);

  /// Adds a piece whose points stand for whole cells. Faces are matched by their positions alone: two cells that touch
  /// have no boundary between them, whatever their values.
  [[nodiscard]] Status add_cells(const Piece& piece, const HashOfPoint& hash);

  /// Returns the faces so far, sorted, for next(); none if no piece was added. Called once, after the last piece, by
  /// callers that bring the faces of pieces together that were read elsewhere.
  [[nodiscard]] Result<std::optional<ExternalSorter>> take_faces();
  [[nodiscard]] bool of_cells() const { return of_cells_; }

  /// Makes sorts for faces, and for the corners of outer faces.
  [[nodiscard]] static std::size_t face_bytes();
  [[nodiscard]] Result<ExternalSorter> sort_of_faces() const;
  [[nodiscard]] Result<ExternalSorter> sort_of_corners(const Cube& cube) const;

  /// Calls visit(bytes of one or some CornerArea) for all faces that are there once.
  [[nodiscard]] static Status find_corners(ExternalSorter& faces, bool of_cells,
                                           const std::function<Status(std::span<const std::byte>)>& visit);

  /// Sorts the corners of the whole mesh's faces. Returns none if no piece was added. Called once, after the last
  /// piece.
  [[nodiscard]] Result<std::optional<BoundaryCorners>> join(const Cube& cube);

 private:
  [[nodiscard]] Status start();
  template <class MakeFace>
  [[nodiscard]] Status add_faces(std::span<const OuterFace> outer, const MakeFace& make);

  PointRecords layout_;
  std::size_t memory_;
  std::string folder_;
  std::optional<ExternalSorter> faces_;
  bool of_cells_ = false;  // the faces belong to points that stand for cells
};

}  // namespace splatvol
