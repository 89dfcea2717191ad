// How a picture at rest gets finer.
#include "player/progressive_refinement.h"

#include <gtest/gtest.h>

namespace splatvol {
namespace {

// Shows one pixel, of a given grey.
struct OnePixel {
  float grey = 0;

  Result<Image> operator()() const { return Image{1, 1, {vec4(grey, grey, grey, 1)}}; }
};

FrameSplats frame_of(std::uint64_t splats, const Detail& detail) {
  FrameSplats frame;
  frame.splats = splats;
  frame.detail = detail;
  return frame;
}

TEST(ProgressiveRefinement, HalvesATolerance) {
  ProgressiveRefinement refinement({.tolerance_percent = 1.5});
  const OnePixel pixel;
  std::vector<double> tolerances;
  while (!refinement.is_done()) {
    tolerances.push_back(refinement.detail().tolerance_percent);
    ASSERT_LT(tolerances.size(), 10U);
    ASSERT_TRUE(refinement.add(frame_of(100, refinement.detail()), pixel));
  }
  EXPECT_EQ(tolerances, (std::vector<double>{4, 2, 1.5}));
  EXPECT_FALSE(refinement.error());
}

TEST(ProgressiveRefinement, DrawsAllPointsAtOnce) {
  ProgressiveRefinement refinement({.tolerance_percent = 0});
  EXPECT_EQ(refinement.detail().tolerance_percent, 0);
  ASSERT_TRUE(refinement.add(frame_of(100, refinement.detail()), OnePixel()));
  EXPECT_TRUE(refinement.is_done());
}

TEST(ProgressiveRefinement, DrawsSplatsAndResolutionsAtOnce) {
  ProgressiveRefinement splats({.max_splats = 300});
  EXPECT_EQ(splats.detail().goal, (ErrorGoal{0, 300}));
  ASSERT_TRUE(splats.add(frame_of(300, splats.detail()), OnePixel()));
  EXPECT_TRUE(splats.is_done());
  EXPECT_FALSE(splats.seeks_error());

  ProgressiveRefinement resolution({.resolution = 2});
  EXPECT_EQ(resolution.detail().resolution, 2U);
  ASSERT_TRUE(resolution.add(frame_of(300, resolution.detail()), OnePixel()));
  EXPECT_TRUE(resolution.is_done());
}

TEST(ProgressiveRefinement, GrowsUntilPicturesDifferByLittle) {
  ProgressiveRefinement refinement({.max_error = 0.01}, 1000);
  OnePixel pixel;
  std::uint64_t before = 0;
  int pictures = 0;
  for (; !refinement.is_done(); ++pictures) {
    ASSERT_LT(pictures, 20);
    const std::uint64_t splats = refinement.detail().goal->max_splats;
    EXPECT_GT(splats, before);
    EXPECT_TRUE(pictures > 0 || splats == 1000);
    pixel.grey = static_cast<float>(0.5 + 3 / std::sqrt(splats));
    ASSERT_TRUE(refinement.add(frame_of(splats, refinement.detail()), pixel));
    before = splats;
  }
  EXPECT_GE(pictures, 3);
  EXPECT_TRUE(refinement.has_reached());
  EXPECT_LE(pixel.grey, 0.5 + 0.0125);
  EXPECT_NEAR(*refinement.error(), 3 / std::sqrt(before), 0.005);
}

TEST(ProgressiveRefinement, EndsWhereMemoryDoes) {
  ProgressiveRefinement refinement({.max_error = 0.001}, 1000);
  OnePixel pixel;
  int pictures = 0;
  for (; !refinement.is_done(); ++pictures) {
    ASSERT_LT(pictures, 20);
    Detail allowed = refinement.detail();
    allowed.goal->max_splats = std::min<std::uint64_t>(allowed.goal->max_splats, 5000);
    pixel.grey = static_cast<float>(0.5 + 3 / std::sqrt(allowed.goal->max_splats));
    ASSERT_TRUE(refinement.add(frame_of(allowed.goal->max_splats, allowed), pixel));
  }
  EXPECT_LE(pictures, 4);
  EXPECT_FALSE(refinement.has_reached());
  EXPECT_GT(*refinement.error(), 0.001);
}

}  // namespace
}  // namespace splatvol
