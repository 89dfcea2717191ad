#include "player/pacer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <ranges>

namespace splatvol {
namespace {

// Splats of the first rung. Each one has about sqrt(2) times those of the one below it.
constexpr double fewest_splats = 64;

// Up to so many splats, samples are so many pixels apart; from as many on, they come closer together.
constexpr std::array ends = {std::pair{4, std::uint64_t{23170}}, std::pair{2, std::uint64_t{65536}},
                             std::pair{1, std::numeric_limits<std::uint64_t>::max()}};

constexpr std::ptrdiff_t most_rungs = 2;  // from picture to picture

// A rung stays unless it takes this many times the wanted time. A finer one follows if it takes less than this.
constexpr double too_long = 1.15, short_enough = 0.9;

// The part of a deviation, in logarithms, that a picture changes what is known of the machine. A deviation has bounds:
// a picture may take long for other reasons.
constexpr double learning = 0.5;
constexpr double most_deviation = 4, most_ratio = 2;

// What is known of other kinds of rungs is forgotten slowly, so that they are tried again.
constexpr double remembered = 0.999;

// Rungs of splats, from few to all points.
std::vector<Rung> rungs_of_splats(const Choices& choices) {
  std::vector<Rung> rungs;
  std::uint64_t before = 0;
  for (int step = 0; rungs.empty() || before < choices.points; ++step) {
    const auto usual = static_cast<std::uint64_t>(std::round(fewest_splats * std::exp2(0.5 * step)));
    const std::uint64_t splats = std::clamp(usual, std::min(choices.least_splats, choices.points), choices.points);
    std::uint64_t begin = 0;
    for (const auto& [usual_spacing, end] : ends) {
      const int spacing = std::clamp(usual_spacing, choices.finest_spacing, choices.widest_spacing);
      const bool is_here = (splats >= begin || splats == choices.points) && splats <= end;
      begin = end;
      if (is_here && (rungs.empty() || rungs.back() != Rung{splats, spacing})) rungs.push_back({splats, spacing});
    }
    before = splats;
  }
  return rungs;
}

// Whether a mean tetrahedron has a sample. Else pictures of splats in the same time are better (docs/decisions).
bool has_samples(const CellCounts& cells, int spacing) {
  return cells.segments / (spacing * spacing) >= cells.tetrahedra;
}

// Whether `a` stands above `b`.
bool is_finer(const Rung& a, const Rung& b) {
  if (a.is_exact() != b.is_exact()) return a.is_exact();
  return a.splats != b.splats ? a.splats > b.splats : a.sample_spacing < b.sample_spacing;
}

}  // namespace

std::vector<Rung> Pacer::ladder(const Choices& choices) const {
  std::vector<Rung> rungs = rungs_of_splats(choices);
  if (!choices.cells) return rungs;
  const double most = work(rungs.back(), choices);
  std::vector<Rung> cells;
  for (const int usual : {4, 2, 1}) {
    const Rung rung{0, std::clamp(usual, choices.finest_spacing, choices.widest_spacing)};
    const bool is_worth_it = usual <= 2 || (work(rung, choices) < most && has_samples(*choices.cells, usual));
    if (is_worth_it && (cells.empty() || cells.back() != rung)) cells.push_back(rung);
  }
  std::erase_if(rungs, [&, of_cells = predict(cells.front(), choices)](const Rung& rung) {
    return predict(rung, choices) >= of_cells;
  });
  rungs.insert(rungs.end(), cells.begin(), cells.end());
  return rungs;
}

double Pacer::work(const Rung& rung, const Choices& choices) const {
  if (rung.is_exact())  // of no cells, too
    return std::max(work_of_cells(*choices.cells, choices.pixels, rung.sample_spacing), nanoseconds::of_picture);
  const auto splats = static_cast<double>(rung.splats);
  const double samples = choices.pixels / (rung.sample_spacing * rung.sample_spacing);
  return work_of_splats(splats, fragments_of_splats(layers_, splats, samples), choices.pixels, rung.sample_spacing);
}

double Pacer::predict(const Rung& rung, const Choices& choices) const {
  const auto ratio = ratios_.find(kind_of(rung));
  return machine_ * (ratio == ratios_.end() ? 1 : ratio->second) * work(rung, choices);
}

Rung Pacer::next(const Choices& choices) {
  const std::vector<Rung> rungs = ladder(choices);
  // From `begin` to `last`; `begin` if there is time for none.
  const auto finest_of = [&](std::ptrdiff_t begin, std::ptrdiff_t last, double seconds) {
    begin = std::max<std::ptrdiff_t>(begin, 0);
    for (std::ptrdiff_t i = std::min(last, std::ssize(rungs) - 1); i > begin; --i)
      if (predict(rungs[static_cast<std::size_t>(i)], choices) <= seconds) return rungs[static_cast<std::size_t>(i)];
    return rungs[static_cast<std::size_t>(begin)];
  };
  if (!rung_) {
    const auto splats = std::ranges::count_if(rungs, [](const Rung& rung) { return !rung.is_exact(); });
    rung_ = finest_of(0, kind_ ? std::ssize(rungs) : splats - 1, seconds_);
    return *rung_;
  }
  const auto finer = std::ranges::find_if(rungs, [&](const Rung& rung) { return is_finer(rung, *rung_); });
  const std::ptrdiff_t above = finer - rungs.begin(), at = above - 1;
  const bool is_here = at >= 0 && rungs[static_cast<std::size_t>(at)] == *rung_;
  if (!is_here)
    rung_ = finest_of(above - most_rungs, at + most_rungs, short_enough * seconds_);
  else if (predict(*rung_, choices) <= too_long * seconds_)
    rung_ = finest_of(at, at + most_rungs, short_enough * seconds_);
  else
    rung_ = finest_of(at - most_rungs, at - 1, seconds_);
  return *rung_;
}

void Pacer::add(const Rung& rung, const Choices& choices, double fragments, double seconds) {
  if (!(seconds > 0)) return;
  if (fragments > 0) {
    const double samples = choices.pixels / (rung.sample_spacing * rung.sample_spacing);
    layers_ = layers_of_one_splat(fragments, static_cast<double>(rung.splats), samples);
  }
  const Kind kind = kind_of(rung);
  for (auto& [other, ratio] : ratios_)
    if (other != kind) ratio = std::pow(ratio, remembered);
  const double deviation = seconds / (machine_ * work(rung, choices));
  if (!kind_)
    machine_ *= deviation;
  else if (kind != *kind_)
    ratios_[kind] = std::clamp(deviation, 1 / most_ratio, most_ratio);
  else
    machine_ *=
        std::pow(std::clamp(deviation / ratios_.try_emplace(kind, 1).first->second, 1 / most_deviation, most_deviation),
                 learning);
  kind_ = kind;
}

}  // namespace splatvol
