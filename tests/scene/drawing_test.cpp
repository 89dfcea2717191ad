#include "scene/drawing.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

namespace splatvol {
namespace {

using testing::HasSubstr;

TEST(CheckQuality, TakesOneMemberAndNoTwo) {
  const std::vector<Quality> each = {{.max_error = 0.1}, {.max_splats = 9}, {.tolerance_percent = 0},
                                     {.resolution = 0},  {.exact = true},   {.milliseconds = 5}};
  EXPECT_TRUE(check_quality({}));
  const auto with = [](const auto& a, const auto& b) { return a ? a : b; };
  for (const Quality& a : each) {
    EXPECT_TRUE(check_quality(a));
    for (const Quality& b : each) {
      if (a == b) continue;
      const Quality both{with(a.max_error, b.max_error),
                         with(a.max_splats, b.max_splats),
                         with(a.tolerance_percent, b.tolerance_percent),
                         with(a.resolution, b.resolution),
                         a.exact || b.exact,
                         with(a.milliseconds, b.milliseconds)};
      if (both.max_error && both.milliseconds)
        EXPECT_TRUE(check_quality(both)) << "of what moves";
      else
        EXPECT_THAT(check_quality(both).error().message, HasSubstr("give one of"));
    }
  }
}

TEST(CheckQuality, RefusesNumbersOutOfRange) {
  constexpr double infinity = std::numeric_limits<double>::infinity();
  for (const double wrong : {0.0, -1.0, infinity, std::nan("")}) {
    EXPECT_FALSE(check_quality({.max_error = wrong})) << wrong;
    EXPECT_FALSE(check_quality({.milliseconds = wrong})) << wrong;
  }
  for (const double wrong : {-1.0, std::nan("")}) EXPECT_FALSE(check_quality({.tolerance_percent = wrong})) << wrong;
  EXPECT_FALSE(check_quality({.max_splats = 0}));
}

TEST(Quality, OfTwoTheFirstThatIsSetCounts) {
  const Quality set{.max_splats = 9};
  EXPECT_EQ(joined(set, {.exact = true}), set);
  EXPECT_EQ(joined({}, set), set);
}

TEST(Drawing, OfTwoEachMemberIsJoined) {
  const Drawing first{.kernel = KernelKind::octant}, second{.kernel = KernelKind::moments, .sort = SortMode::axis};
  EXPECT_EQ(joined(first, second), (Drawing{.kernel = KernelKind::octant, .sort = SortMode::axis}));
}

TEST(Drawing, WordsGoThereAndBack) {
  for (const KernelKind kernel : {KernelKind::moments, KernelKind::octant})
    EXPECT_EQ(kernel_named(name_of(kernel)), kernel);
  for (const SortMode sort : {SortMode::none, SortMode::axis, SortMode::exact})
    EXPECT_EQ(sort_named(name_of(sort)), sort);
  EXPECT_FALSE(kernel_named(""));
  EXPECT_FALSE(sort_named("round"));
}

}  // namespace
}  // namespace splatvol
