// Pictures as the bytes of a window, with every set of instructions.
#include "renderer/cpu/srgb_bytes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "scene/srgb.h"
#include "tests/renderer/targets.h"

namespace splatvol::test {
namespace {

// Widths that are no multiple of the pixels in a vector, and more pixels than a task has.
TEST(SrgbBytes, AreThoseOfTheCurveWithAnyInstructions) {
  const dvec3 background(0.02, 0.5, 1);
  for_each_target([&] {
    for (const auto& [width, height] : {std::pair(1, 1), std::pair(3, 1), std::pair(7, 3), std::pair(331, 217)}) {
      Image image{width, height, std::vector<vec4>(static_cast<std::size_t>(width) * height)};
      for (std::size_t i = 0; i < image.pixels.size(); ++i) {
        const double x = static_cast<double>(i) / static_cast<double>(image.pixels.size());
        image.pixels[i] = vec4(x * x * x, 1.2 * x - 0.1, 0.004 * x, std::abs(std::sin(9 * x)));
      }
      std::vector<std::uint8_t> bytes;
      encode_srgb(image, background, bytes);
      ASSERT_EQ(bytes.size(), 4 * image.pixels.size());
      for (std::size_t i = 0; i < image.pixels.size(); ++i) {
        const vec4 pixel = image.pixels[i];
        for (int channel = 0; channel < 3; ++channel)
          ASSERT_NEAR(bytes[4 * i + static_cast<std::size_t>(channel)],
                      255 * srgb_of(pixel[channel] + (1.0 - pixel.a) * background[channel]), 0.5 + 255 * 8e-6)
              << "pixel " << i << " of " << width << " x " << height;
        ASSERT_EQ(bytes[4 * i + 3], 255);
      }
    }
  });
}

// The pixels beside are right.
TEST(SrgbBytes, OfNumbersThatAreNoneHarmNobody) {
  constexpr float nan = std::numeric_limits<float>::quiet_NaN(), infinity = std::numeric_limits<float>::infinity();
  const Image image{4, 1, {vec4(1, 0, 1, 1), vec4(nan, nan, nan, nan), vec4(infinity, -infinity, 1, 1), vec4(0)}};
  std::vector<std::uint8_t> bytes;
  encode_srgb(image, dvec3(0), bytes);
  EXPECT_EQ(bytes[0], 255);
  EXPECT_EQ(bytes[1], 0);
  EXPECT_EQ(bytes[8], 255);
  EXPECT_EQ(bytes[9], 0);
  EXPECT_EQ(bytes[12], 0);
}

}  // namespace
}  // namespace splatvol::test
