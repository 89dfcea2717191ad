// How long a rung takes on this machine.
#pragma once

#include <map>
#include <optional>
#include <utility>

#include "player/recipe.h"

namespace splatvol {

/// Predicts the time of a rung: its counted work (renderer/work.h) times factors of the machine, learned from picture
/// to picture.
class DrawingTimes {
 public:
  /// Returns the counted work, in nanoseconds of the machine of renderer/work.h.
  [[nodiscard]] double work(const Recipe& rung, const Choices& choices) const;

  /// Returns seconds.
  [[nodiscard]] double predict(const Recipe& rung, const Choices& choices) const;

  /// Adds the time of a picture with all of its parts. Ignores times of 0 or less.
  void add(const Outcome& outcome, const Choices& choices);

  /// Whether a time was added.
  [[nodiscard]] bool is_measured() const { return kind_.has_value(); }

 private:
  using Kind = std::pair<bool, int>;  // is exact; the spacing of samples
  [[nodiscard]] double ratio_of(const Kind& kind) const;
  static Kind kind_of(const Recipe& rung) { return {rung.is_exact(), rung.sample_spacing}; }

  double layers_ = 2;      // layers_of_one_splat
  double machine_ = 1e-9;  // seconds of a unit of work

  // [sample spacing]: the segments of cells over those that samples so far apart have. Refined samples have more.
  std::map<int, double> refined_;

  // The factors of kinds of rungs. Each is learned by the first picture of its kind after one of another kind.
  std::map<Kind, double> ratios_;
  std::optional<Kind> kind_;  // of the last picture
};

}  // namespace splatvol
