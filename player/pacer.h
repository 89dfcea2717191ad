// Chooses what to draw in a wanted time: a rung of a ladder that is the same on all machines.
#pragma once

#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "renderer/work.h"

namespace splatvol {

/// The most pixels from one sample to the next in a picture of a wanted time.
inline constexpr int widest_samples_in_a_time = 4;

/// What is drawn: a number of splats, or the cells that a file keeps, and the distance of samples. Its picture does not
/// depend on how it was found.
struct Rung {
  std::uint64_t splats = 0;  // at most; 0: cells
  int sample_spacing = 1;

  [[nodiscard]] bool is_exact() const { return splats == 0; }
  [[nodiscard]] bool operator==(const Rung&) const = default;
};

/// What can be drawn of a view.
struct Choices {
  std::uint64_t points = std::numeric_limits<std::uint32_t>::max();  // that can be drawn
  std::uint64_t least_splats = 1;
  int finest_spacing = 1, widest_spacing = widest_samples_in_a_time;
  double pixels = 512 * 512;
  std::optional<CellCounts> cells = {};  // none: they cannot be drawn
};

/// Predicts the time of a rung: its counted work (renderer/work.h) times factors of the machine, learned from picture
/// to picture.
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
  [[nodiscard]] bool fits(const Rung& rung, const Choices& choices) const { return predict(rung, choices) <= seconds_; }

  /// Adds the time of a rung that was drawn with all of its parts. `fragments`: as FrameTimes counts them; of cells 0.
  /// Ignores times of 0 or less.
  void add(const Rung& rung, const Choices& choices, double fragments, double seconds);

 private:
  using Kind = std::pair<bool, int>;  // is exact; the spacing of samples
  static Kind kind_of(const Rung& rung) { return {rung.is_exact(), rung.sample_spacing}; }
  [[nodiscard]] double work(const Rung& rung, const Choices& choices) const;
  [[nodiscard]] double predict(const Rung& rung, const Choices& choices) const;

  double seconds_;
  std::optional<Rung> rung_;  // the last one
  double layers_ = 2;         // layers_of_one_splat
  double machine_ = 1e-9;     // seconds of a unit of work

  // The factors of kinds of rungs. Each is learned by the first picture of its kind after one of another kind.
  std::map<Kind, double> ratios_;
  std::optional<Kind> kind_;  // of the last picture
};

}  // namespace splatvol
