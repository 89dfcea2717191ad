#include "streamer/splats/node_tree.h"

#include <numeric>
#include <utility>

namespace splatvol {
namespace {

using format::IndexPage;

// Share of a splat's size. Rounding may move a point out of its node, and a splat beyond its size, by less than this.
constexpr double position_slack = 1.0 / 16;

// The least section that counts: splats cover some of a plane beside their node, too.
constexpr double least_section = 0.05;

// Returns the area of a plane in a cube, in faces of the cube: the density of the sum of three uniform distributions.
double section_of(const Cube& cube, const Plane& plane) {
  const dvec3 widths = glm::max(glm::abs(plane.normal), dvec3(1e-3));
  const double end = plane.distance(cube.origin + 0.5 * cube.edge) / cube.edge + 0.5 * (widths.x + widths.y + widths.z);
  double sum = 0;
  for (int corner = 0; corner < 8; ++corner) {
    double from = end, sign = 1;
    for (int axis = 0; axis < 3; ++axis)
      if (corner >> axis & 1) from -= widths[axis], sign = -sign;
    if (from > 0) sum += sign * from * from;
  }
  return std::max(sum / (2 * widths.x * widths.y * widths.z), 0.0);
}

// Returns the cube, larger by `by` on each side.
Cube grown(const Cube& cube, double by) { return {cube.origin - by, cube.edge + 2 * by}; }

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
      size_bound_(size_bound),
      occlusion_(view) {}

Result<Node> NodeTree::root() const {
  SPLATVOL_TRY_ASSIGN(page, index_.root());
  Node root{std::move(page), 0, info_.cube, Begins(info_.resolutions()), 0};
  for (std::size_t s = 1; s < info_.resolutions(); ++s) root.begins[s] = info_.resolution_counts[s - 1];
  return root;
}

// The points of a child begin behind those of the siblings before it.
Result<std::optional<NodeTree::Children>> NodeTree::children_of(const Node& node) const {
  if (node.depth >= format::max_node_depth)
    return fail(ErrorCode::invalid_data, "the index is deeper than {}", format::max_node_depth);
  const bool linked = node.page->links[node.index] != IndexPage::no_node;
  std::shared_ptr<const IndexPage> page = node.page;
  if (linked) {
    SPLATVOL_TRY_SET(page, index_.linked(*node.page, node.index));
    if (!page) return std::nullopt;
  }
  std::uint32_t next = linked ? 0 : node.page->first_children[node.index];

  Children children;
  Begins begins = node.begins;
  for (unsigned octant = 0; octant < 8; ++octant) {
    if ((node.child_mask() >> octant & 1) == 0) continue;
    const double edge = 0.5 * node.cube.edge;
    const Cube cube{node.cube.origin + edge * dvec3(octant & 1, octant >> 1 & 1, octant >> 2), edge};
    children[octant] = Node{page, next++, cube, begins, node.depth + 1};
    const auto counts = children[octant]->counts();
    for (std::size_t s = 0; s < counts.size(); ++s) begins[s] += counts[s];
  }
  return children;
}

double NodeTree::splat_bound(const Node& node, std::size_t resolution) const {
  return format::size_bound(node.page->nodes.size_code_at(node.index, size_bound_, resolution), info_.cube.edge);
}

// Size codes are relative to the root's edge. The edge of a node at depth d is 2^d times smaller.
double NodeTree::splat_bound_in_cube(const Node& node, std::size_t resolution) const {
  return format::size_bound_exponent(node.page->nodes.size_code_at(node.index, size_bound_, resolution)) +
         static_cast<double>(node.depth);
}

// Centroids may be outside of the node's cube: no farther than ellipsoids may reach.
double NodeTree::covered_percent(const Node& node, std::size_t resolution) const {
  const double size = splat_bound(node, resolution);
  const Cube centers = kernel_ == KernelKind::octant ? node.cube : grown(node.cube, moments_reach * size);
  return frustum_.covered_percent(size, frustum_.nearest_depth(centers));
}

Result<bool> NodeTree::find_hidden(const FilledNodes& filled, std::optional<KeptOcclusion>* kept) {
  if (!filled.any()) return true;
  if (kept && *kept) {
    SPLATVOL_TRY_ASSIGN(holds, holds_still(**kept));
    if (holds) {
      occlusion_ = (*kept)->occlusion;
      return (*kept)->complete;
    }
    kept->reset();
  }
  SPLATVOL_TRY_ASSIGN(root, this->root());
  Finding finding{filled, root.page.get(), {}};
  SPLATVOL_TRY(hide_behind(finding, root, 0, false));
  if (kept) kept->emplace(KeptOcclusion{visibility_, occlusion_, std::move(finding.links), finding.complete});
  return finding.complete;
}

// Whether finding the occlusion again would give the same result.
Result<bool> NodeTree::holds_still(const KeptOcclusion& kept) const {
  if (!(kept.occlusion.view() == view_ && kept.visibility == visibility_)) return false;
  SPLATVOL_TRY_ASSIGN(root, index_.root());
  std::vector<std::shared_ptr<const IndexPage>> pages{std::move(root)};
  for (const KeptOcclusion::Link& link : kept.links) {
    SPLATVOL_TRY_ASSIGN(page, index_.linked(*pages[link.from], link.node));
    if ((page != nullptr) != link.found) return false;
    pages.push_back(std::move(page));
  }
  return true;
}

// Adds the nodes that hide others, front to back. A node that closes all rays through it is added as a whole; of other
// nodes the children are tried, which may be denser. `page`: number of the node's page, as in KeptOcclusion::Link.
Status NodeTree::hide_behind(Finding& finding, const Node& node, std::size_t page, bool parent_filled) {
  // Material of too low an extinction closes no ray, even if it fills the cube.
  const auto [least, most] = visibility_.extinctions(node.values());
  if (!(most * info_.cube.edge >= Occlusion::closed) || !is_visible(node)) return {};

  const bool in_root_page = node.page.get() == finding.root_page;
  const bool is_filled = in_root_page ? finding.filled.has(node.index) : parent_filled;
  const bool is_linked = node.page->links[node.index] != IndexPage::no_node;
  const bool has_parts = node.page->first_children[node.index] != IndexPage::no_node || (is_filled && is_linked);
  const bool closes = is_filled && least * node.cube.edge >= Occlusion::closed;
  if (has_parts && !closes && !occlusion_.is_small(node.cube)) {
    SPLATVOL_TRY_ASSIGN(children, children_of(node));
    if (is_linked) {
      finding.links.push_back({page, node.index, children.has_value()});
      page = finding.links.size();
    }
    if (!children) {
      finding.complete = false;
      return {};
    }
    const unsigned nearest = nearest_octant(view_, node.cube);
    for (unsigned i = 0; i < 8; ++i)
      if (const std::optional<Node>& child = (*children)[i ^ nearest])
        SPLATVOL_TRY(hide_behind(finding, *child, page, is_filled));
    return {};
  }
  if (is_filled && least > 0 && !is_clipped(node.cube, view_.clip)) occlusion_.add(node.cube, least);
  return {};
}

bool NodeTree::is_visible(const Node& node) const {
  if ((view_.slices.empty() && !shows(node)) || occlusion_.hides(node.cube)) return false;
  if (is_within_reach(node)) return true;
  for (std::size_t r = node.first_resolution(); r <= finest(); ++r)
    if (is_within_reach(node, r)) return true;
  return false;
}

bool NodeTree::shows(const Node& node) const { return visibility_.shows(node.values()); }

// The sections of a node's children add up to its own.
double NodeTree::weight_within(const Node& node, double reach) const {
  double sum = 0;
  if (!(node.summary().min <= node.summary().max)) return sum;
  for (const Slice& slice : view_.slices) {
    if (!meets(node.cube, reach, slice.plane)) continue;
    sum += std::max(section_of(node.cube, slice.plane), least_section) * slice.opacity * slice.opacity;
  }
  return sum;
}

double NodeTree::reach_of(const Node& node, std::size_t resolution) const {
  const double reach = kernel_ == KernelKind::octant ? octant_reach : moments_reach;
  return (reach + position_slack) * splat_bound(node, resolution);
}

double NodeTree::slice_weight(const Node& node, std::size_t resolution) const {
  return view_.slices.empty() ? 0 : weight_within(node, reach_of(node, resolution));
}

bool NodeTree::is_within_reach(const Node& node) const {
  if (!frustum_.touches(node.cube, 0)) return false;
  return view_.slices.empty() || shows(node) || weight_within(node, 0) > 0;
}

bool NodeTree::is_within_reach(const Node& node, std::size_t resolution) const {
  const double reach = reach_of(node, resolution);
  const bool touches =
      kernel_ == KernelKind::octant ? frustum_.touches(node.cube, reach) : frustum_.touches(grown(node.cube, reach), 0);
  return touches && (view_.slices.empty() || shows(node) || weight_within(node, reach) > 0);
}

}  // namespace splatvol
