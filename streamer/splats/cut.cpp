#include "streamer/splats/cut.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <iterator>

#include "splat/record.h"
#include "streamer/splats/error_model.h"
#include "streamer/splats/node_tree.h"
#include "streamer/splats/refinement.h"

namespace splatvol {
namespace {

// The outcome of choosing the part of the cut below a node, from worst to best.
enum class Outcome {
  invalid,  // a fixed resolution is not valid there
  absent,   // not resident at any resolution
  other,    // resident, but not as it is wanted
  wanted,
};

// The most splats of a node that is drawn because the page of its children is not there.
constexpr std::uint64_t most_unasked_splats = 1 << 16;

// How many resolutions finer than wanted a node may be drawn: finer splats are resident after the eye has moved away.
constexpr std::size_t finer_resolutions = 2;

class CutSelector {
 public:
  // Null `residency`: everything counts as resident.
  CutSelector(const format::VolumeInfo& info, IndexPages& index, Residency* residency, const View& view,
              const ValueVisibility& visibility, const CutOptions& options, std::size_t size_bound)
      : tree_(info, index, view, visibility, options.kernel, size_bound),
        model_(tree_),
        residency_(residency),
        options_(options) {}

  Result<Cut> run() {
    if (options_.filled && !is_coarsest()) {
      SPLATVOL_TRY_ASSIGN(found, tree_.find_hidden(*options_.filled, options_.kept_occlusion));
      wanted_.complete = drawn_.complete = found;
    }
    SPLATVOL_TRY_ASSIGN(outcome, options_.detail.goal ? visit_refined() : visit_all());
    if (!residency_) return std::move(wanted_);
    if (outcome == Outcome::absent) return fail(ErrorCode::invalid_argument, "not even the coarsest splats are there");
    return std::move(drawn_);
  }

 private:
  // The size of a cut before children were tried, to return to.
  struct Mark {
    std::size_t items, ranges;
    std::uint64_t splats;
    double squared_error;
  };

  // What is known of a node that was chosen for a goal.
  struct Chosen {
    const Refinement& refinement;
    const Refinement::Item& item;
    [[nodiscard]] double error_at(std::size_t resolution) const { return refinement.error_of(item, resolution); }
  };

  static Mark mark(const Cut& cut) { return {cut.items.size(), cut.ranges.size(), cut.splats, cut.squared_error}; }
  static void return_to(const Mark& mark, Cut& cut) {
    cut.items.resize(mark.items);
    cut.ranges.resize(mark.ranges);
    cut.splats = mark.splats;
    cut.squared_error = mark.squared_error;
  }

  std::size_t finest() const { return tree_.finest(); }

  Result<Outcome> visit_all() {
    SPLATVOL_TRY_ASSIGN(root, tree_.root());
    return visit(root);
  }

  // Appends the best cut of the node.
  Result<Outcome> visit(const Node& node) {
    const std::optional<std::size_t> resolution = choose_resolution(node);
    if (options_.detail.resolution && !resolution) return Outcome::invalid;
    if (!tree_.is_visible(node)) return Outcome::wanted;
    if (node.child_mask() == 0) return draw(node, resolution.value_or(finest()));
    std::uint64_t splats = std::numeric_limits<std::uint64_t>::max();
    if (resolution) splats = tree_.is_within_reach(node, *resolution) ? node.splat_count(*resolution) : 0;
    if (resolution && (splats <= options_.compare_above || is_coarsest())) return draw(node, *resolution);

    // Draws the node or its children, whichever are fewer splats. At equal numbers, children: smaller nodes are sorted
    // better.
    const Mark before = mark(wanted_), drawn_before = mark(drawn_);
    SPLATVOL_TRY_ASSIGN(children, visit_children(node));
    if (!children) return draw_unasked(node);
    if (*children != Outcome::invalid && wanted_.splats - before.splats <= splats)
      return residency_ ? settle(node, *children, wanted_.splats - before.splats, drawn_before) : *children;
    return_to(before, wanted_);
    return_to(drawn_before, drawn_);
    return draw(node, *resolution);
  }

  // Whether nothing coarser can be asked for. Then no index page is read only to leave out some splats of the root.
  bool is_coarsest() const {
    if (options_.detail.goal) return options_.detail.goal->max_splats <= 1;
    return options_.detail.resolution ? *options_.detail.resolution == 0
                                      : std::isinf(options_.detail.tolerance_percent);
  }

  // Returns the worst outcome of the children, or nothing if their page is not there.
  Result<std::optional<Outcome>> visit_children(const Node& node) {
    SPLATVOL_TRY_ASSIGN(children, tree_.children_of(node));
    if (!children) return std::nullopt;
    const unsigned nearest = nearest_octant(tree_.view(), node.cube);
    Outcome worst = Outcome::wanted;
    for (unsigned i = 8; i-- > 0 && worst != Outcome::invalid;) {
      const std::optional<Node>& child = (*children)[i ^ nearest];
      if (!child) continue;
      SPLATVOL_TRY_ASSIGN(outcome, visit(*child));
      worst = std::min(worst, outcome);
    }
    return worst;
  }

  // Draws a node that should be opened, but whose children's page is not there. Only the page tells how many splats the
  // children need: until then the node counts at its first resolution, and its splats are not read.
  Result<Outcome> draw_unasked(const Node& node, const Chosen* chosen = nullptr) {
    wanted_.complete = drawn_.complete = false;
    const Mark before = mark(wanted_), drawn_before = mark(drawn_);
    SPLATVOL_TRY(want(node, node.first_resolution(), chosen));
    if (wanted_.items.size() > before.items) wanted_.items.back().error = 0;
    return residency_ ? settle(node, Outcome::absent, most_unasked_splats, drawn_before, chosen) : Outcome::absent;
  }

  // For a goal, Refinement first chooses the whole cut.
  Result<Outcome> visit_refined() {
    Refinement refinement(tree_);
    SPLATVOL_TRY(refinement.choose(*options_.detail.goal, options_.max_choice_bytes));
    wanted_.finest = refinement.items().empty();  // nothing is visible
    if (refinement.items().empty()) return Outcome::wanted;
    SPLATVOL_TRY_ASSIGN(root, tree_.root());
    SPLATVOL_TRY_ASSIGN(outcome, visit_chosen(refinement, 0, root));
    wanted_.finest = refinement.is_finest() && !residency_;
    wanted_.squared_goal_error = refinement.error();
    return outcome;
  }

  Result<Outcome> visit_chosen(const Refinement& refinement, std::uint32_t index, const Node& node) {
    const Refinement::Item& item = refinement.items()[index];
    const Chosen chosen{refinement, item};
    if (item.wants_opening && item.absent) return draw_unasked(node, &chosen);
    if (!item.opened) return draw(node, item.resolution, &chosen);
    const Mark before = mark(wanted_), drawn_before = mark(drawn_);
    SPLATVOL_TRY_ASSIGN(children, tree_.children_of(node));
    if (!children) return draw_unasked(node, &chosen);
    const unsigned nearest = nearest_octant(tree_.view(), node.cube);
    Outcome worst = Outcome::wanted;
    for (unsigned i = 8; i-- > 0;) {
      const std::uint32_t child = item.children[i ^ nearest];
      if (child == 0) continue;
      SPLATVOL_TRY_ASSIGN(outcome, visit_chosen(refinement, child, *(*children)[i ^ nearest]));
      worst = std::min(worst, outcome);
    }
    return residency_ ? settle(node, worst, wanted_.splats - before.splats, drawn_before, &chosen) : worst;
  }

  std::optional<std::size_t> choose_resolution(const Node& node) const {
    if (options_.detail.resolution) {
      const std::size_t fixed = std::min(*options_.detail.resolution, finest());
      return fixed >= node.first_resolution() ? std::optional(fixed) : std::nullopt;
    }
    for (std::size_t r = node.first_resolution(); r <= finest(); ++r)
      if (tree_.covered_percent(node, r) <= options_.detail.tolerance_percent) return r;
    return std::nullopt;
  }

  // Draws the node at the wanted resolution, or at the nearest resident one: a little finer rather than coarser.
  Result<Outcome> draw(const Node& node, std::size_t resolution, const Chosen* chosen = nullptr) {
    SPLATVOL_TRY(want(node, resolution, chosen));
    if (!residency_) return Outcome::wanted;
    for (std::size_t r = resolution; r <= std::min(resolution + finer_resolutions, finest()); ++r) {
      if (!holds(node, r)) continue;
      SPLATVOL_TRY(append(node, r, drawn_, chosen));
      return r == resolution ? Outcome::wanted : Outcome::other;
    }
    for (std::size_t r = resolution; r-- > node.first_resolution();) {
      if (!holds(node, r)) continue;
      SPLATVOL_TRY(append(node, r, drawn_, chosen));
      return Outcome::other;
    }
    return Outcome::absent;
  }

  // Decides what to draw for a node that was opened: its children, or the node itself if it shows more or if a child is
  // not resident. `most`: the most splats of the node, unless it is drawn at its first resolution.
  Result<Outcome> settle(const Node& node, Outcome children, std::uint64_t most, const Mark& before,
                         const Chosen* chosen = nullptr) {
    if (children == Outcome::wanted) return children;
    std::optional<std::size_t> best;
    for (std::size_t r = node.first_resolution(); r <= finest(); ++r) {
      if ((r > node.first_resolution() && node.splat_count(r) > most) || !holds(node, r)) break;
      best = r;
    }
    if (children == Outcome::other && (!best || node.splat_count(*best) <= drawn_.splats - before.splats))
      return children;
    return_to(before, drawn_);
    if (!best) return Outcome::absent;
    SPLATVOL_TRY(append(node, *best, drawn_, chosen));
    return Outcome::other;
  }

  bool holds(const Node& node, std::size_t resolution) {
    if (!tree_.is_within_reach(node, resolution)) return true;
    return residency_->holds(ranges_of(node, resolution));
  }

  std::span<const PointRange> ranges_of(const Node& node, std::size_t resolution) {
    for (std::size_t s = 0; s <= resolution; ++s) node_ranges_[s] = {node.begins[s], node.counts()[s]};
    return std::span(node_ranges_).first(resolution + 1);
  }

  Status want(const Node& node, std::size_t resolution, const Chosen* chosen) {
    return append(node, resolution, wanted_, chosen);
  }

  // With residency, checks memory for the substitute only. The cut that it replaces was checked when it was chosen.
  Status append(const Node& node, std::size_t resolution, Cut& cut, const Chosen* chosen) {
    if (!tree_.is_within_reach(node, resolution)) return {};
    const std::uint64_t splats = node.splat_count(resolution);
    cut.items.push_back({node.cube, cut.ranges.size(), static_cast<std::uint32_t>(resolution),
                         chosen ? saved_by_a_splat(*chosen, splats) : covered_visibly(node, resolution),
                         tree_.slice_weight(node, resolution) > 0});
    std::ranges::copy(ranges_of(node, resolution), std::back_inserter(cut.ranges));
    cut.splats += splats;
    cut.squared_error += chosen ? chosen->error_at(resolution) : model_.of(node).at(resolution, splats).error;
    if (residency_ && &cut == &wanted_) return {};
    const std::uint64_t bytes_each = record_bytes(options_.kernel);
    if (cut.splats > options_.max_bytes / bytes_each ||
        cut.memory_bytes() > options_.max_bytes - cut.splats * bytes_each)
      return fail(ErrorCode::out_of_budget, "the view needs more than {} bytes", options_.max_bytes);
    return {};
  }

  // Returns about the squared error that each splat saves: without it there would be coarser splats, and about the
  // error of the node's first resolution.
  static float saved_by_a_splat(const Chosen& chosen, std::uint64_t splats) {
    const double error = chosen.error_at(chosen.item.first_resolution);
    return static_cast<float>(std::clamp(error / std::max(1.0, static_cast<double>(splats)), 1e-30, 1e6));
  }

  float covered_visibly(const Node& node, std::size_t resolution) const {
    const std::uint64_t occupied = node.summary().occupancy;
    const double visible =
        tree_.slice_weight(node, resolution) > 0
            ? 1
            : std::popcount(occupied & tree_.visibility().bins()) / std::max(1.0, 1.0 * std::popcount(occupied));
    return static_cast<float>(std::clamp(tree_.covered_percent(node, resolution) * visible, 1e-30, 1e6));
  }

  NodeTree tree_;
  const ErrorModel model_;
  Residency* const residency_;
  const CutOptions& options_;
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
