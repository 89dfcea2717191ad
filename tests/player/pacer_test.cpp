#include "player/pacer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace splatvol {
namespace {

constexpr Choices million = {.points = 1'000'000};
constexpr Choices with_cells = {.points = 100'000, .cells = CellCounts{2'000'000, 30'000'000}};

std::ptrdiff_t place_of(const Recipe& rung, const std::vector<Recipe>& ladder) {
  return std::ranges::find(ladder, rung) - ladder.begin();
}

Outcome outcome_of(const Recipe& rung, double fragments, double seconds) {
  return {.recipe = rung, .fragments = fragments, .seconds = seconds};
}

// A machine of its own: it takes more or less time for each kind of work than the pacer believes.
struct Machine {
  double factor;

  [[nodiscard]] static double layers(const Recipe& rung) {
    return 3 * std::cbrt(static_cast<double>(rung.most_splats()));
  }
  [[nodiscard]] static double fragments(const Recipe& rung, const Choices& choices) {
    return layers(rung) * choices.pixels / (rung.sample_spacing * rung.sample_spacing);
  }
  [[nodiscard]] double seconds(const Recipe& rung, const Choices& choices) const {
    const double samples = 1.0 / (rung.sample_spacing * rung.sample_spacing);
    if (rung.is_exact())
      return factor * (2e-8 * static_cast<double>(choices.cells->tetrahedra) +
                       1e-8 * static_cast<double>(choices.cells->segments) * samples);
    return factor * (2e-4 + 6e-8 * static_cast<double>(rung.most_splats()) + 1.7e-9 * fragments(rung, choices));
  }

  // Draws a picture, and tells the pacer.
  Recipe draw(Pacer& pacer, const Choices& choices, double jitter = 1) const {
    const Recipe rung = *pacer.next(choices);
    pacer.add(outcome_of(rung, rung.is_exact() ? 0 : fragments(rung, choices), jitter * seconds(rung, choices)),
              choices);
    return rung;
  }
};

TEST(Pacer, SamplesComeCloserBeforeSplatsAreMany) {
  for (const std::uint64_t points : {1u, 100u, 5000u, 40'000u, 1'000'000u, 4'000'000'000u}) {
    const Choices choices = {.points = points};
    const std::vector<Recipe> ladder = Pacer(1).ladder(choices);
    EXPECT_EQ(ladder.back(), Recipe::of_splats(points, 1));
    for (std::size_t i = 1; i < ladder.size(); ++i) {
      EXPECT_GE(ladder[i].most_splats(), ladder[i - 1].most_splats()) << points;
      EXPECT_LE(static_cast<double>(ladder[i].most_splats()), 1.43 * static_cast<double>(ladder[i - 1].most_splats()))
          << points;
      EXPECT_LE(ladder[i].sample_spacing, ladder[i - 1].sample_spacing) << points;
      EXPECT_NE(ladder[i], ladder[i - 1]);
    }
    for (const Recipe& rung : ladder)
      EXPECT_TRUE(rung.sample_spacing == widest_samples_in_a_time || rung.most_splats() > 20'000 ||
                  rung.most_splats() == points);
  }
}

TEST(Pacer, EachRungIsMoreWork) {
  for (const Choices& choices : {million, with_cells}) {
    const auto work = [&](const Recipe& rung) { return DrawingTimes().work(rung, choices); };
    EXPECT_TRUE(std::ranges::is_sorted(Pacer(1).ladder(choices), {}, work));
  }
}

TEST(Pacer, CellsStandAboveSplatsOfLessWork) {
  const std::vector<Recipe> ladder = Pacer(1).ladder(with_cells);
  ASSERT_GT(ladder.size(), 20U);
  EXPECT_EQ(ladder.back(), Recipe::of_cells(1));
  EXPECT_EQ(ladder[ladder.size() - 2], Recipe::of_cells(2));
  EXPECT_EQ(ladder[ladder.size() - 3], Recipe::of_splats(100'000, 1))
      << "samples farther apart are as much work as all points";

  Choices few_cells = with_cells;
  few_cells.cells = CellCounts{50'000, 1'000'000};
  const std::vector<Recipe> short_ladder = Pacer(1).ladder(few_cells);
  EXPECT_EQ(short_ladder[short_ladder.size() - 3], Recipe::of_cells(4));
  EXPECT_LT(short_ladder[short_ladder.size() - 4].most_splats(), 100'000u);

  Choices small_cells = with_cells;
  small_cells.cells = CellCounts{100'000, 1'000'000};
  for (const Recipe& rung : Pacer(1).ladder(small_cells))
    EXPECT_NE(rung, Recipe::of_cells(4)) << "most would have no sample";
}

TEST(Pacer, KeepsToTheSamplesThatAreAllowed) {
  const Choices wide = {.points = 50'000, .finest_spacing = 8, .widest_spacing = 8, .cells = with_cells.cells};
  for (const Recipe& rung : Pacer(1).ladder(wide)) EXPECT_EQ(rung.sample_spacing, 8);
  const Choices surfaces = {.points = 50'000, .least_splats = 32'768, .widest_spacing = 1};
  EXPECT_EQ(Pacer(1).ladder(surfaces),
            (std::vector{Recipe::of_splats(32'768, 1), Recipe::of_splats(46'341, 1), Recipe::of_splats(50'000, 1)}));
}

TEST(Pacer, FindsTheRungOfItsTimeOnAnyMachine) {
  constexpr double wanted = 0.02;
  for (const double factor : {0.03, 0.1, 0.5, 1.0, 2.0, 8.0, 50.0})
    for (const Choices& choices : {million, with_cells}) {
      const Machine machine{factor};
      Pacer pacer(wanted);
      Recipe rung;
      for (int picture = 0; picture < 40; ++picture) rung = machine.draw(pacer, choices);
      const std::vector<Recipe> ladder = pacer.ladder(choices);
      const std::ptrdiff_t at = place_of(rung, ladder);
      EXPECT_EQ(pacer.next(choices), rung) << "it has come to rest";
      if (at > 0) {
        EXPECT_LE(machine.seconds(rung, choices), 1.2 * wanted) << factor;
      }
      if (rung != ladder.back()) {
        EXPECT_GT(machine.seconds(ladder[static_cast<std::size_t>(at) + 1], choices), 0.7 * wanted) << factor;
      }
    }
}

TEST(Pacer, MovesByTwoRungsAtMost) {
  for (const Choices& choices : {million, with_cells})
    for (const double slower : {1.5, 0.7, 20.0, 0.01}) {
      Machine machine{1};
      Pacer pacer(0.02);
      for (int picture = 0; picture < 40; ++picture) static_cast<void>(machine.draw(pacer, choices));
      Recipe before = machine.draw(pacer, choices);
      machine.factor = slower;
      for (int picture = 0; picture < 40; ++picture) {
        const std::vector<Recipe> ladder = pacer.ladder(choices);
        const Recipe rung = machine.draw(pacer, choices);
        EXPECT_LE(std::abs(place_of(rung, ladder) - place_of(before, ladder)), 2) << slower;
        before = rung;
      }
      pacer.leap();
      const std::vector<Recipe> ladder = pacer.ladder(choices);
      EXPECT_LE(std::abs(place_of(*pacer.next(choices), ladder) - place_of(before, ladder)), 1) << "it was there";
    }
}

// Pictures of other rungs look different: they do not come in turns.
TEST(Pacer, StaysWhereTimesDifferALittle) {
  for (const Choices& choices : {million, with_cells}) {
    Pacer pacer(0.02);
    const Machine machine{1};
    for (int picture = 0; picture < 40; ++picture) static_cast<void>(machine.draw(pacer, choices));
    const Recipe rung = *pacer.next(choices);
    for (const double jitter : {1.03, 0.98, 1.02, 0.97, 1.03, 0.99})
      EXPECT_EQ(machine.draw(pacer, choices, jitter), rung);
  }
}

// One picture of a kind took long by chance, or there was nothing to draw. Later the kind is tried again.
TEST(Pacer, ForgetsAMishap) {
  Choices choices = with_cells, nothing = with_cells;
  choices.cells = CellCounts{1'000'000, 20'000'000};
  nothing.cells = CellCounts{};
  const Machine machine{0.1};
  Pacer pacer(0.02);
  for (int picture = 0; picture < 40; ++picture) static_cast<void>(machine.draw(pacer, choices));
  ASSERT_TRUE(pacer.next(choices)->is_exact());
  for (const Recipe& slow : pacer.ladder(choices)) pacer.add(outcome_of(slow, slow.is_exact() ? 0 : 1e6, 5), choices);
  for (int picture = 0; picture < 5; ++picture) pacer.add(outcome_of(Recipe::of_cells(1), 0, 3e-3), nothing);
  int pictures = 0;
  while (!machine.draw(pacer, choices).is_exact()) ASSERT_LT(++pictures, 1000);
  EXPECT_GT(pictures, 1);
  for (int picture = 0; picture < 40; ++picture) EXPECT_TRUE(machine.draw(pacer, choices).is_exact());
}

TEST(Pacer, LeavesTimeForSurfaces) {
  const auto splats_in = [](double surfaces_seconds) {
    Choices choices = million;
    choices.surfaces_seconds = surfaces_seconds;
    Pacer pacer(0.02);
    Recipe rung;
    for (int picture = 0; picture < 40; ++picture) rung = Machine{1}.draw(pacer, choices);
    return rung.most_splats();
  };
  EXPECT_LT(splats_in(0.015), splats_in(0) / 2);
  EXPECT_EQ(splats_in(0.05), Pacer(1).ladder(million).front().most_splats()) << "there is no time left";
}

// Where samples are refined, pictures of wide ones take about as long as those of all.
TEST(Pacer, CountsRefinedSamples) {
  Choices choices{.cells = CellCounts{100'000, 10'000'000}, .has_splats = false};
  Pacer pacer(0.1);
  ASSERT_EQ(pacer.next(choices), Recipe::of_cells(4));
  Outcome outcome = outcome_of(Recipe::of_cells(4), 0, 0.05);
  outcome.segments = 8'000'000;
  pacer.add(outcome, choices);
  EXPECT_EQ(pacer.next(choices), Recipe::of_cells(1));
}

TEST(Pacer, StaysOnTheLadderWhateverItIsTold) {
  for (const double seconds : {1e-300, 1e300}) {
    Pacer pacer(seconds);
    for (const double told : {10.0, 1e-12, 0.0, -1.0, 1e300})
      for (int picture = 0; picture < 50; ++picture) {
        const Recipe rung = *pacer.next(with_cells);
        EXPECT_LT(place_of(rung, pacer.ladder(with_cells)), std::ssize(pacer.ladder(with_cells)));
        pacer.add(outcome_of(rung, 1e5, told), with_cells);
      }
  }
}

}  // namespace
}  // namespace splatvol
