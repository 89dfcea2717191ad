#include "builder/index_builder.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace splatvol {
namespace {

constexpr std::size_t size_bounds = 2, octant_bound = 0, moments_bound = 1;

// How much larger than exact a splat may come back from the file (format/columns.h): its deviations by 2^(1/256); the
// end of each axis moves towards a shorter one by 1/16 of that one, which adds up to less than 1/8 of the extent in any
// direction, or by what a quaternion of 20 bits resolves; its centroid by 1/64 of the shortest deviation.
constexpr double stretch = 1.003;
constexpr double tilted_stretch = stretch + 1.0 / 8;
constexpr double resolved_tilt = 1e-5;
constexpr double centroid_error = 1.0 / 64;

const double uniform_width = std::sqrt(12.0);  // of a uniform distribution, in standard deviations

struct Box {
  dvec3 low, high;
};

Box cell_box(const dvec3& position, const Cube& cube, int depth) {
  const dvec3 center = cell_center(position, cube, depth);
  const double half = std::ldexp(cube.edge, -depth - 1);
  return {center - half, center + half};
}

// What the splat `moments` may fill; at a boundary, with what its reflection adds.
Box splat_box(const dvec3& position, const Material& material, std::size_t member) {
  const SpatialMoments& moments = material.moments[member];
  const Extent& extent = material.extents[member];
  const SymmetricMatrix& s = moments.covariance;
  dvec3 shift(0);
  if (!material.planes.empty() && material.planes[member].area != dvec3(0)) {
    const format::SplatShape shape = material.shape(member);
    shift = glm::mat3_cast(shape.orientation) * (shape.boundary * shape.deviations);
  }
  const dvec3 center = position + moments.centroid + shift;
  const dvec3 deviations = glm::sqrt(glm::max(dvec3(s.xx, s.yy, s.zz) + shift * shift, 0.0));
  const dvec3 half =
      uniform_width * (tilted_stretch * deviations + resolved_tilt * extent.longest) + centroid_error * extent.shortest;
  return {center - half, center + half};
}

// Largest distance along an axis by which `box` reaches out of `cell`.
double overreach(const Box& box, const Box& cell) {
  const dvec3 out = glm::max(cell.low - box.low, box.high - cell.high);
  return std::max({out.x, out.y, out.z});
}

// What a subtree says of the splats of one resolution in it.
struct SplatsBelow {
  std::uint8_t least_depth = 255;  // of the octant splats' leaves; 255: no member
  double width = 0;                // largest of the moments splats
  std::vector<Box> outside;        // of those that reach so far out of the subtree's cell that this makes their size

  void include(SplatsBelow&& other) {
    least_depth = std::min(least_depth, other.least_depth);
    width = std::max(width, other.width);
    outside.insert(outside.end(), other.outside.begin(), other.outside.end());
  }
};

class IndexBuilder {
 public:
  IndexBuilder(const IndexInput& input, std::uint64_t leaf_points)
      : input_(input), leaf_points_(leaf_points), cursors_(input.resolutions.size(), 0) {
    nodes_.shape = {input.resolutions.size(), size_bounds, input.attributes.size()};
  }

  format::NodeArrays run() && {
    add_node(0, input_.keys.size(), 0);
    return std::move(nodes_);
  }

 private:
  using Splats = std::vector<SplatsBelow>;  // [resolution]

  // Adds the subtree over points [begin, end), which share a cell at `depth`.
  Splats add_node(std::size_t begin, std::size_t end, int depth) {
    const std::size_t node = append_empty_node();
    Splats splats(nodes_.shape.resolutions);
    if (end - begin <= leaf_points_ || depth == max_morton_depth) {
      fill_leaf(node, begin, end, splats);
    } else {
      for (std::size_t child_begin = begin; child_begin < end;) {
        const unsigned octant = octant_at(input_.keys[child_begin], depth);
        const std::size_t child_end = find_octant_end(child_begin, end, depth, octant);
        nodes_.child_masks[node] = static_cast<std::uint8_t>(nodes_.child_masks[node] | 1u << octant);
        const std::size_t child = nodes_.size();
        Splats of_child = add_node(child_begin, child_end, depth + 1);
        for (std::size_t r = 0; r < splats.size(); ++r) splats[r].include(std::move(of_child[r]));
        merge_child(node, child);
        child_begin = child_end;
      }
    }
    nodes_.first_resolutions[node] = first_resolution(splats, depth);
    bound_moments(node, cell_box(input_.positions[begin], input_.cube, depth), splats);
    return splats;
  }

  std::size_t append_empty_node() {
    const std::size_t node = nodes_.size();
    nodes_.child_masks.push_back(0);
    nodes_.first_resolutions.push_back(0);
    nodes_.counts.resize(nodes_.counts.size() + nodes_.shape.resolutions);
    nodes_.size_codes.resize(nodes_.size_codes.size() + size_bounds * nodes_.shape.resolutions, 255);
    nodes_.summaries.resize(nodes_.summaries.size() + nodes_.shape.attributes);
    return node;
  }

  std::size_t find_octant_end(std::size_t begin, std::size_t end, int depth, unsigned octant) const {
    const auto keys = input_.keys.subspan(begin, end - begin);
    const auto past =
        std::ranges::partition_point(keys, [&](const MortonKey& key) { return octant_at(key, depth) <= octant; });
    return begin + static_cast<std::size_t>(past - keys.begin());
  }

  std::uint8_t& size_code(std::size_t node, std::size_t bound, std::size_t resolution) {
    return nodes_.size_codes[(node * size_bounds + bound) * nodes_.shape.resolutions + resolution];
  }

  // Leaves come in Morton order, so the members of each resolution are met front to back.
  void fill_leaf(std::size_t node, std::size_t begin, std::size_t end, Splats& splats) {
    for (std::size_t i = begin; i < end; ++i) ++nodes_.counts[node * nodes_.shape.resolutions + input_.segments[i]];
    for (std::size_t r = 0; r < nodes_.shape.resolutions; ++r) {
      const Resolution& resolution = input_.resolutions[r];
      const Material& material = input_.materials[r];
      std::uint8_t& code = size_code(node, octant_bound, r);
      for (std::size_t& m = cursors_[r]; m < resolution.size() && resolution.members[m] < end; ++m) {
        splats[r].least_depth = std::min(splats[r].least_depth, resolution.depths[m]);
        const double size = std::ldexp(1.0, -resolution.depths[m]) / std::cbrt(resolution.counts[m]);
        code = std::min(code, format::size_code(size, 1.0));
        if (!(material.moments[m].mass > 0)) continue;
        splats[r].width = std::max(splats[r].width, uniform_width * stretch * material.extents[m].longest);
        splats[r].outside.push_back(splat_box(input_.positions[resolution.members[m]], material, m));
      }
    }
    for (std::size_t a = 0; a < nodes_.shape.attributes; ++a)
      nodes_.summaries[node * nodes_.shape.attributes + a] = summarize_points(a, begin, end);
  }

  format::ValueSummary summarize_points(std::size_t attribute, std::size_t begin, std::size_t end) const {
    const StoredAttribute& stored = input_.attributes[attribute];
    const format::ValueBins& bins = input_.bins[attribute];
    format::ValueSummary summary = bins.summarize(std::span(stored.values).subspan(begin, end - begin));
    for (std::size_t i = begin; i < end; ++i)
      summary.include(summarize(input_.materials.back().value_moments[attribute][i], stored.description.offset, bins));
    return summary;
  }

  // Sizes of the moments splats. What does not reach far enough out of a cell does not out of the parent's either, so
  // few boxes are carried upwards.
  void bound_moments(std::size_t node, const Box& cell, Splats& splats) {
    for (std::size_t r = 0; r < splats.size(); ++r) {
      double size = splats[r].width;
      std::erase_if(splats[r].outside, [&](const Box& box) { return overreach(box, cell) / 2 <= splats[r].width; });
      for (const Box& box : splats[r].outside) size = std::max(size, overreach(box, cell) / 2);
      if (size > 0) size_code(node, moments_bound, r) = format::size_code(size, input_.cube.edge);
    }
  }

  void merge_child(std::size_t node, std::size_t child) {
    const std::size_t resolutions = nodes_.shape.resolutions, attributes = nodes_.shape.attributes;
    for (std::size_t r = 0; r < resolutions; ++r) {
      nodes_.counts[node * resolutions + r] += nodes_.counts[child * resolutions + r];
      std::uint8_t& code = size_code(node, octant_bound, r);
      code = std::min(code, size_code(child, octant_bound, r));
    }
    for (std::size_t a = 0; a < attributes; ++a)
      nodes_.summaries[node * attributes + a].include(nodes_.summaries[child * attributes + a]);
  }

  std::uint8_t first_resolution(const Splats& splats, int depth) const {
    std::size_t first = nodes_.shape.resolutions - 1;
    while (first > 0 && splats[first].least_depth != 255 && splats[first].least_depth >= depth) --first;
    return static_cast<std::uint8_t>(first);
  }

  const IndexInput& input_;
  std::uint64_t leaf_points_;
  std::vector<std::size_t> cursors_;  // [resolution]: members before the next leaf
  format::NodeArrays nodes_;
};

}  // namespace

format::NodeArrays build_index(const IndexInput& input, std::uint64_t leaf_points) {
  return IndexBuilder(input, leaf_points).run();
}

}  // namespace splatvol
