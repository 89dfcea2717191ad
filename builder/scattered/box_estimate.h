// Splat moments of scattered points that are too many for their Voronoi cells, or lie on a plane or a line.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/math.h"
#include "builder/mesh/moments.h"

namespace splatvol {

/// The material of the points in an estimate node; the estimate writes into these spans.
struct EstimatedMaterial {
  std::span<SpatialMoments> moments;                   // [point]
  std::vector<std::span<ValueMoments>> value_moments;  // [attribute][point]
  std::vector<std::span<dvec3>> gradients;             // [attribute][point]; 0 if there is none. Or empty: not wanted
};

/// Shares out the volume of an estimate node by a k-d tree over its points: each point has a box, and the boxes tile
/// the node. A side that is far longer than the usual sides beside it borders on a void, and is cut off; no other
/// volume is lost. Made for points without direction. Boxes do not follow layers that are not parallel to an axis, so
/// cells of high aspect ratio need SampledCells. Keeps its scratch memory. Not thread-safe: use one for each
/// thread.
class BoxEstimate {
 public:
  /// Writes the material of all points into `result`. The first of coincident points has the whole box, the others have
  /// no mass. A value is linear in a box, with the gradient that fits about 16 points there best; it has no mass if it
  /// is missing (NaN). The result depends on the arguments alone. Best for some hundred to some thousand points.
  /// Requires fewer than 2^32 finite positions inside `bounds`, borders included; values, and room in `result`, for
  /// each of them.
  void estimate(std::span<const dvec3> positions, std::span<const std::span<const double>> values, const Box& bounds,
                const EstimatedMaterial& result);

 private:
  // A point: one vector, compared and moved as a whole.
  struct Entry {
    using Lanes [[gnu::vector_size(4 * sizeof(double))]] = double;
    Lanes lanes;  // the position, less the node's lowest corner; then the point's index

    double operator[](int axis) const { return lanes[axis]; }
    [[nodiscard]] dvec3 position() const { return {lanes[0], lanes[1], lanes[2]}; }
    [[nodiscard]] std::uint32_t point() const { return static_cast<std::uint32_t>(lanes[3]); }
  };
  struct Range {
    std::uint32_t begin, end;  // of entries
  };
  // Whether a neighbourhood and a group round a range have been found.
  struct Enclosing {
    bool neighbourhood = false, group = false;
  };
  void split(Range range, const Box& box, Enclosing enclosing);
  struct Split {
    std::uint32_t middle;
    double plane;
  };
  [[nodiscard]] Split find_split(Range range, int axis);
  using Indices [[gnu::vector_size(4 * sizeof(std::int64_t))]] = std::int64_t;
  static void sort_few(std::span<Entry> entries, int axis);
  [[nodiscard]] Split split_at_gap(Range range, int axis);
  [[nodiscard]] Split split_at_median(Range range, int axis);
  [[nodiscard]] double widest_spacing() const;
  void cut_off_voids(Range neighbourhood, double widest);
  void store_boxes(std::span<SpatialMoments> moments) const;
  [[nodiscard]] dvec3 fit_gradient(Range range, std::span<const double> values, const dvec3& around) const;
  void store_values(Range group, std::span<const double> values, const dvec3& gradient,
                    std::span<const SpatialMoments> moments, std::span<ValueMoments> result) const;

  std::vector<Entry> entries_;         // in the order of the tree
  std::vector<Box> boxes_;             // [entry]; inside out: none
  std::vector<Range> neighbourhoods_;  // ranges whose boxes have usual sides in common
  std::vector<Range> groups_;          // ranges that share a gradient
  std::vector<double> lengths_;
};

}  // namespace splatvol
