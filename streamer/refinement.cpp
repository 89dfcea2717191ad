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

// A node is opened where more splats might be saved by it, or error worth as many, than this share of all; and where it
// has more than so many, unless they are its coarsest: what one part of it needs is not to cost all of it.
constexpr double least_share = 1.0 / 128;
constexpr float smallest_gain = 4, largest_gain = 512;
constexpr float gain_for_error = 64;  // where it is not known how many there will be
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
  for (auto* numbers : {&hidden_, &floors_}) numbers->push_back(0);
  items_.push_back(
      {.is_leaf = node.child_mask() == 0, .first_resolution = static_cast<std::uint8_t>(node.first_resolution())});
  nodes_.push_back(node);
  for (auto* numbers : {&splats_, &errors_, &seams_, &costs_, &offers_}) numbers->resize(first + resolutions_);
  levels_.resize(first + resolutions_);
  opens_.resize(first + resolutions_);
  const ErrorModel::OfNode model = model_.of(node);
  const bool is_in_view = tree_.is_within_reach(node);
  std::uint64_t splats = 0;
  for (std::size_t r = 0; r < resolutions_; ++r) {
    splats += node.counts()[r];
    if (r < node.first_resolution() || !(is_in_view || tree_.is_within_reach(node, r))) continue;
    const ErrorModel::Terms terms = model.at(r, splats);
    splats_[first + r] = static_cast<float>(splats);
    errors_[first + r] = static_cast<float>(terms.error);
    seams_[first + r] = static_cast<float>(terms.seam);
  }
  return static_cast<std::uint32_t>(items_.size() - 1);
}

Status Refinement::expand(std::uint32_t item) {
  SPLATVOL_TRY_ASSIGN(children, tree_.children_of(nodes_[item]));
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
  if (items_[item].is_leaf) return false;
  const std::size_t begin = item * resolutions_, first = items_[item].first_resolution;
  std::size_t best = first;
  const auto cost = [&](std::size_t r) { return errors_[begin + r] + price * splats_[begin + r]; };
  for (std::size_t r = first + 1; r < resolutions_; ++r)
    if (cost(r) < cost(best)) best = r;
  return (best > first && splats_[begin + best] > most_splats) ||
         cost(best) - price * splats_[begin + first] > price * least_gain_;
}

// Requires that its children's offers are made.
void Refinement::settle_costs(std::uint32_t index, float price) {
  const Item& item = items_[index];
  const std::size_t begin = index * resolutions_, first = item.first_resolution;
  const bool is_absent = item.wants_opening && item.absent, may_open = item.wants_opening && !item.absent;
  std::array<float, format::max_resolutions> opened{};
  float parts = 0;
  for (const std::uint32_t child : item.children) {
    if (!may_open || child == 0) continue;
    for (std::size_t r = 0; r < resolutions_; ++r) opened[r] += offers_[child * resolutions_ + r];
    parts += floors_[child];
  }

  // The parts of a node tell more than the whole: it is not better, at any resolution, than they add up to.
  const float whole = errors_[begin + resolutions_ - 1], hidden = std::max(parts - whole, 0.0F);
  hidden_[index] = hidden;
  floors_[index] = whole + hidden;

  float* const costs = &costs_[begin];
  for (std::size_t r = 0; r < resolutions_; ++r) {
    const bool drawable =
        r == first || (r > first && !is_absent && (item.is_leaf || splats_[begin + r] <= most_splats));
    costs[r] = drawable ? (is_absent ? 0 : errors_[begin + r] + hidden) + price * splats_[begin + r] : none;
    opens_[begin + r] = may_open && opened[r] < costs[r];
    if (opens_[begin + r] != 0) costs[r] = opened[r];
  }

  // From each level to the next the seam of the coarser one, to and fro.
  float* const offers = &offers_[begin];
  std::uint8_t* const levels = &levels_[begin];
  for (std::size_t r = 0; r < resolutions_; ++r) {
    offers[r] = costs[r];
    levels[r] = static_cast<std::uint8_t>(r);
  }
  const auto offer = [&](std::size_t from, std::size_t to) {
    const float cost = offers[from] + seams_[begin + std::max(std::min(from, to), first)];
    if (!(cost < offers[to])) return;
    offers[to] = cost;
    levels[to] = levels[from];
  };
  for (std::size_t r = 1; r < resolutions_; ++r) offer(r - 1, r);
  for (std::size_t r = resolutions_ - 1; r-- > 0;) offer(r + 1, r);
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
  items_[0].resolution = static_cast<std::uint8_t>(std::ranges::min_element(root_costs) - root_costs.begin());
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
    sum.splats += static_cast<std::uint64_t>(splats_[begin + r]);
    sum.error += static_cast<double>(errors_[begin + r] + hidden_[i]);
    sum.finest = sum.finest && !(errors_[begin + resolutions_ - 1] < errors_[begin + r]);
  }
  return sum;
}

// How far to lower the price, in view of how splats and errors usually answer: never so far that much more of the index
// is read than the goal needs.
int Refinement::step_to(const ErrorGoal& goal, const Sum& from) {
  double octaves = 2;
  if (from.splats > 0)
    octaves =
        std::min(octaves, 1.6 * std::log2(static_cast<double>(goal.max_splats) / static_cast<double>(from.splats)));
  if (goal.max_error > 0) octaves = std::min(octaves, 2 * std::log2(from.error / (goal.max_error * goal.max_error)));
  return std::max(static_cast<int>(steps_per_octave * octaves), steps_per_octave / 4);
}

// The price is lowered until the goal is met or there is nothing to gain, then the last step is narrowed down. The
// search depends on nothing but what it finds, so that it always ends at the same price.
Status Refinement::choose(const ErrorGoal& goal) {
  items_.clear();
  nodes_.clear();
  for (auto* numbers : {&splats_, &errors_, &seams_, &costs_, &offers_, &hidden_, &floors_}) numbers->clear();
  levels_.clear();
  opens_.clear();
  SPLATVOL_TRY_ASSIGN(root, tree_.root());
  if (!tree_.is_visible(root)) return {};
  static_cast<void>(add(root));
  least_gain_ = std::clamp(static_cast<float>(least_share * static_cast<double>(goal.max_splats)), smallest_gain,
                           goal.max_error > 0 ? gain_for_error : largest_gain);

  const float error = *std::ranges::max_element(errors_);
  const int highest = error > 0 ? static_cast<int>(steps_per_octave * std::log2(error)) : 0;
  SPLATVOL_TRY_ASSIGN(coarse, evaluate(std::max(highest, lowest_price)));
  while (fits(goal, coarse.splats) && !is_good(goal, coarse.error) && !coarse.finest && coarse.price > lowest_price) {
    SPLATVOL_TRY_ASSIGN(finer, evaluate(std::max(coarse.price - step_to(goal, coarse), lowest_price)));
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
