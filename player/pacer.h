// Chooses what to draw in a wanted time: a rung of a ladder that is the same on all machines.
#pragma once

#include <optional>
#include <vector>

#include "player/drawing_times.h"
#include "player/rung.h"

namespace splatvol {

/// Chooses by predicted times (DrawingTimes), learned from picture to picture.
class Pacer {
 public:
  /// Requires `seconds` to be finite and above 0, here and in `set_seconds`.
  explicit Pacer(double seconds) : seconds_(seconds) {}

  /// Changes the time that pictures are to take.
  void set_seconds(double seconds) { seconds_ = seconds; }
  [[nodiscard]] double seconds() const { return seconds_; }

  /// Returns the rungs of a view, from the fewest splats to cells. Splats that are predicted to take longer than cells
  /// are left out.
  [[nodiscard]] std::vector<Rung> ladder(const Choices& choices) const;

  /// Returns the finest rung that there is time for, at most two from the one before. Stays while there is about the
  /// right time for it. The first one may be any of splats.
  [[nodiscard]] Rung next(const Choices& choices);

  /// Lets the next rung be any.
  void leap() { rung_.reset(); }

  /// Whether a rung's predicted time is short enough.
  [[nodiscard]] bool fits(const Rung& rung, const Choices& choices) const {
    return times_.predict(rung, choices) <= seconds_;
  }

  /// As DrawingTimes::add.
  void add(const Rung& rung, const Choices& choices, double fragments, double seconds) {
    times_.add(rung, choices, fragments, seconds);
  }

 private:
  double seconds_;
  std::optional<Rung> rung_;  // the last one
  DrawingTimes times_;
};

}  // namespace splatvol
