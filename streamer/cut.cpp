#include "streamer/cut.h"

#include <algorithm>
#include <array>
#include <bit>
#include <iterator>
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

// What a cell's part of a cut came to, from worst to best.
enum class Outcome {
  invalid,  // a fixed resolution is not valid in it
  absent,   // not there, at no resolution
  other,    // there, but not as it is wanted
  wanted,
};

// What may be drawn of a node whose children's page is not there.
constexpr std::uint64_t most_unasked_splats = 1 << 16;

// How much finer than wanted a node may be drawn: when the eye moves away, the finer splats are there.
constexpr std::size_t finer_resolutions = 2;

class CutSelector {
 public:
  // Without `residency`, everything counts as there.
  CutSelector(const format::VolumeInfo& info, IndexPages& index, Residency* residency, const View& view,
              const ValueVisibility& visibility, const CutOptions& options, std::size_t size_bound)
      : info_(info),
        index_(index),
        residency_(residency),
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
    SPLATVOL_TRY_ASSIGN(outcome, visit(root));
    if (!residency_) return std::move(wanted_);
    if (outcome == Outcome::absent) return fail(ErrorCode::invalid_argument, "not even the coarsest splats are there");
    return std::move(drawn_);
  }

 private:
  // Where a cut stood before children were tried.
  struct Mark {
    std::size_t items, ranges;
    std::uint64_t splats;
  };
  static Mark mark(const Cut& cut) { return {cut.items.size(), cut.ranges.size(), cut.splats}; }
  static void return_to(const Mark& mark, Cut& cut) {
    cut.items.resize(mark.items);
    cut.ranges.resize(mark.ranges);
    cut.splats = mark.splats;
  }

  std::size_t finest() const { return info_.resolutions() - 1; }

  // Appends the best cut of the node's cell.
  Result<Outcome> visit(const Node& node) {
    const std::optional<std::size_t> resolution = choose_resolution(node);
    if (options_.resolution && !resolution) return Outcome::invalid;
    if (!is_visible(node)) return Outcome::wanted;
    if (node.child_mask() == 0) return draw(node, resolution.value_or(finest()));
    std::uint64_t splats = std::numeric_limits<std::uint64_t>::max();
    if (resolution) splats = is_within_reach(node, *resolution) ? splat_count(node, *resolution) : 0;
    if (resolution && splats <= options_.compare_above) return draw(node, *resolution);

    // Whichever is fewer; at equal numbers smaller nodes are better sorted.
    const Mark before = mark(wanted_), drawn_before = mark(drawn_);
    SPLATVOL_TRY_ASSIGN(children, visit_children(node));
    if (!children) {
      // What it will take shows with the page; until then it is to look cheap, and nothing is to be read for it.
      SPLATVOL_TRY(want(node, node.first_resolution()));
      if (wanted_.items.size() > before.items) wanted_.items.back().error = 0;
      return residency_ ? settle(node, Outcome::absent, most_unasked_splats, drawn_before) : Outcome::absent;
    }
    if (*children != Outcome::invalid && wanted_.splats - before.splats <= splats)
      return residency_ ? settle(node, *children, wanted_.splats - before.splats, drawn_before) : *children;
    return_to(before, wanted_);
    return_to(drawn_before, drawn_);
    return draw(node, *resolution);
  }

  // The worst outcome of a child; none where their page is not there.
  Result<std::optional<Outcome>> visit_children(const Node& node) {
    if (node.depth >= format::max_node_depth)
      return fail(ErrorCode::invalid_data, "the index is deeper than {}", format::max_node_depth);
    SPLATVOL_TRY_ASSIGN(children, children_of(node));
    if (!children) return std::nullopt;
    const unsigned nearest = nearest_octant(node.cell);
    Outcome worst = Outcome::wanted;
    for (unsigned i = 8; i-- > 0 && worst != Outcome::invalid;) {
      const std::optional<Node>& child = (*children)[i ^ nearest];
      if (!child) continue;
      SPLATVOL_TRY_ASSIGN(outcome, visit(*child));
      worst = std::min(worst, outcome);
    }
    return worst;
  }

  // By octant. A child's points begin where those of the siblings before it end.
  using Children = std::array<std::optional<Node>, 8>;
  Result<std::optional<Children>> children_of(const Node& node) {
    const bool linked = node.page->links[node.index] != IndexPage::no_node;
    std::shared_ptr<const IndexPage> page = node.page;
    if (linked) {
      SPLATVOL_TRY_ASSIGN(other, index_.linked(*node.page, node.index));
      page = std::move(other);
      if (!page) {
        wanted_.complete = drawn_.complete = false;
        return std::nullopt;
      }
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

  // Draws the node at the resolution that is wanted, or as near to it as is there: a little finer rather than coarser.
  Result<Outcome> draw(const Node& node, std::size_t resolution) {
    SPLATVOL_TRY(want(node, resolution));
    if (!residency_) return Outcome::wanted;
    for (std::size_t r = resolution; r <= std::min(resolution + finer_resolutions, finest()); ++r) {
      if (!holds(node, r)) continue;
      SPLATVOL_TRY(append(node, r, drawn_));
      return r == resolution ? Outcome::wanted : Outcome::other;
    }
    for (std::size_t r = resolution; r-- > node.first_resolution();) {
      if (!holds(node, r)) continue;
      SPLATVOL_TRY(append(node, r, drawn_));
      return Outcome::other;
    }
    return Outcome::absent;
  }

  // What is drawn of a node that was to be opened: its children, or itself where that shows more or where one of them
  // is not there. `most`: splats that it may draw for this, unless it draws at its first resolution.
  Result<Outcome> settle(const Node& node, Outcome children, std::uint64_t most, const Mark& before) {
    if (children == Outcome::wanted) return children;
    std::optional<std::size_t> best;
    for (std::size_t r = node.first_resolution(); r <= finest(); ++r) {
      if ((r > node.first_resolution() && splat_count(node, r) > most) || !holds(node, r)) break;
      best = r;
    }
    if (children == Outcome::other && (!best || splat_count(node, *best) <= drawn_.splats - before.splats))
      return children;
    return_to(before, drawn_);
    if (!best) return Outcome::absent;
    SPLATVOL_TRY(append(node, *best, drawn_));
    return Outcome::other;
  }

  bool holds(const Node& node, std::size_t resolution) {
    if (!is_within_reach(node, resolution)) return true;
    return residency_->holds(ranges_of(node, resolution));
  }

  std::span<const PointRange> ranges_of(const Node& node, std::size_t resolution) {
    for (std::size_t s = 0; s <= resolution; ++s) node_ranges_[s] = {node.begins[s], node.counts()[s]};
    return std::span(node_ranges_).first(resolution + 1);
  }

  // Of what is drawn at once, the memory is looked at; what it stands in for has been looked at before.
  Status want(const Node& node, std::size_t resolution) {
    SPLATVOL_TRY(append(node, resolution, wanted_));
    return {};
  }

  Status append(const Node& node, std::size_t resolution, Cut& cut) {
    if (!is_within_reach(node, resolution)) return {};
    cut.items.push_back(
        {node.cell, cut.ranges.size(), static_cast<std::uint32_t>(resolution), error_of(node, resolution)});
    std::ranges::copy(ranges_of(node, resolution), std::back_inserter(cut.ranges));
    cut.splats += splat_count(node, resolution);
    if (residency_ && &cut == &wanted_) return {};
    const std::uint64_t bytes_each = splat_bytes(options_.kernel);
    if (cut.splats > options_.max_bytes / bytes_each ||
        cut.memory_bytes() > options_.max_bytes - cut.splats * bytes_each)
      return fail(ErrorCode::out_of_budget, "the view needs more than {} bytes", options_.max_bytes);
    return {};
  }

  float error_of(const Node& node, std::size_t resolution) const {
    const double size = splat_bound(node, resolution);
    const double covered = frustum_.covered_percent(size, frustum_.nearest_depth(cell_of_centres(node, size)));
    const std::uint64_t occupied = node.page->nodes.summaries[node.index].occupancy;
    const double visible = std::popcount(occupied & visibility_.bins()) / std::max(1.0, 1.0 * std::popcount(occupied));
    return static_cast<float>(std::clamp(covered * visible, 1e-30, 1e6));
  }

  const format::VolumeInfo& info_;
  IndexPages& index_;
  Residency* const residency_;
  const View& view_;
  const Frustum frustum_;
  const ValueVisibility& visibility_;
  const CutOptions& options_;
  const std::size_t size_bound_;
  Cut wanted_;
  Cut drawn_;  // with residency
  std::array<PointRange, format::max_resolutions> node_ranges_;
};

Result<Cut> select(const format::VolumeInfo& info, IndexPages& index, Residency* residency, const View& view,
                   const ValueVisibility& visibility, const CutOptions& options) {
  const char* name = options.kernel == KernelKind::octant ? "octant" : "moments";
  const auto bound = std::ranges::find(info.size_bounds, name);
  if (bound == info.size_bounds.end())
    return fail(ErrorCode::unsupported, "no splat sizes for the kernel {} in the index", name);
  const auto size_bound = static_cast<std::size_t>(bound - info.size_bounds.begin());
  return CutSelector(info, index, residency, view, visibility, options, size_bound).run();
}

}  // namespace

bool Cut::operator==(const Cut& other) const {
  return ranges == other.ranges &&
         std::ranges::equal(items, other.items, {}, &CutItem::resolution, &CutItem::resolution);
}

Result<Cut> select_cut(const format::VolumeInfo& info, IndexPages& index, const View& view,
                       const ValueVisibility& visibility, const CutOptions& options) {
  return select(info, index, nullptr, view, visibility, options);
}

Result<Cut> select_resident_cut(const format::VolumeInfo& info, IndexPages& index, Residency& residency,
                                const View& view, const ValueVisibility& visibility, const CutOptions& options) {
  return select(info, index, &residency, view, visibility, options);
}

}  // namespace splatvol
