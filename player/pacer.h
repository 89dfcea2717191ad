// Chooses what to draw in a wanted time.
#pragma once

#include <optional>
#include <vector>

#include "player/drawing_times.h"
#include "player/recipe.h"

namespace splatvol {

/// The part of a picture's time that the drawing of splats may take. The rest is for choosing them.
inline constexpr double drawing_share = 0.7;

/// Chooses by predicted times (DrawingTimes), learned from picture to picture. There is always another picture.
class Pacer final : public Chooser {
 public:
  /// `seconds`: of drawing. Requires them to be finite and above 0, here and in `set_seconds`.
  explicit Pacer(double seconds) : seconds_(seconds) {}

  /// Changes the time. If it is another one, the next rung may be any.
  void set_seconds(double seconds) {
    if (seconds != seconds_) leap();
    seconds_ = seconds;
  }

  /// Returns the rungs of a view, from the fewest splats to cells. Splats that are predicted to take longer than cells
  /// are left out.
  [[nodiscard]] std::vector<Recipe> ladder(const Choices& choices) const;

  /// Returns the finest rung that there is time for, at most two from the one before. Stays while there is about the
  /// right time for it. The first one may be any of splats.
  [[nodiscard]] std::optional<Recipe> next(const Choices& choices) override;

  /// As DrawingTimes::add.
  void add(const Outcome& outcome, const Choices& choices) override { times_.add(outcome, choices); }
  [[nodiscard]] Needs needs() const override {
    return {.cells = Cells::near, .widest_spacing = widest_samples_in_a_time, .seconds = seconds_ / drawing_share};
  }

  /// Lets the next rung be any.
  void leap() { rung_.reset(); }

 private:
  double seconds_;
  std::optional<Recipe> rung_;  // the last one
  DrawingTimes times_;
};

/// Finds what can be drawn in a time, in a few pictures with all of their parts.
class PaceSearch final : public Chooser {
 public:
  /// As Pacer.
  explicit PaceSearch(double seconds) : pacer_(seconds) {}

  [[nodiscard]] std::optional<Recipe> next(const Choices& choices) override;
  void add(const Outcome& outcome, const Choices& choices) override;
  [[nodiscard]] Needs needs() const override {
    return {.cells = Cells::all, .widest_spacing = widest_samples_in_a_time, .steady_time = true};
  }

  /// Returns the rungs that were drawn, the wanted one at the end.
  [[nodiscard]] const std::vector<Recipe>& drawn() const { return drawn_; }

 private:
  Pacer pacer_;
  Recipe asked_;
  std::vector<Recipe> drawn_;
};

}  // namespace splatvol
