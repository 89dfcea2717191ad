// How a picture at rest gets finer.
#include "player/sharpening.h"

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

TEST(Sharpening, HalvesATolerance) {
  Sharpening sharpening({.tolerance_percent = 1.5});
  const OnePixel pixel;
  std::vector<double> tolerances;
  while (!sharpening.is_done()) {
    tolerances.push_back(sharpening.detail().tolerance_percent);
    ASSERT_LT(tolerances.size(), 10U);
    ASSERT_TRUE(sharpening.add(frame_of(100, sharpening.detail()), pixel));
  }
  EXPECT_EQ(tolerances, (std::vector<double>{4, 2, 1.5}));
  EXPECT_FALSE(sharpening.error());
}

TEST(Sharpening, DrawsAllPointsAtOnce) {
  Sharpening sharpening({.tolerance_percent = 0});
  EXPECT_EQ(sharpening.detail().tolerance_percent, 0);
  ASSERT_TRUE(sharpening.add(frame_of(100, sharpening.detail()), OnePixel()));
  EXPECT_TRUE(sharpening.is_done());
}

TEST(Sharpening, DrawsSplatsAndResolutionsAtOnce) {
  Sharpening splats({.max_splats = 300});
  EXPECT_EQ(splats.detail().goal, (ErrorGoal{0, 300}));
  ASSERT_TRUE(splats.add(frame_of(300, splats.detail()), OnePixel()));
  EXPECT_TRUE(splats.is_done());
  EXPECT_FALSE(splats.seeks_error());

  Sharpening resolution({.resolution = 2});
  EXPECT_EQ(resolution.detail().resolution, 2U);
  ASSERT_TRUE(resolution.add(frame_of(300, resolution.detail()), OnePixel()));
  EXPECT_TRUE(resolution.is_done());
}

TEST(Sharpening, GrowsUntilPicturesDifferByLittle) {
  Sharpening sharpening({.max_error = 0.01}, 1000);
  OnePixel pixel;
  std::uint64_t before = 0;
  int pictures = 0;
  for (; !sharpening.is_done(); ++pictures) {
    ASSERT_LT(pictures, 20);
    const std::uint64_t splats = sharpening.detail().goal->max_splats;
    EXPECT_GT(splats, before);
    EXPECT_TRUE(pictures > 0 || splats == 1000);
    pixel.grey = static_cast<float>(0.5 + 3 / std::sqrt(splats));
    ASSERT_TRUE(sharpening.add(frame_of(splats, sharpening.detail()), pixel));
    before = splats;
  }
  EXPECT_GE(pictures, 3);
  EXPECT_TRUE(sharpening.has_reached());
  EXPECT_LE(pixel.grey, 0.5 + 0.0125);
  EXPECT_NEAR(*sharpening.error(), 3 / std::sqrt(before), 0.005);
}

TEST(Sharpening, EndsWhereMemoryDoes) {
  Sharpening sharpening({.max_error = 0.001}, 1000);
  OnePixel pixel;
  int pictures = 0;
  for (; !sharpening.is_done(); ++pictures) {
    ASSERT_LT(pictures, 20);
    Detail allowed = sharpening.detail();
    allowed.goal->max_splats = std::min<std::uint64_t>(allowed.goal->max_splats, 5000);
    pixel.grey = static_cast<float>(0.5 + 3 / std::sqrt(allowed.goal->max_splats));
    ASSERT_TRUE(sharpening.add(frame_of(allowed.goal->max_splats, allowed), pixel));
  }
  EXPECT_LE(pictures, 4);
  EXPECT_FALSE(sharpening.has_reached());
  EXPECT_GT(*sharpening.error(), 0.001);
}

}  // namespace
}  // namespace splatvol
