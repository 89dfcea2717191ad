#include "streamer/node_tree.h"

#include <numeric>
#include <utility>

namespace splatvol {
namespace {

using format::IndexPage;

// Rounding may move a point out of its cell, and what is drawn of a splat past its size, by less than this part of the
// size.
constexpr double position_slack = 1.0 / 16;

// On all sides, along the axes.
Cube grown(const Cube& cell, double by) { return {cell.origin - by, cell.edge + 2 * by}; }

}  // namespace

std::uint64_t Node::splat_count(std::size_t resolution) const {
  const auto segments = counts().first(resolution + 1);
  return std::accumulate(segments.begin(), segments.end(), std::uint64_t{0});
}

NodeTree::NodeTree(const format::VolumeInfo& info, IndexPages& index, const View& view,
                   const ValueVisibility& visibility, KernelKind kernel, std::size_t size_bound)
    : info_(info),
      index_(index),
      view_(view),
      frustum_(view, kernel == KernelKind::octant ? octant_smallest_reach_pixels : moments_smallest_reach_pixels),
      visibility_(visibility),
      kernel_(kernel),
      size_bound_(size_bound) {}

Result<Node> NodeTree::root() const {
  SPLATVOL_TRY_ASSIGN(page, index_.root());
  Node root{std::move(page), 0, info_.cube, {}, 0};
  for (std::size_t s = 1; s < info_.resolutions(); ++s) root.begins[s] = info_.resolution_counts[s - 1];
  return root;
}

// A child's points begin where those of the siblings before it end.
Result<std::optional<NodeTree::Children>> NodeTree::children_of(const Node& node) const {
  if (node.depth >= format::max_node_depth)
    return fail(ErrorCode::invalid_data, "the index is deeper than {}", format::max_node_depth);
  const bool linked = node.page->links[node.index] != IndexPage::no_node;
  std::shared_ptr<const IndexPage> page = node.page;
  if (linked) {
    SPLATVOL_TRY_ASSIGN(other, index_.linked(*node.page, node.index));
    page = std::move(other);
    if (!page) return std::nullopt;
  }
  std::uint32_t next = linked ? 0 : node.page->first_children[node.index];

  Children children;
  Begins begins = node.begins;
  for (unsigned octant = 0; octant < 8; ++octant) {
    if ((node.child_mask() >> octant & 1) == 0) continue;
    const double edge = 0.5 * node.cell.edge;
    const Cube cell{node.cell.origin + edge * dvec3(octant & 1, octant >> 1 & 1, octant >> 2), edge};
    children[octant] = Node{page, next++, cell, begins, node.depth + 1};
    const auto counts = children[octant]->counts();
    for (std::size_t s = 0; s < counts.size(); ++s) begins[s] += counts[s];
  }
  return children;
}

unsigned NodeTree::nearest_octant(const Cube& cell) const {
  const dvec3 towards_eye = view_.orthographic ? -view_.forward : view_.eye - (cell.origin + 0.5 * cell.edge);
  return (towards_eye.x > 0 ? 1u : 0u) | (towards_eye.y > 0 ? 2u : 0u) | (towards_eye.z > 0 ? 4u : 0u);
}

double NodeTree::splat_bound(const Node& node, std::size_t resolution) const {
  return format::size_bound(node.page->nodes.size_code_at(node.index, size_bound_, resolution), info_.cube.edge);
}

// Centroids may lie outside of the node's cell, as far as their ellipsoids.
double NodeTree::covered_percent(const Node& node, std::size_t resolution) const {
  const double size = splat_bound(node, resolution);
  const Cube centres = kernel_ == KernelKind::octant ? node.cell : grown(node.cell, moments_reach * size);
  return frustum_.covered_percent(size, frustum_.nearest_depth(centres));
}

bool NodeTree::is_visible(const Node& node) const {
  const format::ValueSummary& summary = node.summary();
  if (!visibility_.shows(summary.min, summary.max, summary.occupancy)) return false;
  if (is_within_reach(node)) return true;
  for (std::size_t r = node.first_resolution(); r <= finest(); ++r)
    if (is_within_reach(node, r)) return true;
  return false;
}

bool NodeTree::is_within_reach(const Node& node, std::size_t resolution) const {
  const double size = splat_bound(node, resolution);
  if (kernel_ == KernelKind::octant) return frustum_.touches(node.cell, (octant_reach + position_slack) * size);
  return frustum_.touches(grown(node.cell, (moments_reach + position_slack) * size), 0);
}

}  // namespace splatvol
