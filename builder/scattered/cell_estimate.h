// Voronoi cells of scattered points that are too many to find each cell exactly.
#pragma once

#include <cmath>
#include <cstdint>
#include <span>
#include <unordered_map>
#include <vector>

#include "base/math.h"
#include "builder/mesh/moments.h"
#include "builder/scattered/cell_rays.h"
#include "builder/scattered/surroundings.h"

namespace splatvol {

/// Values of an attribute at the points of an estimate, and at the points outside, in the order in which
/// Surroundings::read returned them.
struct EstimateValues {
  std::span<const double> own, outside;
};

/// Estimates the Voronoi cells of some thousand points among all points of an input. Where a cell ends is found along
/// rays from its point. Rays follow the shape of the cell, so thin cells are measured as well as round ones. Points
/// outside that are far off stand for all others near them. Cells that border on voids are trimmed as ScatteredEstimate
/// trims them. Volumes are right within 1 % (median).
class CellEstimate {
 public:
  /// Estimates the cells of `positions`, all finite, at least one, in the box `domain`, which is that round all points.
  /// The first of coincident points has the whole cell, the others have no mass; the first `coincident` points coincide
  /// with one outside. The result depends on the arguments alone. `outside`: null if there are no others.
  void find(std::span<const dvec3> positions, std::size_t coincident, const Box& domain, Surroundings* outside);

  [[nodiscard]] SpatialMoments moments(std::size_t point) const;

  /// The moments of a value: linear in the cell, with the gradient that fits the neighbours' values best. No mass if
  /// the point's own value is missing (NaN).
  [[nodiscard]] ValueMoments value(std::size_t point, const EstimateValues& values) const;

  /// This gradient; 0 if there is none.
  [[nodiscard]] dvec3 gradient(std::size_t point, const EstimateValues& values) const;

 private:
  // A point: one vector, compared and moved as a whole.
  struct Entry {
    using Lanes [[gnu::vector_size(4 * sizeof(double))]] = double;
    Lanes lanes;  // the position in the estimate's units, from its origin; then the point's index

    double operator[](int axis) const { return lanes[axis]; }
    [[nodiscard]] dvec3 position() const { return {lanes[0], lanes[1], lanes[2]}; }
    [[nodiscard]] std::uint32_t point() const { return static_cast<std::uint32_t>(lanes[3]); }
  };
  // A node of the k-d tree. Its lower child follows it.
  struct TreeNode {
    Box box;                   // round its entries
    std::uint32_t begin, end;  // entries
    std::uint32_t upper = 0;   // its upper child; 0: a bucket
  };
  struct Cell {
    SpatialMoments moments;
    double usual_end;           // the usual distance of its vertices
    double farthest;            // the largest one
    std::uint32_t first, last;  // neighbours
  };
  // A bucket outside, with its box.
  struct Near {
    double square;  // of the distance
    std::size_t number;
    Box box;
  };
  struct Range {
    std::uint32_t begin, end;
  };
  struct Fit {
    dvec3 gradient{0};
    double min, max;
  };

  void order(std::span<const dvec3> positions, std::size_t coincident, const Box& domain);
  void split(std::uint32_t begin, std::uint32_t end);
  void keep_distinct(TreeNode& bucket);
  [[nodiscard]] std::uint32_t split_at_median(std::uint32_t begin, std::uint32_t end, int axis);
  void close_gaps();

  void find_cells(const TreeNode& bucket);
  void find_cell(std::uint32_t entry, const TreeNode& bucket);
  void add_bounds();
  void search(const TreeNode& node, const TreeNode& bucket, const dvec3& from);
  void search_near(const TreeNode& bucket, const dvec3& from);
  void list_near(std::size_t number, const Box& around);
  void search_outside(std::size_t number, const dvec3& from);
  void visit_outside(std::size_t number, const Surroundings::Node& node, const Box& box, const dvec3& from);
  [[nodiscard]] bool is_wanted(const Box& box, const dvec3& from) const;
  void add_points(Range range, std::uint32_t but, const dvec3& from);
  [[nodiscard]] Range read(std::size_t bucket);
  [[nodiscard]] dvec3 position_of(std::uint32_t neighbour) const;
  // How many of a cell's vertices lie between points, and not at a border.
  enum class Ends { none_at_points, some_at_points, all_at_points };
  Ends store_cell(std::uint32_t entry);

  double usual_of(std::uint32_t entry);
  void trim_cells();
  void trim_cell(std::uint32_t entry);
  void cast_trimmed(std::uint32_t entry, std::span<const dvec3> cuts, dmat3& shape);
  [[nodiscard]] dvec3 farthest_out_of_proportion(std::uint32_t entry);
  [[nodiscard]] dvec3 cut_against(std::uint32_t entry, const dvec3& vertex);

  [[nodiscard]] std::span<const std::uint32_t> neighbours(std::uint32_t entry) const {
    return std::span(neighbours_).subspan(cells_[entry].first, cells_[entry].last - cells_[entry].first);
  }
  [[nodiscard]] double value_at(std::uint32_t entry, const EstimateValues& values) const {
    return entry < own_ ? values.own[entries_[entry].point()] : values.outside[entry - own_];
  }
  [[nodiscard]] Fit fit(std::uint32_t entry, const EstimateValues& values) const;

  dvec3 origin_{0};
  double scale_ = 1;            // units of the estimate in a unit of the positions
  double most_bounds_ = 1;      // largest bounds_
  std::vector<Entry> entries_;  // distinct points in the order of the tree, then those outside as they were read
  std::uint32_t own_ = 0;       // entries before those outside
  std::vector<std::uint32_t> entry_of_;  // [point]
  std::vector<TreeNode> tree_;
  Surroundings* outside_ = nullptr;
  std::unordered_map<std::size_t, Range> read_;  // [bucket]
  std::vector<dvec3> stand_ins_;                 // positions that stand for points far off, round one cell
  std::vector<dvec3> kept_stand_ins_;            // those that are neighbours
  std::vector<Cell> cells_;                      // [own entry]
  std::vector<std::uint32_t> neighbours_;        // entries, or from first_stand_in on kept stand-ins
  std::vector<double> usual_;                    // [own entry]: NaN as long as it is not known
  std::vector<double> lengths_;
  std::vector<CellRays::Vertex> vertices_;
  std::vector<std::uint32_t> labels_;
  std::vector<Near> near_;  // within near_reach_ of a bucket, or some if there are too many
  double near_reach_ = 0;   // squared
  CellRays rays_;
  dmat3 shape_{1};     // of the rays, from the last cell
  double bounds_ = 1;  // half the edge of the cube in which a cell is looked for
};

}  // namespace splatvol
