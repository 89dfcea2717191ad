// Splats mixed in slabs, against closed forms: bodies of box-shaped cells with one extinction, whose rays are known.
#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <ctime>
#include <limits>
#include <optional>
#include <random>

#include "renderer/cpu/tile_rasterizer.h"
#include "tests/renderer/bodies.h"
#include "tests/renderer/draw_parts.h"
#include "tests/renderer/random_splats.h"
#include "tests/renderer/targets.h"

namespace splatvol {
namespace {

using test::add_splats;
using test::Body;
using test::crossing;
using test::exact;
using test::gradient;
using test::list_of;
using test::lively;
using test::random_splats;
using test::Ray;
using test::ray_of;
using test::splats_of;
using test::uniform;
using test::value_at;
using test::view_from;

Image draw(const DrawList& list, const TransferFunction& function, const View& view,
           Compositing compositing = Compositing::slabs, const std::optional<Lighting>& lighting = {},
           int spacing = 1) {
  TileRasterizer tiles(KernelKind::moments);
  EXPECT_TRUE(tiles.set_compositing(compositing));
  tiles.set_lighting(lighting);
  EXPECT_TRUE(tiles.set_transfer_function(function, {}));
  EXPECT_TRUE(tiles.set_draw_list(list));
  EXPECT_TRUE(tiles.draw(view, SortMode::exact, spacing));
  return tiles.read_image().value();
}

double rmse(const Image& a, const Image& b) { return compare_images(a, b).value().rmse; }

struct Case {
  const char* name;
  std::vector<Body> bodies;
  double slabs;  // the largest RMSE, over all views
};

const std::vector<Case>& cases() {
  static const std::vector<Case> all = {
      {"a cube", {{dvec3(-0.8), dvec3(0.8), glm::ivec3(9)}}, 0.005},
      {"flat cells", {{dvec3(-0.8), dvec3(0.8), glm::ivec3(3, 30, 8)}}, 0.007},
      {"a layer thinner than its cells",
       {{dvec3(-0.9, -0.02, -0.9), dvec3(0.9, 0.02, 0.9), glm::ivec3(9, 1, 9)}},
       0.0035},
      {"a needle", {{dvec3(-0.9, -0.05, -0.05), dvec3(0.9, 0.05, 0.05), glm::ivec3(9, 1, 1)}}, 0.0018},
      {"a gap of a tenth of a cell",
       {{dvec3(-0.8), dvec3(-0.01, 0.8, 0.8), glm::ivec3(4, 8, 8)},
        {dvec3(0.01, -0.8, -0.8), dvec3(0.8), glm::ivec3(4, 8, 8)}},
       0.0057},
      {"two bodies that touch",
       {{dvec3(-0.8), dvec3(0, 0.8, 0.8), glm::ivec3(4, 8, 8)},
        {dvec3(0, -0.8, -0.8), dvec3(0.8), glm::ivec3(4, 8, 8)}},
       0.0065},
      {"a hole of one cell",
       {{dvec3(-0.9), dvec3(0.9, 0.9, -0.1), glm::ivec3(9, 9, 4)},
        {dvec3(-0.9, -0.9, 0.1), dvec3(0.9), glm::ivec3(9, 9, 4)},
        {dvec3(-0.9, -0.9, -0.1), dvec3(-0.1, 0.9, 0.1), glm::ivec3(4, 9, 1)},
        {dvec3(0.1, -0.9, -0.1), dvec3(0.9, 0.9, 0.1), glm::ivec3(4, 9, 1)}},
       0.017},
      {"large beside small cells",
       {{dvec3(-0.8), dvec3(0, 0.8, 0.8), glm::ivec3(2, 4, 4)},
        {dvec3(0, -0.8, -0.8), dvec3(0.8), glm::ivec3(12, 24, 24)}},
       0.0145},
  };
  return all;
}

TEST(Slabs, BodiesAreAsTheirRaysSay) {
  for (const Case& body : cases())
    for (const bool orthographic : {false, true})
      for (const dvec3 eye : {dvec3(0.03, 0.02, 4), dvec3(2, 1.5, 3), dvec3(-3, 0.4, 1.2)}) {
        SCOPED_TRACE(testing::Message() << body.name << ", orthographic " << orthographic << ", eye " << eye.x);
        const View view = view_from(eye, orthographic);
        const DrawList list = list_of(splats_of(body.bodies));
        const Image truth = exact(body.bodies, 1, view);
        const double by_slabs = rmse(draw(list, uniform(1), view), truth);
        const double one_by_one = rmse(draw(list, uniform(1), view, Compositing::splats), truth);
        EXPECT_LT(by_slabs, body.slabs);
        EXPECT_LT(by_slabs, 1.05 * one_by_one + 1e-3);
      }
}

// A plate of any thinness hides as much as its cells do, though it is far thinner than pixels.
TEST(Slabs, ThinPlatesKeepTheirMatter) {
  for (const double thin : {1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12})
    for (const bool orthographic : {false, true}) {
      SCOPED_TRACE(testing::Message() << thin << ", orthographic " << orthographic);
      const std::vector<Body> bodies = {{dvec3(-0.9, -0.9, -thin), dvec3(0.9, 0.9, thin), glm::ivec3(9, 9, 3)}};
      const View view = view_from({0.3, 1.5, 3}, orthographic);
      const double error =
          rmse(draw(list_of(splats_of(bodies)), uniform(1 / thin), view), exact(bodies, 1 / thin, view));
      EXPECT_LT(error, 0.05);  // of .54
    }
}

// A splat that is a thousand or a million times as long as its chords is not cut into as many slabs: in processor time,
// which other programs do not change.
TEST(Slabs, NeedlesTakeNoTime) {
  std::vector<Material> splats = splats_of({{dvec3(-0.8), dvec3(0.8), glm::ivec3(9)}});
  const View view = view_from({2.2, 1.6, 4}, true, 64, 64);
  const std::clock_t start = std::clock();
  const Image before = draw(list_of(splats), uniform(1), view);
  const std::clock_t without_needles = std::clock() - start;
  for (const double length : {1e3, 1e5, 1e7, 1e9}) {
    std::vector<Material> all = splats;
    for (int i = 0; i < 20; ++i) {
      Material needle = splats[static_cast<std::size_t>(100 + i)];
      needle.deviations = {length, 1e-3, 1e-3};
      needle.mass = 1e-6 * length;
      const dvec3 direction = glm::normalize(dvec3(1, 0.3, 0.1 * i - 1));
      const dvec3 side = glm::normalize(glm::cross(direction, dvec3(0, 1, 0)));
      needle.orientation = glm::quat_cast(glm::dmat3(direction, side, glm::cross(direction, side)));
      needle.boundary = dvec3(0);
      all.push_back(needle);
    }
    const std::clock_t begin = std::clock();
    const Image picture = draw(list_of(all), uniform(1), view);
    EXPECT_LT(std::clock() - begin, 20 * without_needles + CLOCKS_PER_SEC / 2) << length;
    EXPECT_LT(rmse(picture, before), 0.05) << length;
  }
}

TEST(Slabs, ABoundaryOfSomeCellsOnlyIsNone) {
  // As at hanging nodes: on one side of the faces between, points have a boundary, and on the other side none.
  const std::vector<Body> bodies = {{dvec3(-0.8), dvec3(0, 0.8, 0.8), glm::ivec3(8, 16, 16)},
                                    {dvec3(0, -0.8, -0.8), dvec3(0.8), glm::ivec3(4, 8, 8)}};
  std::vector<Material> splats = splats_of(bodies);
  for (Material& splat : splats)
    if (splat.center.x > 0 && splat.center.x < 0.1 && std::abs(splat.center.y) < 0.7 && std::abs(splat.center.z) < 0.7)
      splat.boundary = dvec3(0);
  for (const dvec3 eye : {dvec3(4, 0.2, 0.1), dvec3(-4, 0.2, 0.1), dvec3(2, 1.5, 3)}) {
    const View view = view_from(eye);
    const Image truth = exact(bodies, 1, view);
    const double by_slabs = rmse(draw(list_of(splats), uniform(1), view), truth);
    EXPECT_LT(by_slabs, 0.004) << eye.x;
    EXPECT_LT(by_slabs, rmse(draw(list_of(splats), uniform(1), view, Compositing::splats), truth)) << eye.x;
  }
}

TEST(Slabs, TheEyeInsideSeesTheRest) {
  const std::vector<Body> bodies = {{dvec3(-0.8), dvec3(0.8), glm::ivec3(9)}};
  const View view = view_from(dvec3(0.1, 0.2, 0.3));
  const DrawList list = list_of(splats_of(bodies));
  const Image truth = exact(bodies, 1, view);
  EXPECT_LT(rmse(draw(list, uniform(1), view), truth), 0.006);
}

/// The standard deviation of a picture's middle over its mean.
double ripple(const Image& image) {
  double sum = 0, squares = 0, count = 0;
  for (int y = image.height / 3; y < 2 * image.height / 3; ++y)
    for (int x = image.width / 3; x < 2 * image.width / 3; ++x, ++count) {
      sum += image.at(x, y).a;
      squares += image.at(x, y).a * image.at(x, y).a;
    }
  return std::sqrt(std::max(squares / count - sum * sum / (count * count), 0.0)) / (sum / count);
}

TEST(Slabs, ALatticeSeenAlongAnAxisIsSmooth) {
  for (const int cells : {9, 48}) {  // the latter: more splats than are projected at once
    const DrawList list = list_of(splats_of({{dvec3(-0.8), dvec3(0.8), glm::ivec3(cells)}}));
    const View view = view_from(dvec3(0, 0, 4), true);
    EXPECT_LT(ripple(draw(list, uniform(1), view)), 1.5e-3) << cells;
    EXPECT_GT(ripple(draw(list, uniform(1), view, Compositing::splats)), 0.02) << cells;
  }
}

TEST(Slabs, ANarrowFunctionIsASharpSurface) {
  const std::vector<Body> bodies = {{dvec3(-0.8), dvec3(0.8), glm::ivec3(9)}};
  TransferFunction function = uniform(0);
  function.densities = {{0, 0}, {0.5, 0}, {0.52, 60}, {0.54, 0}, {1, 0}};
  const View view = view_from(dvec3(2, 1.5, 3));
  Image truth = exact({}, 1, view);
  for (int y = 0; y < view.height; ++y)
    for (int x = 0; x < view.width; ++x) {
      const Ray ray = ray_of(view, x, y);
      const auto [begin, end] = crossing(ray, bodies[0]);
      constexpr int steps = 2000;
      double depth = 0;
      for (int i = 0; i < steps; ++i) {
        const double value = value_at(ray.origin + ray.direction * (begin + (end - begin) * (i + 0.5) / steps));
        depth += std::max(0.0, 60 * (1 - std::abs(value - 0.52) / 0.02)) * (end - begin) / steps;
      }
      truth.at(x, view.height - 1 - y) = vec4(static_cast<float>(-std::expm1(-depth)));
    }
  const DrawList list = list_of(splats_of(bodies));
  const double by_slabs = rmse(draw(list, function, view), truth);
  EXPECT_LT(by_slabs, 0.018);
  EXPECT_LT(by_slabs, 0.8 * rmse(draw(list, function, view, Compositing::splats), truth));
}

TEST(Slabs, TwoResolutionsOfAFadeLookLikeOne) {
  const std::vector<Body> fine = {{dvec3(-0.8), dvec3(0.8), glm::ivec3(12)}},
                          coarse = {{dvec3(-0.8), dvec3(0.8), glm::ivec3(5)}};
  std::vector<Material> both = splats_of(fine);
  const std::size_t count = both.size();
  add_splats(coarse[0], both);
  const View view = view_from(dvec3(2, 1.5, 3));
  const DrawList list =
      test::make_list(both, {{dvec3(0), 0, count, 0.3F}, {dvec3(0), count, both.size() - count, 0.7F}});
  const Image truth = exact(fine, 1, view);
  const double by_slabs = rmse(draw(list, uniform(1), view), truth);
  EXPECT_LT(by_slabs, 0.005);
  EXPECT_LT(by_slabs, rmse(draw(list, uniform(1), view, Compositing::splats), truth));
}

TEST(Slabs, ALinearFieldIsLitAsItsGradientSays) {
  const std::vector<Body> bodies = {{dvec3(-0.8), dvec3(0.8), glm::ivec3(9)}};
  const View view = view_from(dvec3(2, 1.5, 3), true);
  const Lighting lighting{0.3, 0.7};
  const Image lit = draw(list_of(splats_of(bodies)), uniform(1), view, Compositing::slabs, lighting);
  const double factor = lighting.factor(view.forward, glm::normalize(gradient));
  const vec4 middle = lit.at(view.width / 2, view.height / 2);
  EXPECT_NEAR(middle.r, factor * middle.a, 0.02);
}

TEST(Slabs, TheOrderOfTheSplatsDoesNotMatter) {
  std::vector<Material> splats = random_splats(5000, 0.002, 0.2);
  const View view = view_from(dvec3(0.3, 0.2, 4));
  const Image one = draw(list_of(splats), lively(), view);
  std::ranges::shuffle(splats, std::mt19937(3));
  EXPECT_LT(rmse(one, draw(list_of(splats), lively(), view)), 1e-5);
}

TEST(Slabs, AreTheSameBitsWithAnyNumberOfThreads) {
  const DrawList list = list_of(random_splats(90'000, 0.002, 0.2));  // two batches
  std::optional<Image> first;
  for (const std::size_t threads : {1, 2, 5}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    const Image image = draw(list, lively(), view_from(dvec3(0.3, 0.2, 4)));
    if (!first) first = image;
    EXPECT_EQ(std::memcmp(image.pixels.data(), first->pixels.data(), image.pixels.size() * sizeof(vec4)), 0) << threads;
  }
}

TEST(Slabs, AreTheSamePictureWithAnyInstructions) {
  const DrawList list = list_of(random_splats(20'000, 0.002, 0.2));
  const View view = view_from(dvec3(0.3, 0.2, 4));
  const Image newest = draw(list, lively(), view);
  test::for_each_target([&] { EXPECT_LT(rmse(newest, draw(list, lively(), view)), 1e-4); });
}

TEST(Slabs, DrawListsOfAnySizeFollowEachOther) {
  TileRasterizer tiles(KernelKind::moments);
  ASSERT_TRUE(tiles.set_transfer_function(lively(), {}));
  const View view = view_from(dvec3(0.3, 0.2, 4));
  for (const std::size_t count : {1'000, 40'000, 150'000, 70'000, 10}) {
    const DrawList list = list_of(random_splats(count, 0.002, 0.2));
    ASSERT_TRUE(tiles.set_draw_list(list));
    for (const Compositing compositing : {Compositing::slabs, Compositing::splats, Compositing::slabs}) {
      ASSERT_TRUE(tiles.set_compositing(compositing));
      ASSERT_TRUE(tiles.draw(view, SortMode::exact, 1));
      EXPECT_EQ(rmse(tiles.read_image().value(), draw(list, lively(), view, compositing)), 0) << count;
    }
  }
}

TEST(Slabs, SamplesApartShowTheSame) {
  const std::vector<Body> bodies = {{dvec3(-0.8), dvec3(0.8), glm::ivec3(9)}};
  const View view = view_from(dvec3(2, 1.5, 3));
  const DrawList list = list_of(splats_of(bodies));
  EXPECT_LT(rmse(draw(list, uniform(1), view, Compositing::slabs, {}, 2), exact(bodies, 1, view)), 0.02);
}

TEST(Slabs, HardSplatsDrawNoNonsense) {
  std::vector<Material> splats = random_splats(300, 0.002, 0.2);
  splats[0].deviations = dvec3(0);        // a point
  splats[1].deviations = dvec3(1, 0, 0);  // a line
  splats[2].deviations = dvec3(1, 1, 0);  // a disc
  splats[3].mass = 1e30;
  splats[4].center = dvec3(0, 0, 4);  // at the eye
  splats[5].value = std::numeric_limits<double>::quiet_NaN();
  splats[6].deviations = dvec3(1e6);
  splats[7].mass = 0;
  for (const bool orthographic : {false, true}) {
    const Image image = draw(list_of(splats), lively(), view_from(dvec3(0, 0, 4), orthographic));
    for (const vec4& pixel : image.pixels)
      for (int i = 0; i < 4; ++i) ASSERT_TRUE(pixel[i] >= -1e-5F && pixel[i] <= 1.0001F) << pixel[i];
  }
}

}  // namespace
}  // namespace splatvol
