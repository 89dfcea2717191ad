#include "builder/mesh/lattice.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <initializer_list>
#include <limits>

namespace splatvol {
namespace {

constexpr int highest_order = 32;
constexpr std::uint32_t no_point = std::numeric_limits<std::uint32_t>::max();

std::size_t lattice_size(CellShape shape, int order, int axial_order) {
  const auto n = static_cast<std::size_t>(order) + 1;
  if (shape == CellShape::hexahedron) return n * n * n;
  if (shape == CellShape::wedge) return n * (n + 1) / 2 * (static_cast<std::size_t>(axial_order) + 1);
  return n * (n + 1) * (n + 2) / 6;
}

/// The points of a cell on their lattice.
class Lattice {
 public:
  Lattice(int order, int axial_order) : order_(order), axial_order_(axial_order), side_(order + 1) {
    point_at_.assign(static_cast<std::size_t>(side_ * side_ * side_), no_point);
  }

  /// Puts a point on the lattice. Returns false if it has no such position, or if the position is taken.
  bool add_point(dvec3 parametric, std::uint32_t point) {
    const auto i = std::lround(parametric.x * order_);
    const auto j = std::lround(parametric.y * order_);
    const auto k = std::lround(parametric.z * axial_order_);
    if (std::min({i, j, k}) < 0 || std::max({i, j, k}) > order_) return false;
    std::uint32_t& at = point_at_[index(static_cast<int>(i), static_cast<int>(j), static_cast<int>(k))];
    if (at != no_point) return false;
    at = point;
    return true;
  }

  std::vector<std::uint32_t> divide(CellShape shape) {
    if (shape == CellShape::hexahedron) divide_hexahedron();
    if (shape == CellShape::wedge) divide_wedge();
    if (shape == CellShape::tetrahedron) divide_tetrahedron();
    return std::move(cells_);
  }

 private:
  [[nodiscard]] std::size_t index(int i, int j, int k) const {
    return static_cast<std::size_t>((k * side_ + j) * side_ + i);
  }

  void add_cell(int i, int j, int k, std::initializer_list<std::array<int, 3>> corners) {
    for (const auto& [di, dj, dk] : corners) cells_.push_back(point_at_[index(i + di, j + dj, k + dk)]);
  }

  void divide_hexahedron() {
    for (int k = 0; k < order_; ++k)
      for (int j = 0; j < order_; ++j)
        for (int i = 0; i < order_; ++i)
          add_cell(i, j, k, {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}});
  }

  void divide_wedge() {
    for (int k = 0; k < axial_order_; ++k)
      for (int j = 0; j < order_; ++j)
        for (int i = 0; i + j < order_; ++i) {
          add_cell(i, j, k, {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 0, 1}, {0, 1, 1}});
          if (i + j + 2 > order_) continue;
          add_cell(i, j, k, {{1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}});
        }
  }

  /// Adds upright tetrahedra. Octahedra and upside-down tetrahedra lie between them; an octahedron becomes four
  /// tetrahedra around a diagonal.
  void divide_tetrahedron() {
    for (int k = 0; k < order_; ++k)
      for (int j = 0; j + k < order_; ++j)
        for (int i = 0; i + j + k < order_; ++i) {
          add_cell(i, j, k, {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}});
          if (i + j + k + 2 > order_) continue;
          add_cell(i, j, k, {{1, 0, 0}, {0, 1, 1}, {1, 1, 0}, {0, 1, 0}});
          add_cell(i, j, k, {{1, 0, 0}, {0, 1, 1}, {1, 0, 1}, {1, 1, 0}});
          add_cell(i, j, k, {{1, 0, 0}, {0, 1, 1}, {0, 0, 1}, {1, 0, 1}});
          add_cell(i, j, k, {{1, 0, 0}, {0, 1, 1}, {0, 1, 0}, {0, 0, 1}});
          if (i + j + k + 3 > order_) continue;
          add_cell(i, j, k, {{1, 1, 0}, {0, 1, 1}, {1, 0, 1}, {1, 1, 1}});
        }
  }

  int order_;
  int axial_order_;
  int side_;
  std::vector<std::uint32_t> point_at_;  // [k][j][i]
  std::vector<std::uint32_t> cells_;
};

}  // namespace

std::optional<std::vector<std::uint32_t>> divide_lattice(CellShape shape, int order, int axial_order,
                                                         std::span<const dvec3> parametric) {
  if (parametric.size() != lattice_size(shape, order, axial_order)) return std::nullopt;
  Lattice lattice(order, axial_order);
  for (std::uint32_t point = 0; point < parametric.size(); ++point)
    if (!lattice.add_point(parametric[point], point)) return std::nullopt;
  std::vector<std::uint32_t> cells = lattice.divide(shape);
  if (std::ranges::find(cells, no_point) != cells.end()) return std::nullopt;
  return cells;
}

std::optional<int> lattice_order(CellShape shape, bool linear_axis, std::size_t points) {
  for (int order = 1; order <= highest_order; ++order)
    if (lattice_size(shape, order, linear_axis ? 1 : order) == points) return order;
  return std::nullopt;
}

}  // namespace splatvol
