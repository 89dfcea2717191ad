#include "player/drawing_times.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdlib>

namespace splatvol {
namespace {

// The part of a deviation, in logarithms, that a picture changes what is known of the machine. A deviation has bounds:
// a picture may take long for other reasons.
constexpr double learning = 0.5;
constexpr double most_deviation = 4, most_ratio = 2;

// Factors of other kinds of rungs go back to 1 slowly, so that these rungs are tried again.
constexpr double remembered = 0.999;

}  // namespace

double DrawingTimes::work(const Recipe& rung, const Choices& choices) const {
  if (rung.is_exact()) {
    CellCounts cells = *choices.cells;
    if (const auto refined = refined_.find(rung.sample_spacing); refined != refined_.end())
      cells.segments *= refined->second;
    // Of no cells, too.
    return std::max(work_of_cells(cells, choices.pixels, rung.sample_spacing), nanoseconds::of_picture);
  }
  const auto splats = static_cast<double>(rung.most_splats());
  const double samples = choices.pixels / (rung.sample_spacing * rung.sample_spacing);
  return work_of_splats(splats, fragments_of_splats(layers_, splats, samples), choices.pixels, rung.sample_spacing);
}

// A kind that was never drawn is like that with about as wide samples.
double DrawingTimes::ratio_of(const Kind& kind) const {
  const auto [is_exact, spacing] = kind;
  std::optional<double> nearest;
  int least = 0;
  for (const auto& [other, ratio] : ratios_) {
    const int distance = std::abs(static_cast<int>(std::bit_width(static_cast<unsigned>(other.second))) -
                                  static_cast<int>(std::bit_width(static_cast<unsigned>(spacing))));
    if (other.first == is_exact && (!nearest || distance < least)) nearest = ratio, least = distance;
  }
  return nearest.value_or(1);
}

double DrawingTimes::predict(const Recipe& rung, const Choices& choices) const {
  return machine_ * ratio_of(kind_of(rung)) * work(rung, choices);
}

void DrawingTimes::add(const Outcome& outcome, const Choices& choices) {
  const Recipe& rung = outcome.recipe;
  if (!(outcome.seconds > 0)) return;
  if (outcome.fragments > 0) {
    const double samples = choices.pixels / (rung.sample_spacing * rung.sample_spacing);
    layers_ = layers_of_one_splat(outcome.fragments, static_cast<double>(rung.most_splats()), samples);
  }
  if (outcome.segments > 0 && rung.sample_spacing > 1 && choices.cells) {
    const double sampled = std::max(sampled_segments(*choices.cells, rung.sample_spacing), 1.0);
    refined_[rung.sample_spacing] = std::max(outcome.segments / sampled, 1.0);
  }
  const Kind kind = kind_of(rung);
  for (auto& [other, ratio] : ratios_)
    if (other != kind) ratio = std::pow(ratio, remembered);
  const double deviation = outcome.seconds / (machine_ * work(rung, choices));
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
