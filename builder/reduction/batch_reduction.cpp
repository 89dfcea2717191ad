#include "builder/reduction/batch_reduction.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <ranges>
#include <utility>

#include "builder/mesh/heights.h"
#include "builder/sorting/octree_nodes.h"

namespace splatvol {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

// A splat's deviation is about a quarter of the spacing of points.
constexpr double error_per_spacing = error_per_deviation / 4;

// Returns a unit vector; 0 if the gradient is 0 or not finite.
inline vec3 direction(const dvec3& gradient) {
  const double largest = std::max({std::abs(gradient.x), std::abs(gradient.y), std::abs(gradient.z)});
  if (!(largest > 0 && std::isfinite(largest))) return vec3(0);
  const dvec3 scaled = gradient * (1 / largest);
  const double factor = 1 / std::sqrt(glm::dot(scaled, scaled));
  return {scaled.x * factor, scaled.y * factor, scaled.z * factor};
}

class BatchReducer {
 public:
  BatchReducer(const PointBatch& batch, const ReductionSettings& settings, ReducedBatch& result)
      : batch_(batch), settings_(settings), result_(result) {
    for (const format::Attribute& attribute : settings.attributes) bins_.push_back(format::bins_of(attribute));
    result_.tail.reserve(settings.packer ? std::min(settings.points_per_chunk, batch.size()) : batch.size());
    clusters_.assign(result.owners);
  }

  void run() {
    for (const NodePart& part : batch_.leaf_parts) {
      part_ = part;
      const std::size_t first_member = result_.members.size();
      OpenIndexLeaf& leaf = result_.leaf_parts.emplace_back().leaf;
      leaf.key = batch_.keys[part.begin];
      leaf.depth = part.depth;
      leaf.summaries.resize(attributes());
      while (leaf_begin_ < part.end) reduce_leaf(leaf);
      result_.members.add_splats(first_member, settings_.attributes);
      include_members(leaf, first_member);
      result_.leaf_parts.back().members_end = result_.members.size();
    }
  }

 private:
  std::size_t attributes() const { return settings_.attributes.size(); }
  const format::Attribute& attribute(std::size_t a) const { return settings_.attributes[a]; }
  BoundaryPlane plane(std::size_t i) const { return batch_.planes.empty() ? BoundaryPlane{} : batch_.planes[i]; }

  // Makes the shapes of several points at a time: points come in their order.
  const SplatShape& shape(std::size_t i) {
    const std::size_t begin = i / shapes_at_once * shapes_at_once;
    if (begin != shapes_begin_) {
      shapes_begin_ = begin;
      std::array<const SpatialMoments*, shapes_at_once> moments{};
      const std::size_t count = std::min(shapes_at_once, batch_.size() - begin);
      for (std::size_t k = 0; k < count; ++k) moments[k] = &batch_.moments[begin + k];
      find_shapes(std::span(moments).first(count), shapes_);
    }
    return shapes_[i % shapes_at_once];
  }

  // Reduces the next leaf of the octree over the points, which lies in an index leaf.
  void reduce_leaf(OpenIndexLeaf& leaf) {
    const auto [end, depth] = result_.leaves[leaf_++];
    const std::size_t begin = leaf_begin_;
    depth_ = depth;
    count_ = std::min<std::size_t>(part_.continued ? 255 : end - begin, 255);  // a leaf in parts has more points
    leaf_begin_ = end;
    if (!result_.owners.empty()) return add_clusters(begin, end, leaf);
    const std::size_t kept = settings_.reduces
                                 ? begin + nearest_to_center(settings_.cube, depth, end - begin,
                                                             [&](std::size_t k) { return batch_.positions[begin + k]; })
                                 : end;
    for (std::size_t i = begin; i < end; ++i) {
      if (i != kept || part_.continued) add_finest(i, leaf);
      if (i == kept) add_member(std::views::iota(begin, end), kept, leaf);
    }
  }

  // Adds the points of a leaf, and the clusters of those that stay.
  void add_clusters(std::size_t begin, std::size_t end, OpenIndexLeaf& leaf) {
    for (std::size_t i = begin; i < end; ++i) {
      const bool stays = result_.owners[i] == i;
      if (!stays || part_.continued) add_finest(i, leaf);
      if (stays) add_member(clusters_.of(i), i, leaf);
    }
  }

  // How far the file may move a splat's centroid.
  double error_of(std::size_t i, const SplatShape& shape) const {
    const double shortest = shortest_deviation(shape);
    return shortest > 0 ? shortest * error_per_deviation : spacing_at(i) * error_per_spacing;
  }

  // How far the file may move the splat's point, which is a corner of cells.
  double point_error(std::size_t i, double splat_error) const {
    return batch_.heights.empty() ? splat_error : std::min(splat_error, batch_.heights[i] * error_per_height);
  }

  // Distance to the nearer neighbour in Morton order, or the mean spacing in the leaf if that is less. Coincident
  // points do not count.
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

  float stored(std::size_t a, std::size_t i) const {
    return static_cast<float>(attribute(a).stored(batch_.values[a][i]));
  }

  // Makes each element in its final memory: the processor would have to wait before it copies what it just wrote.
  void add_finest(std::size_t i, OpenIndexLeaf& leaf) {
    SplatColumns& columns = result_.tail;
    const SpatialMoments& moments = batch_.moments[i];
    const dvec3& position = batch_.positions[i];
    SplatShape& own = columns.splats.shapes.emplace_back(shape(i));
    if (!batch_.planes.empty()) own.boundary = boundary_foot(batch_.planes[i], moments, own);
    const dvec3& centroid = columns.splats.centroids.emplace_back(position + moments.centroid);
    const double error = error_of(i, own);
    columns.splats.least_error = std::min(columns.splats.least_error, error);
    columns.splats.depths.push_back(static_cast<std::uint8_t>(depth_));
    columns.splats.counts.push_back(static_cast<std::uint8_t>(count_));
    columns.add_point({position, point_error(i, error)});
    for (std::size_t a = 0; a < attributes(); ++a) {
      const ValueMoments& material = batch_.value_moments[a][i];
      const StoredValue& splat =
          columns.splat_values[a].emplace_back(MadeBy{[&] { return make_stored_value(material, own, attribute(a)); }});
      const float value = stored(a, i);
      columns.add_point_value(a, value);
      if (!batch_.gradients[a].empty()) columns.add_gradient(a, direction(batch_.gradients[a][i]));
      include(leaf, a, splat.min, splat.max, value);
    }
    leaf.count(0);
    leaf.splats_at(0).include(centroid, own, moments, depth_, count_);
    ++finest_;
    if (settings_.packer && (result_.first_finest + finest_) % settings_.points_per_chunk == 0) close_row();
  }

  // A row that began in an earlier batch is packed later.
  void close_row() {
    if (result_.tail.size() < settings_.points_per_chunk)
      std::swap(result_.finest, result_.tail);
    else
      result_.packed.push_back(settings_.packer->pack(result_.tail));
    result_.tail.clear();
  }

  void include(OpenIndexLeaf& leaf, std::size_t attribute, float low, float high, float value) const {
    leaf.summaries[attribute].include(summarize_range(low, high, bins_[attribute]));
    leaf.summaries[attribute].include(bins_[attribute].summarize(std::span(&value, 1)));
  }

  void include_members(OpenIndexLeaf& leaf, std::size_t first) {
    for (std::size_t m = first; m < result_.members.size(); ++m) {
      const Member& member = result_.members[m];
      for (std::size_t a = 0; a < attributes(); ++a) {
        const StoredValue& splat = member.stored_values(0)[a];
        include(leaf, a, splat.min, splat.max, member.values()[a].value);
      }
    }
  }

  template <class Cluster>
  void add_member(const Cluster& cluster, std::size_t kept, OpenIndexLeaf& leaf) {
    Member& member = result_.members.add();
    member.key = batch_.keys[kept];
    member.leaf = part_.leaf;
    member.number = batch_.first + kept;
    StoredSplat& splat = *std::construct_at(&member.splat(0), MadeBy{[&] {
      return make_stored_splat(batch_.positions[kept], 0, batch_.moments[kept], shape(kept), plane(kept));
    }});
    splat.error = error_of(kept, splat.shape);
    splat.depth = static_cast<std::uint8_t>(depth_);
    splat.count = static_cast<std::uint8_t>(count_);
    member.point = {batch_.positions[kept], point_error(kept, splat.error)};
    // The points of a part that is continued are all finest, and have been added.
    if (!part_.continued) leaf.splats_at(0).include(splat, batch_.moments[kept]);
    const auto shift = [&](std::size_t i) { return batch_.positions[i] - batch_.positions[kept]; };
    for (std::size_t a = 0; a < attributes(); ++a) {
      MemberValue& value = member.values()[a];
      value.value = stored(a, kept);
      if (!batch_.gradients[a].empty()) value.gradient = direction(batch_.gradients[a][kept]);
      std::construct_at(&member.stored_values(0)[a], MadeBy{[&] {
        return make_stored_value(batch_.value_moments[a][kept], splat.shape, attribute(a));
      }});
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
  std::vector<format::ValueBins> bins_;  // [attribute]
  ReducedBatch& result_;
  NodePart part_{};             // the present leaf part
  std::size_t leaf_ = 0;        // the next leaf of the octree over the points
  std::size_t leaf_begin_ = 0;  // its first point
  std::uint64_t finest_ = 0;    // finest points so far
  int depth_ = 0;               // of the present leaf
  std::size_t count_ = 0;       // points in the present leaf, at most 255
  Clusters clusters_;           // empty if there are no owners
  std::array<SplatShape, shapes_at_once> shapes_;
  std::size_t shapes_begin_ = std::numeric_limits<std::size_t>::max();  // the first point of these
  std::vector<BoundaryPlane> planes_;                                   // of a member's points
  std::vector<dvec3> shifts_;                                           // of these from the member
};

// Finds the clusters of each reduction node of a batch. Owners are numbered through the batch.
void find_owners(const PointBatch& batch, const ReductionSettings& settings, std::vector<std::uint32_t>& owners) {
  struct Node {
    std::size_t begin, size;
  };
  std::vector<Node> nodes;
  const auto key = [&](std::size_t i) -> const MortonKey& { return batch.keys[i]; };
  const std::uint64_t most = most_in_reduction_node(settings.method, settings.leaf_points);
  for (const NodePart& part : batch.leaf_parts)
    for_each_leaf(key, part.begin, part.end, part.depth, most, [&](std::size_t begin, std::size_t end, int) {
      nodes.push_back({begin, end - begin});
    });
  owners.resize(batch.size());
  tbb::parallel_for(std::size_t{0}, nodes.size(), [&](std::size_t n) {
    const auto [begin, size] = nodes[n];
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
  finest.clear();
  packed.clear();
  tail.clear();
  members.clear();
  leaf_parts.clear();
}

std::uint64_t find_leaves(const PointBatch& batch, const ReductionSettings& settings, ReducedBatch& result) {
  const auto key = [&](std::size_t i) -> const MortonKey& { return batch.keys[i]; };
  const bool owned = settings.reduces && settings.method != Reduction::octree;
  if (owned) find_owners(batch, settings, result.owners);
  std::uint64_t finest = 0;
  for (const NodePart& part : batch.leaf_parts) {
    const std::size_t first = result.leaves.size();
    for_each_leaf(key, part.begin, part.end, part.depth, settings.leaf_points,
                  [&](std::size_t, std::size_t end, int depth) {
                    result.leaves.push_back({end, depth});
                  });
    finest += part.end - part.begin;
    if (!settings.reduces || part.continued) continue;
    if (!owned) finest -= result.leaves.size() - first;
    for (std::size_t i = part.begin; owned && i < part.end; ++i) finest -= result.owners[i] == i;
  }
  return finest;
}

void reduce_batch(const PointBatch& batch, const ReductionSettings& settings, ReducedBatch& result) {
  BatchReducer(batch, settings, result).run();
}

}  // namespace splatvol
