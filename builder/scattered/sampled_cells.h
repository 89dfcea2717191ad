// Voronoi cells of scattered points, nearly exact: some times as fast as exact ones.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "base/math.h"
#include "builder/mesh/moments.h"
#include "builder/scattered/leaf_samples.h"
#include "builder/scattered/point_leaves.h"
#include "builder/scattered/voronoi_cell.h"

namespace splatvol {

/// Estimates the Voronoi cells of some thousand points. Samples of the space round them tell which points are
/// neighbours: the nearest and the second nearest of a sample are, and the nearest of two samples side by side.
/// Bisectors to a point's neighbours bound its cell. Then the farthest vertex is checked: a point that is nearer to it
/// is a neighbour too. A cell that goes on and on borders on a void; it is trimmed. Small faces may be missed:
/// cells are larger than the exact ones by about 1 %. Keeps its memory. Not thread-safe.
class SampledCells {
 public:
  /// Estimates the cells of the first `own` positions, all finite; the others are those near them. The first of
  /// coincident points has the whole cell, the others have no mass; the first `coincident` points coincide with one of
  /// the others. The result depends on the arguments alone.
  void find(std::span<const dvec3> positions, std::size_t own, std::size_t coincident);

  /// Requires point < own, here and below.
  [[nodiscard]] SpatialMoments moments(std::size_t point) const;

  /// The moments of a value: linear in the cell, with the gradient that fits the neighbours' values best. No mass if
  /// the point's own value is missing (NaN). `values`: of all positions.
  [[nodiscard]] ValueMoments value(std::size_t point, std::span<const double> values) const;

  /// This gradient; 0 if there is none.
  [[nodiscard]] dvec3 gradient(std::size_t point, std::span<const double> values) const;

 private:
  using Pair = std::uint64_t;  // two points: the smaller one in the upper half
  // Neighbours by samples.
  struct Found {
    static constexpr std::uint32_t most = 24;
    std::array<std::uint32_t, most> points;
    std::uint32_t count = 0;

    void add(std::uint32_t point);
  };
  struct Cell {
    SpatialMoments moments;
    double radius = 0;                  // usual distance of its vertices
    double farthest = 0;                // the largest one, squared
    std::uint32_t first = 0, last = 0;  // neighbours
  };

  void set_positions(std::span<const dvec3> positions, std::size_t own, std::size_t coincident);
  void sample(const PointLeaves::Leaf& leaf, std::uint32_t seed);
  void make_first_cell(std::uint32_t point);
  double bound_vertices(std::uint32_t point);
  [[nodiscard]] bool is_in_void(const dvec3& vertex) const;
  bool cut_along(std::uint32_t point, const dvec3& direction, double near, double far);
  void trim_cells();
  [[nodiscard]] double usual_of(std::uint32_t point);
  [[nodiscard]] std::span<const std::uint32_t> neighbours(std::uint32_t point) const {
    return std::span(neighbours_).subspan(cells_[point].first, cells_[point].last - cells_[point].first);
  }

  std::size_t own_ = 0, coincident_ = 0;
  dvec3 origin_{0};
  double unit_ = 1;               // the estimate's units
  std::vector<dvec3> positions_;  // in these, without the coincident ones
  Box domain_;
  PointLeaves leaves_;
  LeafSamples samples_;
  std::array<Pair, 1024> known_pairs_;  // the last ones; 0: none
  std::vector<Found> found_;            // [point], without the coincident ones, as below
  std::vector<Cell> cells_;
  std::vector<std::uint32_t> neighbours_;
  std::vector<double> usual_;  // [position]: that of a cell and its neighbours; 0: not known
  std::vector<double> items_;
  std::vector<dvec3> voids_;  // directions in which the current cell goes on and on
  ConvexCell polyhedron_;
};

}  // namespace splatvol
