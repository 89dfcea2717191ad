// Colour maps and the sRGB curve.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "scene/color_maps.h"
#include "scene/srgb.h"

namespace splatvol {
namespace {

TEST(Srgb, HasTheStandardsValuesAndAnInverse) {
  EXPECT_EQ(srgb_of(0), 0);
  EXPECT_NEAR(srgb_of(1), 1, 1e-15);
  EXPECT_NEAR(srgb_of(0.2140411404822321), 0.5, 1e-12);
  EXPECT_EQ(srgb_of(-1), 0);
  EXPECT_EQ(srgb_of(std::numeric_limits<double>::infinity()), srgb_of(1));
  EXPECT_TRUE(std::isnan(srgb_of(std::nan(""))));
  for (int byte = 0; byte < 256; ++byte)
    EXPECT_NEAR(255 * srgb_of(linear_of_byte(static_cast<std::uint8_t>(byte))), byte, 1e-4);
}

TEST(ColorMaps, AreCompleteAndInRange) {
  for (const ColorMap& map : color_maps()) {
    EXPECT_EQ(map.colors.front().t, 0) << map.name;
    EXPECT_EQ(map.colors.back().t, 1) << map.name;
    for (std::size_t i = 0; i < map.colors.size(); ++i) {
      EXPECT_TRUE(i == 0 || map.colors[i].t > map.colors[i - 1].t) << map.name;
      for (int k = 0; k < 3; ++k) {
        EXPECT_GE(map.colors[i].rgb[k], 0);
        EXPECT_LE(map.colors[i].rgb[k], 1);
      }
    }
    const auto twice = reversed(reversed(map.colors));
    EXPECT_EQ(twice.front().rgb, map.colors.front().rgb);
    EXPECT_EQ(reversed(map.colors).front().rgb, map.colors.back().rgb);
  }
}

TEST(ColorMaps, TheShortOneIsCoolToWarm) {
  const ColorMap& full = color_maps()[2];
  ASSERT_EQ(full.name, "cool to warm");
  const auto colors = short_cool_to_warm();
  ASSERT_EQ(colors.size(), 5U);
  for (std::size_t i = 0; i < colors.size(); ++i) {
    EXPECT_EQ(colors[i].t, full.colors[2 * i].t);
    EXPECT_LT(glm::distance(colors[i].rgb, full.colors[2 * i].rgb), 2e-4);  // less than one code of 8 bits
  }
}

}  // namespace
}  // namespace splatvol
