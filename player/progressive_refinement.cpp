#include "player/progressive_refinement.h"

#include <algorithm>

#include "player/choice.h"

namespace splatvol {
namespace {

// The first tolerance.
constexpr double first_percent = 4;

// Pixels between samples of cells: at most after the first picture, and in the last one.
constexpr int before_finest = 4, widest_spacing = 8;

}  // namespace

ProgressiveRefinement::ProgressiveRefinement(const Start& start)
    : has_splats_(start.splats.has_value()), spacing_(start.first_spacing), shown_(start.shown) {
  if (!start.splats) return;
  const Quality& quality = *start.splats;
  splats_ = true;
  if (quality.tolerance_percent) {
    last_tolerance_ = *quality.tolerance_percent;
    // All points of a file are few, or somebody wants to see them.
    detail_.tolerance_percent = last_tolerance_ > 0 ? std::max(first_percent, last_tolerance_) : 0;
  } else if (quality.max_splats || quality.resolution) {
    detail_ = expected_detail(quality);
    last_tolerance_ = detail_.tolerance_percent;
  } else {
    control_.emplace(*quality.max_error, ErrorControl::Search{.grows = true, .first_splats = start.first_splats});
    ask();
  }
}

void ProgressiveRefinement::ask() {
  if (const auto next = control_->next({}))
    detail_ = *next->splats;
  else
    splats_ = false;
}

Chooser::Needs ProgressiveRefinement::needs() const {
  if (splats_) return {.picture = control_.has_value()};
  return {.cells = Cells::all, .widest_spacing = widest_spacing};
}

std::optional<Recipe> ProgressiveRefinement::next(const Choices& choices) {
  if (splats_) return Recipe{detail_};
  if (spacing_ == 0) return {};
  const int finest = spacing_of_cells(choices);
  if (finest == 0 || (shown_ && shown_->sample_spacing <= finest)) return {};
  return Recipe::of_cells(std::max(spacing_, finest));
}

void ProgressiveRefinement::add(const Outcome& outcome, const Choices& choices) {
  if (outcome.recipe.is_exact()) {
    shown_ = outcome.recipe;
    spacing_ = finer_spacing(outcome.recipe.sample_spacing, choices.finest_spacing);
    return;
  }
  if (!splats_) return;
  if (control_) {
    control_->add(outcome, choices);
    ask();
    return;
  }
  splats_ = detail_.tolerance_percent != last_tolerance_;
  detail_.tolerance_percent = std::max(last_tolerance_, detail_.tolerance_percent / 2);
}

int ProgressiveRefinement::finer_spacing(int spacing, int finest) {
  return spacing > finest ? std::max(std::min(spacing / 2, before_finest), finest) : 0;
}

std::optional<double> ProgressiveRefinement::error() const {
  if (!control_ || control_->pictures() < 2) return std::nullopt;
  return control_->estimate().error;
}

}  // namespace splatvol
