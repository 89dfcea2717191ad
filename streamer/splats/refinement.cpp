#include "streamer/splats/refinement.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace splatvol {
namespace {

constexpr float none = std::numeric_limits<float>::infinity();

// Prices are powers of two: 2^(price / 16).
constexpr int prices_per_octave = 16;
constexpr int lowest_price = -120 * prices_per_octave;
float price_of(int price) { return std::exp2(static_cast<float>(price) / prices_per_octave); }

// A node is opened if this may save more than this share of all splats, or an equal worth of error.
constexpr double least_share = 1.0 / 128;
constexpr float smallest_gain = 4, largest_gain = 512;
constexpr float gain_for_error = 64;  // largest gain if the goal is an error, which does not tell the number of splats

// A node of more splats than this is opened too, unless it is at its coarsest: the detail that one part of it needs
// must not cost splats in all of it.
constexpr float most_splats = 256;

// A cut this near to its goal is near enough.
constexpr double enough_splats = 0.97;
constexpr double enough_error = 0.95;  // squared

// Of the price, for an octave of splats.
constexpr double usual_octaves = 1.6, most_octaves = 8;

bool fits(const ErrorGoal& goal, std::uint64_t splats) { return splats <= goal.max_splats; }
bool is_good(const ErrorGoal& goal, double error) { return error <= goal.expected_error * goal.expected_error; }
bool nearly_fills(const ErrorGoal& goal, std::uint64_t splats) {
  return static_cast<double>(splats) >= enough_splats * static_cast<double>(goal.max_splats);
}

}  // namespace

Refinement::Refinement(const NodeTree& tree) : tree_(tree), model_(tree), resolutions_(tree.finest() + 1) {}

std::span<Refinement::Choice> Refinement::choices(const Item& item) {
  return std::span(choices_).subspan(item.begin, resolutions_ - item.first_resolution);
}

std::span<const Refinement::Choice> Refinement::choices(const Item& item) const {
  return std::span(choices_).subspan(item.begin, resolutions_ - item.first_resolution);
}

std::uint32_t Refinement::add(const Node& node) {
  const std::size_t first = node.first_resolution();
  items_.push_back({.is_leaf = node.child_mask() == 0,
                    .first_resolution = static_cast<std::uint8_t>(first),
                    .begin = static_cast<std::uint32_t>(choices_.size())});
  nodes_.push_back({node.page, node.index, node.cube, node.depth});
  const ErrorModel::OfNode model = model_.of(node);
  const bool is_in_view = tree_.is_within_reach(node);
  std::uint64_t splats = node.splat_count(first);
  for (std::size_t r = first; r < resolutions_; ++r) {
    if (r > first) splats += node.counts()[r];
    Choice& choice = choices_.emplace_back();
    if (!(is_in_view || tree_.is_within_reach(node, r))) continue;
    const ErrorModel::Terms terms = model.at(r, splats);
    choice.splats = static_cast<float>(splats);
    choice.error = static_cast<float>(terms.error);
    choice.seam = static_cast<float>(terms.seam);
  }
  return static_cast<std::uint32_t>(items_.size() - 1);
}

Status Refinement::expand(std::uint32_t item) {
  const Located& node = nodes_[item];
  SPLATVOL_TRY_ASSIGN(children,
                      tree_.children_of({node.page, node.index, node.cube, Begins(resolutions_), node.depth}));
  items_[item].expanded = true;
  items_[item].absent = !children;
  if (!children) return {};
  for (std::size_t octant = 0; octant < 8; ++octant) {
    const std::optional<Node>& child = (*children)[octant];
    if (!child || !tree_.is_visible(*child)) continue;
    const std::uint32_t added = add(*child);
    items_[item].children[octant] = added;
  }
  const std::uint64_t bytes = items_.size() * (sizeof(Item) + sizeof(Located)) + choices_.size() * sizeof(Choice);
  if (bytes > max_bytes_ / 2)  // a growing vector may hold twice its size
    return fail(ErrorCode::out_of_budget, "choosing by expected error takes more than {} bytes", max_bytes_);
  return {};
}

bool Refinement::is_worth_opening(const Item& item, float price) const {
  if (item.is_leaf) return false;
  const auto of_item = choices(item);
  float least = none;
  std::size_t best = 0;
  for (std::size_t i = 0; i < of_item.size(); ++i) {
    const float cost = of_item[i].error + price * of_item[i].splats;
    if (!(cost < least)) continue;
    least = cost;
    best = i;
  }
  return (best > 0 && of_item[best].splats > most_splats) ||
         least - price * of_item.front().splats > price * least_gain_;
}

// Adds to `offers` the offers of the children, for each resolution of the surroundings, from the item's first on.
// Returns the sum of their floors. Requires that the costs of the children are settled.
float Refinement::sum_children(const Item& item, std::span<float> offers) const {
  const std::size_t first = item.first_resolution;
  float floors = 0;
  for (const std::uint32_t index : item.children) {
    if (index == 0) continue;
    const Item& child = items_[index];
    // For surroundings coarser than its first resolution, a child offers the cost at this resolution plus the seams.
    const auto of_child = choices(child);
    for (std::size_t r = first; r < child.first_resolution; ++r)
      offers[r - first] +=
          of_child.front().offer + static_cast<float>(child.first_resolution - r) * of_child.front().seam;
    for (std::size_t r = std::max<std::size_t>(child.first_resolution, first); r < resolutions_; ++r)
      offers[r - first] += of_child[r - child.first_resolution].offer;
    floors += child.floor;
  }
  return floors;
}

// Makes the offers of an item. Requires that the costs of its children are settled.
void Refinement::settle_costs(Item& item, float price) {
  const std::size_t first = item.first_resolution;
  const bool is_absent = item.wants_opening && item.absent, may_open = item.wants_opening && !item.absent;
  std::array<float, format::max_resolutions> opened;  // from the first resolution on
  if (may_open) std::fill_n(opened.begin(), resolutions_ - first, 0.0F);
  const float parts = may_open ? sum_children(item, opened) : 0;

  // The parts of a node tell more than the whole. At no resolution is the node's error smaller than their sum.
  const auto of_item = choices(item);
  const float whole = of_item.back().error;
  item.hidden = std::max(parts - whole, 0.0F);
  item.floor = whole + item.hidden;

  // The cut may also begin with a neighbouring resolution, finer or coarser, for the seam of the coarser one.
  const auto offer = [](const Choice& from, Choice& to, float seam) {
    if (!(from.offer + seam < to.offer)) return;
    to.offer = from.offer + seam;
    to.resolution = from.resolution;
  };
  const float most_drawn = is_absent ? -1 : item.is_leaf ? none : most_splats;  // of splats past the first resolution
  const float share = is_absent ? 0.0F : 1.0F;
  for (std::size_t i = 0; i < of_item.size(); ++i) {
    Choice& choice = of_item[i];
    const bool drawable = i == 0 || choice.splats <= most_drawn;
    const float cost = drawable ? share * (choice.error + item.hidden) + price * choice.splats : none;
    choice.opens = may_open && opened[i] < cost;
    choice.offer = choice.opens ? opened[i] : cost;
    choice.resolution = static_cast<std::uint8_t>(first + i);
    if (i > 0) offer(of_item[i - 1], choice, of_item[i - 1].seam);
  }
  for (std::size_t i = of_item.size() - 1; i-- > 0;) offer(of_item[i + 1], of_item[i], of_item[i].seam);
}

Result<Refinement::Sum> Refinement::evaluate(int log_price) {
  const float price = price_of(log_price);
  for (Item& item : items_) item.reached = false;
  items_[0].reached = true;
  for (std::uint32_t i = 0; i < items_.size(); ++i) {
    if (!items_[i].reached) continue;
    items_[i].wants_opening = is_worth_opening(items_[i], price);
    if (!items_[i].wants_opening) continue;
    if (!items_[i].expanded) SPLATVOL_TRY(expand(i));
    for (const std::uint32_t child : items_[i].children)
      if (child != 0) items_[child].reached = true;
  }
  for (auto i = items_.size(); i-- > 0;)
    if (items_[i].reached) settle_costs(items_[i], price);
  last_ = choose_at(log_price);
  return last_;
}

// Chooses the cheapest cut, from the root down, once all costs are settled. The root has no surroundings: it begins
// with any resolution.
Refinement::Sum Refinement::choose_at(int log_price) {
  Sum sum{.price = log_price};
  for (Item& item : items_) item.reached = item.opened = false;
  items_[0].reached = true;
  items_[0].resolution = std::ranges::min_element(choices(items_[0]), {}, &Choice::offer)->resolution;
  for (Item& item : items_) {
    if (!item.reached) continue;
    const auto of_item = choices(item);
    const Choice& choice = of_item[item.resolution - item.first_resolution];
    item.opened = choice.opens;
    for (const std::uint32_t index : item.children) {
      if (!item.opened || index == 0) continue;
      Item& child = items_[index];
      const std::uint8_t nearest = std::max(item.resolution, child.first_resolution);
      child.reached = true;
      child.resolution = choices(child)[nearest - child.first_resolution].resolution;
    }
    if (item.opened || choice.splats == 0) continue;
    sum.splats += static_cast<std::uint64_t>(choice.splats);
    sum.error += static_cast<double>(choice.error + item.hidden);
    sum.finest = sum.finest && !(of_item.back().error < choice.error);
  }
  return sum;
}

// Returns how far to lower the price, by the response of splats to the last drop, or by the usual one of splats and
// errors; never so far that much more of the index is read than the goal needs.
int Refinement::price_drop(const ErrorGoal& goal, const std::optional<Sum>& before, const Sum& from) {
  double octaves = 2;
  const auto splats = static_cast<double>(from.splats);
  if (from.splats > 0) {
    double octaves_each = usual_octaves;
    if (before && from.splats > before->splats)
      octaves_each = std::clamp(static_cast<double>(before->price - from.price) /
                                    (prices_per_octave * std::log2(splats / static_cast<double>(before->splats))),
                                usual_octaves, most_octaves);
    octaves = std::min(octaves, octaves_each * std::log2(static_cast<double>(goal.max_splats) / splats));
  }
  if (goal.expected_error > 0)
    octaves = std::min(octaves, 2 * std::log2(from.error / (goal.expected_error * goal.expected_error)));
  return std::max(static_cast<int>(prices_per_octave * octaves), prices_per_octave / 4);
}

// Lowers the price until the goal is met or nothing is left to gain, then searches between the last two prices. The
// search depends only on the index, so that it always ends at the same price.
Status Refinement::choose(const ErrorGoal& goal, std::uint64_t max_bytes) {
  items_.clear();
  nodes_.clear();
  choices_.clear();
  max_bytes_ = max_bytes;
  last_ = {};
  SPLATVOL_TRY_ASSIGN(root, tree_.root());
  if (!tree_.is_visible(root)) return {};
  static_cast<void>(add(root));
  least_gain_ = std::clamp(static_cast<float>(least_share * static_cast<double>(goal.max_splats)), smallest_gain,
                           goal.expected_error > 0 ? gain_for_error : largest_gain);

  const float error = std::ranges::max_element(choices_, {}, &Choice::error)->error;
  const int highest = error > 0 ? static_cast<int>(prices_per_octave * std::log2(error)) : 0;
  const bool wants_all = goal.max_splats >= root.splat_count(resolutions_ - 1);
  std::optional<Sum> before;
  SPLATVOL_TRY_ASSIGN(coarse, evaluate(std::max(highest, lowest_price)));
  while (fits(goal, coarse.splats) && !is_good(goal, coarse.error) && !coarse.finest && coarse.price > lowest_price) {
    if (!wants_all && nearly_fills(goal, coarse.splats)) break;
    SPLATVOL_TRY_ASSIGN(finer, evaluate(std::max(coarse.price - price_drop(goal, before, coarse), lowest_price)));
    if (!fits(goal, finer.splats) || is_good(goal, finer.error)) return bisect(goal, coarse, finer);
    before = std::exchange(coarse, finer);
  }
  return {};
}

// Searches for the price between a cut that fits and is not good enough (`coarse`), and one that does not fit or is
// good enough (`fine`).
Status Refinement::bisect(const ErrorGoal& goal, Sum coarse, Sum fine) {
  int last = fine.price;
  for (int i = 0; fine.price + 1 < coarse.price; ++i) {
    if (nearly_fills(goal, coarse.splats)) break;
    if (fits(goal, fine.splats) && fine.error >= enough_error * goal.expected_error * goal.expected_error) break;

    // Interpolates the logarithms of splats or errors; every third time, tries the middle.
    double share = 0.5;
    if (i % 3 != 2) {
      const bool by_splats = !fits(goal, fine.splats);
      const auto from = by_splats ? static_cast<double>(coarse.splats) : coarse.error;
      const auto to = by_splats ? static_cast<double>(fine.splats) : fine.error;
      const double aim =
          by_splats ? 0.985 * static_cast<double>(goal.max_splats) : 0.975 * goal.expected_error * goal.expected_error;
      if (from > 0 && to > 0 && from != to) share = std::log(aim / from) / std::log(to / from);
    }
    const int width = coarse.price - fine.price;
    last = coarse.price - std::clamp(static_cast<int>(std::lround(share * width)), 1, width - 1);
    SPLATVOL_TRY_ASSIGN(middle, evaluate(last));
    (fits(goal, middle.splats) && !is_good(goal, middle.error) ? coarse : fine) = middle;
  }
  const int chosen = fits(goal, fine.splats) ? fine.price : coarse.price;
  if (chosen != last) SPLATVOL_TRY(evaluate(chosen));
  return {};
}

}  // namespace splatvol
