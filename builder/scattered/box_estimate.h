// Splat moments of scattered points block by block, where there are too many for their Voronoi cells.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/math.h"
#include "builder/mesh/moments.h"

namespace splatvol {

/// What the points of a block stand for; where it is to be written.
struct EstimatedMaterial {
  std::span<SpatialMoments> moments;                   // [point]
  std::vector<std::span<ValueMoments>> value_moments;  // [attribute][point]
  std::vector<std::span<dvec3>> gradients;             // [attribute][point]; 0: none
};

/// Shares a block's volume out by a k-d tree over its points: each has a box, and the boxes tile the block. Sides that
/// are far longer than what is usual beside them end holes and concavities and are cut off; nothing else is lost. Good
/// for points without direction; cells of high aspect ratio need ScatteredEstimate, as boxes do not follow layers that
/// are not parallel to an axis. Holds its scratch memory; not thread-safe, one for each thread.
class BoxEstimate {
 public:
  /// Of coincident points the first has the whole box, the others have no mass. Values are linear in a box, with the
  /// gradient that fits some 16 points there best; no mass where a value is missing (NaN). The result depends on the
  /// arguments alone. Best at some hundred to some thousand points. Requires finite positions inside `bounds`, borders
  /// included, fewer than 2^32, as many values of each attribute, and room in `result` for all, which is written over.
  void estimate(std::span<const dvec3> positions, std::span<const std::span<const double>> values, const Box& bounds,
                const EstimatedMaterial& result);

 private:
  // Compared and moved as a whole: a vector in each.
  struct Place {
    using Lanes [[gnu::vector_size(4 * sizeof(double))]] = double;
    Lanes lanes;  // the position, less the block's lowest corner, and the point's number

    double operator[](int axis) const { return lanes[axis]; }
    [[nodiscard]] dvec3 position() const { return {lanes[0], lanes[1], lanes[2]}; }
    [[nodiscard]] std::uint32_t point() const { return static_cast<std::uint32_t>(lanes[3]); }
  };
  struct Range {
    std::uint32_t begin, end;  // of places
  };
  struct Level {
    bool in_neighbourhood = false, in_group = false;
  };
  void split(Range range, const Box& box, Level level);
  struct Split {
    std::uint32_t middle;
    double plane;
  };
  [[nodiscard]] Split find_split(Range range, int axis);
  using Indices [[gnu::vector_size(4 * sizeof(std::int64_t))]] = std::int64_t;
  static void sort_few(std::span<Place> places, int axis);
  [[nodiscard]] Split split_at_gap(Range range, int axis);
  [[nodiscard]] Split split_at_median(Range range, int axis);
  [[nodiscard]] double widest_spacing() const;
  void cut_off_voids(Range neighbourhood, double widest);
  void store_boxes(std::span<SpatialMoments> moments) const;
  [[nodiscard]] dvec3 fit_gradient(Range range, std::span<const double> values, const dvec3& around) const;
  void store_values(Range group, std::span<const double> values, const dvec3& gradient,
                    std::span<const SpatialMoments> moments, std::span<ValueMoments> result) const;

  std::vector<Place> places_;          // in the tree's order
  std::vector<Box> boxes_;             // [place]; turned inside out: none
  std::vector<Range> neighbourhoods_;  // whose boxes tell what is usual
  std::vector<Range> groups_;          // that share a gradient
  std::vector<double> lengths_;
};

}  // namespace splatvol
