#include "player/motion_control.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <utility>

namespace splatvol {
namespace {

// Where no errors were measured, a smooth picture may take longer.
constexpr double unmeasured_patience = 2;

// A larger error shows as a false colour, so that the picture may take longer.
constexpr double false_color_error = 0.03, longer = 2;

// A rung stays if it takes neither more nor less of its time.
constexpr double too_long = 1.5, too_short = 0.4;

// Until errors are measured: those of cells, with samples 2 pixels apart, and how they grow. On the shared views, these
// are about the largest.
constexpr double cells_error = 0.0006, cells_growth = 1.4;

// The same of splats: the error of n splats goes by n^-decay. The file's model may be several times too small.
constexpr double splats_error = 0.75, decay = 0.45;

// A number of splats is near enough to one whose error was measured.
constexpr double near_by = 1.5;

// A view that shows so many times the segments of another one, or fewer, may have other errors. So may one in another
// direction, by the cosine of this angle: along an axis, the outlines of a mesh lie along rows of samples.
constexpr double another_view = 1.5, same_direction = 0.94;

// Where so many times as much or as little comes into view, another rung is chosen.
constexpr double much_more = 2;

// Errors that were measured of a picture with other colours or opacities may be larger by this.
constexpr double doubt = 2;

// Samples as wide as this show steps at outlines, which few pixels have: their error counts more.
constexpr int very_wide = 16;
constexpr double of_very_wide = 2;

// Splats lack some of the light, and wide samples do not: among pictures of about one error, cells are better.
constexpr double of_splats = 1.5;

// Of cells, for each pixel between samples: even where nothing of it was seen, closer samples are better.
constexpr double least_cells_error = 1e-5;

double cells_by_model(int sample_spacing) { return cells_error * std::pow(0.5 * sample_spacing, cells_growth); }

double by_count(std::uint64_t splats) { return std::pow(static_cast<double>(splats), decay); }

}  // namespace

std::vector<Recipe> MotionControl::rungs(const Choices& choices) {
  std::vector<Recipe> rungs = ladder_of_splats(choices);
  if (!choices.cells) return rungs;
  for (int usual = widest_moving_samples; usual >= 1; usual /= 2) {
    const Recipe rung = Recipe::of_cells(std::clamp(usual, choices.finest_spacing, choices.widest_spacing));
    const double segments = choices.cells->segment_work * sampled_segments(*choices.cells, rung.sample_spacing);
    if (segments > choices.most_segments) continue;
    if (rungs.empty() || rungs.back() != rung) rungs.push_back(rung);
  }
  return rungs;
}

// Whether errors were measured in a view that shows much more or less, or from elsewhere.
bool MotionControl::is_another_view(const Choices& choices) const {
  if (!choices.cells || measured_segments_ == 0) return false;
  const double change = std::max(choices.cells->segments, 1.0) / measured_segments_;
  return change > another_view || change < 1 / another_view ||
         glm::dot(choices.direction, measured_direction_) < same_direction;
}

MotionControl::Expected MotionControl::expected_of_cells(int sample_spacing, const Choices& choices) const {
  if (sample_spacing == 1) return {0, true};
  const double by_model = model_factor_ * cells_by_model(sample_spacing);
  const auto known = cell_errors_.find(sample_spacing);
  if (known == cell_errors_.end()) return {by_model};
  const double least = least_cells_error * sample_spacing;
  if (is_another_view(choices)) return {std::max({known->second, by_model, least})};
  return {std::max((are_doubted_ ? doubt : 1) * known->second, least), !are_doubted_};
}

MotionControl::Expected MotionControl::expected_error(const Recipe& rung, const Choices& choices) const {
  if (rung.is_exact()) return expected_of_cells(rung.sample_spacing, choices);
  const double number = by_count(rung.most_splats());
  const double by_model = std::max(model_.value_or(0), splats_error) / number + choices.added_error;
  if (splat_errors_.empty() || is_another_view(choices)) return {by_model};
  auto known = splat_errors_.lower_bound(rung.most_splats());
  const auto ratio_to = [&](const auto& other) {
    return std::abs(std::log(static_cast<double>(other->first) / static_cast<double>(rung.most_splats())));
  };
  if (known == splat_errors_.end() || (known != splat_errors_.begin() && ratio_to(std::prev(known)) < ratio_to(known)))
    --known;
  const double error = known->second * by_count(known->first) / number;
  return {(are_doubted_ ? doubt : 1) * error + choices.added_error,
          !are_doubted_ && ratio_to(known) <= std::log(near_by)};
}

// Whether errors of cells were measured in about this view, and of this picture.
bool MotionControl::are_errors_known(const Choices& choices) const {
  return !choices.cells || (!cell_errors_.empty() && !are_doubted_ && !is_another_view(choices));
}

// `patience`: for pictures that should be smooth, a factor on their time.
MotionControl::Chosen MotionControl::choose(const Choices& choices, double patience) const {
  const std::vector<Recipe> all = rungs(choices);
  struct Candidate {
    Recipe rung;
    double error, seconds;
    [[nodiscard]] double loss() const { return rung.is_exact() ? error : of_splats * error; }
  };
  bool has_splats = false;
  const auto best_of = [&](double most_error, double most_seconds, auto is_better) {
    std::optional<Candidate> best;
    for (const Recipe& rung : all) {
      if (!has_splats && !rung.is_exact()) continue;
      const double shows = rung.is_exact() && rung.sample_spacing >= very_wide ? of_very_wide : 1;
      const Candidate candidate{rung, shows * expected_error(rung, choices).error, times_.predict(rung, choices)};
      if (candidate.error <= most_error && candidate.seconds <= most_seconds && (!best || is_better(candidate, *best)))
        best = candidate;
    }
    return best;
  };
  const auto has_less_error = [](const Candidate& a, const Candidate& b) {
    return a.loss() != b.loss() ? a.loss() < b.loss() : a.seconds < b.seconds;
  };
  const auto is_quicker = [](const Candidate& a, const Candidate& b) { return a.seconds < b.seconds; };
  constexpr double any = std::numeric_limits<double>::infinity();

  const double usual = (are_errors_known(choices) ? 1 : unmeasured_patience) * limits_.smooth_seconds;
  const double smooth = std::min(usual, limits_.seconds), longest = longer * limits_.seconds;
  const double quick = std::min(choices.first_cells_seconds, limits_.seconds);
  for (const double seconds : {quick, limits_.seconds}) {
    if (const auto best = best_of(limits_.max_error, patience * smooth, has_less_error))
      return {best->rung, too_long * smooth, too_short * smooth};
    if (const auto best = best_of(limits_.max_error, seconds, is_quicker))
      return {best->rung, too_long * seconds, too_short * smooth};
    has_splats = true;
  }
  if (const auto best = best_of(std::max(false_color_error, limits_.max_error), limits_.seconds, has_less_error))
    return {best->rung, too_long * limits_.seconds, too_short * limits_.seconds};
  if (const auto best = best_of(any, longest, has_less_error))
    return {best->rung, too_long * longest, too_short * longest};
  return {best_of(any, any, is_quicker)->rung, any, too_short * longest};
}

std::vector<Recipe> MotionControl::unmeasured(const Choices& choices) const {
  const Recipe chosen = choose(choices).rung;
  const double smooth = std::min(limits_.smooth_seconds, limits_.seconds);
  if (chosen.is_exact() && expected_error(chosen, choices).error <= limits_.max_error) return {};
  std::vector<Recipe> unmeasured;
  for (const double seconds : {smooth, limits_.seconds}) {
    std::optional<Recipe> finest;
    for (const Recipe& rung : ladder_of_splats(choices))
      if (times_.predict(rung, choices) <= seconds) finest = rung;
    const bool is_new = finest && (unmeasured.empty() || unmeasured.back() != *finest);
    if (is_new && !expected_error(*finest, choices).is_measured) unmeasured.push_back(*finest);
  }
  return unmeasured;
}

// Whether the rung of this movement may be drawn again.
bool MotionControl::may_stay(const Choices& choices) const {
  const std::vector<Recipe> all = rungs(choices);
  if (!rung_ || std::ranges::find(all, rung_->rung) == all.end()) return false;
  if (!all.back().is_exact() || !had_segments_) return all.back().is_exact() == had_segments_.has_value();
  const double change = std::max(choices.cells->segments, 1.0) / std::max(*had_segments_, 1.0);
  return change < much_more && change > 1 / much_more;
}

std::optional<Recipe> MotionControl::next(const Choices& choices) {
  Chosen chosen = choose(choices);
  if (may_stay(choices)) {
    const auto error_of = [&](const Chosen& other) { return expected_error(other.rung, choices).error; };
    const double seconds = times_.predict(rung_->rung, choices);
    const bool is_quicker = seconds > rung_->too_long && times_.predict(chosen.rung, choices) < seconds;
    bool is_finer = seconds < rung_->too_short && error_of(chosen) < error_of(*rung_);
    // The next finer rung may be quicker than expected. It is tried once.
    if (seconds < rung_->too_short && !is_finer && !std::exchange(has_tried_, true)) {
      chosen = choose(choices, 2);
      is_finer = error_of(chosen) < error_of(*rung_);
    }
    if (!is_quicker && !is_finer) return rung_->rung;
  }
  rung_ = chosen;
  had_segments_ = rungs(choices).back().is_exact() ? std::optional(choices.cells->segments) : std::nullopt;
  return chosen.rung;
}

void MotionControl::add(const Outcome& outcome, const Choices& choices) {
  times_.add(outcome, choices);
  const Recipe& rung = outcome.recipe;
  if (outcome.expected_error && std::isfinite(*outcome.expected_error))
    model_ = *outcome.expected_error * by_count(rung.most_splats());
  if (!outcome.error || !std::isfinite(*outcome.error)) return;
  if (are_doubted_) forget_view();
  if (rung.is_exact()) {
    cell_errors_[rung.sample_spacing] = *outcome.error;
    if (rung.sample_spacing > 1)
      model_factor_ = std::max(model_factor_, *outcome.error / cells_by_model(rung.sample_spacing));
    if (choices.cells) measured_segments_ = choices.cells->segments;
    measured_direction_ = choices.direction;
  }
  if (!rung.is_exact()) splat_errors_[rung.most_splats()] = *outcome.error;
}

void MotionControl::forget_view() {
  cell_errors_.clear();
  splat_errors_.clear();
  measured_segments_ = 0;
  are_doubted_ = false;
}

void MotionControl::forget_errors() {
  forget_view();
  model_factor_ = 1;
}

}  // namespace splatvol
