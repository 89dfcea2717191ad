#include "player/choice.h"

#include <gtest/gtest.h>

namespace splatvol {
namespace {

TEST(DefaultSplats, AreAllPointsOfASmallFile) {
  EXPECT_EQ(default_splats(most_points_at_once), (Quality{.tolerance_percent = 0}));
  EXPECT_EQ(default_splats(most_points_at_once + 1), (Quality{.max_error = default_max_error}));
}

TEST(ExpectedDetail, TakesAnErrorAsExpected) {
  EXPECT_EQ(expected_detail({.max_error = 0.01}), (Detail{.goal = ErrorGoal{.expected_error = 0.01}}));
  EXPECT_EQ(expected_detail({.max_splats = 9}), (Detail{.goal = ErrorGoal{.max_splats = 9}}));
  EXPECT_EQ(expected_detail({.tolerance_percent = 3}), (Detail{.tolerance_percent = 3}));
  EXPECT_EQ(expected_detail({.resolution = 2}), (Detail{.resolution = 2}));
}

}  // namespace
}  // namespace splatvol
