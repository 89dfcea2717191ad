#include "streamer/refinement.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace splatvol {
namespace {

constexpr float none = std::numeric_limits<float>::infinity();

// Prices are powers of two, in so many steps an octave.
constexpr int steps_per_octave = 16;
constexpr int lowest_price = -120 * steps_per_octave;
float price_of(int price) { return std::exp2(static_cast<float>(price) / steps_per_octave); }

// A node is opened where so many splats might be saved by it, or error worth as many; and where it has more than this
// many, unless they are its coarsest: what one part of it needs is not to cost all of it.
constexpr float least_gain = 4;
constexpr float most_splats = 256;

// How near to its goal a cut need not be nearer.
constexpr double enough_splats = 0.97;
constexpr double enough_error = 0.95;  // squared

bool fits(const ErrorGoal& goal, std::uint64_t splats) { return splats <= goal.max_splats; }
bool is_good(const ErrorGoal& goal, double error) { return error <= goal.max_error * goal.max_error; }

}  // namespace

Refinement::Refinement(const NodeTree& tree) : tree_(tree), model_(tree), resolutions_(tree.finest() + 1) {}

std::uint32_t Refinement::add(const Node& node) {
  const std::size_t first = items_.size() * resolutions_;
  items_.push_back({.node = node});
  for (auto* numbers : {&splats_, &errors_, &seams_, &costs_, &offers_}) numbers->resize(first + resolutions_);
  levels_.resize(first + resolutions_);
  opens_.resize(first + resolutions_);
  model_.evaluate(node, std::span(errors_).subspan(first), std::span(seams_).subspan(first));
  for (std::size_t r = 0; r < resolutions_; ++r) {
    const bool counts = r >= node.first_resolution() && tree_.is_within_reach(node, r);
    splats_[first + r] = counts ? static_cast<float>(node.splat_count(r)) : 0;
  }
  return static_cast<std::uint32_t>(items_.size() - 1);
}

Status Refinement::expand(std::uint32_t item) {
  SPLATVOL_TRY_ASSIGN(children, tree_.children_of(items_[item].node));
  items_[item].expanded = true;
  items_[item].absent = !children;
  if (!children) return {};
  for (std::size_t octant = 0; octant < 8; ++octant) {
    const std::optional<Node>& child = (*children)[octant];
    if (child && tree_.is_visible(*child)) items_[item].children[octant] = add(*child);
  }
  return {};
}

bool Refinement::is_worth_opening(std::uint32_t item, float price) const {
  const Node& node = items_[item].node;
  if (node.child_mask() == 0) return false;
  const std::size_t begin = item * resolutions_, first = node.first_resolution();
  std::size_t best = first;
  const auto cost = [&](std::size_t r) { return errors_[begin + r] + price * splats_[begin + r]; };
  for (std::size_t r = first + 1; r < resolutions_; ++r)
    if (cost(r) < cost(best)) best = r;
  return (best > first && splats_[begin + best] > most_splats) ||
         cost(best) - price * splats_[begin + first] > price * least_gain;
}

// Requires that its children's offers are made.
void Refinement::settle_costs(std::uint32_t index, float price) {
  const Item& item = items_[index];
  const std::size_t begin = index * resolutions_, first = item.node.first_resolution();
  const bool is_absent = item.wants_opening && item.absent, is_leaf = item.node.child_mask() == 0;
  std::array<float, format::max_resolutions> opened{};
  for (const std::uint32_t child : item.children)
    for (std::size_t r = 0; child != 0 && r < resolutions_; ++r) opened[r] += offers_[child * resolutions_ + r];
  float* const costs = &costs_[begin];
  for (std::size_t r = 0; r < resolutions_; ++r) {
    const bool drawable = r == first || (r > first && !is_absent && (is_leaf || splats_[begin + r] <= most_splats));
    costs[r] = drawable ? (is_absent ? 0 : errors_[begin + r]) + price * splats_[begin + r] : none;
    opens_[begin + r] = item.wants_opening && !item.absent && opened[r] < costs[r];
    if (opens_[begin + r] != 0) costs[r] = opened[r];
  }

  // Seams cost what the coarser side has of them, for each step.
  for (std::size_t level = 0; level < resolutions_; ++level) {
    float best = none;
    for (std::size_t r = 0; r < resolutions_; ++r) {
      const std::size_t steps = r > level ? r - level : level - r;
      const float seam = seams_[begin + std::max(std::min(r, level), first)];
      const float cost = costs[r] + static_cast<float>(steps) * seam;
      if (!(cost < best)) continue;
      best = cost;
      levels_[begin + level] = static_cast<std::uint8_t>(r);
    }
    offers_[begin + level] = best;
  }
}

Result<Refinement::Sum> Refinement::evaluate(int steps) {
  const float price = price_of(steps);
  for (Item& item : items_) item.reached = false;
  items_[0].reached = true;
  for (std::uint32_t i = 0; i < items_.size(); ++i) {
    if (!items_[i].reached) continue;
    items_[i].wants_opening = is_worth_opening(i, price);
    if (!items_[i].wants_opening) continue;
    if (!items_[i].expanded) SPLATVOL_TRY(expand(i));
    for (const std::uint32_t child : items_[i].children)
      if (child != 0) items_[child].reached = true;
  }
  for (auto i = static_cast<std::uint32_t>(items_.size()); i-- > 0;)
    if (items_[i].reached) settle_costs(i, price);

  // From the root down: what was chosen. Its own level is free.
  Sum sum{.price = steps};
  const auto root_costs = std::span(costs_).first(resolutions_);
  items_[0].resolution = static_cast<std::uint32_t>(std::ranges::min_element(root_costs) - root_costs.begin());
  for (std::uint32_t i = 0; i < items_.size(); ++i) {
    Item& item = items_[i];
    const std::size_t begin = i * resolutions_, r = item.resolution;
    item.opened = item.reached && opens_[begin + r] != 0;
    for (const std::uint32_t child : item.children) {
      if (child == 0) continue;
      items_[child].reached = item.opened;
      items_[child].resolution = levels_[child * resolutions_ + r];
    }
    if (!item.reached || item.opened || splats_[begin + r] == 0) continue;
    sum.splats += item.node.splat_count(r);
    sum.error += static_cast<double>(errors_[begin + r]);
    sum.finest = sum.finest && !(errors_[begin + resolutions_ - 1] < errors_[begin + r]);
  }
  return sum;
}

// The price is lowered until the goal is met or there is nothing to gain, then the last step is narrowed down. The
// search depends on nothing but what it finds, so that it always ends at the same price.
Status Refinement::choose(const ErrorGoal& goal) {
  items_.clear();
  for (auto* numbers : {&splats_, &errors_, &seams_, &costs_, &offers_}) numbers->clear();
  levels_.clear();
  opens_.clear();
  SPLATVOL_TRY_ASSIGN(root, tree_.root());
  if (!tree_.is_visible(root)) return {};
  static_cast<void>(add(root));

  const float error = *std::ranges::max_element(errors_);
  const int highest = error > 0 ? static_cast<int>(steps_per_octave * std::log2(error)) : 0;
  SPLATVOL_TRY_ASSIGN(coarse, evaluate(std::max(highest, lowest_price)));
  while (fits(goal, coarse.splats) && !is_good(goal, coarse.error) && !coarse.finest && coarse.price > lowest_price) {
    SPLATVOL_TRY_ASSIGN(finer, evaluate(std::max(coarse.price - 2 * steps_per_octave, lowest_price)));
    if (!fits(goal, finer.splats) || is_good(goal, finer.error)) return bisect(goal, coarse, finer);
    coarse = finer;
  }
  return {};
}

// `coarse` fits and is not good enough; `fine` does not fit, or is good enough.
Status Refinement::bisect(const ErrorGoal& goal, Sum coarse, Sum fine) {
  int last = fine.price;
  for (int i = 0; fine.price + 1 < coarse.price; ++i) {
    if (static_cast<double>(coarse.splats) >= enough_splats * static_cast<double>(goal.max_splats)) break;
    if (fits(goal, fine.splats) && fine.error >= enough_error * goal.max_error * goal.max_error) break;

    // Where straight lines between the logarithms reach the goal; every third time, half way.
    double share = 0.5;
    if (i % 3 != 2) {
      const bool by_splats = !fits(goal, fine.splats);
      const auto from = by_splats ? static_cast<double>(coarse.splats) : coarse.error;
      const auto to = by_splats ? static_cast<double>(fine.splats) : fine.error;
      const double aim =
          by_splats ? 0.985 * static_cast<double>(goal.max_splats) : 0.975 * goal.max_error * goal.max_error;
      if (from > 0 && to > 0 && from != to) share = std::log(aim / from) / std::log(to / from);
    }
    const int width = coarse.price - fine.price;
    const int step = std::clamp(static_cast<int>(std::lround(share * width)), 1, width - 1);
    last = coarse.price - step;
    SPLATVOL_TRY_ASSIGN(middle, evaluate(last));
    (fits(goal, middle.splats) && !is_good(goal, middle.error) ? coarse : fine) = middle;
  }
  const int chosen = fits(goal, fine.splats) ? fine.price : coarse.price;
  if (chosen != last) SPLATVOL_TRY(evaluate(chosen));
  return {};
}

}  // namespace splatvol
