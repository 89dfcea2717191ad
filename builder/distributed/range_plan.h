// Facts of all ranges that a rank needs before it reduces its own.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "builder/distributed/key_ranges.h"
#include "builder/distributed/ranks.h"
#include "builder/pipeline/build.h"
#include "builder/points/batch_cutter.h"
#include "builder/points/point_stream.h"

namespace splatvol {

struct RangePlan {
  std::size_t ranges = 1;             // ranks that reduce; range r belongs to rank r
  PointBorders borders;               // of this rank's range
  std::size_t own_levels = 0;         // levels 1 to this one are reduced in ranges, coarser ones at rank 0
  std::vector<std::uint64_t> counts;  // [level up to own_levels]: points in all ranges
  std::vector<std::uint64_t> before;  // [segment up to own_levels]: points in the ranges before this one
  std::uint64_t points_before = 0;    // all points in the ranges before this one
};

/// Collective: counts the points that each level will have in each range, by a first pass over `points` (null on ranks
/// without a range), which then start again. Returns nothing if the points are too few to be cut: a node across a
/// border could be a leaf. `node_points`: most points in an index leaf or estimate node.
[[nodiscard]] Result<std::optional<RangePlan>> plan_ranges(Ranks& ranks, const RangeBegins& begins, PointStream* points,
                                                           const BuildOptions& options, std::uint64_t index_leaf_points,
                                                           std::uint64_t node_points);

}  // namespace splatvol
