#include "player/motion_control.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace splatvol {
namespace {

constexpr double smooth = 1.0 / 60;

constexpr Choices points = {.points = 1'000'000, .widest_spacing = 8, .pixels = 1'000'000};

Choices with_cells(double tetrahedra, double segments) {
  Choices choices = points;
  choices.cells = CellCounts{tetrahedra, segments};
  return choices;
}

// A machine of its own, and the true errors of a view.
struct Machine {
  double factor = 1;
  double splats_error = 0.37;   // times n^-.45
  double cells_error = 0.0002;  // with samples 2 pixels apart; 4 apart twice that, and so on

  [[nodiscard]] static double fragments(const Recipe& rung, const Choices& choices) {
    return 3 * std::cbrt(static_cast<double>(rung.most_splats())) * choices.pixels /
           (rung.sample_spacing * rung.sample_spacing);
  }
  [[nodiscard]] double seconds(const Recipe& rung, const Choices& choices) const {
    if (rung.is_exact()) return factor * 1e-9 * work_of_cells(*choices.cells, choices.pixels, rung.sample_spacing);
    return factor * 1e-9 *
           work_of_splats(static_cast<double>(rung.most_splats()), fragments(rung, choices), choices.pixels,
                          rung.sample_spacing);
  }
  [[nodiscard]] double error(const Recipe& rung) const {
    if (rung.is_exact()) return rung.sample_spacing == 1 ? 0 : 0.5 * cells_error * rung.sample_spacing;
    return splats_error * std::pow(static_cast<double>(rung.most_splats()), -0.45);
  }
  Recipe draw(MotionControl& control, const Choices& choices, double jitter = 1) const {
    const Recipe rung = *control.next(choices);
    control.add({.recipe = rung,
                 .fragments = rung.is_exact() ? 0 : fragments(rung, choices),
                 .seconds = jitter * seconds(rung, choices)},
                choices);
    return rung;
  }
  void teach(MotionControl& control, const Choices& choices) const {
    for (const Recipe& rung : MotionControl::rungs(choices)) {
      if (rung.is_exact() || rung.most_splats() == 23170) control.add({.recipe = rung, .error = error(rung)}, choices);
    }
  }
};

// The best of what the rule allows, by true times and errors.
Recipe best_by_the_rule(const Machine& machine, const Choices& choices, const MotionLimits& limits) {
  const std::vector<Recipe> all = MotionControl::rungs(choices);
  const auto best_of = [&](bool has_splats, double most_error, double most_seconds, const auto& is_better) {
    std::optional<Recipe> best;
    for (const Recipe& rung : all)
      if ((has_splats || rung.is_exact()) && machine.error(rung) <= most_error &&
          machine.seconds(rung, choices) <= most_seconds && (!best || is_better(rung, *best)))
        best = rung;
    return best;
  };
  const auto is_finer = [&](const Recipe& a, const Recipe& b) { return machine.error(a) < machine.error(b); };
  const auto is_quicker = [&](const Recipe& a, const Recipe& b) {
    return machine.seconds(a, choices) < machine.seconds(b, choices);
  };
  for (const bool has_splats : {false, true}) {
    if (const auto best = best_of(has_splats, limits.max_error, smooth, is_finer)) return *best;
    const double seconds = has_splats ? limits.seconds : 1.0 / 12;
    if (const auto best = best_of(has_splats, limits.max_error, seconds, is_quicker)) return *best;
  }
  if (const auto best = best_of(true, 0.03, limits.seconds, is_finer)) return *best;
  if (const auto best = best_of(true, 1, 2 * limits.seconds, is_finer)) return *best;
  return *best_of(true, 1, 1e9, is_quicker);
}

TEST(MotionControl, FindsTheRungOfItsRule) {
  const MotionLimits limits;
  for (const double factor : {0.2, 1.0, 3.0, 20.0})
    for (const Choices& choices : {points, with_cells(2e5, 2e7), with_cells(2e6, 3e7), with_cells(3e7, 3e8)})
      for (const double splats_error : {0.2, 0.8, 5.0}) {
        const Machine machine{.factor = factor, .splats_error = splats_error};
        MotionControl control;
        machine.teach(control, choices);
        // Each movement learns the times of what it draws.
        for (int movement = 0; movement < 12; ++movement) {
          static_cast<void>(machine.draw(control, choices));
          control.rest();
        }
        const Recipe found = *control.next(choices), wanted = best_by_the_rule(machine, choices, limits);
        const double seconds = machine.seconds(found, choices), error = machine.error(found);
        EXPECT_LE(seconds, 1.5 * std::max(machine.seconds(wanted, choices), smooth)) << factor << ' ' << splats_error;
        EXPECT_LE(error, 1.3 * std::max(machine.error(wanted), limits.max_error)) << factor << ' ' << splats_error;
      }
}

TEST(MotionControl, DrawsNoFalseColorForAFrame) {
  const Choices choices = with_cells(2e5, 3e7);
  const Machine machine{.factor = 2, .splats_error = 3};  // splats are poor here
  MotionControl control;
  machine.teach(control, choices);
  const Recipe rung = machine.draw(control, choices);
  EXPECT_TRUE(rung.is_exact());
  EXPECT_GT(machine.seconds(rung, choices), smooth);
  EXPECT_LE(machine.seconds(rung, choices), 0.1);
}

// As while steps play: nobody sees more pictures.
TEST(MotionControl, DrawsTheFinestInTheTimeThatIsSmooth) {
  const Choices choices = with_cells(2e5, 2e7);
  const Machine machine;
  MotionControl control;
  machine.teach(control, choices);
  EXPECT_GT(machine.draw(control, choices).sample_spacing, 1);
  const double seconds = 1.1 * machine.seconds(Recipe::of_cells(1), choices);
  ASSERT_GT(seconds, smooth);
  control.set_limits({.seconds = seconds, .smooth_seconds = seconds});
  EXPECT_EQ(*control.next(choices), Recipe::of_cells(1));
  control.set_limits({});
  EXPECT_GT(control.next(choices)->sample_spacing, 1);
}

// Right after opening, nothing is measured.
TEST(MotionControl, PrefersCellsAtFirst) {
  MotionControl control;
  EXPECT_TRUE(control.next(with_cells(2e5, 2e7))->is_exact());
  EXPECT_FALSE(control.next(points)->is_exact());
  EXPECT_FALSE(control.expected_error(Recipe::of_cells(4), with_cells(2e5, 2e7)).is_measured);
}

// A narrow function may have a much larger error than the model says.
TEST(MotionControl, DrawsFinerCellsUntilErrorsAreMeasured) {
  const Choices choices = with_cells(1e5, 4e6);
  const Machine machine{.cells_error = 1e-3};
  MotionControl control;
  const Recipe first = machine.draw(control, choices);
  ASSERT_TRUE(first.is_exact());
  EXPECT_GT(machine.seconds(first, choices), smooth);
  EXPECT_LE(machine.seconds(first, choices), 2 * smooth);
  machine.teach(control, choices);
  control.rest();
  const Recipe second = machine.draw(control, choices);
  EXPECT_GT(second.sample_spacing, first.sample_spacing);
  EXPECT_LE(machine.seconds(second, choices), smooth);
}

// Both have more than the wanted error.
TEST(MotionControl, CellsComeBeforeSplatsOfAboutTheirError) {
  const Choices choices = with_cells(1e6, 2e7);
  const MotionLimits limits{.max_error = 1e-4};
  for (const double advantage : {1.2, 3.0}) {
    MotionControl control(limits);
    for (const Recipe& rung : MotionControl::rungs(choices))
      control.add({.recipe = rung, .error = rung.is_exact() ? 0.002 * rung.sample_spacing : 0.004 / advantage},
                  choices);
    EXPECT_EQ(control.next(choices)->is_exact(), advantage < 1.5) << advantage;
  }
}

TEST(MotionControl, KeepsARungWithinAMovement) {
  for (const Choices& choices : {points, with_cells(2e5, 2e7), with_cells(2e6, 3e7)}) {
    const Machine machine;
    MotionControl control;
    machine.teach(control, choices);
    for (int picture = 0; picture < 5; ++picture) static_cast<void>(machine.draw(control, choices));
    const Recipe rung = *control.next(choices);
    for (const double jitter : {1.2, 0.9, 1.1, 0.85, 1.2, 0.9, 1.0})
      EXPECT_EQ(machine.draw(control, choices, jitter), rung) << jitter;
  }
}

TEST(MotionControl, FollowsAMachineThatChanges) {
  Machine machine{.splats_error = 0.2};
  MotionControl control;
  machine.teach(control, points);
  for (int picture = 0; picture < 10; ++picture) static_cast<void>(machine.draw(control, points));
  const Recipe before = *control.next(points);
  machine.factor = 30;
  for (int picture = 0; picture < 10; ++picture) static_cast<void>(machine.draw(control, points));
  const Recipe slower = *control.next(points);
  EXPECT_LT(machine.seconds(slower, points), machine.seconds(before, points));
  machine.factor = 1;
  for (int picture = 0; picture < 10; ++picture) static_cast<void>(machine.draw(control, points));
  EXPECT_GT(control.next(points)->most_splats(), slower.most_splats());
}

TEST(MotionControl, TakesCellsWhenTheyCome) {
  Choices choices = with_cells(1e5, 5e6);
  choices.cells.reset();
  const Machine machine;
  MotionControl control;
  EXPECT_FALSE(machine.draw(control, choices).is_exact());
  choices.cells = CellCounts{1e5, 5e6};
  EXPECT_TRUE(machine.draw(control, choices).is_exact());
  choices.cells.reset();
  EXPECT_FALSE(machine.draw(control, choices).is_exact());
}

TEST(MotionControl, CellsHaveNoMoreSegmentsThanTheyMay) {
  Choices choices = with_cells(1e6, 115e6);
  choices.most_segments = 60e6;
  std::vector<Recipe> rungs = MotionControl::rungs(choices);
  EXPECT_EQ(rungs.back(), (Recipe::of_cells(2)));
  choices.most_segments = 1e6;
  rungs = MotionControl::rungs(choices);
  EXPECT_FALSE(rungs.back().is_exact());
}

TEST(MotionControl, SplatsThatLackContoursGiveWayToCells) {
  Choices choices = with_cells(5e5, 6e7);
  const Machine machine{.splats_error = 0.1, .cells_error = 0.01};
  MotionControl control;
  machine.teach(control, choices);
  EXPECT_FALSE(control.next(choices)->is_exact());
  control.rest();
  control.forget_errors();
  choices.added_error = 0.05;
  EXPECT_TRUE(control.next(choices)->is_exact());
}

TEST(MotionControl, ExpectsWhatWasMeasuredNearby) {
  MotionControl control;
  control.add({.recipe = Recipe::of_splats(1000, 4), .expected_error = 0.2}, points);
  EXPECT_NEAR(control.expected_error(Recipe::of_splats(1000, 4), points).error, 0.2, 1e-9);
  EXPECT_NEAR(control.expected_error(Recipe::of_splats(4000, 4), points).error, 0.2 * std::pow(4, -0.45), 1e-9);
  control.add({.recipe = Recipe::of_splats(1000, 4), .error = 0.01}, points);
  EXPECT_NEAR(control.expected_error(Recipe::of_splats(1000, 4), points).error, 0.01, 1e-9);
  EXPECT_TRUE(control.expected_error(Recipe::of_splats(1400, 4), points).is_measured);
  EXPECT_FALSE(control.expected_error(Recipe::of_splats(4000, 4), points).is_measured);
  control.doubt_errors();
  EXPECT_GT(control.expected_error(Recipe::of_splats(1000, 4), points).error, 0.01);
  EXPECT_FALSE(control.expected_error(Recipe::of_splats(1000, 4), points).is_measured);
  control.forget_errors();
  EXPECT_FALSE(control.expected_error(Recipe::of_splats(1000, 4), points).is_measured);
  EXPECT_EQ(control.expected_error(Recipe::of_cells(1), points).error, 0);
}

// Where nothing was seen, closer samples had no less error. Elsewhere they have.
TEST(MotionControl, DoesNotTrustTheErrorsOfAnotherView) {
  const Choices near = with_cells(1e3, 1e4), far = with_cells(1e3, 1e5);
  MotionControl control;
  for (const int spacing : {2, 4, 8, 16}) control.add({.recipe = Recipe::of_cells(spacing), .error = 0}, near);
  EXPECT_TRUE(control.expected_error(Recipe::of_cells(8), near).is_measured);
  EXPECT_EQ(control.next(near), (Recipe::of_cells(1))) << "all are quick";
  EXPECT_FALSE(control.expected_error(Recipe::of_cells(8), far).is_measured);
  EXPECT_GT(control.expected_error(Recipe::of_cells(8), far).error, 0.002);
}

// A narrow function has larger errors than most, in other views, too.
// A key shows the data from another side.
TEST(MotionControl, DoesNotTrustTheErrorsOfAnotherDirection) {
  Choices choices = with_cells(2e5, 2e7);
  const Machine machine{.cells_error = 1e-5};
  MotionControl control;
  machine.teach(control, choices);
  const double measured = control.expected_error(Recipe::of_cells(8), choices).error;
  choices.direction = glm::normalize(dvec3(0.2, 0, 1));
  EXPECT_TRUE(control.expected_error(Recipe::of_cells(8), choices).is_measured);
  choices.direction = {1, 0, 0};
  EXPECT_GT(control.expected_error(Recipe::of_cells(8), choices).error, 10 * measured);
  EXPECT_FALSE(control.expected_error(Recipe::of_cells(8), choices).is_measured);
}

TEST(MotionControl, RemembersThatErrorsAreLarge) {
  const Choices near = with_cells(1e3, 1e4), far = with_cells(1e3, 1e5);
  MotionControl control;
  control.add({.recipe = Recipe::of_cells(4), .error = 0.02}, near);
  EXPECT_GE(control.expected_error(Recipe::of_cells(4), far).error, 0.02);
  EXPECT_GT(control.expected_error(Recipe::of_cells(2), far).error, 0.005);
  control.forget_errors();
  EXPECT_LT(control.expected_error(Recipe::of_cells(4), far).error, 0.005);
}

TEST(MotionControl, AsksForErrorsWhereSplatsMayServe) {
  const Machine machine;
  MotionControl control;
  const Choices few = with_cells(1e4, 1e6);
  machine.teach(control, few);
  EXPECT_TRUE(control.unmeasured(few).empty()) << "cells are smooth";
  const Choices many = with_cells(2e7, 1e8);
  control.forget_errors();
  const std::vector<Recipe> asked = control.unmeasured(many);
  ASSERT_FALSE(asked.empty());
  for (const Recipe& rung : asked) control.add({.recipe = rung, .error = machine.error(rung)}, many);
  EXPECT_TRUE(control.unmeasured(many).empty());
}

}  // namespace
}  // namespace splatvol
