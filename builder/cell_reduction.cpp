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
inline vec3 direction(const dvec3& gradient) {
  const double largest = std::max({std::abs(gradient.x), std::abs(gradient.y), std::abs(gradient.z)});
  if (!(largest > 0 && std::isfinite(largest))) return vec3(0);
  const dvec3 scaled = gradient * (1 / largest);
  return vec3(scaled * (1 / std::sqrt(glm::dot(scaled, scaled))));
}

class CellReducer {
 public:
  CellReducer(const PointBatch& batch, const ReductionSettings& settings, MemberPool& pool, ReducedBatch& result)
      : batch_(batch), settings_(settings), pool_(pool), result_(result) {
    for (const format::Attribute& attribute : settings.attributes) bins_.push_back(format::bins_of(attribute));
    result_.finest.reserve(batch.size());
  }

  void run() {
    for (const PointCell& cell : batch_.cells) {
      cell_ = cell;
      const std::size_t first_point = result_.finest.size(), first_member = result_.members.size();
      OpenLeaf& leaf = result_.cells.emplace_back().leaf;
      for (std::size_t begin = cell.begin; begin < cell.end;) begin = reduce_leaf(begin, leaf);
      add_splats(std::span(result_.members).subspan(first_member), settings_.offsets);
      describe(leaf, first_point, first_member);
      result_.cells.back().members_end = result_.members.size();
    }
  }

 private:
  std::size_t attributes() const { return settings_.attributes.size(); }
  BoundaryPlane plane(std::size_t i) const { return batch_.planes.empty() ? BoundaryPlane{} : batch_.planes[i]; }
  SplatRow& splat(std::size_t i) { return leaf_splats_[i - leaf_begin_]; }

  // A leaf of the octree over the points, which lies in a leaf of the index. Returns where the next one begins.
  std::size_t reduce_leaf(std::size_t begin, OpenLeaf& leaf) {
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
    for (std::size_t i = begin; i < end; ++i) add_splat_of(i, depth, count, leaf);
    if (settings_.wants_splats) result_.splats.insert(result_.splats.end(), leaf_splats_.begin(), leaf_splats_.end());

    const std::size_t kept = settings_.reduces
                                 ? begin + nearest_to_center(settings_.cube, depth, end - begin,
                                                             [&](std::size_t k) { return batch_.positions[begin + k]; })
                                 : end;
    for (std::size_t i = begin; i < end; ++i)
      if (i != kept || cell_.continued) add_finest(i);
    if (kept != end) add_member(begin, end, kept);
    return end;
  }

  void add_splat_of(std::size_t i, int depth, std::size_t count, OpenLeaf& leaf) {
    SplatRow row = make_splat_row(batch_.positions[i], 0, batch_.moments[i], plane(i));
    if (!(row.error > 0)) row.error = spacing_at(i, depth, count) * error_per_spacing;
    row.number = batch_.first + i;
    row.depth = static_cast<std::uint8_t>(depth);
    row.count = static_cast<std::uint8_t>(count);
    leaf.splats_at(0).include(row, batch_.moments[i]);
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
    value_rows_.clear();
    for (std::size_t a = 0; a < attributes(); ++a) value_rows_.push_back(value_row(a, i));
    rows.add_splat(splat(i), value_rows_);
    rows.add_point({batch_.positions[i], splat(i).error});
    for (std::size_t a = 0; a < attributes(); ++a)
      rows.add_point_value(a, stored(a, i), direction(batch_.gradients[a][i]));
  }

  void add_member(std::size_t begin, std::size_t end, std::size_t kept) {
    Member& member = *result_.members.emplace_back(pool_.take());
    member.key = batch_.keys[kept];
    member.leaf = cell_.leaf;
    member.point = {batch_.positions[kept], splat(kept).error};
    member.splats.push_back(splat(kept));
    const auto shift = [&](std::size_t i) { return batch_.positions[i] - batch_.positions[kept]; };
    member.values.resize(attributes());
    for (std::size_t a = 0; a < attributes(); ++a) {
      MemberValue& value = member.values[a];
      value.value = stored(a, kept);
      value.gradient = direction(batch_.gradients[a][kept]);
      member.value_rows.push_back(value_row(a, kept));
      for (std::size_t i = begin; i < end; ++i) merge(value.moments, batch_.value_moments[a][i], shift(i));
    }
    for (std::size_t i = begin; i < end; ++i) merge(member.moments, batch_.moments[i], shift(i));
    if (!batch_.planes.empty()) {
      shifts_.clear();
      for (std::size_t i = begin; i < end; ++i) shifts_.push_back(shift(i));
      member.plane = merge_planes(std::span(batch_.planes).subspan(begin, end - begin), shifts_);
    }
    result_.parts.push_back(end - begin);
  }

  void describe(OpenLeaf& leaf, std::size_t first_point, std::size_t first_member) const {
    leaf.key = batch_.keys[cell_.begin];
    leaf.depth = cell_.depth;
    leaf.count(0, result_.finest.size() - first_point);
    for (std::size_t a = 0; a < attributes(); ++a) {
      const format::ValueBins& bins = bins_[a];
      format::ValueSummary summary;
      const auto include = [&](float min, float max, float value) {
        summary.include(summarize_range(min, max, bins));
        summary.include(bins.summarize(std::span(&value, 1)));
      };
      const SplatRows::SplatValues& values = result_.finest.splat_values[a];
      for (std::size_t k = first_point; k < result_.finest.size(); ++k)
        include(values.min[k], values.max[k], result_.finest.point_values[a].values[k]);
      for (std::size_t m = first_member; m < result_.members.size(); ++m) {
        const Member& member = *result_.members[m];
        include(member.value_rows[a].min, member.value_rows[a].max, member.values[a].value);
      }
      leaf.summaries.push_back(summary);
    }
  }

  const PointBatch& batch_;
  const ReductionSettings& settings_;
  MemberPool& pool_;
  std::vector<format::ValueBins> bins_;  // [attribute]
  ReducedBatch& result_;
  PointCell cell_{};            // the present one
  std::size_t leaf_begin_ = 0;  // of the present leaf
  std::vector<SplatRow> leaf_splats_;
  std::vector<ValueRow> value_rows_;  // [attribute]: of the present point
  std::vector<dvec3> shifts_;
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

void ReducedBatch::clear() {
  splats.clear();
  finest.clear();
  members.clear();
  parts.clear();
  cells.clear();
}

void reduce_cells(const PointBatch& batch, const ReductionSettings& settings, MemberPool& pool, ReducedBatch& result) {
  CellReducer(batch, settings, pool, result).run();
}

}  // namespace splatvol
