// What a line of sight shows where splats answer: known splats, and the pictures of sessions.
#include "player/splat_ray.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <numbers>

#include "splat/kernel.h"
#include "tests/player/session_fixture.h"
#include "tests/player/waves.h"

namespace splatvol {
namespace {

TransferFunction constant(double extinction) { return {.colors = {{0, dvec3(1)}}, .densities = {{0, extinction}}}; }

MomentsSplat ball(const dvec3& center, double deviation, double mass, double value) {
  MomentsSplat splat;
  splat.center = center;
  splat.deviations = dvec3(deviation);
  splat.mass = mass;
  splat.value = value;
  return splat;
}

View view_along_z(bool orthographic) {
  Camera camera{.projection = orthographic ? Camera::Projection::orthographic : Camera::Projection::perspective,
                .parallel_height = 4,
                .position = {1e6, 0, 10},
                .focal_point = {1e6, 0, 0}};
  return make_view(camera, 200, 100).value();
}

std::optional<Pick> pick(const DrawList& list, const TransferFunction& function, const DrawingUnits& units,
                         const View& view, double x, double y, const std::vector<Surface>& surfaces = {}) {
  return pick_splats(PickedSplats(list, {}, units, "value"), {}, function, surfaces, looking_through(view, x, y));
}

template <class Splat>
DrawList list_of(const std::vector<Splat>& splats) {
  DrawList list;
  append(list, pack_row(splats, {1e6, 0, 0}, 1), 0, static_cast<std::uint32_t>(splats.size()));
  return list;
}

TEST(SplatRay, FindsTheFirstOfTwoOpaqueSplats) {
  for (const bool orthographic : {false, true}) {
    const std::vector<MomentsSplat> splats = {ball({0, 0, -2}, 0.1, 10, 1), ball({0, 0, 2}, 0.1, 10, 5)};
    const auto found =
        pick(list_of(splats), constant(1000), {.value_offset = 100}, view_along_z(orthographic), 100, 50);
    ASSERT_TRUE(found);
    EXPECT_EQ(found->values[0].value, 105);      // the nearer one, with the offset
    EXPECT_NEAR(found->position.z, 2.33, 0.03);  // where the splat begins
    EXPECT_NEAR(found->position.x, 1e6, 1e-6);
    EXPECT_NEAR(found->opacity, 1, 1e-12);
  }
}

// A square across the line of sight, at a depth.
Surface square(double z, double opacity) {
  auto mesh = std::make_shared<TriangleMesh>();
  for (const dvec2 corner : {dvec2(-1, -1), dvec2(1, -1), dvec2(1, 1), dvec2(-1, 1)})
    mesh->points.emplace_back(1e6 + corner.x, corner.y, z);
  mesh->triangles = {{0, 1, 2}, {0, 2, 3}};
  return {{.opacity = opacity, .boundary = "wall"}, mesh};
}

TEST(SplatRay, TellsTheSurfaceOfTheLargestShare) {
  const std::vector<MomentsSplat> splats = {ball({0, 0, 0}, 0.1, 10, 3)};
  const View view = view_along_z(false);
  const auto found = [&](const std::vector<Surface>& surfaces) {
    return pick(list_of(splats), constant(1000), {}, view, 100.5, 50.5, surfaces);
  };
  EXPECT_EQ(found({square(-2, 1)})->name, "") << "it lies behind an opaque volume";
  const auto in_front = found({square(2, 1)});
  EXPECT_EQ(in_front->kind, Pick::Kind::surface);
  EXPECT_NEAR(in_front->position.z, 2, 1e-9);
  EXPECT_TRUE(std::isnan(in_front->values[0].value)) << "no splat is there";
  EXPECT_EQ(found({square(2, 0.4)})->name, "") << "most of the light is the volume's";
  EXPECT_EQ(found({square(2, 0.6)})->name, "wall");
}

TEST(SplatRay, OpacityIsTheIntegralAlongTheRay) {
  constexpr double deviation = 0.3, mass = 0.02, extinction = 2;
  const std::vector<MomentsSplat> splats = {ball({0, 0, 0}, deviation, mass, 1), ball({0, 0, -5}, 0.1, 0, 1)};
  const auto found = pick(list_of(splats), constant(extinction), {}, view_along_z(true), 100, 50);
  ASSERT_TRUE(found);
  // Density falls as (1 - u^2)^(3/2) along the chord, whose integral is 3 pi / 8.
  const double half_axis = moments_half_width * deviation;
  const double depth = extinction * mass * moments_peak * 3 * std::numbers::pi / 8 / (half_axis * half_axis);
  EXPECT_NEAR(found->opacity, 1 - std::exp(-depth), 1e-4);
}

TEST(SplatRay, KnowsTheOpacityOfAnotherAttribute) {
  const std::vector<MomentsSplat> splats = {ball({0, 0, 0}, 0.3, 0.02, 1)};
  TransferFunction factors = constant(1);
  factors.lo = 0;
  factors.hi = 10;
  factors.densities = {{0, 0}, {1, 1}};
  const DrawingUnits units{.opacity_offset = 1, .opacity_scale = 2};
  DrawList list;
  append(list, pack_row(std::span(splats), {1e6, 0, 0}, 1, {{{0.75F, 0, 255}}, 0}), 0, 1);  // 2.5: a factor of 1/4
  const TransferFunction function = constant(8), weaker = constant(2);
  const Looking looking = looking_through(view_along_z(true), 100, 50);
  const PickedSplats picked(list, {}, units, "value");
  Scene faded, plain;
  faded.opacity = SceneOpacity{"other", factors};
  const auto found = pick_splats(picked, faded, function, {}, looking);
  const auto expected = pick_splats(picked, plain, weaker, {}, looking);
  ASSERT_TRUE(found && expected);
  EXPECT_NEAR(found->opacity, expected->opacity, 1e-4);
  EXPECT_EQ(found->values[0].value, expected->values[0].value);
  EXPECT_NEAR(found->rows[100].opacity, expected->rows[100].opacity, 1e-4);
  faded.opacity->function.densities = {{0, 0}};
  EXPECT_FALSE(pick_splats(picked, faded, function, {}, looking));
}

// An opaque splat that is thinner than the distance of rows hides what is behind.
TEST(SplatRay, SeesThinSplats) {
  std::vector<MomentsSplat> splats = {ball({0, 0, 2}, 0.5, 10, 5), ball({0, 0, -200}, 30, 1e4, 1)};
  splats[0].deviations.z = 1e-4;
  const auto found = pick(list_of(splats), constant(1000), {}, view_along_z(true), 100, 50);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->values[0].value, 5);
  EXPECT_NEAR(found->position.z, 2, 1.2);
}

TEST(SplatRay, MeetsNothingBesideOrBehind) {
  const std::vector<MomentsSplat> splats = {ball({1.5, 0, 0}, 0.1, 10, 1), ball({0, 0, 20}, 0.1, 10, 5)};
  const auto at = [&](double x) { return pick(list_of(splats), constant(1000), {}, view_along_z(true), x, 50); };
  EXPECT_FALSE(at(100));
  ASSERT_TRUE(at(100 + 1.5 * 25));
  EXPECT_FALSE(pick(list_of(splats), constant(0), {}, view_along_z(true), 137.5, 50));
}

// The density along the ray is the splat's, and the value follows its gradient.
TEST(SplatRay, FollowsTheRay) {
  std::vector<MomentsSplat> splats = {ball({0, 0, 0}, 0.5, 1, 3), ball({0, 0, -6}, 0.5, 1, 8)};
  splats[0].value_deviation = 0.2;
  splats[0].correlations = {0, 0, 0.5};
  const auto found = pick(list_of(splats), constant(0.1), {}, view_along_z(true), 100, 50);
  ASSERT_TRUE(found);
  ASSERT_FALSE(found->rows.empty());
  const double reach = moments_half_width * 0.5;
  EXPECT_NEAR(found->rows.front().distance, 10 - reach, 0.02);
  EXPECT_NEAR(found->rows.back().distance, 16 + reach, 0.02);
  EXPECT_NEAR(found->rows.back().opacity, found->opacity, 1e-9);
  double before = 0;
  bool has_gap = false;
  for (const Pick::Row& row : found->rows) {
    EXPECT_GE(row.opacity, before);
    before = row.opacity;
    const double z = 10 - row.distance;  // of the camera's axis
    if (std::abs(z) < reach) {
      EXPECT_NEAR(row.value, 3 + 0.2 * 0.5 * z / 0.5, 0.01) << z;
    }
    if (z < -reach && z > -6 + reach) has_gap |= std::isnan(row.value);
    if (std::abs(z + 6) < reach - 0.02) {
      EXPECT_NEAR(row.value, 8, 0.05) << z;
    }
  }
  EXPECT_TRUE(has_gap);
}

TEST(SplatRay, AHalfEndsAtItsBoundary) {
  std::vector<MomentsSplat> splats = {ball({0, 0, 0}, 0.5, 1, 3), ball({0, 0, 0}, 0.5, 0, 3)};
  splats[0].boundary = {0, 0, 0.75};  // a plane at z = 0.375
  const auto found = pick(list_of(splats), constant(0.1), {}, view_along_z(true), 100, 50);
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->rows.front().distance, 10 - 0.375, 0.01);
}

// Values that spread over a narrow peak: the mean of the extinction counts, not that of the mean value.
TEST(SplatRay, SpreadsOverNarrowPeaks) {
  TransferFunction peak;
  peak.lo = 0, peak.hi = 1;
  peak.colors = {{0, dvec3(1)}};
  peak.densities = {{0.49, 0}, {0.5, 100}, {0.51, 0}};
  std::vector<MomentsSplat> splats = {ball({0, 0, 0}, 0.5, 1, 0.3), ball({0, 0, 0}, 0.5, 0, 3)};
  splats[0].value_deviation = 0.1;
  const auto found = pick(list_of(splats), peak, {}, view_along_z(true), 100, 50);
  ASSERT_TRUE(found) << "the mean value is not in the peak, but other values are";
  const double density = std::exp(-2.0) / (0.1 * std::sqrt(2 * std::numbers::pi));  // of values in the peak's middle
  const double half_axis = moments_half_width * 0.5;
  const double depth = 100 * 0.01 * density * moments_peak * 3 * std::numbers::pi / 8 / (half_axis * half_axis);
  EXPECT_NEAR(-std::log1p(-found->opacity), depth, 0.03 * depth);
}

TEST(SplatRay, SeesFlatSplatsAndOctants) {
  std::vector<MomentsSplat> flat = {ball({0, 0, 0}, 1, 1, 3), ball({0, 0, 0}, 0.1, 0, 0)};
  flat[0].deviations.z = 0;  // faces the eye
  const auto found = pick(list_of(flat), constant(10), {}, view_along_z(true), 100, 50);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->values[0].value, 3);
  EXPECT_NEAR(found->position.z, 0, 0.02);

  const std::vector<OctantSplat> octants = {{{0, 0, 1}, 7, 0.5f, 0}, {{0, 0, 0}, std::nanf(""), 0.5f, 0}};
  const auto round = pick(list_of(octants), constant(100), {}, view_along_z(true), 100, 50);
  ASSERT_TRUE(round);
  EXPECT_DOUBLE_EQ(round->values[0].value, 7);
}

struct SplatsOfASession : test::SessionFixture {};

// The opacity that splats tell is the picture's: all over the picture, also for a peak of values and for octants.
TEST_F(SplatsOfASession, HasThePicturesOpacity) {
  const auto waves = [](dvec3 p) { return std::sin(20 * p.x) * std::cos(17 * p.y) + std::sin(9 * p.z); };
  test::build_mesh(test::lattice(84), waves, path("m.svol"));  // more points than are drawn at once
  for (const KernelKind kernel : {KernelKind::moments, KernelKind::octant}) {
    settings.drawing.kernel = kernel;
    const auto session = open(path("m.svol"));
    settled(*session);
    TransferFunction peak = session->scene.transfer_function;
    peak.densities = {{0.55, 0}, {0.6, 10 * peak.densities.back().extinction}, {0.65, 0}};
    for (const TransferFunction& function : {session->scene.transfer_function, peak}) {
      session->scene.transfer_function = function;
      const Image picture = settled(*session);
      const PickedSplats splats(session->frame()->list, {}, session->units(), "value");
      const View& view = session->view();
      double squares = 0;
      int count = 0;
      for (int y = 5; y < picture.height; y += 10)
        for (int x = 5; x < picture.width; x += 10, ++count) {
          const auto found = pick_splats(splats, session->scene, function, {}, looking_through(view, x + 0.5, y + 0.5));
          const double difference = (found ? found->opacity : 0) - static_cast<double>(picture.at(x, y).a);
          squares += difference * difference;
        }
      const double bound = kernel == KernelKind::moments ? 0.01 : 0.05;  // an octant counts as a Gaussian
      EXPECT_LT(std::sqrt(squares / count), bound) << static_cast<int>(kernel);
    }
  }
}

}  // namespace
}  // namespace splatvol
