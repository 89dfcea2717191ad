// Chooses what is drawn while something moves: its error first, and then frames.
#pragma once

#include <cstdint>
#include <map>
#include <optional>

#include "player/drawing_times.h"
#include "player/rung.h"

namespace splatvol {

/// How good pictures are to be while something moves.
struct MotionLimits {
  double max_error = 0.002;  // root mean square of linear RGB; expected
  double seconds = 0.1;      // that a picture of this error may take

  [[nodiscard]] bool operator==(const MotionLimits&) const = default;
};

/// Draws at 60 pictures a second if the best of these has the wanted error. Else it draws the quickest that has it,
/// down to `seconds` a picture. If there is none, it draws the best in `seconds`, and in twice that time if its error
/// would show as a false colour. Within a movement a rung stays, unless it takes much more or less time than it may.
///
/// Expects errors by what was learned at rest, and until then by a rough model. Expects times by DrawingTimes.
class MotionControl {
 public:
  explicit MotionControl(const MotionLimits& limits = {}) : limits_(limits) {}

  /// Requires numbers above 0.
  void set_limits(const MotionLimits& limits) { limits_ = limits; }

  /// Returns what to draw next.
  [[nodiscard]] Rung next(const Choices& choices);

  /// What came of a picture, at rest or while something moves.
  struct Outcome {
    Rung rung;
    double fragments = 0;                    // as DrawingTimes::add
    double seconds = 0;                      // 0: not known, as some parts were read or are missing
    std::optional<double> model_error = {};  // of splats: what the file's index tells of the error
    std::optional<double> error = {};        // measured
  };
  void add(const Outcome& outcome, const Choices& choices);

  /// Ends a movement: the next rung may be any.
  void rest() { rung_.reset(); }

  /// Forgets measured errors: the next pictures differ by more than their view.
  void forget_errors();

  struct Expected {
    double error = 0;
    bool is_measured = false;  // in about this view
  };
  [[nodiscard]] Expected expected_error(const Rung& rung, const Choices& choices) const;

  /// Returns seconds.
  [[nodiscard]] double expected_seconds(const Rung& rung, const Choices& choices) const {
    return times_.predict(rung, choices);
  }

  /// Returns rungs of splats whose errors are worth measuring in this view. None where cells serve.
  [[nodiscard]] std::vector<Rung> unmeasured(const Choices& choices) const;

  /// Returns the rungs of a view.
  [[nodiscard]] static std::vector<Rung> rungs(const Choices& choices);

 private:
  struct Chosen {
    Rung rung;
    double too_long, too_short;  // seconds
  };
  [[nodiscard]] Chosen choose(const Choices& choices) const;

  MotionLimits limits_;
  DrawingTimes times_;
  std::optional<Chosen> rung_;  // of this movement
  bool had_cells_ = false;      // to choose from, then

  std::map<int, double> cell_errors_;             // [sample spacing]
  std::map<std::uint64_t, double> splat_errors_;  // [splats]
  std::optional<double> model_;                   // of the last splats: their error times their number^decay
};

}  // namespace splatvol
