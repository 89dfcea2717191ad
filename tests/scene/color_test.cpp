// Colour maps and the sRGB curve.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "scene/color_map_file.h"
#include "scene/color_maps.h"
#include "scene/srgb.h"
#include "tests/support/results.h"

namespace splatvol {
namespace {

using testing::HasSubstr;

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

std::vector<dvec3> seen(const std::vector<TransferFunction::Color>& colors, int count) {
  TransferFunction function;
  function.colors = colors;
  std::vector<dvec3> result;
  for (int i = 0; i < count; ++i) {
    const dvec3 c = function.color_at(double(i) / (count - 1));
    result.emplace_back(srgb_of(c.r), srgb_of(c.g), srgb_of(c.b));
  }
  return result;
}

double difference(const std::vector<dvec3>& a, const std::vector<dvec3>& b) {
  double largest = 0;
  for (std::size_t i = 0; i < a.size(); ++i)
    for (int k = 0; k < 3; ++k) largest = std::max(largest, std::abs(a[i][k] - b[i][k]));
  return largest;
}

const ColorMap& map_named(std::string_view name) { return *std::ranges::find(color_maps(), name, &ColorMap::name); }

// Mikhailov's own polynomials for turbo, which are this rough.
TEST(ColorMaps, TurboIsTurbo) {
  std::vector<dvec3> polynomials;
  for (int i = 0; i < 256; ++i) {
    const double x = i / 255.0;
    const auto at = [&](std::array<double, 6> c) {
      return std::clamp(c[0] + x * (c[1] + x * (c[2] + x * (c[3] + x * (c[4] + x * c[5])))), 0.0, 1.0);
    };
    polynomials.emplace_back(at({0.13572138, 4.61539260, -42.66032258, 132.13108234, -152.94239396, 59.28637943}),
                             at({0.09140261, 2.19418839, 4.84296658, -14.18503333, 4.27729857, 2.82956604}),
                             at({0.10667330, 12.64194608, -60.58204836, 110.36276771, -89.90310912, 27.34824973}));
  }
  const auto table = seen(map_named("turbo").colors, 256);
  double sum = 0;
  for (std::size_t i = 0; i < 256; ++i) sum += glm::dot(table[i] - polynomials[i], table[i] - polynomials[i]) / 3;
  EXPECT_LT(std::sqrt(sum / 256), 0.035);
  EXPECT_LT(difference(table, polynomials), 0.13);
}

// Made for eyes that do not tell red from green: brighter and brighter, from blue to yellow.
TEST(ColorMaps, CividisRises) {
  double before = -1;
  for (const dvec3& c : seen(map_named("cividis").colors, 64)) {
    EXPECT_GT(c.r + c.g, before);
    EXPECT_LT(std::abs(c.r - c.g), 0.24);
    before = c.r + c.g;
  }
}

std::vector<dvec3> imported(const std::string& space, const std::string& points, const std::string& more = "") {
  const auto maps = parse_color_maps(R"([{"Name": "m", "ColorSpace": ")" + space + R"(", "RGBPoints": [)" + points +
                                     "]" + more + "}]");
  EXPECT_TRUE(maps) << maps.error().message;
  EXPECT_EQ(maps->at(0).name, "m");
  EXPECT_EQ(maps->at(0).colors.front().t, 0);
  EXPECT_EQ(maps->at(0).colors.back().t, 1);
  return seen(maps->at(0).colors, 9);
}

TEST(ColorMapFile, KnowsParaViewsSpaces) {
  constexpr double code = 1.5 / 255;
  const std::string blue_to_red = "-2, 0, 0, 1, 6, 1, 0, 0";
  std::vector<dvec3> rgb, steps, rainbow;
  for (int i = 0; i < 9; ++i) {
    rgb.emplace_back(i / 8.0, 0, 1 - i / 8.0);
    steps.push_back(i < 8 ? dvec3(0, 0, 1) : dvec3(1, 0, 0));
  }
  // Hues from 240 to 0 degrees, 30 at a time.
  for (const dvec3& c : {dvec3(0, 0, 1), dvec3(0, 0.5, 1), dvec3(0, 1, 1), dvec3(0, 1, 0.5), dvec3(0, 1, 0),
                         dvec3(0.5, 1, 0), dvec3(1, 1, 0), dvec3(1, 0.5, 0), dvec3(1, 0, 0)})
    rainbow.push_back(c);
  EXPECT_LT(difference(imported("RGB", blue_to_red), rgb), code);
  EXPECT_LT(difference(imported("HSV", blue_to_red), rainbow), code);
  EXPECT_LT(difference(imported("Step", blue_to_red), steps), 1e-15);
  const auto wrapped = imported("HSV", blue_to_red, R"(, "HSVWrap": true)");
  EXPECT_LT(glm::distance(wrapped[4], dvec3(1, 0, 1)), code);
  // Lab: a grey half as light as white. Moreland's published table of cool to warm.
  for (const std::string space : {"Lab", "CIELAB"})
    EXPECT_LT(glm::distance(imported(space, "0, 0, 0, 0, 1, 1, 1, 1")[4], dvec3(0.4663)), 2 * code);
  EXPECT_LT(difference(imported("Diverging", "0, 0.2298, 0.2987, 0.7537, 1, 0.7057, 0.0156, 0.1502"),
                       seen(map_named("cool to warm").colors, 9)),
            2 * code);
  // Each half turns from a saturated colour to grey.
  EXPECT_LT(difference(imported("Diverging",
                                "0, 0.2298, 0.2987, 0.7537, 3, 0.8654, 0.8654, 0.8654, 6, 0.7057, 0.0156, 0.1502"),
                       seen(map_named("cool to warm").colors, 9)),
            2 * code);
}

TEST(ColorMapFile, HasNamesAndJumps) {
  const auto maps = test::value_of(parse_color_maps(
      R"([{"RGBPoints": [0,0,0,0, 1,1,1,1, 1,0,0,0, 4,1,1,1]}, {"Name": "kinds", "IndexedColors": [1,1,1]}, {"Name": "b", "ColorSpace": "RGB", "RGBPoints": [0,0,0,0, 1,1,1,1]}])"));
  ASSERT_EQ(maps.size(), 2u);
  EXPECT_EQ(maps.at(0).name, "map 1");
  EXPECT_EQ(maps.at(1).name, "b");
  TransferFunction function;
  function.colors = maps.at(0).colors;
  EXPECT_EQ(function.color_at(0.25), dvec3(0));
  EXPECT_GT(function.color_at(0.2499).r, 0.9);
  EXPECT_TRUE(parse_color_maps(R"({"RGBPoints": [0,0,0,0, 1,1,1,1]})")) << "no list";
}

TEST(ColorMapFile, RefusesWhatIsNone) {
  for (const auto& [text, reason] : {std::pair<std::string, std::string>{"[", "no colour map"},
                                     {"[]", "RGBPoints"},
                                     {"[3, null, \"a\"]", "RGBPoints"},
                                     {std::string(100000, '['), "nested"},
                                     {R"([{"RGBPoints": 3}])", "four numbers"},
                                     {R"([{"RGBPoints": [0,0,0,0]}])", "four numbers"},
                                     {R"([{"RGBPoints": [0,0,0,0,1,1,1]}])", "four numbers"},
                                     {R"([{"RGBPoints": [0,0,0,0,1,1,"a",1]}])", "[6]: not a number"},
                                     {R"([{"RGBPoints": [1,0,0,0,0,1,1,1]}])", "fall"},
                                     {R"([{"RGBPoints": [0,0,0,0,0,1,1,1]}])", "same"},
                                     {R"([{"RGBPoints": [0,0,0,0,1,1,2,1]}])", "between 0 and 1"},
                                     {R"([{"RGBPoints": [0,0,0,0,1e999,1,1,1]}])", "no colour map"},
                                     {R"([{"RGBPoints": [0,0,0,0,1e101,1,1,1]}])", "[4]: beyond"},
                                     {R"([{"ColorSpace": "XYZ", "RGBPoints": [0,0,0,0,1,1,1,1]}])", "'XYZ'"},
                                     {R"([{"ColorSpace": 3, "RGBPoints": [0,0,0,0,1,1,1,1]}])", "no colour map"}}) {
    EXPECT_THAT(test::message_of(parse_color_maps(text)), HasSubstr(reason)) << text;
  }
  EXPECT_THAT(load_color_maps("no/such.json").error().message, HasSubstr("no/such.json"));
}

}  // namespace
}  // namespace splatvol
