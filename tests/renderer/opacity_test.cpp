// A factor on the extinction by the values of another attribute, on all devices.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

#include "tests/renderer/bodies.h"
#include "tests/renderer/random_splats.h"
#include "tests/renderer/ways.h"
#include "tests/support/results.h"

namespace splatvol::test {
namespace {

/// What draws lists.
class Drawing {
 public:
  explicit Drawing(const Way& way, KernelKind kernel = KernelKind::moments,
                   const std::optional<Lighting>& lighting = {})
      : rasterizer_(make_rasterizer_for(way, kernel)) {
    rasterizer_->set_lighting(lighting);
  }

  [[nodiscard]] Image picture(const DrawList& list, const Transfer& transfer, const DrawingUnits& units = {},
                              const View& view = view_from({0.3, 0.5, 4})) {
    EXPECT_TRUE(rasterizer_->set_transfer_function(transfer, units));
    EXPECT_EQ(message_of(rasterizer_->set_draw_list(list)), "");
    EXPECT_TRUE(rasterizer_->draw(view, SortMode::exact, 1));
    return rasterizer_->read_image().value();
  }

 private:
  std::unique_ptr<Rasterizer> rasterizer_;
};

/// Packs splats with these values of the opacity attribute.
template <class Splat>
DrawList list_of(const std::vector<Splat>& splats, std::vector<OpacityValue> values, double deviation_scale = 0) {
  DrawList list;
  append(list, pack_row(std::span(splats), dvec3(0), 1, {std::move(values), deviation_scale}), 0,
         static_cast<std::uint32_t>(splats.size()));
  return list;
}

std::vector<OpacityValue> same(std::size_t count, float value) {
  return std::vector<OpacityValue>(count, {value, 0, 255});
}

/// The factor is the value.
TransferFunction ramp() { return {.colors = {{0, {1, 0, 1}}}, .densities = {{0, 0}, {1, 1}}}; }

TransferFunction times(TransferFunction function, double factor) {
  for (auto& density : function.densities) density.extinction *= factor;
  return function;
}

double largest_difference(const Image& a, const Image& b) { return compare_images(a, b).value().max; }

bool shows(const Image& image) {
  return std::ranges::any_of(image.pixels, [](const vec4& pixel) { return pixel.a > 0.05F; });
}

TEST(Opacity, AFactorIsThatOfThinnerMaterial) {
  const auto splats = random_splats(800);
  const TransferFunction function = lively(), factors = ramp();
  for (const Way& way : all_ways())
    for (const std::optional<Lighting>& lighting : {std::optional<Lighting>(), std::optional(Lighting())}) {
      SCOPED_TRACE(testing::Message() << way.name << ", lit " << lighting.has_value());
      Drawing drawing(way, KernelKind::moments, lighting);
      const Image expected = drawing.picture(list_of(splats, {}), times(function, 0.25));
      const Image image = drawing.picture(list_of(splats, same(800, 0.25F)), {function, &factors});
      EXPECT_TRUE(shows(image));
      EXPECT_LT(largest_difference(image, expected), 2e-4);
      // Without the functions, or without the values, there is no factor.
      const Image whole = drawing.picture(list_of(splats, {}), function);
      EXPECT_EQ(largest_difference(drawing.picture(list_of(splats, same(800, 0.25F)), function), whole), 0);
      EXPECT_EQ(largest_difference(drawing.picture(list_of(splats, {}), {function, &factors}), whole), 0);
    }
}

TEST(Opacity, EachSplatHasItsOwn) {
  const auto splats = random_splats(600);
  std::vector<MomentsSplat> shown;
  std::vector<OpacityValue> values;
  for (std::size_t i = 0; i < splats.size(); ++i) {
    values.push_back({i % 3 == 0 ? 0.0F : 1.0F, 0, 255});
    if (i % 3 != 0) shown.push_back(splats[i]);
  }
  const TransferFunction function = lively(), factors = ramp();
  for (const Way& way : all_ways()) {
    SCOPED_TRACE(way.name);
    Drawing drawing(way);
    const Image expected = drawing.picture(list_of(shown, {}), function);
    const Image image = drawing.picture(list_of(splats, values), {function, &factors});
    EXPECT_LT(largest_difference(image, expected), 2e-4);
  }
}

TEST(Opacity, AHiddenBodyIsNotThere) {
  const std::vector<Body> bodies = {{dvec3(-0.8, -0.8, -0.2), dvec3(-0.1, 0.8, 0.2), glm::ivec3(6)},
                                    {dvec3(0.1, -0.8, -0.2), dvec3(0.8, 0.8, 0.2), glm::ivec3(6)}};
  const std::vector<MomentsSplat> first = splats_of({bodies[0]}), both = splats_of(bodies);
  std::vector<OpacityValue> values = same(both.size(), 0);
  std::fill_n(values.begin(), first.size(), OpacityValue{1, 0, 255});
  const TransferFunction function = uniform(3), factors = ramp();
  const View view = view_from({0.2, 0.1, 4});
  for (const Way& way : all_ways()) {
    SCOPED_TRACE(way.name);
    const Image image = Drawing(way).picture(list_of(both, values), {function, &factors}, {}, view);
    EXPECT_LT(compare_images(image, exact({bodies[0]}, 3, view))->rmse, 0.02);
  }
}

// The mean over the values of a splat, as a step has it: the share of a normal distribution above the step.
TEST(Opacity, IsTheMeanOverASplatsValues) {
  const std::vector<MomentsSplat> splat = {{{.mass = 1.2, .deviations = dvec3(0.3)}}};
  TransferFunction step = ramp();
  step.densities = {{0, 0}, {0.5, 0}, {0.5, 1}, {1, 1}};
  const auto depth = [](const Image& image) {
    return -std::log1p(-static_cast<double>(image.at(image.width / 2, image.height / 2).a));
  };
  const View view = view_from({0, 0, 4});
  for (const Way& way : all_ways())
    for (const double deviation : {0.0, 0.02, 0.3, 40.0}) {
      SCOPED_TRACE(testing::Message() << way.name << ", deviation " << deviation);
      // Stored values count from 100, in steps of 10.
      const DrawingUnits units{.opacity_offset = 100, .opacity_scale = 10};
      step.lo = 100 + 10 * 2.0;
      step.hi = 100 + 10 * 3.0;
      const double mean = 2.4;
      const OpacityValue value{static_cast<float>(mean), log_code(deviation, 64), 255};
      const double held = log_number(value.deviation, 64);
      const double expected = held > 0 ? 0.5 * std::erfc((2.5 - mean) / held / std::numbers::sqrt2) : 0;
      Drawing drawing(way);
      const double whole = depth(drawing.picture(list_of(splat, {}), uniform(0.5), {}, view));
      const double faded = depth(drawing.picture(list_of(splat, {value}, 64), {uniform(0.5), &step}, units, view));
      ASSERT_GT(whole, 0.05);
      EXPECT_NEAR(faded / whole, expected, 0.02);
    }
}

TEST(Opacity, KnowsTheAxes) {
  const std::vector<MomentsSplat> splat = {{{.mass = 1.2, .deviations = dvec3(0.3)}}};
  const auto depth = [](const Image& image) {
    return -std::log1p(-static_cast<double>(image.at(image.width / 2, image.height / 2).a));
  };
  const View view = view_from({0, 0, 4});
  for (const ValueAxis axis : {ValueAxis::linear, ValueAxis::log, ValueAxis::asinh})
    for (const Way& way : all_ways())
      for (const double value : {0.02, 0.5, 30.0, 900.0}) {
        TransferFunction factors = ramp();
        factors.axis = axis;
        factors.lo = 0.01;
        factors.hi = 1000;
        factors.linear_width = 0.1;
        SCOPED_TRACE(testing::Message() << way.name << ", axis " << static_cast<int>(axis) << ", value " << value);
        Drawing drawing(way);
        const double whole = depth(drawing.picture(list_of(splat, {}), uniform(0.5), {}, view));
        const double faded = depth(
            drawing.picture(list_of(splat, same(1, static_cast<float>(value))), {uniform(0.5), &factors}, {}, view));
        EXPECT_NEAR(faded / whole, factors.extinction(value), 0.004);
      }
}

TEST(Opacity, WhatHasNoValueIsNotDrawn) {
  constexpr float nan = std::numeric_limits<float>::quiet_NaN();
  const auto splats = random_splats(300);
  const TransferFunction function = lively();
  TransferFunction one = ramp();
  one.densities = {{0, 1}};
  for (const Way& way : all_ways()) {
    SCOPED_TRACE(way.name);
    Drawing drawing(way);
    for (const OpacityValue& missing : {OpacityValue{0.5F, 0, 0}, OpacityValue{nan, 0, 255}}) {
      const std::vector<OpacityValue> values(splats.size(), missing);
      EXPECT_FALSE(shows(drawing.picture(list_of(splats, values), {function, &one})));
    }
    const std::vector<OpacityValue> half(splats.size(), {0.5F, 0, 51});
    const Image expected = drawing.picture(list_of(splats, {}), times(function, 0.2));
    EXPECT_LT(largest_difference(drawing.picture(list_of(splats, half), {function, &one}), expected), 2e-4);
  }
}

TEST(Opacity, ServesTheKernelOctant) {
  std::vector<OctantSplat> splats, shown;
  std::vector<OpacityValue> values;
  for (const MomentsSplat& splat : random_splats(500)) {
    splats.push_back({vec3(splat.center), static_cast<float>(splat.value), 0.1F, 0});
    const bool hidden = splats.size() % 2 == 0;
    values.push_back({hidden ? 0.0F : 0.4F, 0, 255});
    if (!hidden) shown.push_back(splats.back());
  }
  const TransferFunction function = lively(), factors = ramp();
  for (const Way& way : all_ways()) {
    SCOPED_TRACE(way.name);
    Drawing drawing(way, KernelKind::octant);
    const Image expected = drawing.picture(list_of(shown, {}), times(function, 0.4));
    const Image image = drawing.picture(list_of(splats, values), {function, &factors});
    EXPECT_TRUE(shows(image));
    EXPECT_LT(largest_difference(image, expected), 2e-4);
  }
}

// Pages of the device grow, and lists with and without values take turns.
TEST(Opacity, HoldsWhileListsChange) {
  constexpr std::size_t each = 4000, rows = 20;
  const auto splats = random_splats(each, 0.002, 0.02);
  const TransferFunction function = lively(40), factors = ramp();
  DrawList all, first, without;
  for (std::size_t i = 0; i < rows; ++i) {
    const RecordRow row = pack_row(std::span(splats), dvec3(0.05 * static_cast<double>(i)), 1,
                                   {same(each, static_cast<float>(i) / rows), 0});
    append(all, row, 0, each);
    if (i < rows / 4) append(first, row, 0, each);
    append(without, pack_row(std::span(splats), dvec3(0), 1), 0, each);
  }
  for (const Way& way : all_ways()) {
    SCOPED_TRACE(way.name);
    const Image expected = Drawing(way).picture(all, {function, &factors});
    Drawing drawing(way);
    EXPECT_TRUE(shows(drawing.picture(first, {function, &factors})));
    EXPECT_EQ(largest_difference(drawing.picture(all, {function, &factors}), expected), 0);
    static_cast<void>(drawing.picture(without, {function, &factors}));
    EXPECT_EQ(largest_difference(drawing.picture(all, {function, &factors}), expected), 0);
  }
}

TEST(Opacity, WrongFactorsAreRefused) {
  for (const Way& way : all_ways()) {
    const auto rasterizer = make_rasterizer(way.device, {.kernel = KernelKind::moments}).value();
    for (const double wrong : {-0.1, 1.1, std::numeric_limits<double>::quiet_NaN()}) {
      TransferFunction factors = ramp();
      factors.densities = {{0, wrong}};
      EXPECT_THAT(message_of(rasterizer->set_transfer_function({lively(), &factors}, {})),
                  testing::HasSubstr("outside [0, 1]"));
    }
    TransferFunction empty = ramp();
    empty.hi = empty.lo;
    EXPECT_FALSE(rasterizer->set_transfer_function({lively(), &empty}, {}));
  }
}

}  // namespace
}  // namespace splatvol::test
