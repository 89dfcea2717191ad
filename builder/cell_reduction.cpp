#include "builder/cell_reduction.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace splatvol {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

// A deviation is about a quarter of the spacing of points.
constexpr double error_per_spacing = error_per_deviation / 4;

// Unit vector; 0 for 0.
vec3 direction(const dvec3& gradient) {
  const double largest = std::max({std::abs(gradient.x), std::abs(gradient.y), std::abs(gradient.z)});
  return largest > 0 && std::isfinite(largest) ? vec3(glm::normalize(gradient / largest)) : vec3(0);
}

class CellReducer {
 public:
  CellReducer(const PointBatch& batch, const PointCell& cell, const ReductionSettings& settings)
      : batch_(batch), cell_(cell), settings_(settings), result_{{}, SplatRows(attributes()), {}, {}, {}} {}

  ReducedCell run() && {
    reserve();
    for (std::size_t begin = cell_.begin; begin < cell_.end;) begin = reduce_leaf(begin);
    describe_leaf();
    return std::move(result_);
  }

 private:
  std::size_t attributes() const { return settings_.attributes.size(); }
  BoundaryPlane plane(std::size_t i) const { return batch_.planes.empty() ? BoundaryPlane{} : batch_.planes[i]; }
  SplatRow& splat(std::size_t i) { return leaf_splats_[i - leaf_begin_]; }

  void reserve() {
    const std::size_t count = cell_.end - cell_.begin;
    SplatRows& rows = result_.finest;
    if (settings_.wants_splats) result_.splats.reserve(count);
    rows.splats.reserve(count);
    rows.points.reserve(count);
    for (std::size_t a = 0; a < attributes(); ++a) {
      rows.value_rows[a].reserve(count);
      rows.values[a].reserve(count);
      rows.gradients[a].reserve(count);
    }
  }

  // Returns where the next one begins.
  std::size_t reduce_leaf(std::size_t begin) {
    const std::vector<MortonKey>& keys = batch_.keys;
    const std::size_t n = settings_.leaf_points;
    const int shared = begin == cell_.begin ? cell_.depth - 1 : common_depth(keys[begin - 1], keys[begin]);
    const int depth = leaf_depth(shared, keys[begin], begin + n < cell_.end ? &keys[begin + n] : nullptr);
    std::size_t end = begin + 1;
    while (end < cell_.end && common_depth(keys[begin], keys[end]) >= depth) ++end;

    // A part of a cell that is not whole has more points than can be counted.
    const std::size_t count = std::min<std::size_t>(cell_.continued ? 255 : end - begin, 255);
    leaf_begin_ = begin;
    leaf_splats_.clear();
    for (std::size_t i = begin; i < end; ++i) add_splat_of(i, depth, count);
    if (settings_.wants_splats) result_.splats.insert(result_.splats.end(), leaf_splats_.begin(), leaf_splats_.end());

    const std::size_t kept = settings_.reduces
                                 ? begin + nearest_to_center(settings_.cube, depth, end - begin,
                                                             [&](std::size_t k) { return batch_.positions[begin + k]; })
                                 : end;
    for (std::size_t i = begin; i < end; ++i)
      if (i != kept) add_finest(i);
    if (kept != end) add_member(begin, end, kept);
    return end;
  }

  void add_splat_of(std::size_t i, int depth, std::size_t count) {
    SplatRow row = make_splat_row(batch_.positions[i], 0, batch_.moments[i], plane(i));
    if (!(row.error > 0)) row.error = spacing_at(i, depth, count) * error_per_spacing;
    row.number = batch_.first + i;
    row.depth = static_cast<std::uint8_t>(depth);
    row.count = static_cast<std::uint8_t>(count);
    result_.leaf.splats_at(0).include(row, batch_.moments[i]);
    leaf_splats_.push_back(row);
  }

  // Of the nearest neighbours in Morton order. Coincident points set no bound.
  double spacing_at(std::size_t i, int depth, std::size_t count) const {
    const auto distance = [&](const dvec3& other) {
      const double length = glm::length(batch_.positions[i] - other);
      return length > 0 ? length : infinity;
    };
    double spacing = std::ldexp(settings_.cube.edge, -depth) / std::cbrt(count);
    if (i > 0)
      spacing = std::min(spacing, distance(batch_.positions[i - 1]));
    else if (batch_.before)
      spacing = std::min(spacing, distance(*batch_.before));
    if (i + 1 < batch_.size())
      spacing = std::min(spacing, distance(batch_.positions[i + 1]));
    else if (batch_.behind)
      spacing = std::min(spacing, distance(*batch_.behind));
    return spacing;
  }

  float stored(std::size_t attribute, std::size_t i) const {
    return static_cast<float>(batch_.values[attribute][i] - settings_.attributes[attribute].offset);
  }
  ValueRow value_row(std::size_t attribute, std::size_t i) {
    return make_value_row(batch_.value_moments[attribute][i], splat(i).shape, settings_.attributes[attribute].offset);
  }

  void add_finest(std::size_t i) {
    SplatRows& rows = result_.finest;
    rows.splats.push_back(splat(i));
    rows.points.push_back({batch_.positions[i], splat(i).error});
    for (std::size_t a = 0; a < attributes(); ++a) {
      rows.value_rows[a].push_back(value_row(a, i));
      rows.values[a].push_back(stored(a, i));
      rows.gradients[a].push_back(direction(batch_.gradients[a][i]));
    }
  }

  void add_member(std::size_t begin, std::size_t end, std::size_t kept) {
    Member member;
    member.key = batch_.keys[kept];
    member.leaf = cell_.leaf;
    member.point = {batch_.positions[kept], splat(kept).error};
    member.splats.reserve(2);
    member.splats.push_back(splat(kept));
    const auto shift = [&](std::size_t i) { return batch_.positions[i] - batch_.positions[kept]; };
    member.values.resize(attributes());
    member.value_rows.reserve(2 * attributes());
    for (std::size_t a = 0; a < attributes(); ++a) {
      MemberValue& value = member.values[a];
      value.value = stored(a, kept);
      value.gradient = direction(batch_.gradients[a][kept]);
      member.value_rows.push_back(value_row(a, kept));
      for (std::size_t i = begin; i < end; ++i) merge(value.moments, batch_.value_moments[a][i], shift(i));
    }
    for (std::size_t i = begin; i < end; ++i) merge(member.moments, batch_.moments[i], shift(i));
    if (!batch_.planes.empty()) {
      std::vector<dvec3> shifts;
      for (std::size_t i = begin; i < end; ++i) shifts.push_back(shift(i));
      member.plane = merge_planes(std::span(batch_.planes).subspan(begin, end - begin), shifts);
    }
    add_splat(member, settings_.offsets);
    result_.members.push_back(std::move(member));
    result_.parts.push_back(end - begin);
  }

  void describe_leaf() {
    OpenLeaf& leaf = result_.leaf;
    leaf.key = batch_.keys[cell_.begin];
    leaf.depth = cell_.depth;
    leaf.count(0, result_.finest.size());
    for (std::size_t a = 0; a < attributes(); ++a) {
      const format::ValueBins bins = format::bins_of(settings_.attributes[a]);
      format::ValueSummary summary;
      const auto include = [&](const ValueRow& row, float value) {
        summary.include(summarize_range(row.min, row.max, bins));
        summary.include(bins.summarize(std::span(&value, 1)));
      };
      for (std::size_t k = 0; k < result_.finest.size(); ++k)
        include(result_.finest.value_rows[a][k], result_.finest.values[a][k]);
      for (const Member& member : result_.members) include(member.value_rows[a], member.values[a].value);
      leaf.summaries.push_back(summary);
    }
  }

  const PointBatch& batch_;
  const PointCell& cell_;
  const ReductionSettings& settings_;
  ReducedCell result_;
  std::size_t leaf_begin_ = 0;  // of the present leaf
  std::vector<SplatRow> leaf_splats_;
};

}  // namespace

SplatBounds& OpenLeaf::splats_at(std::size_t step) {
  if (splats.size() <= step) splats.resize(step + 1);
  return splats[step];
}

void OpenLeaf::count(std::size_t step, std::uint64_t points) {
  if (counts.size() <= step) counts.resize(step + 1);
  counts[step] += points;
}

void OpenLeaf::include_late(const OpenLeaf& other) {
  for (std::size_t s = 0; s < other.counts.size(); ++s) count(s, other.counts[s]);
  for (std::size_t s = 0; s < other.splats.size(); ++s) splats_at(s).include(other.splats[s]);
}

void OpenLeaf::include(const OpenLeaf& other) {
  include_late(other);
  for (std::size_t a = 0; a < summaries.size(); ++a) summaries[a].include(other.summaries[a]);
}

ReducedCell reduce_cell(const PointBatch& batch, const PointCell& cell, const ReductionSettings& settings) {
  return CellReducer(batch, cell, settings).run();
}

}  // namespace splatvol
