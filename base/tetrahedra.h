// Tetrahedra with values.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/math.h"

namespace splatvol {

/// The tetrahedra of a chunk of cells, in the order of the cells.
struct Tetrahedra {
  std::vector<dvec3> points;  // world coordinates

  /// [tetrahedron]: points, ascending. The same points of two chunks are in the same order.
  std::vector<std::array<std::uint32_t, 4>> corners;

  bool constant = false;  // a value holds in all of a cell; else values are linear in each tetrahedron

  /// [attribute][point], or [attribute][tetrahedron] if constant. NaN: missing. A tetrahedron with a missing value at a
  /// corner has no values.
  std::vector<std::vector<double>> values;

  // Names.
  std::vector<std::uint64_t> ranks;  // [point]: ascending; if constant, numbers of vertices
  std::vector<std::uint32_t> cells;  // [tetrahedron]: the number of its cell in the chunk, if constant

  [[nodiscard]] std::size_t size() const { return corners.size(); }
  [[nodiscard]] std::array<dvec3, 4> corners_of(std::size_t tetrahedron) const {
    const auto& [a, b, c, d] = corners[tetrahedron];
    return {points[a], points[b], points[c], points[d]};
  }
  /// Returns the values at the corners; equal ones if constant.
  [[nodiscard]] std::array<double, 4> values_of(std::size_t tetrahedron, std::size_t attribute) const {
    const std::vector<double>& all = values[attribute];
    const auto& [a, b, c, d] = corners[tetrahedron];
    if (!constant) return {all[a], all[b], all[c], all[d]};
    const double value = all[tetrahedron];
    return {value, value, value, value};
  }

  [[nodiscard]] std::uint64_t memory_bytes() const {
    std::uint64_t bytes = points.capacity() * sizeof(dvec3) + corners.capacity() * sizeof(corners[0]) +
                          ranks.capacity() * sizeof(ranks[0]) + cells.capacity() * sizeof(cells[0]);
    for (const std::vector<double>& of_attribute : values) bytes += of_attribute.capacity() * sizeof(double);
    return bytes;
  }
};

}  // namespace splatvol
