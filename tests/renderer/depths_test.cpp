// Opaque surfaces: what lies behind them is hidden, in each pixel. Against closed forms, on all devices.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <numbers>
#include <optional>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "renderer/depth_pyramid.h"
#include "renderer/device/device.h"
#include "splat/kernel.h"
#include "tests/renderer/bodies.h"
#include "tests/renderer/draw_parts.h"
#include "tests/renderer/random_splats.h"
#include "tests/renderer/targets.h"
#include "tests/renderer/ways.h"
#include "tests/support/results.h"

namespace splatvol::test {
namespace {

using ::testing::HasSubstr;

constexpr float infinity = std::numeric_limits<float>::infinity();

/// A rasterizer that draws a list, and what it draws without surfaces.
class Drawn {
 public:
  Drawn(const Way& way, const DrawList& list, const TransferFunction& function, const DrawingUnits& units = {})
      : Drawn(way, KernelKind::moments, list, function, units) {}
  Drawn(const Way& way, KernelKind kernel, const DrawList& list, const TransferFunction& function,
        const DrawingUnits& units = {})
      : rasterizer_(make_rasterizer_for(way, kernel)) {
    EXPECT_TRUE(rasterizer_->set_transfer_function(function, units));
    EXPECT_TRUE(rasterizer_->set_draw_list(list));
  }

  [[nodiscard]] Rasterizer& rasterizer() { return *rasterizer_; }

  /// Draws with surfaces, or without.
  Image picture(const View& view, const std::optional<SurfaceDepths>& depths = {}, int spacing = 1) {
    EXPECT_TRUE(rasterizer_->set_surface_depths(depths ? std::make_shared<const SurfaceDepths>(*depths) : nullptr));
    EXPECT_EQ(message_of(rasterizer_->draw(view, SortMode::exact, spacing)), "");
    return rasterizer_->read_image().value();
  }

 private:
  std::unique_ptr<Rasterizer> rasterizer_;
};

/// The depths that `depth_at` gives for a pixel's column and its row from the lower edge.
template <class DepthAt>
SurfaceDepths depths_of(const View& view, const DepthAt& depth_at) {
  SurfaceDepths depths{view.width, view.height, {}};
  for (int row = 0; row < view.height; ++row)
    for (int x = 0; x < view.width; ++x)
      depths.depths.push_back(static_cast<float>(depth_at(x, view.height - 1 - row)));
  return depths;
}

SurfaceDepths constant(const View& view, double depth) {
  return depths_of(view, [&](int, int) { return depth; });
}

/// The plane through a point with this normal.
SurfaceDepths plane(const View& view, dvec3 point, dvec3 normal) {
  return depths_of(view, [&](int x, int y) {
    const Ray ray = ray_of(view, x, y);
    const double distance = glm::dot(point - ray.origin, normal) / glm::dot(ray.direction, normal);
    return distance > 0 ? distance * glm::dot(ray.direction, view.forward) : infinity;
  });
}

SurfaceDepths ball(const View& view, dvec3 center, double radius) {
  return depths_of(view, [&](int x, int y) {
    const Ray ray = ray_of(view, x, y);
    const double along = glm::dot(center - ray.origin, ray.direction);
    const double rest = radius * radius - glm::dot(center - ray.origin, center - ray.origin) + along * along;
    return rest > 0 ? (along - std::sqrt(rest)) * glm::dot(ray.direction, view.forward) : infinity;
  });
}

double rmse(const Image& a, const Image& b) { return compare_images(a, b).value().rmse; }

bool are_same_bits(const Image& a, const Image& b) {
  return a.pixels.size() == b.pixels.size() &&
         std::memcmp(a.pixels.data(), b.pixels.data(), a.pixels.size() * sizeof(vec4)) == 0;
}

float largest(const Image& image) {
  float result = 0;
  for (const vec4& pixel : image.pixels)
    for (int i = 0; i < 4; ++i) result = std::max(result, std::abs(pixel[i]));
  return result;
}

std::vector<OctantSplat> random_octants(std::size_t count) {
  std::mt19937 generator(3);
  std::uniform_real_distribution<float> unit(-1, 1);
  std::vector<OctantSplat> splats(count);
  for (OctantSplat& splat : splats) {
    splat.position = vec3(unit(generator), unit(generator), unit(generator));
    splat.size = 0.1F + 0.05F * unit(generator);
    splat.value = 0.5F + 0.4F * unit(generator);
  }
  return splats;
}

/// A drawing of each kernel on each device.
struct Case {
  std::string name;
  Way way;
  KernelKind kernel;
  DrawList list;
};

std::vector<Case> random_cases(std::size_t count) {
  const std::vector<OctantSplat> octants = random_octants(count);
  std::vector<Case> cases;
  for (const Way& way : all_ways()) {
    cases.push_back({way.name, way, KernelKind::moments, list_of(random_splats(count))});
    cases.push_back({std::string(way.name) + ", octant", way, KernelKind::octant,
                     make_list(octants, {{dvec3(0), 0, octants.size()}})});
  }
  return cases;
}

TEST(Depths, OfWhatIsBehindEverythingChangeNoBit) {
  for (const bool orthographic : {false, true})
    for (const dvec3 eye : {dvec3(0.3, 0.2, 4), dvec3(0.1, 0.2, 0.3)}) {
      const View view = view_from(eye, orthographic, 131, 97);
      for (const Case& c : random_cases(3000)) {
        SCOPED_TRACE(testing::Message() << c.name << ", orthographic " << orthographic << ", eye " << eye.z);
        Drawn drawn(c.way, c.kernel, c.list, lively());
        const Image without = drawn.picture(view);
        EXPECT_GT(largest(without), 0.5F);
        for (const float depth : {8.0F, 1e30F, infinity, std::numeric_limits<float>::quiet_NaN()})
          EXPECT_TRUE(are_same_bits(drawn.picture(view, constant(view, depth)), without)) << depth;
        EXPECT_TRUE(are_same_bits(drawn.picture(view), without));
      }
    }
}

TEST(Depths, OfWhatIsInFrontOfEverythingLeaveNothing) {
  for (const bool orthographic : {false, true})
    for (const Case& c : random_cases(3000)) {
      SCOPED_TRACE(testing::Message() << c.name << ", orthographic " << orthographic);
      Drawn drawn(c.way, c.kernel, c.list, lively());
      const View outside = view_from(dvec3(0.3, 0.2, 4), orthographic, 131, 97);
      for (const double depth : {1.0, 1e-30, 0.0, -3.0, -std::numeric_limits<double>::infinity()})
        EXPECT_EQ(largest(drawn.picture(outside, constant(outside, depth))), 0) << depth;
      const View inside = view_from(dvec3(0.1, 0.2, 0.3), orthographic, 131, 97);
      for (const double depth : {0.0, -3.0})
        EXPECT_EQ(largest(drawn.picture(inside, constant(inside, depth))), 0) << depth;
    }
}

/// The share of a chord's mass in front of u, by DESIGN.md: F(u) = (3 asin u + u (5 - 2 u^2) sqrt(1 - u^2)) / 8.
double share_in_front(double u) {
  u = std::clamp(u, -1.0, 1.0);
  const double f = (3 * std::asin(u) + u * (5 - 2 * u * u) * std::sqrt(1 - u * u)) / 8;
  return 0.5 + f / (3 * std::numbers::pi / 8);
}

TEST(Depths, ARoundSplatHasItsClosedForm) {
  const double deviation = 0.2, mass = 0.4, center = 3;
  MomentsSplat splat;
  splat.mass = mass;
  splat.deviations = dvec3(deviation);
  for (const bool orthographic : {false, true}) {
    const View view = view_from(dvec3(0, 0, center), orthographic, 97, 97);
    const double pixel = (orthographic ? 1 : center) / view.focal;
    const double a = moments_half_width * std::sqrt(deviation * deviation + 0.1 * pixel * pixel);
    for (const Way& way : all_ways()) {
      Drawn drawn(way, list_of({splat}), uniform(1));
      for (const double depth : {2.2, 2.5, 2.8, 3.0, 3.1, 3.5, 3.7}) {
        SCOPED_TRACE(testing::Message() << way.name << ", orthographic " << orthographic << ", depth " << depth);
        const Image image = drawn.picture(view, constant(view, depth));
        for (int x = 0; x < view.width; ++x) {
          const Ray ray = ray_of(view, x, view.height / 2);
          const double along = glm::dot(-ray.origin, ray.direction);
          const double inside = 1 - (glm::dot(ray.origin, ray.origin) - along * along) / (a * a);
          const double cut = (depth / glm::dot(ray.direction, view.forward) - along) / (a * std::sqrt(inside));
          const double optical = inside > 0 ? mass * 3 / (std::numbers::pi * a * a) * inside * inside : 0;
          const double exact = inside > 0 ? -std::expm1(-optical * share_in_front(cut)) : 0;
          // The part fainter than 3e-4 is cut, and its light given to the rest.
          ASSERT_NEAR(image.at(x, view.height / 2).a, exact, 3.2e-4 + 2e-4 * optical) << x;
        }
      }
    }
  }
}

TEST(Depths, TheValueIsThatOfWhatIsInFront) {
  // A linear field along the line of sight: what a surface hides has the larger values.
  MomentsSplat splat;
  splat.mass = 0.4;
  splat.deviations = dvec3(0.2);
  splat.value = 0.5;
  splat.value_deviation = 0.1;
  splat.correlations = dvec3(0, 0, -1);
  TransferFunction function = uniform(1e-2);
  function.colors = {{0, dvec3(0)}, {1, dvec3(1)}};
  const View view = view_from(dvec3(0, 0, 3), true, 97, 97);
  for (const Way& way : all_ways()) {
    Drawn drawn(way, list_of({splat}), function);
    for (const double depth : {2.7, 3.0, 3.2, 4.0}) {
      const vec4 middle = drawn.picture(view, constant(view, depth)).at(48, 48);
      // The mean of u in front of the surface; u = 1 is moments_half_width deviations behind the centre.
      const double u = std::min((depth - 3) / (0.2 * moments_half_width), 1.0);
      const double moment = -std::pow(1 - u * u, 2.5) / 5 / (3 * std::numbers::pi / 8);
      const double mean = moment / share_in_front(u);
      EXPECT_NEAR(middle.r / middle.a, 0.5 + 0.1 * moments_half_width * mean, 2e-3) << way.name << " " << depth;
    }
  }
}

struct Surfaced {
  const char* name;
  SurfaceDepths depths;
};

std::vector<Surfaced> surfaces_for(const View& view) {
  const double distance = glm::dot(-view.eye, view.forward);
  return {{"a plane across the view", constant(view, distance - 0.2)},
          {"another", constant(view, distance + 0.33)},
          {"a tilted plane", plane(view, dvec3(0.1, 0, 0), glm::normalize(dvec3(0.5, 0.7, 1)))},
          {"a plane seen from the side", plane(view, dvec3(0.1, 0.05, 0), dvec3(1, 0.2, -0.1))},
          {"a ball", ball(view, dvec3(0.1, -0.1, 0.2), 0.5)}};
}

TEST(Depths, BodiesAreAsTheirRaysSay) {
  const std::vector<Body> bodies = {{dvec3(-0.8), dvec3(0.8), glm::ivec3(9)}};
  const DrawList list = list_of(splats_of(bodies));
  for (const Way& way : all_ways())
    for (const bool orthographic : {false, true})
      for (const dvec3 eye : {dvec3(0.03, 0.02, 4), dvec3(2, 1.5, 3), dvec3(0.1, 0.2, 0.3)}) {
        const View view = view_from(eye, orthographic);
        Drawn drawn(way, list, uniform(1));
        const double without = rmse(drawn.picture(view), test::exact(bodies, 1, view));
        for (const auto& [name, depths] : surfaces_for(view)) {
          SCOPED_TRACE(testing::Message()
                       << way.name << ", " << name << ", orthographic " << orthographic << ", eye " << eye.x);
          const double error = rmse(drawn.picture(view, depths), test::exact(bodies, 1, view, &depths));
          EXPECT_LT(error, 0.02);
          EXPECT_LT(error, 1.6 * without + 1e-3);
        }
      }
}

TEST(Depths, OfWallsShowWhatIsBetweenThem) {
  // The wall is where the mesh ends, as in a flow round a body.
  const std::vector<Body> bodies = {{dvec3(-0.8), dvec3(0.8), glm::ivec3(9)}};
  const DrawList list = list_of(splats_of(bodies));
  for (const Way& way : all_ways())
    for (const double behind : {-1e-3, 0.0, 1e-3}) {
      const View view = view_from(dvec3(0.4, 0.3, 4));
      const SurfaceDepths depths = plane(view, dvec3(0, 0, -0.8 - behind), dvec3(0, 0, 1));
      Drawn drawn(way, list, uniform(1));
      const Image truth = test::exact(bodies, 1, view, &depths);
      const double without = rmse(drawn.picture(view), truth), error = rmse(drawn.picture(view, depths), truth);
      EXPECT_LT(error, 1.1 * without + 5e-4) << way.name << " " << behind;
    }
}

TEST(Depths, HideToTheEdgeOfAPixel) {
  // On the left a surface hides all, on the right there is none.
  const View view = view_from(dvec3(0.3, 0.2, 4), false, 131, 97);
  const SurfaceDepths depths = depths_of(view, [](int x, int) { return x < 61 ? 1 : infinity; });
  for (const Case& c : random_cases(3000))
    for (const int spacing : {1, 4}) {
      SCOPED_TRACE(testing::Message() << c.name << ", every " << spacing << " pixels");
      Drawn drawn(c.way, c.kernel, c.list, lively());
      const Image without = drawn.picture(view), image = drawn.picture(view, depths, spacing);
      double squares = 0;
      for (int y = 0; y < view.height; ++y)
        for (int x = 0; x < view.width; ++x)
          for (int i = 0; i < 4; ++i) {
            if (x < 61)
              ASSERT_EQ(image.at(x, y)[i], 0) << x;
            else
              squares += std::pow(image.at(x, y)[i] - without.at(x, y)[i], 2);
          }
      // Splats that are cut on the left are drawn in the near form, and have samples at each pixel.
      EXPECT_LT(std::sqrt(squares / (4.0 * 70 * view.height)), 1e-3);
    }
}

TEST(Depths, DevicesAgree) {
  if (!parse_device("gl")) GTEST_SKIP() << "a build without OpenGL";
  for (const bool orthographic : {false, true})
    for (const dvec3 eye : {dvec3(0.3, 0.2, 4), dvec3(0.1, 0.2, 0.3)}) {
      const View view = view_from(eye, orthographic, 131, 97);
      const double distance = glm::dot(-eye, view.forward);
      const SurfaceDepths waves = depths_of(
          view, [&](int x, int y) { return distance + 0.4 * std::sin(0.3 * x) * std::cos(0.2 * y + 0.01 * x * y); });
      for (const auto& [smallest, largest] : {std::pair(0.002, 0.01), std::pair(0.01, 0.1), std::pair(0.01, 1.0)}) {
        const DrawList list = list_of(random_splats(5000, smallest, largest));
        const Image one = Drawn(by_splats, list, lively()).picture(view, waves);
        const Image other = Drawn(by_gl, list, lively()).picture(view, waves);
        EXPECT_LT(rmse(one, other), 1e-4) << orthographic << " " << eye.z << " " << largest;
      }
      const std::vector<OctantSplat> octants = random_octants(3000);
      const DrawList list = make_list(octants, {{dvec3(0), 0, 3000}});
      const Image one = Drawn(by_splats, KernelKind::octant, list, lively()).picture(view, waves);
      const Image other = Drawn(by_gl, KernelKind::octant, list, lively()).picture(view, waves);
      EXPECT_LT(rmse(one, other), 1e-4) << orthographic << " " << eye.z;
    }
}

TEST(Depths, OctantSplatsAreFlat) {
  OctantSplat splat{};
  splat.position = vec3(0);
  splat.size = 1;
  splat.value = 0.5F;
  const DrawList list = make_list(std::vector{splat}, {{dvec3(0), 0, 1}});
  const View view = view_from(dvec3(0, 0, 3), false, 65, 65);
  for (const Way& way : all_ways()) {
    Drawn drawn(way, KernelKind::octant, list, uniform(1));
    const Image without = drawn.picture(view);
    EXPECT_TRUE(are_same_bits(drawn.picture(view, constant(view, 3.01)), without));
    EXPECT_EQ(largest(drawn.picture(view, constant(view, 2.99))), 0);
    const Image half =
        drawn.picture(view, depths_of(view, [](int, int y) { return y < 32 ? 2.99 : 3.01; }));  // y: from below
    for (int row = 0; row < 65; ++row)
      EXPECT_EQ(half.at(32, row), row <= 32 ? without.at(32, row) : vec4(0)) << way.name << " " << row;
  }
}

TEST(Depths, AreInWorldUnits) {
  const std::vector<MomentsSplat> splats = random_splats(2000);
  const View view = view_from(dvec3(0.3, 0.2, 4), false, 131, 97);
  const SurfaceDepths depths = plane(view, dvec3(0), glm::normalize(dvec3(0.5, 0.7, 1)));
  for (const Way& way : all_ways()) {
    const Image plain = Drawn(way, list_of(splats), lively()).picture(view, depths);
    // The same splats in a world that is 2^40 times as large.
    const double unit = std::ldexp(1, 40);
    std::vector<MomentsSplat> far = splats;
    DrawList list;
    append(list, pack_row(std::span(std::as_const(far)), dvec3(0), unit), 0, static_cast<std::uint32_t>(far.size()));
    View large = view;
    large.eye *= unit;
    SurfaceDepths scaled = depths;
    for (float& depth : scaled.depths) depth *= static_cast<float>(unit);
    TransferFunction function = lively();
    for (auto& density : function.densities) density.extinction /= unit;
    DrawingUnits units{.length = unit};
    EXPECT_LT(rmse(Drawn(way, list, function, units).picture(large, scaled), plain), 1e-6) << way.name;
  }
}

TEST(Depths, OfAnotherSizeAreRefused) {
  const View view = view_from(dvec3(0.3, 0.2, 4), false, 64, 48);
  for (const Way& way : all_ways()) {
    Drawn drawn(way, list_of(random_splats(100)), lively());
    const Image hidden = drawn.picture(view, constant(view, 4));
    const auto wrong = std::make_shared<const SurfaceDepths>(SurfaceDepths{4, 4, std::vector<float>(15)});
    EXPECT_THAT(drawn.rasterizer().set_surface_depths(wrong),
                FailsWith(ErrorCode::invalid_argument, HasSubstr("15 depths of surfaces for 4 x 4 pixels")));

    View other = view;
    other.height = 49;
    EXPECT_THAT(drawn.rasterizer().draw(other, SortMode::exact, 1),
                FailsWith(ErrorCode::invalid_argument, HasSubstr("64 x 48 pixels, but the picture has 64 x 49")));
    // The depths before still hold.
    ASSERT_TRUE(drawn.rasterizer().draw(view, SortMode::exact, 1));
    EXPECT_TRUE(are_same_bits(drawn.rasterizer().read_image().value(), hidden));
  }
}

TEST(Depths, AreTheSameBitsWithAnyNumberOfThreads) {
  const View view = view_from(dvec3(0.3, 0.2, 4), false, 131, 97);
  const SurfaceDepths depths = ball(view, dvec3(0), 0.7);
  const DrawList list = list_of(random_splats(90'000, 0.002, 0.2));  // two batches
  std::optional<Image> first;
  for (const std::size_t threads : {1, 2, 5}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    const Image image = Drawn(by_splats, list, lively()).picture(view, depths);
    if (!first) first = image;
    EXPECT_TRUE(are_same_bits(image, *first)) << threads;
  }
}

TEST(Depths, AreTheSamePictureWithAnyInstructions) {
  const View view = view_from(dvec3(0.3, 0.2, 4), false, 131, 97);
  const SurfaceDepths depths = ball(view, dvec3(0), 0.7);
  const DrawList list = list_of(random_splats(5000));
  const Image newest = Drawn(by_splats, list, lively()).picture(view, depths);
  for_each_target([&] { EXPECT_LT(rmse(newest, Drawn(by_splats, list, lively()).picture(view, depths)), 1e-4); });
}

TEST(DepthPyramid, RangesHoldTheDepthsOfTheirPixels) {
  std::mt19937 generator(5);
  std::uniform_real_distribution<float> unit(0.1F, 9);
  for (const auto& [width, height] : {std::pair(1, 1), std::pair(4, 5), std::pair(131, 97), std::pair(7, 300)}) {
    SurfaceDepths depths{width, height, std::vector<float>(static_cast<std::size_t>(width) * height)};
    for (float& depth : depths.depths) depth = unit(generator);
    const DepthPyramid surfaces(depths, 2);
    EXPECT_EQ(*surfaces.at(0, height - 1), depths.depths[0] / 2);
    const auto all = surfaces.range(0, 0, width, height);
    EXPECT_EQ(all.farthest, std::ranges::max(depths.depths) / 2);
    for (int i = 0; i < 300; ++i) {
      const auto below = [&](int end) { return static_cast<int>(generator() % static_cast<unsigned>(end)); };
      const int left = below(width), bottom = below(height);
      const int right = left + 1 + below(width - left), top = bottom + 1 + below(height - bottom);
      const DepthRange range = surfaces.range(left, bottom, right, top);
      for (int y = bottom; y < top; ++y)
        for (int x = left; x < right; ++x) {
          ASSERT_LE(range.nearest, *surfaces.at(x, y));
          ASSERT_GE(range.farthest, *surfaces.at(x, y));
        }
    }
  }
}

}  // namespace
}  // namespace splatvol::test
