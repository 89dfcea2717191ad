#include "player/pacer.h"

#include <algorithm>
#include <limits>
#include <ranges>

namespace splatvol {
namespace {

constexpr std::ptrdiff_t most_rungs = 2;  // from picture to picture

// Of a search, and those among the first that may be any rung.
constexpr std::size_t most_pictures = 12, most_leaps = 3;

// A rung stays unless it takes this many times the wanted time. A finer one follows if it takes less than this.
constexpr double too_long = 1.15, short_enough = 0.9;

// Whether a mean tetrahedron has a sample. Else pictures of splats in the same time are better (docs/decisions).
bool has_samples(const CellCounts& cells, int spacing) {
  return cells.segments / (spacing * spacing) >= cells.tetrahedra;
}

// Whether `a` stands above `b`.
bool is_finer(const Recipe& a, const Recipe& b) {
  if (a.is_exact() != b.is_exact()) return a.is_exact();
  return a.most_splats() != b.most_splats() ? a.most_splats() > b.most_splats() : a.sample_spacing < b.sample_spacing;
}

}  // namespace

std::vector<Recipe> Pacer::ladder(const Choices& choices) const {
  std::vector<Recipe> rungs = ladder_of_splats(choices);
  if (!choices.cells) return rungs;
  const bool has_splats = !rungs.empty();
  const double most = has_splats ? times_.work(rungs.back(), choices) : std::numeric_limits<double>::infinity();
  std::vector<Recipe> cells;
  for (const int usual : {4, 2, 1}) {
    const Recipe rung = Recipe::of_cells(std::clamp(usual, choices.finest_spacing, choices.widest_spacing));
    const bool is_worth_it =
        usual <= 2 || !has_splats || (times_.work(rung, choices) < most && has_samples(*choices.cells, usual));
    if (is_worth_it && (cells.empty() || cells.back() != rung)) cells.push_back(rung);
  }
  std::erase_if(rungs, [&, of_cells = times_.predict(cells.front(), choices)](const Recipe& rung) {
    return times_.predict(rung, choices) >= of_cells;
  });
  rungs.insert(rungs.end(), cells.begin(), cells.end());
  return rungs;
}

std::optional<Recipe> Pacer::next(const Choices& choices) {
  const std::vector<Recipe> rungs = ladder(choices);
  const double time = seconds_ - choices.surfaces_seconds;
  // From `begin` to `last`; `begin` if there is time for none.
  const auto finest_of = [&](std::ptrdiff_t begin, std::ptrdiff_t last, double seconds) {
    begin = std::max<std::ptrdiff_t>(begin, 0);
    for (std::ptrdiff_t i = std::min(last, std::ssize(rungs) - 1); i > begin; --i)
      if (times_.predict(rungs[static_cast<std::size_t>(i)], choices) <= seconds)
        return rungs[static_cast<std::size_t>(i)];
    return rungs[static_cast<std::size_t>(begin)];
  };
  if (!rung_) {
    const auto splats = std::ranges::count_if(rungs, [](const Recipe& rung) { return !rung.is_exact(); });
    rung_ = finest_of(0, times_.is_measured() ? std::ssize(rungs) : splats - 1, time);
    return rung_;
  }
  const auto finer = std::ranges::find_if(rungs, [&](const Recipe& rung) { return is_finer(rung, *rung_); });
  const std::ptrdiff_t above = finer - rungs.begin(), at = above - 1;
  const bool is_here = at >= 0 && rungs[static_cast<std::size_t>(at)] == *rung_;
  if (!is_here)
    rung_ = finest_of(above - most_rungs, at + most_rungs, short_enough * time);
  else if (times_.predict(*rung_, choices) <= too_long * time)
    rung_ = finest_of(at, at + most_rungs, short_enough * time);
  else
    rung_ = finest_of(at - most_rungs, at - 1, time);
  return rung_;
}

std::optional<Recipe> PaceSearch::next(const Choices& choices) {
  if (drawn_.size() == most_pictures) return {};
  if (drawn_.size() < most_leaps) pacer_.leap();
  std::optional<Recipe> rung = pacer_.next(choices);
  if (!drawn_.empty() && rung == drawn_.back()) return {};
  asked_ = *rung;
  return rung;
}

void PaceSearch::add(const Outcome& outcome, const Choices& choices) {
  drawn_.push_back(asked_);  // budgets may have made it coarser
  pacer_.add(outcome, choices);
}

}  // namespace splatvol
