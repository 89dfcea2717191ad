#include <epoxy/gl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "renderer/gl/picture_texture.h"
#include "tests/renderer/device_name.h"
#include "tests/renderer/draw_parts.h"
#include "tests/renderer/raster_test.h"
#include "tests/support/results.h"

namespace splatvol::test {
namespace {

using ::testing::HasSubstr;

constexpr float nan_value = std::numeric_limits<float>::quiet_NaN();
constexpr float infinity = std::numeric_limits<float>::infinity();

/// An OctantSplat; without a gradient by default.
struct Splat {
  vec3 position;
  float value;
  float size;
  std::uint32_t gradient = 0;
};

/// Values 0, 1, 2, 3 are red, green, blue, white; extinction rises from 0 at value -1 to `extinction` at 0 and stays.
TransferFunction four_colors(double extinction) {
  return {.lo = -1,
          .hi = 3,
          .colors = {{0, {1, 0, 0}}, {0.25, {1, 0, 0}}, {0.5, {0, 1, 0}}, {0.75, {0, 0, 1}}, {1, {1, 1, 1}}},
          .densities = {{0, 0}, {0.25, extinction}, {1, extinction}}};
}

/// A world unit is a pixel.
View orthographic_view(int width, int height, dvec3 eye = dvec3(0)) {
  return test::orthographic_view(height, width, height, eye);
}

/// Returns splats of random positions and values.
std::vector<Splat> random_splats(std::size_t count, std::uint32_t seed, float size) {
  std::mt19937 generator(seed);
  std::uniform_real_distribution<float> coordinate(-1, 1);
  std::vector<Splat> splats(count);
  for (Splat& splat : splats)
    splat = {
        {coordinate(generator), coordinate(generator), coordinate(generator)}, 1 + 2 * coordinate(generator), size};
  return splats;
}

/// Draws the picture by its definition, in double precision: every splat over every pixel of its square.
Image composite(std::vector<Splat> splats, dvec3 origin, const View& view, const TransferFunction& function) {
  const auto position = [&](const Splat& splat) { return view.to_view(origin + dvec3(splat.position)); };
  const auto distance = [&](const Splat& splat) {
    return view.orthographic ? position(splat).z : glm::length(position(splat));
  };
  std::ranges::stable_sort(splats, std::ranges::greater{}, distance);

  Image image{view.width, view.height, std::vector<vec4>(static_cast<std::size_t>(view.width) * view.height)};
  for (const Splat& splat : splats) {
    const dvec3 center = position(splat);
    const double alpha = 1 - std::exp(-function.extinction(splat.value) * splat.size);
    if (!(center.z > 0) || !(alpha > 0)) continue;
    const double scale = view.focal / (view.orthographic ? 1 : center.z);
    const double sigma = 0.4 * splat.size * scale;
    const dvec3 color = function.color(splat.value);
    for (int y = 0; y < view.height; ++y) {
      for (int x = 0; x < view.width; ++x) {
        const double dx = x + 0.5 - (center.x * scale + 0.5 * view.width);
        const double dy = view.height - y - 0.5 - (center.y * scale + 0.5 * view.height);
        if (std::max(std::abs(dx), std::abs(dy)) > 3 * sigma) continue;
        const double a = alpha * std::exp(-(dx * dx + dy * dy) / (2 * sigma * sigma));
        vec4& pixel = image.at(x, y);
        pixel = vec4(glm::dvec4(color * a, a) + glm::dvec4(pixel) * (1 - a));
      }
    }
  }
  return image;
}

DrawList list_of(const std::vector<Splat>& splats, const std::vector<DrawPart>& parts) {
  std::vector<OctantSplat> converted;
  for (const Splat& splat : splats) converted.push_back({splat.position, splat.value, splat.size, splat.gradient});
  return make_list(converted, parts);
}

struct RendererTest : test::RasterizerTest {
  RendererTest() : RasterizerTest(KernelKind::octant) {}

  /// Draws `splats`, in world coordinates relative to `origin`.
  Image picture(const std::vector<Splat>& splats, const View& view, const TransferFunction& function,
                SortMode sort = SortMode::exact, dvec3 origin = dvec3(0)) {
    EXPECT_TRUE(renderer_->set_transfer_function(function, {}));
    EXPECT_TRUE(set_splats(splats, {{origin, 0, splats.size()}}));
    return redraw(view, sort);
  }

  Status set_splats(const std::vector<Splat>& splats, const std::vector<DrawPart>& parts) {
    return renderer_->set_draw_list(list_of(splats, parts));
  }
};

TEST_P(RendererTest, SplatIsAGaussianAsOpaqueAsItsSlab) {
  const double size = 21;
  for (const double extinction : {1.01e-6, 1e-4, 0.05, 0.5}) {
    const Image image =
        picture({{{0, 0, -10}, 3, static_cast<float>(size)}}, orthographic_view(65, 65), four_colors(extinction));
    const double opacity = -std::expm1(-extinction * size);
    EXPECT_NEAR(image.at(32, 32).a / opacity, 1, GetParam() == Device::gl ? 1e-4 : 5e-4);
    const double sigma = 0.4 * size;
    for (int x = 0; x < 65; ++x) {
      const double offset = std::abs(x - 32);
      const double alpha = offset < 3 * sigma ? opacity * std::exp(-offset * offset / (2 * sigma * sigma)) : 0;
      EXPECT_NEAR(image.at(x, 32).a, alpha, 2e-5 * opacity + (opacity < 0.01 ? 1e-5 : 0)) << x;
      EXPECT_NEAR(image.at(32, x).r, alpha, 2e-5 * opacity + (opacity < 0.01 ? 1e-5 : 0)) << x;
    }
  }
}

TEST_P(RendererTest, SizeInPerspectiveFallsWithDepth) {
  const View view = perspective_view(129, 129);
  for (const float depth : {2.0F, 4.0F, 1000.0F}) {
    const float size = depth / 20;
    const Image image = picture({{{0, 0, -depth}, 3, size}}, view, four_colors(1 / size));
    const double sigma = 0.4 * size * view.focal / depth;
    const double opacity = 1 - std::exp(-1.0);
    for (const int offset : {0, 1, 3, 5, 8})
      EXPECT_NEAR(image.at(64 + offset, 64).a, opacity * std::exp(-offset * offset / (2 * sigma * sigma)), 1e-5);
  }
}

TEST_P(RendererTest, ControlPointsKeepTheirColors) {
  const View view = orthographic_view(9, 9);
  const auto color = [&](float value) {
    return vec3(picture({{{0, 0, -1}, value, 1e4F}}, view, four_colors(1)).at(4, 4));
  };
  EXPECT_LT(glm::distance(color(0), vec3(1, 0, 0)), 1e-6);
  EXPECT_LT(glm::distance(color(1), vec3(0, 1, 0)), 1e-6);
  EXPECT_LT(glm::distance(color(2), vec3(0, 0, 1)), 1e-6);
  EXPECT_LT(glm::distance(color(1.25), vec3(0, 0.75, 0.25)), 1e-6);
  EXPECT_LT(glm::distance(color(1.23456), vec3(0, 0.76544, 0.23456)), 1e-5);

  // Values outside of the domain are clamped.
  EXPECT_LT(glm::distance(color(3), vec3(1)), 1e-6);
  EXPECT_LT(glm::distance(color(1e9), vec3(1)), 1e-6);
  EXPECT_LT(glm::distance(color(infinity), vec3(1)), 1e-6);
  EXPECT_EQ(color(-1), vec3(0));
  EXPECT_EQ(color(-infinity), vec3(0));
}

TEST_P(RendererTest, NearOverFarWhateverTheArrayOrder) {
  const Splat near_red{{0, 0, -5}, 0, 10};
  const Splat far_blue{{0, 0, -9}, 2, 10};
  const TransferFunction function = four_colors(0.1);
  const float a = 1 - std::exp(-1.0F);
  const vec4 red_over_blue(a, 0, a * (1 - a), 1 - (1 - a) * (1 - a));
  const vec4 blue_over_red(a * (1 - a), 0, a, red_over_blue.a);

  const View view = orthographic_view(65, 65);
  EXPECT_LT(glm::distance(picture({near_red, far_blue}, view, function).at(32, 32), red_over_blue), 1e-3);
  EXPECT_LT(glm::distance(picture({far_blue, near_red}, view, function).at(32, 32), red_over_blue), 1e-3);
  EXPECT_LT(glm::distance(picture({far_blue, near_red}, view, function, SortMode::none).at(32, 32), red_over_blue),
            1e-3);
  EXPECT_LT(glm::distance(picture({near_red, far_blue}, view, function, SortMode::none).at(32, 32), blue_over_red),
            1e-3);
}

TEST_P(RendererTest, PerspectiveSortsByDistanceAndOrthographicByDepth) {
  const std::vector<Splat> splats{{{0, 0, -10}, 0, 40}, {{8, 0, -9}, 2, 40}};
  const TransferFunction function = four_colors(0.05);
  const auto check = [&](const View& view) {
    EXPECT_LT(rmse(picture(splats, view, function), composite(splats, dvec3(0), view, function)), 1e-4);
  };
  check(perspective_view(64, 64));
  check(orthographic_view(64, 64));
}

TEST_P(RendererTest, ManySplatsAgreeWithTheirDefinition) {
  std::mt19937 generator(3);
  std::uniform_real_distribution<float> coordinate(-1, 1);
  std::vector<Splat> splats(400);
  for (Splat& splat : splats)
    splat = {{coordinate(generator), coordinate(generator), 1.5F * coordinate(generator)},
             1 + 2 * coordinate(generator),
             0.25F + 0.2F * coordinate(generator)};
  const TransferFunction function = four_colors(2);

  for (const View& view : {perspective_view(80, 60, {0.3, 0.2, 4}), test::orthographic_view(2.5, 60, 80, {0, 0, 3}),
                           perspective_view(64, 64, {0, 0, 0.2})}) {
    const Image image = picture(splats, view, function);
    expect_sane(image);
    EXPECT_LT(rmse(image, composite(splats, dvec3(0), view, function)), 2e-3);
  }
}

TEST_P(RendererTest, BatchesShareOneOrder) {
  // Splats behind each other, in batches with origins of their own.
  std::vector<Splat> all;
  std::array<std::vector<Splat>, 3> parts;
  const std::array<dvec3, 3> origins{dvec3(5, 0, 0), dvec3(0, -3, 2), dvec3(1, 1, -30)};
  for (int i = 0; i < 60; ++i) {
    const dvec3 position(0, 0, -10 - (i * 37) % 60);
    const float value = static_cast<float>(i % 4);
    all.push_back({vec3(position), value, 15});
    parts[i % 3].push_back({vec3(position - origins[i % 3]), value, 15});
  }
  const TransferFunction function = four_colors(0.02);
  const View view = perspective_view(64, 64);
  const Image expected = picture(all, view, function);

  // Batches in another order than their splats, with an empty one between.
  std::vector<Splat> joined;
  for (const auto& part : parts) joined.insert(joined.end(), part.begin(), part.end());
  ASSERT_TRUE(set_splats(joined, {{origins[2], 40, 20}, {dvec3(7), 60, 0}, {origins[0], 0, 20}, {origins[1], 20, 20}}));
  EXPECT_LT(rmse(redraw(view), expected), 1e-5);
}

TEST_P(RendererTest, OrderFollowsViewSplatsAndColors) {
  const std::vector<Splat> splats{{{0, 0, -5}, 0, 10}, {{0, 0, 5}, 2, 10}};
  const TransferFunction function = four_colors(0.1);
  View front = orthographic_view(65, 65, {0, 0, 20});
  View back = front;
  back.eye = {0, 0, -20};
  back.forward = {0, 0, 1};
  back.right = {-1, 0, 0};

  EXPECT_GT(picture(splats, front, function).at(32, 32).b, 0.6);
  EXPECT_GT(redraw(back).at(32, 32).r, 0.6);
  EXPECT_GT(redraw(front).at(32, 32).b, 0.6);

  // A splat that was clear comes back with other colours.
  TransferFunction no_red = function;
  no_red.densities = {{0, 0}, {0.25, 0}, {0.5, 0.1}, {1, 0.1}};
  ASSERT_TRUE(renderer_->set_transfer_function(no_red, {}));
  EXPECT_EQ(redraw(front).at(32, 32).r, 0);
  ASSERT_TRUE(renderer_->set_transfer_function(function, {}));
  EXPECT_GT(redraw(front).at(32, 32).r, 0.1);

  const std::vector<Splat> swapped{{{0, 0, 5}, 0, 10}, {{0, 0, -5}, 2, 10}};
  ASSERT_TRUE(set_splats(swapped, {{dvec3(0), 0, 2}}));
  EXPECT_GT(redraw(front).at(32, 32).r, 0.6);
}

TEST_P(RendererTest, AStillViewIsSortedOnce) {
  const std::vector<Splat> splats(1000, {{0, 0, -5}, 0, 1});
  const View view = orthographic_view(16, 16);
  picture(splats, view, four_colors(1));
  double least = 1;  // a moment at most: reading the clock twice
  for (int i = 0; i < 5; ++i) {
    const auto again = renderer_->draw(view, SortMode::exact, 1);
    ASSERT_TRUE(again);
    EXPECT_GT(again->draw, 0);
    least = std::min(least, again->sort);
  }
  EXPECT_LT(least, 1e-6);
}

TEST_P(RendererTest, WhatDrawsNothing) {
  const View view = perspective_view(32, 32);
  const std::vector<Splat> nothing{
      {{0, 0, -5}, nan_value, 1},  // missing
      {{0, 0, -5}, -1, 1},         // extinction 0
      {{0, 0, 5}, 0, 100},         // behind the eye, but reaching before it
      {{0, 0, 0}, 0, 100},         // the eye at its centre
      {{3, 0, 0}, 0, 100},         // beside the eye
      {{0, 0, -5}, 0, 0},          // no size
      {{0, 0, -5}, 0, -1},         //
      {{0, 0, -5}, 0, nan_value},  //
      {{500, 0, -5}, 0, 1},        // outside the picture
      {{0, 0, -5}, 0, 1e-20F},     // too faint for a float
  };
  for (const SortMode sort : {SortMode::none, SortMode::exact}) {
    const Image image = picture(nothing, view, four_colors(1), sort);
    for (const vec4& pixel : image.pixels) ASSERT_EQ(pixel, vec4(0));

    // They do not disturb a splat that draws.
    std::vector<Splat> with_one = nothing;
    with_one.insert(with_one.begin() + 5, {{0, 0, -5}, 0, 1});
    const Image one = picture({{{0, 0, -5}, 0, 1}}, view, four_colors(1), sort);
    EXPECT_LT(rmse(picture(with_one, view, four_colors(1), sort), one), 1e-5);
  }
}

TEST_P(RendererTest, MissingValuesDrawNothingWhateverTheColors) {
  TransferFunction everywhere{.colors = {{0, {1, 1, 1}}}, .densities = {{0, 1}}};
  const View view = orthographic_view(16, 16);
  EXPECT_EQ(total_alpha(picture({{{0, 0, -5}, nan_value, 4}, {{0, 0, -5}, -nan_value, 4}}, view, everywhere)), 0);
  EXPECT_GT(total_alpha(picture({{{0, 0, -5}, 0.5F, 4}}, view, everywhere)), 1);
}

TEST_P(RendererTest, SplatAtTheEyeCoversThePicture) {
  const View view = perspective_view(32, 32);
  const float opacity = 1 - std::exp(-1.0F);
  for (const float depth : {1e-3F, 1e-10F, 1e-30F, 1e-37F}) {
    const Image image = picture({{{0, 0, -depth}, 0, 1}}, view, four_colors(1));
    expect_sane(image);
    for (const vec4& pixel : image.pixels) ASSERT_NEAR(pixel.a, opacity, 1e-4) << depth;

    // Beside the axis it still covers the pixel, as faint as its Gaussian is there.
    const Image aside = picture({{{0.4F, 0, -depth}, 0, 1}}, view, four_colors(1));
    expect_sane(aside);
    EXPECT_NEAR(aside.at(16, 16).a, opacity * std::exp(-0.5), 1e-3) << depth;
  }
}

TEST_P(RendererTest, ExtremeSizesStaySane) {
  std::vector<Splat> splats;
  for (const float size : {1e-30F, 1e-10F, 1e-3F, 1.0F, 1e5F, 1e18F, 3e38F, infinity})
    for (const float depth : {1e-30F, 1e-10F, 1.0F, 1e10F, 1e18F, 3e38F})
      for (const float aside : {0.0F, 1e-3F, 1e10F, 3e38F}) splats.push_back({{aside, -aside, -depth}, 0, size});
  for (const double extinction : {1e-30, 1.0, 1e30}) {
    expect_sane(picture(splats, perspective_view(33, 17), four_colors(extinction)));
    expect_sane(picture(splats, orthographic_view(33, 17), four_colors(extinction)));
  }
}

TEST_P(RendererTest, DetailSurvivesFarFromTheOrigin) {
  std::vector<Splat> splats = random_splats(300, 5, 0.1F);
  const TransferFunction function = four_colors(5);
  const Image at_origin = picture(splats, perspective_view(64, 64, {0, 0, 4}), function);
  ASSERT_GT(total_alpha(at_origin), 100);

  const dvec3 far(1e7, -3e7, 2e7);
  const Image far_away =
      picture(splats, perspective_view(64, 64, far + dvec3(0, 0, 4)), function, SortMode::exact, far);
  EXPECT_LE(rmse(at_origin, far_away), 1e-3);
}

TEST_P(RendererTest, ThePictureDoesNotDependOnTheUnitOfLength) {
  std::vector<Splat> splats = random_splats(300, 6, 0.1F);
  const Image expected = picture(splats, perspective_view(64, 64, {0, 0, 4}), four_colors(5));

  for (const float unit : {1e-6F, 1e6F}) {
    std::vector<Splat> scaled = splats;
    for (Splat& splat : scaled) {
      splat.position *= unit;
      splat.size *= unit;
    }
    const Image image = picture(scaled, perspective_view(64, 64, {0, 0, 4.0 * unit}), four_colors(5.0 / unit));
    EXPECT_LE(rmse(image, expected), 1e-3) << unit;
  }
}

TEST_P(RendererTest, SmallSplatsKeepTheirLight) {
  std::mt19937 generator(8);
  std::uniform_real_distribution<double> fraction(0, 1);
  for (const double sigma : {0.01, 0.1, 0.3, 0.5, 0.8, 2.0}) {
    // A grid of splats at random positions between the pixels' centres, too far apart to overlap.
    std::vector<Splat> splats;
    for (int y = 0; y < 32; ++y)
      for (int x = 0; x < 32; ++x)
        splats.push_back({vec3(16 * x - 248 + fraction(generator), 16 * y - 248 + fraction(generator), -100), 3,
                          static_cast<float>(sigma / 0.4)});
    const double optical_depth = 3;
    const TransferFunction function = four_colors(optical_depth / (sigma / 0.4));
    const double expected = 1024 * 2 * std::numbers::pi * sigma * sigma * (1 - std::exp(-optical_depth));
    EXPECT_NEAR(total_alpha(picture(splats, orthographic_view(512, 512), function)) / expected, 1, 0.02) << sigma;
  }
}

TEST_P(RendererTest, SmallSplatsKeepTheirLightInPerspective) {
  const View view = perspective_view(64, 64);
  std::mt19937 generator(9);
  std::uniform_real_distribution<float> coordinate(-2, 2);
  std::vector<Splat> splats(2000);
  for (Splat& splat : splats) splat = {{coordinate(generator), coordinate(generator), -10}, 3, 0.01F};

  // Faint, so that overlaps add up.
  const double sigma = 0.4 * 0.01 * view.focal / 10;
  const double expected = 2000 * 2 * std::numbers::pi * sigma * sigma * (1 - std::exp(-0.1));
  ASSERT_LT(sigma, 0.5);
  EXPECT_NEAR(total_alpha(picture(splats, view, four_colors(10))) / expected, 1, 0.04);
}

TEST_P(RendererTest, ThinSplatsAddUp) {
  // A thousand layers of optical depth 1/1000: 8 bits would show nothing, and an alpha cut at 0.001 neither.
  std::vector<Splat> splats;
  for (int i = 0; i < 1000; ++i) splats.push_back({{0, 0, -10.0F - static_cast<float>(i)}, 3, 20});
  const Image image = picture(splats, orthographic_view(65, 65), four_colors(1e-3 / 20));
  EXPECT_NEAR(image.at(32, 32).a, 1 - std::exp(-1.0), 1e-3);
  const double sum = total_alpha(image);

  double expected = 0;
  for (int y = -32; y <= 32; ++y)
    for (int x = -32; x <= 32; ++x) expected += 1 - std::exp(-std::exp(-(x * x + y * y) / (2 * 64.0)));
  EXPECT_NEAR(sum / expected, 1, 0.02);
}

TEST_P(RendererTest, NarrowRangesFarFromZeroKeepTheirColours) {
  // Values near 101325 that single precision could not tell apart.
  TransferFunction function = four_colors(1);
  const double offset = 101325;
  const View view = orthographic_view(20, 10);
  const auto value = static_cast<float>(0.7 * (function.hi - function.lo) + function.lo);
  const Image near_zero = picture({{{0, 0, -1}, value, 5}}, view, function);
  constexpr float scale = 1e-5F;
  function.lo = offset + function.lo * static_cast<double>(scale);
  function.hi = offset + function.hi * static_cast<double>(scale);
  const std::vector<Splat> splats = {{{0, 0, -1}, value * scale, 5}};
  ASSERT_TRUE(set_splats(splats, {{dvec3(0), 0, 1}}));
  ASSERT_TRUE(renderer_->set_transfer_function(function, {.value_offset = offset}));
  EXPECT_LE(compare_images(near_zero, redraw(view))->max, 1e-4);
}

TEST_P(RendererTest, LightFollowsTheGradient) {
  // Gradients at angles to the line of sight, which is the direction of the light.
  const auto packed = [](double angle) {
    const auto x = static_cast<std::uint32_t>(std::lround(127 * std::sin(angle))) & 0xffU;
    const auto z = static_cast<std::uint32_t>(std::lround(127 * std::cos(angle))) & 0xffU;
    return x | z << 16;
  };
  for (const View& view : {orthographic_view(9, 9), perspective_view(9, 9)}) {
    for (const double angle : {0.0, 0.5, 1.2, 2.0, 3.1}) {
      renderer_->set_lighting(Lighting{0.25, 0.5});
      const std::vector<Splat> splats{{{0, 0, -1}, 0, 20, packed(angle)}};
      EXPECT_NEAR(picture(splats, view, four_colors(1)).at(4, 4).r, 0.25 + 0.5 * std::abs(std::cos(angle)), 5e-3);
      EXPECT_NEAR(redraw(view).at(4, 4).a, 1, 1e-4);
      // Without a gradient: full light. Without lighting: the colour itself.
      EXPECT_NEAR(picture({{{0, 0, -1}, 0, 20}}, view, four_colors(1)).at(4, 4).r, 0.75, 1e-4);
      renderer_->set_lighting({});
      EXPECT_NEAR(picture(splats, view, four_colors(1)).at(4, 4).r, 1, 1e-4);
    }
  }
}

TEST_P(RendererTest, AxisOrderIsExactAlongTheAxis) {
  std::vector<Splat> splats;
  for (int i = 0; i < 60; ++i) splats.push_back({{0, 0, -10 - (i * 37) % 60}, static_cast<float>(i % 4), 15});
  View view = orthographic_view(64, 64);
  const Image front = picture(splats, view, four_colors(0.02));
  EXPECT_LT(rmse(redraw(view, SortMode::axis), front), 1e-6);
  EXPECT_GT(rmse(redraw(view, SortMode::none), front), 1e-2);

  view.eye = {0, 0, -100};
  view.forward = {0, 0, 1};
  view.right = {-1, 0, 0};
  const Image back = redraw(view);
  EXPECT_GT(rmse(back, front), 1e-2);
  EXPECT_LT(rmse(redraw(view, SortMode::axis), back), 1e-6);
}

TEST_P(RendererTest, NoSplatsGiveTransparentBlack) {
  ASSERT_TRUE(renderer_->set_transfer_function(four_colors(1), {}));
  for (const SortMode sort : {SortMode::none, SortMode::exact}) {
    for (const vec4& pixel : redraw(orthographic_view(20, 10), sort).pixels) ASSERT_EQ(pixel, vec4(0));
    ASSERT_TRUE(set_splats({}, {{dvec3(1), 0, 0}}));
    for (const vec4& pixel : redraw(orthographic_view(20, 10), sort).pixels) ASSERT_EQ(pixel, vec4(0));
  }

  // The earlier splats are gone, too.
  ASSERT_GT(total_alpha(picture({{{0, 0, -1}, 0, 5}}, orthographic_view(20, 10), four_colors(1))), 1);
  ASSERT_TRUE(set_splats({}, {}));
  EXPECT_EQ(total_alpha(redraw(orthographic_view(20, 10))), 0);
}

TEST_P(RendererTest, AMillionSplats) {
  std::vector<Splat> splats = random_splats(1'000'000, 10, 0.01F);
  const View view = perspective_view(256, 256, {0, 0, 5});
  const Image exact = picture(splats, view, four_colors(5));
  expect_sane(exact);
  EXPECT_GT(total_alpha(exact), 256 * 256 * 0.2);

  // Splats that the test has sorted give the same picture in array order: there is no seam between runs.
  std::ranges::sort(splats, std::ranges::greater{},
                    [&](const Splat& splat) { return glm::length(view.to_view(dvec3(splat.position))); });
  EXPECT_LT(rmse(picture(splats, view, four_colors(5), SortMode::none), exact), 1e-4);
}

TEST_P(RendererTest, SizesChangeBetweenDraws) {
  const std::vector<Splat> splats{{{3, 2, -5}, 0, 4}};
  const Image first = picture(splats, orthographic_view(64, 64), four_colors(1));
  const Image wide = redraw(orthographic_view(128, 32));
  EXPECT_EQ(wide.width, 128);
  EXPECT_EQ(wide.height, 32);
  EXPECT_LT(glm::distance(wide.at(64 + 3, 16 - 2), first.at(32 + 3, 32 - 2)), 1e-6);
  EXPECT_EQ(rmse(redraw(orthographic_view(64, 64)), first), 0);
  EXPECT_EQ(redraw(orthographic_view(1, 1)).pixels.size(), 1U);
}

// A Gaussian whose deviation is 5 samples is smooth between samples, except for the jump of 1/90 at its cut.
TEST_P(RendererTest, WideSamplesKeepLargeSplats) {
  for (const int spacing : {2, 3, 4, 8}) {
    const auto size = static_cast<float>(12.5 * spacing);
    for (const View& view : {orthographic_view(256, 177), perspective_view(129, 256, dvec3(0, 0, 90))}) {
      const Image exact = picture({{{1, 2, -10}, 3, size}, {{-9, 5, -20}, 1, size}}, view, four_colors(0.01));
      const Image sampled = redraw(view, SortMode::exact, spacing);
      expect_sane(sampled);
      float largest = 0, brightest = 0;
      for (std::size_t i = 0; i < exact.pixels.size(); ++i) {
        const vec4 difference = glm::abs(exact.pixels[i] - sampled.pixels[i]);
        largest = std::max({largest, difference.r, difference.g, difference.b, difference.a});
        brightest = std::max(brightest, exact.pixels[i].a);
      }
      EXPECT_LT(largest, brightest / 145) << spacing;
      EXPECT_GT(largest, 0) << spacing;
      EXPECT_NEAR(total_alpha(sampled) / total_alpha(exact), 1, 1e-3) << spacing;
    }
  }
}

TEST_P(RendererTest, SamplesOfNothing) {
  (void)picture({}, orthographic_view(64, 64), four_colors(1));
  glBindVertexArray(0);  // as before the very first splat
  const Image image = redraw(orthographic_view(64, 64), SortMode::exact, 4);
  for (const vec4& pixel : image.pixels) ASSERT_EQ(pixel, vec4(0));
}

TEST_P(RendererTest, SamplesHaveTheMiddleOfThePicture) {
  for (const auto& [width, height, spacing] :
       {std::tuple{64, 64, 4}, {65, 63, 4}, {33, 50, 7}, {7, 3, 5}, {1, 1, 64}}) {
    const View view = orthographic_view(width, height);
    (void)picture({{{0, 0, -10}, 3, 40}}, view, four_colors(0.02));
    const Image image = redraw(view, SortMode::exact, spacing);
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        ASSERT_NEAR(image.at(x, y).a, image.at(width - 1 - x, height - 1 - y).a, 1e-5) << width << " " << spacing;
    EXPECT_GT(image.at(width / 2, height / 2).a, 0.1);
  }
}

// The picture where the device has it, and its copy.
TEST_P(RendererTest, PixelsAreReadWhereThePictureIs) {
  EXPECT_FALSE(read_pixel(renderer_->picture(), 0, 0)) << "before the first picture";
  ASSERT_TRUE(renderer_->set_transfer_function(four_colors(3), {}));
  ASSERT_TRUE(set_splats(random_splats(200, 5, 0.3F), {{dvec3(0), 0, 200}}));
  const Image image = redraw(perspective_view(40, 30, {0, 0, 4}));
  ASSERT_GT(total_alpha(image), 0);
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x) ASSERT_EQ(read_pixel(renderer_->picture(), x, y).value(), image.at(x, y));
  for (const auto& [x, y] : {std::pair{-1, 0}, {0, -1}, {image.width, 0}, {0, image.height}})
    EXPECT_FALSE(read_pixel(renderer_->picture(), x, y));
}

TEST_P(RendererTest, RefusesWhatItCannotDraw) {
  const View view = orthographic_view(8, 8);
  EXPECT_THAT(renderer_->draw(view, SortMode::none, 1).error().message, HasSubstr("transfer function"));
  EXPECT_THAT(renderer_->read_image().error().message, HasSubstr("no picture"));
  EXPECT_FALSE(renderer_->set_transfer_function(TransferFunction{}, {}));
  ASSERT_TRUE(renderer_->set_transfer_function(four_colors(1), {}));

  for (const int size : {0, -5, renderer_->capabilities().largest_side + 1, 1 << 20}) {
    View impossible = view;
    impossible.width = size;
    EXPECT_THAT(renderer_->draw(impossible, SortMode::none, 1), FailsWith(ErrorCode::invalid_argument));
  }
  for (const int spacing : {-1, 0, max_sample_spacing + 1})
    EXPECT_FALSE(renderer_->draw(view, SortMode::none, spacing));
  EXPECT_TRUE(renderer_->draw(view, SortMode::none, 1));
}

INSTANTIATE_TEST_SUITE_P(Devices, RendererTest, testing::Values(Device::gl, Device::cpu), device_name);

}  // namespace
}  // namespace splatvol::test
