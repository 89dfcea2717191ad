// The probe under the pointer, for known splats and in the pictures of sessions.
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <numbers>

#include "splat/kernel.h"
#include "tests/player/session_fixture.h"
#include "tests/player/waves.h"
#include "viewer/probe.h"

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

std::optional<Probe> probe(const DrawList& list, const TransferFunction& function, const DrawingUnits& units,
                           const View& view, double x, double y) {
  return ProbedFrame(list, units).probe(function, looking_through(view, x, y));
}

template <class Splat>
DrawList list_of(const std::vector<Splat>& splats) {
  DrawList list;
  append(list, pack_row(splats, {1e6, 0, 0}, 1), 0, static_cast<std::uint32_t>(splats.size()));
  return list;
}

TEST(Probe, FindsTheFirstOfTwoOpaqueSplats) {
  for (const bool orthographic : {false, true}) {
    const std::vector<MomentsSplat> splats = {ball({0, 0, -2}, 0.1, 10, 1), ball({0, 0, 2}, 0.1, 10, 5)};
    const auto found =
        probe(list_of(splats), constant(1000), {.value_offset = 100}, view_along_z(orthographic), 100, 50);
    ASSERT_TRUE(found);
    EXPECT_EQ(found->value, 105);  // the nearer one, with the offset
    EXPECT_NEAR(found->position.z, 2, 1e-9);
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

TEST(Probe, TellsTheSurfaceOfTheLargestShare) {
  const std::vector<MomentsSplat> splats = {ball({0, 0, 0}, 0.1, 10, 3)};
  for (const bool orthographic : {false, true}) {
    View view = view_along_z(orthographic);
    const Ray ray = looking_through(view, 100.5, 50.5).ray;
    const auto found = [&](const std::vector<Surface>& surfaces, bool has_volume = true) {
      return with_surfaces(has_volume ? probe(list_of(splats), constant(1000), {}, view, 100.5, 50.5) : std::nullopt,
                           surfaces, view, ray);
    };
    EXPECT_EQ(found({square(-2, 1)})->surface, "") << "it lies behind an opaque volume";
    const auto in_front = found({square(2, 1)});
    EXPECT_EQ(in_front->surface, "wall");
    EXPECT_NEAR(in_front->position.z, 2, 1e-9);
    EXPECT_TRUE(std::isnan(in_front->value));
    EXPECT_EQ(in_front->opacity, 1);
    EXPECT_EQ(found({square(2, 0.4)})->surface, "") << "most of the light is the volume's";
    EXPECT_EQ(found({square(2, 0.6)})->surface, "wall");
    EXPECT_NEAR(found({square(2, 0.4), square(3, 0.5)}, false)->position.z, 3, 1e-9);
    EXPECT_FALSE(found({}, false));
    Surface hidden = square(2, 1);
    hidden.style.shown = false;
    EXPECT_EQ(found({hidden})->surface, "");
    view.clip.box = Box{{1e6 - 5, -5, -5}, {1e6 + 5, 5, 1}};
    EXPECT_EQ(found({square(2, 1)})->surface, "") << "it is cut away";
  }
}

TEST(Probe, OpacityIsTheIntegralAlongTheRay) {
  constexpr double deviation = 0.3, mass = 0.02, extinction = 2;
  const std::vector<MomentsSplat> splats = {ball({0, 0, 0}, deviation, mass, 1), ball({0, 0, -5}, 0.1, 0, 1)};
  const auto found = probe(list_of(splats), constant(extinction), {}, view_along_z(true), 100, 50);
  ASSERT_TRUE(found);
  // Density falls as (1 - u^2)^(3/2) along the chord, whose integral is 3 pi / 8.
  const double half_axis = moments_half_width * deviation;
  const double depth = extinction * mass * moments_peak * 3 * std::numbers::pi / 8 / (half_axis * half_axis);
  EXPECT_NEAR(found->opacity, 1 - std::exp(-depth), 1e-4);
}

TEST(Probe, KnowsTheOpacityOfAnotherAttribute) {
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
  const auto found = ProbedFrame(list, units).probe({function, &factors}, looking);
  const auto expected = ProbedFrame(list, units).probe(weaker, looking);
  ASSERT_TRUE(found && expected);
  EXPECT_NEAR(found->opacity, expected->opacity, 1e-4);
  EXPECT_EQ(found->value, expected->value);
  EXPECT_NEAR(found->samples[100].opacity, expected->samples[100].opacity, 1e-4);
  factors.densities = {{0, 0}};
  EXPECT_FALSE(ProbedFrame(list, units).probe({function, &factors}, looking));
}

TEST(Probe, MeetsNothingBesideOrBehind) {
  const std::vector<MomentsSplat> splats = {ball({1.5, 0, 0}, 0.1, 10, 1), ball({0, 0, 20}, 0.1, 10, 5)};
  const auto at = [&](double x) { return probe(list_of(splats), constant(1000), {}, view_along_z(true), x, 50); };
  EXPECT_FALSE(at(100));
  ASSERT_TRUE(at(100 + 1.5 * 25));
  EXPECT_FALSE(probe(list_of(splats), constant(0), {}, view_along_z(true), 137.5, 50));
}

// The density along the ray is the splat's, and the value follows its gradient.
TEST(Probe, FollowsTheRay) {
  std::vector<MomentsSplat> splats = {ball({0, 0, 0}, 0.5, 1, 3), ball({0, 0, -6}, 0.5, 1, 8)};
  splats[0].value_deviation = 0.2;
  splats[0].correlations = {0, 0, 0.5};
  const auto found = probe(list_of(splats), constant(0.1), {}, view_along_z(true), 100, 50);
  ASSERT_TRUE(found);
  ASSERT_FALSE(found->samples.empty());
  const double reach = moments_half_width * 0.5;
  EXPECT_NEAR(found->samples.front().distance, 10 - reach, 0.02);
  EXPECT_NEAR(found->samples.back().distance, 16 + reach, 0.02);
  EXPECT_NEAR(found->samples.back().opacity, found->opacity, 1e-9);
  double before = 0;
  bool has_gap = false;
  for (const Probe::Sample& sample : found->samples) {
    EXPECT_GE(sample.opacity, before);
    before = sample.opacity;
    const double z = 10 - sample.distance;  // of the camera's axis
    if (std::abs(z) < reach) {
      EXPECT_NEAR(sample.value, 3 + 0.2 * 0.5 * z / 0.5, 0.01) << z;
    }
    if (z < -reach && z > -6 + reach) has_gap |= std::isnan(sample.value);
    if (std::abs(z + 6) < reach - 0.02) {
      EXPECT_NEAR(sample.value, 8, 0.05) << z;
    }
  }
  EXPECT_TRUE(has_gap);
}

TEST(Probe, AHalfEndsAtItsBoundary) {
  std::vector<MomentsSplat> splats = {ball({0, 0, 0}, 0.5, 1, 3), ball({0, 0, 0}, 0.5, 0, 3)};
  splats[0].boundary = {0, 0, 0.75};  // a plane at z = 0.375
  const auto found = probe(list_of(splats), constant(0.1), {}, view_along_z(true), 100, 50);
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->samples.front().distance, 10 - 0.375, 0.01);
}

// Values that spread over a narrow peak: the mean of the extinction counts, not that of the mean value.
TEST(Probe, SpreadsOverNarrowPeaks) {
  TransferFunction peak;
  peak.lo = 0, peak.hi = 1;
  peak.colors = {{0, dvec3(1)}};
  peak.densities = {{0.49, 0}, {0.5, 100}, {0.51, 0}};
  std::vector<MomentsSplat> splats = {ball({0, 0, 0}, 0.5, 1, 0.3), ball({0, 0, 0}, 0.5, 0, 3)};
  splats[0].value_deviation = 0.1;
  const auto found = probe(list_of(splats), peak, {}, view_along_z(true), 100, 50);
  ASSERT_TRUE(found) << "the mean value is not in the peak, but other values are";
  const double density = std::exp(-2.0) / (0.1 * std::sqrt(2 * std::numbers::pi));  // of values in the peak's middle
  const double half_axis = moments_half_width * 0.5;
  const double depth = 100 * 0.01 * density * moments_peak * 3 * std::numbers::pi / 8 / (half_axis * half_axis);
  EXPECT_NEAR(-std::log1p(-found->opacity), depth, 0.03 * depth);
}

TEST(Probe, SeesFlatSplatsAndOctants) {
  std::vector<MomentsSplat> flat = {ball({0, 0, 0}, 1, 1, 3), ball({0, 0, 0}, 0.1, 0, 0)};
  flat[0].deviations.z = 0;  // faces the eye
  const auto found = probe(list_of(flat), constant(10), {}, view_along_z(true), 100, 50);
  ASSERT_TRUE(found);
  EXPECT_EQ(found->value, 3);
  EXPECT_NEAR(found->position.z, 0, 1e-9);

  const std::vector<OctantSplat> octants = {{{0, 0, 1}, 7, 0.5f, 0}, {{0, 0, 0}, std::nanf(""), 0.5f, 0}};
  const auto round = probe(list_of(octants), constant(100), {}, view_along_z(true), 100, 50);
  ASSERT_TRUE(round);
  EXPECT_EQ(round->value, 7);
}

struct ProbeOfASession : test::SessionFixture {};

// The opacity that the probe tells is the picture's: all over the picture, also for a peak of values and for octants.
TEST_F(ProbeOfASession, HasThePicturesOpacity) {
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
      const ProbedFrame frame(session->frame()->list, session->units());
      const View& view = session->view();
      double squares = 0;
      int count = 0;
      for (int y = 5; y < picture.height; y += 10)
        for (int x = 5; x < picture.width; x += 10, ++count) {
          const auto found = frame.probe(function, looking_through(view, x + 0.5, y + 0.5));
          const double difference = (found ? found->opacity : 0) - static_cast<double>(picture.at(x, y).a);
          squares += difference * difference;
        }
      const double bound = kernel == KernelKind::moments ? 0.01 : 0.05;  // an octant is a Gaussian to the probe
      EXPECT_LT(std::sqrt(squares / count), bound) << static_cast<int>(kernel);
    }
  }
}

TEST_F(ProbeOfASession, HasTheMeshsOwnValues) {
  const test::Mesh mesh = test::jittered(12, 0.2);
  BuildOptions options{.exact = {.positions = true, .values = true}, .keep_cells = true};
  test::build_mesh(mesh, test::waves, path("m.svol"), options);
  options.keep_cells = false;
  test::build_mesh(mesh, test::waves, path("without.svol"), options);
  const auto session = open(path("m.svol"));
  settled(*session);
  const auto cells = test::value_of(ProbedCells::open(session->steps(), 0, "value"));
  ASSERT_TRUE(cells);
  const Looking looking = looking_through(session->view(), 0.5 * width, 0.5 * height);
  auto found = ProbedFrame(session->frame()->list, session->units())
                   .probe({session->drawn_scene().transfer_function, nullptr}, looking);
  ASSERT_TRUE(found);
  cells->take_values(looking.ray, *found);
  const std::vector<double> values = test::sample(mesh, test::waves);
  EXPECT_NEAR(found->value, test::value_in(mesh, values, found->position), 1e-9);
  std::size_t inside = 0;
  for (std::size_t i = 0; i < found->samples.size(); i += 8) {
    const Probe::Sample& sample = found->samples[i];
    const double expected = test::value_in(mesh, values, looking.ray.origin + sample.distance * looking.ray.direction);
    EXPECT_EQ(std::isnan(sample.value), std::isnan(expected)) << i;
    EXPECT_TRUE(std::isnan(expected) || std::abs(sample.value - expected) < 1e-9) << i;
    inside += std::isnan(expected) ? 0 : 1;
  }
  EXPECT_GT(inside, 16);
  EXPECT_FALSE(test::value_of(ProbedCells::open(open(path("without.svol"))->steps(), 0, "value")));
}

}  // namespace
}  // namespace splatvol
