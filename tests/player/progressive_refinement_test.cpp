// How a picture at rest gets finer.
#include "player/progressive_refinement.h"

#include <gtest/gtest.h>

#include <cmath>

namespace splatvol {
namespace {

Image one_pixel(double grey) {
  const auto level = static_cast<float>(grey);
  return {1, 1, {vec4(level, level, level, 1)}};
}

// Draws the next picture, of splats.
void draw(ProgressiveRefinement& refinement, std::uint64_t splats, const Image& picture = one_pixel(0)) {
  refinement.add({.recipe = *refinement.next({}), .splats = splats, .picture = &picture}, {});
}

TEST(ProgressiveRefinement, HalvesATolerance) {
  ProgressiveRefinement refinement({.splats = Quality{.tolerance_percent = 1.5}});
  std::vector<double> tolerances;
  while (!refinement.is_done()) {
    tolerances.push_back(refinement.detail().tolerance_percent);
    ASSERT_LT(tolerances.size(), 10U);
    draw(refinement, 100);
  }
  EXPECT_EQ(tolerances, (std::vector<double>{4, 2, 1.5}));
  EXPECT_FALSE(refinement.error());
}

TEST(ProgressiveRefinement, DrawsAllPointsAtOnce) {
  ProgressiveRefinement refinement({.splats = Quality{.tolerance_percent = 0}});
  EXPECT_EQ(refinement.detail().tolerance_percent, 0);
  draw(refinement, 100);
  EXPECT_TRUE(refinement.is_done());
}

TEST(ProgressiveRefinement, DrawsSplatsAndResolutionsAtOnce) {
  ProgressiveRefinement splats({.splats = Quality{.max_splats = 300}});
  EXPECT_EQ(splats.detail().goal, (ErrorGoal{0, 300}));
  draw(splats, 300);
  EXPECT_TRUE(splats.is_done());
  EXPECT_FALSE(splats.seeks_error());

  ProgressiveRefinement resolution({.splats = Quality{.resolution = 2}});
  EXPECT_EQ(resolution.detail().resolution, 2U);
  draw(resolution, 300);
  EXPECT_TRUE(resolution.is_done());
}

TEST(ProgressiveRefinement, GrowsUntilPicturesDifferByLittle) {
  ProgressiveRefinement refinement({.splats = Quality{.max_error = 0.01}, .first_splats = 1000});
  double grey = 0;
  std::uint64_t before = 0;
  int pictures = 0;
  for (; !refinement.is_done(); ++pictures) {
    ASSERT_LT(pictures, 20);
    const std::uint64_t splats = refinement.detail().goal->max_splats;
    EXPECT_GT(splats, before);
    EXPECT_TRUE(pictures > 0 || splats == 1000);
    grey = 0.5 + 3 / std::sqrt(splats);
    draw(refinement, splats, one_pixel(grey));
    before = splats;
  }
  EXPECT_GE(pictures, 3);
  EXPECT_TRUE(refinement.has_reached());
  EXPECT_LE(grey, 0.5 + 0.0125);
  EXPECT_NEAR(*refinement.error(), 3 / std::sqrt(before), 0.005);
}

TEST(ProgressiveRefinement, EndsWhereMemoryDoes) {
  ProgressiveRefinement refinement({.splats = Quality{.max_error = 0.001}, .first_splats = 1000});
  int pictures = 0;
  for (; !refinement.is_done(); ++pictures) {
    ASSERT_LT(pictures, 20);
    Recipe allowed = *refinement.next({});
    std::uint64_t& splats = allowed.splats->goal->max_splats;
    splats = std::min<std::uint64_t>(splats, 5000);
    const Image picture = one_pixel(0.5 + 3 / std::sqrt(splats));
    refinement.add({.recipe = allowed, .splats = splats, .picture = &picture}, {});
  }
  EXPECT_LE(pictures, 4);
  EXPECT_FALSE(refinement.has_reached());
  EXPECT_GT(*refinement.error(), 0.001);
}

// Returns the distances of samples in the pictures of cells.
std::vector<int> spacings_of(ProgressiveRefinement& refinement, const Choices& choices) {
  std::vector<int> spacings;
  while (const auto recipe = refinement.next(choices)) {
    EXPECT_TRUE(recipe->is_exact());
    spacings.push_back(recipe->sample_spacing);
    refinement.add({.recipe = *recipe}, choices);
  }
  refinement.skip_cells();
  EXPECT_TRUE(refinement.is_done());
  return spacings;
}

TEST(ProgressiveRefinement, CellsFollowSplatsUntilTheyAreTooMuchWork) {
  Choices choices{.widest_spacing = 8, .cells = CellCounts{1000, 1e6}, .most_segments = 1e6};
  const auto spacings = [&](const ProgressiveRefinement::Start& start) {
    ProgressiveRefinement refinement(start);
    if (start.splats) {
      EXPECT_FALSE(refinement.next(choices)->is_exact());
      EXPECT_EQ(refinement.needs().cells, Chooser::Cells::none);
      refinement.add({.recipe = *refinement.next(choices), .splats = 10}, choices);
    }
    EXPECT_TRUE(refinement.has_all_splats());
    EXPECT_EQ(refinement.needs().cells, Chooser::Cells::all);
    return spacings_of(refinement, choices);
  };
  const Quality splats{.max_splats = 10};
  EXPECT_EQ(spacings({.splats = splats, .first_spacing = 4}), (std::vector{4, 2, 1}));
  EXPECT_EQ(spacings({.first_spacing = 16}), (std::vector{16, 4, 2, 1}));
  EXPECT_EQ(spacings({.first_spacing = 2, .shown = Recipe::of_cells(4)}), (std::vector{2, 1}));
  choices.cells->segments = 1e7;
  EXPECT_EQ(spacings({.splats = splats, .first_spacing = 4}), std::vector{4});
  choices.cells->segments = 5e7;
  EXPECT_EQ(spacings({.splats = splats, .first_spacing = 4}), std::vector{8});
  choices.cells->segments = 1e9;
  EXPECT_EQ(spacings({.splats = splats, .first_spacing = 4}), std::vector<int>());
}

}  // namespace
}  // namespace splatvol
