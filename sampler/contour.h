// The surface of a value in the cells of a chunk: marching tetrahedra.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "base/math.h"
#include "base/tetrahedra.h"

namespace splatvol {

/// Where a vertex of a contour is in the mesh: on the edge between two points of these ranks, `low` < `high`; at the
/// point itself if they are equal.
struct ContourKey {
  std::uint64_t low, high;

  [[nodiscard]] bool operator==(const ContourKey&) const = default;
};

/// The part of a contour in a chunk of cells. Corners whose values are at least that of the contour are inside.
/// Triangles turn counter-clockwise, seen from outside.
struct ContourPart {
  std::vector<ContourKey> keys;                         // [vertex]: each once
  std::vector<dvec3> points;                            // [vertex]; of one key, the same bits in all chunks
  std::vector<std::vector<double>> values;              // [attribute][vertex]: linear on the edge; NaN: missing
  std::vector<std::array<std::uint32_t, 3>> triangles;  // of different vertices
  std::vector<std::uint32_t> tetrahedra;                // [triangle]: the one that it is in

  [[nodiscard]] std::array<dvec3, 3> corners_of(std::size_t triangle) const {
    const auto& [a, b, c] = triangles[triangle];
    return {points[a], points[b], points[c]};
  }
};

/// Returns the contour of a function at `value`. `function`: [point], and linear in each tetrahedron. It may be an
/// attribute of the tetrahedra: its values are exactly `value` then. Tetrahedra with a missing value of it (NaN) have
/// none. Values of cells with one each are left out: triangles name their tetrahedra.
[[nodiscard]] ContourPart contour_of(const Tetrahedra& tetrahedra, std::span<const double> function, double value);

/// What triangles measure. Sums of parts of a contour are those of the whole.
class ContourMeasure {
 public:
  /// `middle`: any position near the contour.
  explicit ContourMeasure(const dvec3& middle) : middle_(middle) {}

  void add(const ContourPart& part);
  void add(const ContourMeasure& other);

  [[nodiscard]] double area() const { return area_; }

  /// Whether each edge belongs to an even number of triangles.
  [[nodiscard]] bool is_closed() const { return edges_ == std::array<std::uint64_t, 2>{}; }

  /// Returns the volume inside of a closed contour; negative if the contour is the border of a hole.
  [[nodiscard]] double volume() const { return volume_; }

 private:
  void add_edge(const dvec3& a, const dvec3& b);

  dvec3 middle_;
  double area_ = 0, volume_ = 0;
  std::array<std::uint64_t, 2> edges_{};  // exclusive or of hashes of all edges: those of a pair cancel
};

}  // namespace splatvol
