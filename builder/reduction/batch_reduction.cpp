#include "builder/reduction/batch_reduction.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <ranges>
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
  const double factor = 1 / std::sqrt(glm::dot(scaled, scaled));
  return {scaled.x * factor, scaled.y * factor, scaled.z * factor};
}

class BatchReducer {
 public:
  BatchReducer(const PointBatch& batch, const ReductionSettings& settings, MemberPool& pool, ReducedBatch& result)
      : batch_(batch), settings_(settings), pool_(pool), result_(result) {
    for (const format::Attribute& attribute : settings.attributes) bins_.push_back(format::bins_of(attribute));
    result_.tail.reserve(settings.pack ? settings.points_per_chunk : batch.size());
    clusters_.assign(result.owners);
  }

  void run() {
    if (settings_.reduces) pool_.take(most_members(), spare_);
    for (const NodePart& cell : batch_.cells) {
      cell_ = cell;
      const std::size_t first_member = result_.members.size();
      OpenIndexLeaf& leaf = result_.cells.emplace_back().leaf;
      leaf.key = batch_.keys[cell.begin];
      leaf.depth = cell.depth;
      leaf.summaries.resize(attributes());
      while (leaf_begin_ < cell.end) reduce_leaf(leaf);
      add_splats(std::span(result_.members).subspan(first_member), settings_.offsets);
      include_members(leaf, first_member);
      result_.cells.back().members_end = result_.members.size();
    }
    if (!settings_.pack) std::swap(result_.finest, result_.tail);
    pool_.give_back(spare_);
  }

 private:
  std::size_t attributes() const { return settings_.attributes.size(); }
  double offset(std::size_t attribute) const { return settings_.attributes[attribute].offset; }
  BoundaryPlane plane(std::size_t i) const { return batch_.planes.empty() ? BoundaryPlane{} : batch_.planes[i]; }
  // The next leaf of the octree over the points, which lies in a leaf of the index.
  void reduce_leaf(OpenIndexLeaf& leaf) {
    const auto [end, depth] = result_.leaves[leaf_++];
    const std::size_t begin = leaf_begin_;

    // A part of a cell that is not whole has more points than can be counted.
    depth_ = depth;
    count_ = std::min<std::size_t>(cell_.continued ? 255 : end - begin, 255);
    leaf_begin_ = end;
    if (!result_.owners.empty()) return add_leaf(begin, end, leaf);
    const std::size_t kept = settings_.reduces
                                 ? begin + nearest_to_center(settings_.cube, depth, end - begin,
                                                             [&](std::size_t k) { return batch_.positions[begin + k]; })
                                 : end;
    for (std::size_t i = begin; i < end; ++i) {
      if (i != kept || cell_.continued) add_finest(i, leaf);
      if (i == kept) add_member(std::views::iota(begin, end), kept, leaf);
    }
  }

  // The same where its points belong to clusters of their own.
  void add_leaf(std::size_t begin, std::size_t end, OpenIndexLeaf& leaf) {
    for (std::size_t i = begin; i < end; ++i) {
      const bool stays = result_.owners[i] == i;
      if (!stays || cell_.continued) add_finest(i, leaf);
      if (stays) add_member(clusters_.of(i), i, leaf);
    }
  }

  // A splat's centroid may move by so much, and its point.
  double error_of(std::size_t i, const format::SplatShape& shape) const {
    const double shortest = shortest_deviation(shape);
    return shortest > 0 ? shortest * error_per_deviation : spacing_at(i) * error_per_spacing;
  }

  // Of the nearest neighbours in Morton order. Coincident points set no bound.
  double spacing_at(std::size_t i) const {
    const auto distance = [&](const dvec3& other) {
      const double length = glm::length(batch_.positions[i] - other);
      return length > 0 ? length : infinity;
    };
    double spacing = node_edge(settings_.cube, depth_) / std::cbrt(count_);
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
    return static_cast<float>(batch_.values[attribute][i] - offset(attribute));
  }

  // All is made where it stays: the processor would wait before it copies what was just written.
  void add_finest(std::size_t i, OpenIndexLeaf& leaf) {
    SplatRows& rows = result_.tail;
    const SpatialMoments& moments = batch_.moments[i];
    const dvec3& position = batch_.positions[i];
    format::SplatShape& shape = rows.splats.shapes.emplace_back(InPlace{[&] { return shape_of(moments); }});
    if (!batch_.planes.empty()) shape.boundary = boundary_foot(batch_.planes[i], moments, shape);
    const dvec3& centroid = rows.splats.centroids.emplace_back(position + moments.centroid);
    const double error = error_of(i, shape);
    rows.splats.errors.push_back(error);
    rows.splats.numbers.push_back(batch_.first + i);
    rows.splats.depths.push_back(static_cast<std::uint8_t>(depth_));
    rows.splats.counts.push_back(static_cast<std::uint8_t>(count_));
    rows.points.positions.push_back(position);
    rows.points.errors.push_back(error);
    for (std::size_t a = 0; a < attributes(); ++a) {
      const ValueMoments& material = batch_.value_moments[a][i];
      rows.splat_values[a].moments.emplace_back(InPlace{[&] { return stored_value(material, shape, offset(a)); }});
      const auto [low, high] = stored_range(material, offset(a));
      const float value = stored(a, i);
      rows.splat_values[a].min.push_back(low);
      rows.splat_values[a].max.push_back(high);
      rows.point_values[a].values.push_back(value);
      rows.point_values[a].gradients.push_back(direction(batch_.gradients[a][i]));
      count(a, value);
      include(leaf, a, low, high, value);
    }
    leaf.count(0);
    leaf.splats_at(0).include(centroid, shape, moments, depth_, count_);
    ++finest_;
    if (settings_.wants_splats)
      result_.splats.push_back(
          {centroid, error, shape, batch_.first + i, rows.splats.depths.back(), rows.splats.counts.back()});
    if (settings_.pack && (result_.first_finest + finest_) % settings_.points_per_chunk == 0) close_chunk();
  }

  void close_chunk() {
    if (result_.tail.size() < settings_.points_per_chunk)
      std::swap(result_.finest, result_.tail);
    else
      result_.packed.push_back(settings_.pack(result_.tail));
    result_.tail.clear();
  }

  void count(std::size_t attribute, float value) {
    if (std::isnan(value))
      ++result_.missing[attribute];
    else
      ++result_.histograms[attribute][static_cast<std::size_t>(bins_[attribute].bin(double{value}))];
  }

  void include(OpenIndexLeaf& leaf, std::size_t attribute, float low, float high, float value) const {
    leaf.summaries[attribute].include(summarize_range(low, high, bins_[attribute]));
    leaf.summaries[attribute].include(bins_[attribute].summarize(std::span(&value, 1)));
  }

  void include_members(OpenIndexLeaf& leaf, std::size_t first) {
    for (std::size_t m = first; m < result_.members.size(); ++m) {
      const Member& member = *result_.members[m];
      for (std::size_t a = 0; a < attributes(); ++a) {
        // Of a cell that is continued, all points have been counted.
        if (!cell_.continued) count(a, member.values[a].value);
        include(leaf, a, member.value_rows[a].min, member.value_rows[a].max, member.values[a].value);
      }
    }
  }

  std::size_t most_members() const {
    const std::vector<std::uint32_t>& owners = result_.owners;
    if (owners.empty()) return result_.leaves.size();
    std::size_t stay = 0;
    for (std::size_t i = 0; i < owners.size(); ++i) stay += owners[i] == i;
    return stay;
  }

  Member& next_member() {
    const std::size_t left = spare_.size();
    if (left > 2) spare_[left - 3]->prefetch_vectors();
    if (left > 6) spare_[left - 7]->prefetch();
    MemberPool::Handle& member = result_.members.emplace_back(std::move(spare_.back()));
    spare_.pop_back();
    return *member;
  }

  template <class Cluster>
  void add_member(const Cluster& cluster, std::size_t kept, OpenIndexLeaf& leaf) {
    Member& member = next_member();
    member.key = batch_.keys[kept];
    member.leaf = cell_.leaf;
    SplatRow& splat = member.splats.emplace_back(
        InPlace{[&] { return make_splat_row(batch_.positions[kept], 0, batch_.moments[kept], plane(kept)); }});
    splat.error = error_of(kept, splat.shape);
    splat.number = batch_.first + kept;
    splat.depth = static_cast<std::uint8_t>(depth_);
    splat.count = static_cast<std::uint8_t>(count_);
    member.point = {batch_.positions[kept], splat.error};
    // Of a cell that is continued, all points are finest ones as well.
    if (!cell_.continued) leaf.splats_at(0).include(splat, batch_.moments[kept]);
    if (!cell_.continued && settings_.wants_splats) result_.splats.push_back(splat);
    const auto shift = [&](std::size_t i) { return batch_.positions[i] - batch_.positions[kept]; };
    member.values.resize(attributes());
    for (std::size_t a = 0; a < attributes(); ++a) {
      MemberValue& value = member.values[a];
      value.value = stored(a, kept);
      value.gradient = direction(batch_.gradients[a][kept]);
      member.value_rows.emplace_back(
          InPlace{[&] { return make_value_row(batch_.value_moments[a][kept], splat.shape, offset(a)); }});
      for (const std::size_t i : cluster) merge(value.moments, batch_.value_moments[a][i], shift(i));
    }
    for (const std::size_t i : cluster) merge(member.moments, batch_.moments[i], shift(i));
    if (!batch_.planes.empty()) {
      planes_.clear();
      shifts_.clear();
      for (const std::size_t i : cluster) {
        planes_.push_back(batch_.planes[i]);
        shifts_.push_back(shift(i));
      }
      member.plane = merge_planes(planes_, shifts_);
    }
  }

  const PointBatch& batch_;
  const ReductionSettings& settings_;
  MemberPool& pool_;
  std::vector<format::ValueBins> bins_;  // [attribute]
  ReducedBatch& result_;
  NodePart cell_{};                        // the present one
  std::size_t leaf_ = 0;                   // the next one of the octree over the points
  std::size_t leaf_begin_ = 0;             // its first point
  std::uint64_t finest_ = 0;               // points that no coarser resolution has, so far
  int depth_ = 0;                          // its own
  std::size_t count_ = 0;                  // its points, at most 255
  Clusters clusters_;                      // where there are owners
  std::vector<MemberPool::Handle> spare_;  // members to come
  std::vector<BoundaryPlane> planes_;
  std::vector<dvec3> shifts_;
};

// The clusters of each block of a batch; numbers are those of its points.
void find_owners(const PointBatch& batch, const ReductionSettings& settings, std::vector<std::uint32_t>& owners) {
  struct Block {
    std::size_t begin, size;
  };
  std::vector<Block> blocks;
  const auto key = [&](std::size_t i) -> const MortonKey& { return batch.keys[i]; };
  for (const NodePart& cell : batch.cells)
    for_each_leaf(key, cell.begin, cell.end, cell.depth, most_in_reduction_node(settings.method, settings.leaf_points),
                  [&](std::size_t begin, std::size_t end, int) {
                    blocks.push_back({begin, end - begin});
                  });
  owners.resize(batch.size());
  tbb::parallel_for(std::size_t{0}, blocks.size(), [&](std::size_t b) {
    const auto [begin, size] = blocks[b];
    const auto found = std::span(owners).subspan(begin, size);
    find_clusters(settings.method, settings.leaf_points, std::span(batch.keys).subspan(begin, size),
                  std::span(batch.positions).subspan(begin, size), found);
    for (std::uint32_t& owner : found) owner += static_cast<std::uint32_t>(begin);
  });
}

}  // namespace

void ReducedBatch::clear() {
  leaves.clear();
  owners.clear();
  splats.clear();
  finest.clear();
  packed.clear();
  tail.clear();
  members.clear();
  cells.clear();
  for (auto& histogram : histograms) histogram.fill(0);
  std::ranges::fill(missing, 0);
}

std::uint64_t find_leaves(const PointBatch& batch, const ReductionSettings& settings, ReducedBatch& result) {
  const auto key = [&](std::size_t i) -> const MortonKey& { return batch.keys[i]; };
  const bool owned = settings.reduces && settings.method != Reduction::octree;
  if (owned) find_owners(batch, settings, result.owners);
  std::uint64_t finest = 0;
  for (const NodePart& cell : batch.cells) {
    const std::size_t first = result.leaves.size();
    for_each_leaf(key, cell.begin, cell.end, cell.depth, settings.leaf_points,
                  [&](std::size_t, std::size_t end, int depth) {
                    result.leaves.push_back({end, depth});
                  });
    finest += cell.end - cell.begin;
    if (!settings.reduces || cell.continued) continue;
    if (!owned) finest -= result.leaves.size() - first;
    for (std::size_t i = cell.begin; owned && i < cell.end; ++i) finest -= result.owners[i] == i;
  }
  return finest;
}

void reduce_batch(const PointBatch& batch, const ReductionSettings& settings, MemberPool& pool, ReducedBatch& result) {
  BatchReducer(batch, settings, pool, result).run();
}

}  // namespace splatvol
