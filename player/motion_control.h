// Chooses what is drawn while something moves: its error first, and then frames.
#pragma once

#include <cstdint>
#include <map>
#include <optional>

#include "player/drawing_times.h"
#include "player/recipe.h"

namespace splatvol {

/// How good pictures are to be while something moves.
struct MotionLimits {
  double max_error = 0.002;  // root mean square of linear RGB; expected
  double seconds = 0.1;      // that a picture of this error may take

  // A picture that takes no longer is smooth: the finest of these is drawn. Where no errors were measured, it may take
  // twice that time, to be sure.
  double smooth_seconds = 1.0 / 60;

  [[nodiscard]] bool operator==(const MotionLimits&) const = default;
};

/// Draws cells if some distance of samples has the wanted error at 12 pictures a second: the finest that is smooth, or
/// else the quickest. If none has, splats may be drawn, too: the finest that is smooth, or the quickest in `seconds`,
/// that has the error. If there is none, draws what has the least error in
/// `seconds`, or in twice that time if its error would show as a false colour. Within a movement a rung stays, unless
/// it takes much more or less time than it may, or much more or less is in view.
///
/// Expects errors by what was measured at rest, and until then by a rough model. Expects times by DrawingTimes.
class MotionControl final : public Chooser {
 public:
  explicit MotionControl(const MotionLimits& limits = {}) : limits_(limits) {}

  /// Other limits begin another movement. Requires numbers above 0.
  void set_limits(const MotionLimits& limits) {
    if (limits_ != limits) rest();
    limits_ = limits;
  }

  /// There is always another picture.
  [[nodiscard]] std::optional<Recipe> next(const Choices& choices) override;

  /// Adds what came of a picture, at rest or while something moves.
  void add(const Outcome& outcome, const Choices& choices) override;
  [[nodiscard]] Needs needs() const override {
    return {.cells = Cells::near, .widest_spacing = widest_moving_samples, .seconds = limits_.seconds};
  }

  /// Ends a movement: the next rung may be any.
  void rest() {
    rung_.reset();
    has_tried_ = false;
  }

  /// Tells that pictures differ by more than their view from now on: measured errors hold roughly.
  void doubt_errors() { are_doubted_ = true; }

  /// Forgets measured errors: others will be added.
  void forget_view();

  /// Forgets all that is known of errors: pictures show something else.
  void forget_errors();

  struct Expected {
    double error = 0;
    bool is_measured = false;  // in about this view
  };
  [[nodiscard]] Expected expected_error(const Recipe& rung, const Choices& choices) const;

  /// Returns seconds.
  [[nodiscard]] double expected_seconds(const Recipe& rung, const Choices& choices) const {
    return times_.predict(rung, choices);
  }

  /// Returns rungs of splats whose errors are worth measuring in this view. None where cells serve.
  [[nodiscard]] std::vector<Recipe> unmeasured(const Choices& choices) const;

  /// Returns the rungs of a view.
  [[nodiscard]] static std::vector<Recipe> rungs(const Choices& choices);

 private:
  struct Chosen {
    Recipe rung;
    double too_long, too_short;  // seconds
  };
  [[nodiscard]] Chosen choose(const Choices& choices, double patience = 1) const;
  [[nodiscard]] bool may_stay(const Choices& choices) const;
  [[nodiscard]] bool is_another_view(const Choices& choices) const;
  [[nodiscard]] bool are_errors_known(const Choices& choices) const;
  [[nodiscard]] Expected expected_of_cells(int sample_spacing, const Choices& choices) const;

  MotionLimits limits_;
  DrawingTimes times_;
  std::optional<Chosen> rung_;          // of this movement
  std::optional<double> had_segments_;  // of cells, then; none: there were no cells to choose from
  bool has_tried_ = false;              // a rung that was expected to take too long, in this movement

  std::map<int, double> cell_errors_;             // [sample spacing]
  std::map<std::uint64_t, double> splat_errors_;  // [splats]
  double measured_segments_ = 0;                  // of cells, in the view of cell_errors_
  dvec3 measured_direction_ = {0, 0, 1};          // of that view
  double model_factor_ = 1;                       // the largest by which errors of cells exceeded the model
  bool are_doubted_ = false;                      // the measured errors
  std::optional<double> model_;                   // of the last splats: their error times their number^decay
};

}  // namespace splatvol
