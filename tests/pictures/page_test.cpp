// Pages: titles, scalar bars and outlines on pictures of any size.
#include <gtest/gtest.h>
#include <png.h>

#include <algorithm>
#include <cmath>

#include "pictures/contrast.h"
#include "pictures/outline.h"
#include "pictures/page.h"
#include "pictures/text.h"
#include "pictures/ticks.h"
#include "scene/srgb.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

TransferFunction ramp(double low, double high) {
  return {low, high, {{0, dvec3(0, 0, 1)}, {1, dvec3(1, 0, 0)}}, {{0, 1}, {1, 2}}};
}

std::vector<std::string> labels(double low, double high) {
  std::vector<std::string> list;
  for (const Tick& tick : ticks_between(low, high, 5).list) list.push_back(tick.label);
  return list;
}

TEST(Ticks, AreRoundNumbers) {
  EXPECT_EQ(labels(0, 1), (std::vector<std::string>{"0.0", "0.2", "0.4", "0.6", "0.8", "1.0"}));
  EXPECT_EQ(labels(-3, 7), (std::vector<std::string>{"-2", "0", "2", "4", "6"}));
  EXPECT_EQ(labels(101300, 101360), (std::vector<std::string>{"101300", "101320", "101340", "101360"}));
  EXPECT_EQ(labels(0.9990, 1.0010).size(), 5u);
}

// Values far from zero and close together differ in their last digits: the others are the offset.
TEST(Ticks, HaveAnOffsetForValuesFarFromZero) {
  EXPECT_EQ(labels(101324.999, 101325.001),
            (std::vector<std::string>{"-0.0010", "-0.0005", "0.0000", "0.0005", "0.0010"}));
  EXPECT_EQ(ticks_between(101324.999, 101325.001, 5).factor, "+ 101325");
  EXPECT_EQ(ticks_between(101324.9999, 101325.0001, 5).factor, "× 10⁻⁴ + 101325");
  EXPECT_EQ(labels(1000000, 1000005), (std::vector<std::string>{"0", "1", "2", "3", "4", "5"}));
  EXPECT_EQ(ticks_between(1000000, 1000005, 5).factor, "+ 1000000");
  EXPECT_EQ(ticks_between(-300.0002, -300, 5).factor, "× 10⁻⁴ − 300.0001");
  for (const double size : {-1e-300, -1.0, 1e-40, 1e-3, 1.0, 1e7, 1e300})
    for (const double share : {1e-6, 1e-9, 1e-13}) {
      const double low = std::min(size, size * (1 + share)), high = std::max(size, size * (1 + share));
      const Ticks ticks = ticks_between(low, high, 5);
      ASSERT_GE(ticks.list.size(), 2u) << size << " " << share;
      for (const Tick& tick : ticks.list) {
        EXPECT_GE(tick.value, low);
        EXPECT_LE(tick.value, high);
        EXPECT_LE(tick.label.size(), 9u) << tick.label;
      }
    }
}

TEST(Ticks, DigitsTellValuesOfARangeApart) {
  EXPECT_EQ(digits_of_range(0, 1), 5);
  EXPECT_EQ(digits_of_range(-3e20, 1), 5);
  EXPECT_EQ(digits_of_range(101325, 101325.001), 13);
  EXPECT_EQ(digits_of_range(1, 1 + 1e-15), 17);
  EXPECT_EQ(digits_of_range(2, 2), 5);
}

TEST(Ticks, HaveAFactorForValuesOfAnySize) {
  EXPECT_EQ(ticks_between(0, 3, 5).factor, "");
  EXPECT_EQ(ticks_between(1e51, 5e51, 5).factor, "× 10⁵¹");
  EXPECT_EQ(labels(1e51, 5e51), (std::vector<std::string>{"1", "2", "3", "4", "5"}));
  EXPECT_EQ(ticks_between(-2e-40, 1e-40, 5).factor, "× 10⁻⁴⁰");
  for (const double size : {1e-300, 1e-40, 1e-3, 1.0, 1e7, 1e51, 1e300})
    for (const double low : {-1.0, 0.0, 0.3, 0.999}) {
      const Ticks ticks = ticks_between(low * size, 1.0 * size, 5);
      ASSERT_GE(ticks.list.size(), 2u);
      ASSERT_LE(ticks.list.size(), 6u);
      for (const Tick& tick : ticks.list) {
        EXPECT_GE(tick.value, low * size);
        EXPECT_LE(tick.value, size);
        EXPECT_LE(tick.label.size(), 9u) << tick.label;
      }
      EXPECT_LT(ticks.list[0].value, ticks.list[1].value);
    }
}

std::vector<std::string> axis_labels(ValueAxis axis, double low, double high, double width = 1) {
  TransferFunction function = ramp(low, high);
  function.axis = axis;
  function.linear_width = width;
  std::vector<std::string> list;
  double last = -INFINITY;
  for (const Tick& tick : ticks_of(function, 5).list) {
    EXPECT_GT(tick.value, last);
    EXPECT_GE(function.t_of(tick.value), -1e-9);
    EXPECT_LE(function.t_of(tick.value), 1 + 1e-9);
    last = tick.value;
    list.push_back(tick.label);
  }
  return list;
}

TEST(Ticks, OfALogarithmicAxisArePowersOfTen) {
  using Labels = std::vector<std::string>;
  EXPECT_EQ(axis_labels(ValueAxis::log, 1e-6, 1e3), (Labels{"10⁻⁶", "10⁻⁴", "10⁻²", "10⁰", "10²"}));
  EXPECT_EQ(axis_labels(ValueAxis::log, 0.9e-2, 101), (Labels{"0.01", "0.1", "1", "10", "100"}));
  EXPECT_EQ(axis_labels(ValueAxis::log, 1, 30), (Labels{"1", "2", "5", "10", "20"}));
  EXPECT_EQ(axis_labels(ValueAxis::log, 3e51, 9e52), (Labels{"5 × 10⁵¹", "10⁵²", "2 × 10⁵²", "5 × 10⁵²"}));
  EXPECT_EQ(axis_labels(ValueAxis::log, 3.1, 3.4).size(), 4u);
  EXPECT_EQ(axis_labels(ValueAxis::linear, 0, 1).size(), 6u);
}

TEST(Ticks, OfAnAsinhAxisHaveBothSigns) {
  using Labels = std::vector<std::string>;
  EXPECT_EQ(axis_labels(ValueAxis::asinh, -100, 100, 10), (Labels{"-100", "-10", "0", "10", "100"}));
  EXPECT_EQ(axis_labels(ValueAxis::asinh, -1e6, 1e6, 100), (Labels{"-10⁶", "-10³", "0", "10³", "10⁶"}));
  EXPECT_LE(axis_labels(ValueAxis::asinh, -1e30, 1e30).size(), 6u);
  EXPECT_GE(axis_labels(ValueAxis::asinh, -1e-3, 1e-3).size(), 2u);
}

TEST(Font, WritesWordsAndAnyBytes) {
  const Font font = Font::create(20).value();
  EXPECT_GT(font.width("WWW"), 2 * font.width("iii"));
  Image image{120, 40, std::vector<vec4>(120 * 40)};
  font.write(image, 5, 25, "Δp × 10⁵ \xff\xe2", dvec3(1));
  const auto ink = std::ranges::count_if(image.pixels, [](const vec4& pixel) { return pixel.a > 0.5f; });
  EXPECT_GT(ink, 100);
  font.write(image, -50, 60, "outside of the image", dvec3(1));  // nothing breaks
}

TEST(Page, LeavesThePictureItsOwnPlace) {
  for (const auto& [width, height] : {std::pair{120, 90}, std::pair{512, 512}, std::pair{3000, 1200}}) {
    const PageText text{"Flow past a wing", {{"p [Pa]", ramp(0, 1)}}};
    const auto page = value_of(lay_out_page(width, height, text));
    EXPECT_EQ(page.width, width);
    EXPECT_GE(2 * page.picture_width, width);
    EXPECT_EQ(page.top + page.picture_height, height);
    const auto count = static_cast<std::size_t>(page.picture_width) * page.picture_height;
    const Image picture{page.picture_width, page.picture_height, std::vector<vec4>(count, vec4(0, 1, 0, 1))};
    const auto image = value_of(compose_page(page, picture, text, dvec3(1)));
    const auto green = std::ranges::count(image.pixels, vec4(0, 1, 0, 1));
    EXPECT_EQ(static_cast<std::size_t>(green), count);  // nothing covers the volume
    bool red = false, blue = false;
    for (int y = 0; y < height; ++y) {
      const vec4 pixel = image.at(page.picture_width + static_cast<int>(0.9 * page.text_height), y);
      red = red || (pixel.r > 0.9f && pixel.b < 0.1f), blue = blue || (pixel.b > 0.9f && pixel.r < 0.1f);
    }
    EXPECT_TRUE(red && blue);  // both ends of the bar
  }
  EXPECT_FALSE(lay_out_page(20, 20, {"t", {{"p", ramp(0, 1)}}}));
  EXPECT_EQ(lay_out_page(64, 48, {})->picture_width, 64);
}

TEST(Page, HasABarBesideTheOther) {
  const PageText one{"", {{"p [Pa]", ramp(0, 1)}}}, two{"", {{"p [Pa]", ramp(0, 1)}, {"a longer name", ramp(0, 9)}}};
  const Page page = value_of(lay_out_page(512, 512, two));
  EXPECT_LT(page.picture_width, value_of(lay_out_page(512, 512, one)).picture_width - 30);
  const Image picture{page.picture_width, 512, std::vector<vec4>(static_cast<std::size_t>(page.picture_width) * 512)};
  const Image image = value_of(compose_page(page, picture, two, dvec3(1)));
  int bars = 0;  // in the middle row: where red and blue meet
  for (int x = 1; x < 512; ++x) bars += image.at(x, 256).b > 0.2f && image.at(x - 1, 256).b < 0.2f ? 1 : 0;
  EXPECT_EQ(bars, 2);
}

TEST(Page, OutlinesAreBehindAndInFrontOfTheVolume) {
  Camera camera{.position = {3, 2.5, 4}};
  const View view = make_view(camera, 200, 200).value();
  Image image{200, 200, std::vector<vec4>(200 * 200, vec4(0, 0, 0, 1))};  // opaque: hides the edges behind it
  draw_outline(image, view, {dvec3(-0.5), dvec3(0.5)}, dvec3(1));
  const auto at = [&](const dvec3& p) {
    const dvec3 v = view.to_view(p);
    return image.at(static_cast<int>(100 + view.focal * v.x / v.z), static_cast<int>(100 - view.focal * v.y / v.z));
  };
  EXPECT_GT(at({0, 0.5, 0.5}).r, 0.2f);
  EXPECT_LT(at({0.02, -0.5, -0.5}).r, 0.1f);
}

TEST(Page, WordsWithAHaloAreReadOnAnyBackground) {
  const PageText text{"Title", {{"p [Pa]", ramp(0, 1)}}};
  const Page page = lay_out_page(1600, 1200, text).value();
  const Image picture{page.picture_width, page.picture_height,
                      std::vector<vec4>(static_cast<std::size_t>(page.picture_width) * page.picture_height)};
  for (const dvec3& ink : {dvec3(0), dvec3(1)}) {
    const Image plain = compose_page(page, picture, text, ink).value();
    const Image image = compose_page(page, picture, text, ink, true).value();
    // Round each dark stroke there are bright pixels, and the other way round.
    const auto count = [&](const Image& of, double brightness) {
      std::size_t found = 0;
      for (int y = 0; y < page.top; ++y)
        for (int x = 0; x < page.picture_width; ++x)
          if (const vec4& pixel = of.at(x, y); pixel.a > 0.7f && std::abs(pixel.r / pixel.a - brightness) < 0.2)
            ++found;
      return found;
    };
    EXPECT_GT(count(image, ink.r), 200u);
    EXPECT_GT(count(image, 1 - ink.r), 200u);
    EXPECT_EQ(count(plain, 1 - ink.r), 0u);
    EXPECT_GT(count(image, ink.r), 0.8 * static_cast<double>(count(plain, ink.r)));
  }
  const double contrast_on_black = (luminance(ink_on_any()) + 0.05) / 0.05;
  const double contrast_on_white = 1.05 / (luminance(ink_on_any()) + 0.05);
  EXPECT_GT(std::min(contrast_on_black, contrast_on_white), 4.4);
}

TEST(Contrast, KeepsColoursAndDensitiesVisible) {
  Scene scene;
  scene.transfer_function = ramp(0, 1);
  scene.transfer_function.colors = {{0, dvec3(0)}, {1, dvec3(1, 1, 0.5)}};
  adapt_to_background(scene, dvec3(1));
  EXPECT_EQ(scene.background, dvec3(1));
  EXPECT_EQ(scene.transfer_function.densities[1].extinction, 4);
  EXPECT_LT(luminance(scene.transfer_function.colors[1].rgb), 0.31);
  EXPECT_EQ(scene.transfer_function.colors[0].rgb, dvec3(0));
  adapt_to_background(scene, dvec3(0));
  EXPECT_EQ(scene.transfer_function.densities[1].extinction, 2);
  EXPECT_GT(luminance(scene.transfer_function.colors[0].rgb), 0.03);
}

// Reads an RGBA file.
std::vector<png_byte> read_png(const std::string& path) {
  png_image image{};
  image.version = PNG_IMAGE_VERSION;
  EXPECT_TRUE(png_image_begin_read_from_file(&image, path.c_str())) << image.message;
  EXPECT_TRUE(image.format & PNG_FORMAT_FLAG_ALPHA);
  image.format = PNG_FORMAT_RGBA;
  std::vector<png_byte> bytes(PNG_IMAGE_SIZE(image));
  EXPECT_TRUE(png_image_finish_read(&image, nullptr, bytes.data(), 0, nullptr)) << image.message;
  return bytes;
}

TEST(WriteImage, TransparentLooksTheSameOverItsBackground) {
  Image image{16, 1, {}};
  for (int i = 0; i < 16; ++i) {
    const float alpha = static_cast<float>(i) / 15;
    image.pixels.push_back(vec4(alpha * vec3(1, 0.3, 0.05), alpha));
  }
  const TempFolder folder;
  const std::string path = folder.path("a.png");
  for (const dvec3& background : {dvec3(0), dvec3(1), dvec3(0.2, 0.5, 0.9)}) {
    ASSERT_TRUE(write_image(path, image, background, {}, true));
    const auto bytes = read_png(path);
    for (std::size_t i = 0; i < 16; ++i)
      for (int channel = 0; channel < 3; ++channel) {
        const double alpha = bytes[4 * i + 3] / 255.0, c = bytes[4 * i + static_cast<std::size_t>(channel)] / 255.0;
        const double shown = alpha * c + (1 - alpha) * srgb_of(background[channel]);
        const vec4& pixel = image.pixels[i];
        EXPECT_NEAR(shown, srgb_of(pixel[channel] + (1.0 - pixel.a) * background[channel]), 0.008);
      }
    EXPECT_EQ(bytes[3], 0);
  }
}

}  // namespace
}  // namespace splatvol::test
