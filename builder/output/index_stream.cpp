#include "builder/output/index_stream.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "builder/sorting/octree_nodes.h"

namespace splatvol {
namespace {

// A splat may come back from the file larger than it was (format/columns.h). Its deviations grow by up to 2^(1/256).
// The end of each axis moves towards a shorter axis by up to 1/16 of the shorter one. Together this is less than 1/8 of
// the extent in any direction; or it is the resolution of a quaternion of 20 bits, if that is more. The centroid moves
// by up to 1/64 of the shortest deviation.
constexpr double stretch = 1.003;
constexpr double tilted_stretch = stretch + 1.0 / 8;
constexpr double resolved_tilt = 1e-5;

const double uniform_width = std::sqrt(12.0);  // of a uniform distribution, in standard deviations

// Box that the splat of `moments` may fill; at a boundary, with what its reflection adds.
Box splat_box(const dvec3& centroid, const SplatShape& shape, const SpatialMoments& moments) {
  const SymmetricMatrix& s = moments.covariance;
  const dvec3 shift = reflection_shift(shape);
  const dvec3 center = centroid + shift;
  const dvec3 deviations = glm::sqrt(glm::max(dvec3(s.xx, s.yy, s.zz) + shift * shift, 0.0));
  const dvec3 half = uniform_width * (tilted_stretch * deviations + resolved_tilt * shape.deviations[0]) +
                     error_per_deviation * shortest_deviation(shape);
  return {center - half, center + half};
}

// Largest distance along an axis by which `box` reaches out of `node`.
double overreach(const Box& box, const Box& node) {
  const dvec3 out = glm::max(node.low - box.low, box.high - node.high);
  return std::max({out.x, out.y, out.z});
}

// Looks the size code up in a table: logarithms and roots for each point would take longer than the rest.
std::uint8_t octant_code(int depth, std::size_t count) {
  static const auto codes = [] {
    std::array<std::array<std::uint8_t, 256>, max_morton_depth + 1> table{};
    for (int d = 0; d <= max_morton_depth; ++d)
      for (int c = 1; c < 256; ++c)
        table[static_cast<std::size_t>(d)][static_cast<std::size_t>(c)] =
            format::size_code(std::ldexp(1.0, -d) / std::cbrt(c), 1.0);
    return table;
  }();
  return codes[static_cast<std::size_t>(depth)][count];
}

std::uint8_t first_resolution(std::span<const SplatBounds> splats, int depth) {
  std::size_t first = splats.size() - 1;
  while (first > 0 && splats[first].least_depth != 255 && splats[first].least_depth >= depth) --first;
  return static_cast<std::uint8_t>(first);
}

// Only the splat that reaches furthest out of a node counts: a box round all splats is enough.
std::uint8_t moments_code(const SplatBounds& splats, const Box& node, double edge) {
  const double size = std::max(splats.width, overreach(splats.box, node) / 2);
  return size > 0 ? format::size_code(size, edge) : std::uint8_t{255};
}

IndexLeaf empty_node(const MortonKey& key, int depth, const format::NodeShape& shape) {
  return {key, depth, std::vector<std::uint64_t>(shape.resolutions), std::vector<SplatBounds>(shape.resolutions),
          std::vector<format::ValueSummary>(shape.attributes)};
}

void merge_child(IndexLeaf& parent, const IndexLeaf& child) {
  for (std::size_t r = 0; r < parent.counts.size(); ++r) {
    parent.counts[r] += child.counts[r];
    parent.splats[r].include(child.splats[r]);
  }
  for (std::size_t a = 0; a < parent.summaries.size(); ++a) parent.summaries[a].include(child.summaries[a]);
}

}  // namespace

void SplatBounds::include(const dvec3& centroid, const SplatShape& shape, const SpatialMoments& moments, int depth,
                          std::size_t count) {
  least_depth = std::min(least_depth, static_cast<std::uint8_t>(depth));
  octant_code = std::min(octant_code, splatvol::octant_code(depth, count));
  if (!(moments.mass > 0)) return;
  width = std::max(width, uniform_width * stretch * shape.deviations[0]);
  box.include(splat_box(centroid, shape, moments));
}

void SplatBounds::include(const SplatBounds& other) {
  least_depth = std::min(least_depth, other.least_depth);
  octant_code = std::min(octant_code, other.octant_code);
  width = std::max(width, other.width);
  box.include(other.box);
}

Status IndexStream::add(IndexLeaf leaf) {
  if (leaf.depth < 0 || leaf.depth > max_morton_depth || leaf.counts.size() != shape_.resolutions ||
      leaf.splats.size() != shape_.resolutions || leaf.summaries.size() != shape_.attributes)
    return fail(ErrorCode::invalid_argument, "index: a leaf of another shape");
  int shared_depth = -1;
  if (!open_.empty()) {
    const IndexLeaf& last = open_.back();
    shared_depth = common_depth(last.key, leaf.key);
    if (leaf.key < last.key || shared_depth >= std::min(last.depth, leaf.depth))
      return fail(ErrorCode::invalid_argument, "index: leaves out of order");
  }
  while (std::ssize(open_) > shared_depth + 1) SPLATVOL_TRY(close_node());
  for (int depth = shared_depth + 1; depth <= leaf.depth; ++depth) {
    SPLATVOL_TRY(packer_.begin_node(depth == 0 ? 0 : octant_at(leaf.key, depth - 1)));
    if (depth < leaf.depth) open_.push_back(empty_node(leaf.key, depth, shape_));
  }
  open_.push_back(std::move(leaf));
  return {};
}

Result<format::PackedIndexPage> IndexStream::finish() {
  while (!open_.empty()) SPLATVOL_TRY(close_node());
  return packer_.finish();
}

Status IndexStream::close_node() {
  IndexLeaf node = std::move(open_.back());
  open_.pop_back();
  if (!open_.empty()) merge_child(open_.back(), node);
  const Box box = node_box(node.key, cube_, node.depth);
  std::vector<std::uint8_t> size_codes;
  for (const SplatBounds& splats : node.splats) size_codes.push_back(splats.octant_code);
  for (const SplatBounds& splats : node.splats) size_codes.push_back(moments_code(splats, box, cube_.edge));
  return packer_.end_node({first_resolution(node.splats, node.depth), std::move(node.counts), std::move(size_codes),
                           std::move(node.summaries)});
}

}  // namespace splatvol
