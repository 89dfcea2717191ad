#include "builder/distributed/range_plan.h"

#include <algorithm>
#include <limits>
#include <numeric>

#include "builder/distributed/level_counts.h"

namespace splatvol {
namespace {

using Intervals = std::vector<std::vector<std::uint64_t>>;  // [level][interval between marks]

// The smallest octree nodes across the borders, as the marks at which they begin and end.
std::vector<MortonKey> marks_of(const RangeBegins& begins) {
  std::vector<MortonKey> marks;
  for (const MortonKey& begin : begins) {
    const int depth = common_depth(key_before(begin), begin);
    marks.push_back(first_key(begin, depth));
    marks.push_back(key_behind(last_key(begin, depth)));
  }
  std::ranges::sort(marks);
  return marks;
}

// The least that a node across a border has at a level.
std::uint64_t least_across(const RangeBegins& begins, const std::vector<MortonKey>& marks,
                           const std::vector<std::uint64_t>& intervals) {
  std::uint64_t least = std::numeric_limits<std::uint64_t>::max();
  const auto interval = [&](const MortonKey& key) {
    return intervals.begin() + (std::ranges::upper_bound(marks, key) - marks.begin());
  };
  for (const MortonKey& begin : begins) {
    const int depth = common_depth(key_before(begin), begin);
    const auto first = interval(first_key(begin, depth)), last = interval(last_key(begin, depth));
    least = std::min(least, std::accumulate(first, last + 1, std::uint64_t{0}));
  }
  return least;
}

// Counts of a rank in its own range.
struct RangeCounts {
  Intervals intervals;
  std::uint64_t points = 0;
  std::optional<dvec3> first, last;  // positions
};

Result<RangeCounts> count_range(PointStream& points, const KeyBorders& borders, const std::vector<MortonKey>& marks,
                                const BuildOptions& options, std::uint64_t index_leaf_points) {
  LevelCounts levels(points.summary().cube, options.leaf_points, index_leaf_points, borders, marks);
  RangeCounts counts;
  PointBatch batch;
  batch.resize_attributes(points.summary().attributes.size());
  for (;;) {
    SPLATVOL_TRY_ASSIGN(more, points.next(batch));
    if (!more) break;
    levels.add(batch);
    counts.points += batch.size();
    if (!counts.first) counts.first = batch.positions.front();
    counts.last = batch.positions.back();
    for_each_array(batch, batch, [](auto& items, auto&) { items.clear(); });
  }
  levels.finish();
  counts.intervals = levels.intervals();
  SPLATVOL_TRY(points.rewind());
  return counts;
}

struct Neighbour {
  bool any = false;
  dvec3 first{0}, last{0};
};

}  // namespace

Result<std::optional<RangePlan>> plan_ranges(Ranks& ranks, const RangeBegins& begins, PointStream* points,
                                             const BuildOptions& options, std::uint64_t index_leaf_points,
                                             std::uint64_t node_points) {
  const std::vector<MortonKey> marks = marks_of(begins);
  RangePlan plan;
  plan.ranges = begins.size() + 1;
  const auto count_own = [&]() -> Result<RangeCounts> {
    if (!points) return RangeCounts{};
    plan.borders.keys = borders_of(begins, ranks.rank());
    return count_range(*points, plan.borders.keys, marks, options, index_leaf_points);
  };
  SPLATVOL_TRY_ASSIGN(own, ranks.agree_on(count_own()));

  own.intervals.resize(max_levels, std::vector<std::uint64_t>(marks.size() + 1));
  Intervals all = own.intervals;
  for (std::vector<std::uint64_t>& of_level : all) ranks.sum(of_level);
  const auto total = [](const std::vector<std::uint64_t>& of_level) {
    return std::accumulate(of_level.begin(), of_level.end(), std::uint64_t{0});
  };
  const auto neighbours =
      gather_values(ranks, Neighbour{own.first.has_value(), own.first.value_or(dvec3(0)), own.last.value_or(dvec3(0))});
  const bool all_have_points = std::all_of(neighbours.begin(), neighbours.begin() + std::ptrdiff_t(plan.ranges),
                                           [](const Neighbour& n) { return n.any; });
  if (!all_have_points || least_across(begins, marks, all[0]) <= node_points) return std::nullopt;
  while (plan.own_levels + 2 < max_levels && total(all[plan.own_levels + 1]) > coarsest_target &&
         least_across(begins, marks, all[plan.own_levels + 1]) > options.leaf_points)
    ++plan.own_levels;
  if (plan.own_levels == 0) return std::nullopt;

  const std::size_t r = ranks.rank();
  if (points && r > 0) plan.borders.before = neighbours[r - 1].last;
  if (points && r + 1 < plan.ranges) plan.borders.behind = neighbours[r + 1].first;
  // A segment has the points of its level that the next coarser level has not.
  std::vector<std::uint64_t> segments;
  for (std::size_t level = 0; level <= plan.own_levels; ++level) {
    plan.counts.push_back(total(all[level]));
    segments.push_back(total(own.intervals[level]) - total(own.intervals[level + 1]));
  }
  const std::vector<std::uint64_t> points_of = gather_values(ranks, own.points);
  plan.points_before = std::accumulate(points_of.begin(), points_of.begin() + std::ptrdiff_t(r), std::uint64_t{0});
  plan.before.resize(segments.size());
  const auto of_ranks = gather_arrays(ranks, std::span<const std::uint64_t>(segments));
  for (std::size_t before = 0; before < r; ++before)
    for (std::size_t s = 0; s < segments.size(); ++s) plan.before[s] += of_ranks[before][s];
  return plan;
}

}  // namespace splatvol
