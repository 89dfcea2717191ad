#include "streamer/cut.h"

#include <algorithm>
#include <array>
#include <numeric>

#include "streamer/frustum.h"

namespace splatvol {
namespace {

using format::IndexPage;

// Rounding may move a point out of its cell, and what is drawn of a splat past its size, by less than this part of the
// size.
constexpr double position_slack = 1.0 / 16;

// Where a node's points begin in each segment.
using Begins = std::array<std::uint64_t, format::max_resolutions>;

struct Node {
  std::shared_ptr<const IndexPage> page;
  std::uint32_t index;
  Cube cell;
  Begins begins;
  std::size_t depth;

  std::uint8_t child_mask() const { return page->nodes.child_masks[index]; }
  std::size_t first_resolution() const { return page->nodes.first_resolutions[index]; }
  std::span<const std::uint64_t> counts() const { return page->nodes.counts_of(index); }
};

// On all sides, along the axes.
Cube grown(const Cube& cell, double by) { return {cell.origin - by, cell.edge + 2 * by}; }

class CutSelector {
 public:
  CutSelector(const format::VolumeInfo& info, IndexPages& index, const View& view, const ValueVisibility& visibility,
              const CutOptions& options, std::size_t size_bound)
      : info_(info),
        index_(index),
        view_(view),
        frustum_(view,
                 options.kernel == KernelKind::octant ? octant_smallest_reach_pixels : moments_smallest_reach_pixels),
        visibility_(visibility),
        options_(options),
        size_bound_(size_bound) {}

  Result<Cut> run() {
    SPLATVOL_TRY_ASSIGN(page, index_.root());
    Node root{std::move(page), 0, info_.cube, {}, 0};
    for (std::size_t s = 1; s < info_.resolutions(); ++s) root.begins[s] = info_.resolution_counts[s - 1];
    SPLATVOL_TRY(visit(root));
    return std::move(cut_);
  }

 private:
  // Where the cut stood before children were tried.
  struct Mark {
    std::size_t items, ranges;
    std::uint64_t splats;
  };
  Mark mark() const { return {cut_.items.size(), cut_.ranges.size(), cut_.splats}; }
  void return_to(const Mark& mark) {
    cut_.items.resize(mark.items);
    cut_.ranges.resize(mark.ranges);
    cut_.splats = mark.splats;
  }

  std::size_t finest() const { return info_.resolutions() - 1; }

  // Appends the best cut of the node's cell; false where a fixed resolution is not valid in it.
  Result<bool> visit(const Node& node) {
    const std::optional<std::size_t> resolution = choose_resolution(node);
    if (options_.resolution && !resolution) return false;
    if (!is_visible(node)) return true;
    if (node.child_mask() == 0) return draw(node, resolution.value_or(finest()));
    if (!resolution) return visit_children(node);
    const std::uint64_t splats = is_within_reach(node, *resolution) ? splat_count(node, *resolution) : 0;
    if (splats <= options_.compare_above) return draw(node, *resolution);

    // Whichever is fewer; at equal numbers smaller nodes are better sorted.
    const Mark before = mark();
    SPLATVOL_TRY_ASSIGN(valid, visit_children(node));
    if (valid && cut_.splats - before.splats <= splats) return true;
    return_to(before);
    return draw(node, *resolution);
  }

  Result<bool> visit_children(const Node& node) {
    if (node.depth >= format::max_node_depth)
      return fail(ErrorCode::invalid_data, "the index is deeper than {}", format::max_node_depth);
    SPLATVOL_TRY_ASSIGN(children, children_of(node));
    const unsigned nearest = nearest_octant(node.cell);
    for (unsigned i = 8; i-- > 0;) {
      const std::optional<Node>& child = children[i ^ nearest];
      if (!child) continue;
      SPLATVOL_TRY_ASSIGN(valid, visit(*child));
      if (!valid) return false;
    }
    return true;
  }

  // By octant. A child's points begin where those of the siblings before it end.
  Result<std::array<std::optional<Node>, 8>> children_of(const Node& node) {
    const bool linked = node.page->links[node.index] != IndexPage::no_node;
    std::shared_ptr<const IndexPage> page = node.page;
    if (linked) {
      SPLATVOL_TRY_ASSIGN(other, index_.linked(*node.page, node.index));
      page = std::move(other);
    }
    std::uint32_t next = linked ? 0 : node.page->first_children[node.index];

    std::array<std::optional<Node>, 8> children;
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

  // Descending in i, the octants i ^ nearest are back to front: whatever differs from the nearest on more axes is
  // behind.
  unsigned nearest_octant(const Cube& cell) const {
    const dvec3 towards_eye = view_.orthographic ? -view_.forward : view_.eye - (cell.origin + 0.5 * cell.edge);
    return (towards_eye.x > 0 ? 1u : 0u) | (towards_eye.y > 0 ? 2u : 0u) | (towards_eye.z > 0 ? 4u : 0u);
  }

  std::optional<std::size_t> choose_resolution(const Node& node) const {
    if (options_.resolution) {
      const std::size_t fixed = std::min(*options_.resolution, finest());
      return fixed >= node.first_resolution() ? std::optional(fixed) : std::nullopt;
    }
    for (std::size_t r = node.first_resolution(); r <= finest(); ++r) {
      const double size = splat_bound(node, r);
      const double depth = frustum_.nearest_depth(cell_of_centres(node, size));
      if (frustum_.covered_percent(size, depth) <= options_.tolerance_percent) return r;
    }
    return std::nullopt;
  }

  // Where the splats' centres lie: centroids may lie outside of the node's cell, as far as their ellipsoids.
  Cube cell_of_centres(const Node& node, double size) const {
    return options_.kernel == KernelKind::octant ? node.cell : grown(node.cell, moments_reach * size);
  }

  double splat_bound(const Node& node, std::size_t resolution) const {
    return format::size_bound(node.page->nodes.size_code_at(node.index, size_bound_, resolution), info_.cube.edge);
  }

  bool is_visible(const Node& node) const {
    const format::ValueSummary& summary = node.page->nodes.summaries[node.index];
    if (!visibility_.shows(summary.min, summary.max, summary.occupancy)) return false;
    for (std::size_t r = node.first_resolution(); r <= finest(); ++r)
      if (is_within_reach(node, r)) return true;
    return false;
  }

  // Whether the node's splats may reach into the picture.
  bool is_within_reach(const Node& node, std::size_t resolution) const {
    const double size = splat_bound(node, resolution);
    if (options_.kernel == KernelKind::octant)
      return frustum_.touches(node.cell, (octant_reach + position_slack) * size);
    return frustum_.touches(grown(node.cell, (moments_reach + position_slack) * size), 0);
  }

  static std::uint64_t splat_count(const Node& node, std::size_t resolution) {
    const auto counts = node.counts().first(resolution + 1);
    return std::accumulate(counts.begin(), counts.end(), std::uint64_t{0});
  }

  Result<bool> draw(const Node& node, std::size_t resolution) {
    if (!is_within_reach(node, resolution)) return true;
    cut_.items.push_back({node.cell, cut_.ranges.size(), static_cast<std::uint32_t>(resolution)});
    for (std::size_t s = 0; s <= resolution; ++s) cut_.ranges.push_back({node.begins[s], node.counts()[s]});
    cut_.splats += splat_count(node, resolution);
    const std::uint64_t bytes_each = splat_bytes(options_.kernel);
    if (cut_.splats > options_.max_bytes / bytes_each ||
        cut_.memory_bytes() > options_.max_bytes - cut_.splats * bytes_each)
      return fail(ErrorCode::out_of_budget, "the view needs more than {} bytes", options_.max_bytes);
    return true;
  }

  const format::VolumeInfo& info_;
  IndexPages& index_;
  const View& view_;
  const Frustum frustum_;
  const ValueVisibility& visibility_;
  const CutOptions& options_;
  const std::size_t size_bound_;
  Cut cut_;
};

}  // namespace

bool Cut::operator==(const Cut& other) const {
  return ranges == other.ranges &&
         std::ranges::equal(items, other.items, {}, &CutItem::resolution, &CutItem::resolution);
}

Result<Cut> select_cut(const format::VolumeInfo& info, IndexPages& index, const View& view,
                       const ValueVisibility& visibility, const CutOptions& options) {
  const char* name = options.kernel == KernelKind::octant ? "octant" : "moments";
  const auto bound = std::ranges::find(info.size_bounds, name);
  if (bound == info.size_bounds.end())
    return fail(ErrorCode::unsupported, "no splat sizes for the kernel {} in the index", name);
  const auto size_bound = static_cast<std::size_t>(bound - info.size_bounds.begin());
  return CutSelector(info, index, view, visibility, options, size_bound).run();
}

}  // namespace splatvol
