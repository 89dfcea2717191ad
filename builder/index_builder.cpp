#include "builder/index_builder.h"

#include <algorithm>
#include <cmath>

namespace splatvol {
namespace {

class IndexBuilder {
 public:
  IndexBuilder(const IndexInput& input, std::uint64_t leaf_points)
      : input_(input), leaf_points_(leaf_points), cursors_(input.resolutions.size(), 0) {
    nodes_.shape = {input.resolutions.size(), 1, input.attributes.size()};
  }

  format::NodeArrays run() && {
    add_node(0, input_.keys.size(), 0);
    return std::move(nodes_);
  }

 private:
  using Depths =
      std::vector<std::uint8_t>;  // [resolution]: least depth of the leaves of a node's members; 255: no member

  // Adds the subtree over points [begin, end), which share a cell at `depth`.
  Depths add_node(std::size_t begin, std::size_t end, int depth) {
    const std::size_t node = append_empty_node();
    Depths least(nodes_.shape.resolutions, 255);
    if (end - begin <= leaf_points_ || depth == max_morton_depth) {
      fill_leaf(node, begin, end, least);
    } else {
      for (std::size_t child_begin = begin; child_begin < end;) {
        const unsigned octant = octant_at(input_.keys[child_begin], depth);
        const std::size_t child_end = find_octant_end(child_begin, end, depth, octant);
        nodes_.child_masks[node] = static_cast<std::uint8_t>(nodes_.child_masks[node] | 1u << octant);
        const std::size_t child = nodes_.size();
        const Depths child_least = add_node(child_begin, child_end, depth + 1);
        std::ranges::transform(least, child_least, least.begin(), [](auto a, auto b) { return std::min(a, b); });
        merge_child(node, child);
        child_begin = child_end;
      }
    }
    nodes_.first_resolutions[node] = first_resolution(least, depth);
    return least;
  }

  std::size_t append_empty_node() {
    const std::size_t node = nodes_.size();
    nodes_.child_masks.push_back(0);
    nodes_.first_resolutions.push_back(0);
    nodes_.counts.resize(nodes_.counts.size() + nodes_.shape.resolutions);
    nodes_.size_codes.resize(nodes_.size_codes.size() + nodes_.shape.resolutions, 255);
    nodes_.summaries.resize(nodes_.summaries.size() + nodes_.shape.attributes);
    return node;
  }

  std::size_t find_octant_end(std::size_t begin, std::size_t end, int depth, unsigned octant) const {
    const auto keys = input_.keys.subspan(begin, end - begin);
    const auto past =
        std::ranges::partition_point(keys, [&](const MortonKey& key) { return octant_at(key, depth) <= octant; });
    return begin + static_cast<std::size_t>(past - keys.begin());
  }

  // Leaves come in Morton order, so the members of each resolution are met front to back.
  void fill_leaf(std::size_t node, std::size_t begin, std::size_t end, Depths& least) {
    for (std::size_t i = begin; i < end; ++i) ++nodes_.counts[node * nodes_.shape.resolutions + input_.segments[i]];
    for (std::size_t r = 0; r < nodes_.shape.resolutions; ++r) {
      const Resolution& resolution = input_.resolutions[r];
      std::uint8_t& code = nodes_.size_codes[node * nodes_.shape.resolutions + r];
      for (std::size_t& m = cursors_[r]; m < resolution.size() && resolution.members[m] < end; ++m) {
        least[r] = std::min(least[r], resolution.depths[m]);
        const double size = std::ldexp(1.0, -resolution.depths[m]) / std::cbrt(resolution.counts[m]);
        code = std::min(code, format::size_code(size, 1.0));
      }
    }
    for (std::size_t a = 0; a < nodes_.shape.attributes; ++a)
      nodes_.summaries[node * nodes_.shape.attributes + a] =
          input_.bins[a].summarize(std::span(input_.attributes[a].values).subspan(begin, end - begin));
  }

  void merge_child(std::size_t node, std::size_t child) {
    const std::size_t resolutions = nodes_.shape.resolutions, attributes = nodes_.shape.attributes;
    for (std::size_t r = 0; r < resolutions; ++r) {
      nodes_.counts[node * resolutions + r] += nodes_.counts[child * resolutions + r];
      std::uint8_t& code = nodes_.size_codes[node * resolutions + r];
      code = std::min(code, nodes_.size_codes[child * resolutions + r]);
    }
    for (std::size_t a = 0; a < attributes; ++a)
      nodes_.summaries[node * attributes + a].include(nodes_.summaries[child * attributes + a]);
  }

  std::uint8_t first_resolution(const Depths& least, int depth) const {
    std::size_t first = nodes_.shape.resolutions - 1;
    while (first > 0 && least[first] != 255 && least[first] >= depth) --first;
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
