// Plays the steps of a series.
#pragma once

#include <cstddef>
#include <optional>

namespace splatvol {

/// Says which step is shown next while steps play, and when.
class Playing {
 public:
  double steps_per_second = 5;  // at most
  bool loops = false;           // goes on with the first step after the last

  [[nodiscard]] bool is_begun() const { return seconds_.has_value(); }
  void begin();
  void end() { seconds_.reset(); }

  /// Returns the step that comes after `step`; none after the last, unless it loops. `count`: of all steps.
  [[nodiscard]] std::optional<std::size_t> after(std::size_t step, std::size_t count) const {
    if (step + 1 < count) return step + 1;
    return loops ? std::optional<std::size_t>(0) : std::nullopt;
  }

  /// Returns the step after the one that is shown. At the end, and if another step came than was awaited, there is
  /// none, and steps do not play any more. `count`: of all steps.
  [[nodiscard]] std::optional<std::size_t> next(std::size_t shown, std::size_t count);

  /// Counts the time since the last call, also while a picture is drawn. Requires that steps play.
  void pass(double seconds) { *seconds_ += seconds; }

  /// Whether the time of the step that is shown has passed. Until the next step is ready, the time waits. On the
  /// average, the rate is kept.
  [[nodiscard]] bool is_due(bool is_ready);

  /// Returns how many seconds the picture of a step may take: time is left to show it.
  [[nodiscard]] double picture_seconds() const { return 0.8 / steps_per_second; }

  /// Says that a step was asked for, and will be shown later.
  void await(std::size_t step) { awaited_ = step; }

 private:
  std::optional<double> seconds_;  // since the last change; none: steps do not play
  std::optional<std::size_t> awaited_;
};

}  // namespace splatvol
