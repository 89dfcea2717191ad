// Clipping splats at the faces of a box.
#include "streamer/splats/clip.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <random>

#include "tests/streamer/fixture.h"
#include "tests/support/random.h"

namespace splatvol::test {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

constexpr double mass_error = 1e-6;

MomentsSplat random_splat(std::mt19937& random) {
  std::uniform_real_distribution<double> unit(-1, 1);
  std::normal_distribution<double> normal;
  MomentsSplat splat;
  splat.center = {unit(random), unit(random), unit(random)};
  splat.deviations = {0.5, 0.2, 0.05};
  splat.orientation = glm::normalize(random_quaternion(normal, random));
  splat.mass = 2 + unit(random);
  splat.value = unit(random);
  splat.value_deviation = 0.3;
  splat.correlations = {0.4, -0.25, 0.1};
  return splat;
}

Box half_space(int axis, double from, double to) {
  Box box{dvec3(-infinity), dvec3(infinity)};
  box.low[axis] = from;
  box.high[axis] = to;
  return box;
}

MomentsSplat clipped(MomentsSplat splat, const dvec3& origin, const Box& box) {
  clip(splat, {Box{box.low - origin, box.high - origin}, {}});
  return splat;
}

TEST(Clip, TwoHalvesMakeTheWhole) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> coordinate(-1.5, 1.5);
  const dvec3 origin(1e7, -1e7, 3);
  for (int i = 0; i < 3000; ++i) {
    const MomentsSplat whole = random_splat(random);
    const int axis = i % 3;
    const double face = origin[axis] + coordinate(random);
    const MomentsSplat low = clipped(whole, origin, half_space(axis, -infinity, face));
    const MomentsSplat high = clipped(whole, origin, half_space(axis, face, infinity));
    // A face beyond three deviations cuts off all or nothing, which is off by a thousandth of the mass.
    ASSERT_NEAR(low.mass + high.mass, whole.mass, 2e-3 * whole.mass);
    for (int k = 0; k < 3; ++k)
      ASSERT_NEAR(low.mass * low.center[k] + high.mass * high.center[k], whole.mass * whole.center[k],
                  5e-3 * whole.mass);
    ASSERT_NEAR(low.mass * low.value + high.mass * high.value, whole.mass * whole.value, 5e-3 * whole.mass);
    ASSERT_LE(low.value_deviation, whole.value_deviation);
    ASSERT_LE(low.deviations.x, whole.deviations.x);
  }
}

TEST(Clip, HalfABallHasClosedForms) {
  MomentsSplat splat;
  splat.center = {0.25, 0, 0};
  splat.deviations = dvec3(2);
  splat.mass = 1;
  splat.value = 7;
  splat.value_deviation = 3;
  splat.correlations = {1, 0, 0};  // the value rises along x alone
  const MomentsSplat half = clipped(splat, dvec3(0), half_space(0, 0.25, infinity));
  const double mean = std::sqrt(2 / std::numbers::pi);
  EXPECT_NEAR(half.mass, 0.5, mass_error);
  EXPECT_NEAR(half.center.x, 0.25 + 2 * mean, 1e-5);
  EXPECT_NEAR(half.deviations.x, 2 * std::sqrt(1 - mean * mean), 1e-5);
  EXPECT_NEAR(half.deviations.y, 2, 1e-12);
  EXPECT_NEAR(half.value, 7 + 3 * mean, 1e-5);
  EXPECT_NEAR(half.value_deviation, 3 * std::sqrt(1 - mean * mean), 1e-5);
  // The face is the boundary of the splat: the foot is at the distance of the new centroid from the face.
  EXPECT_NEAR(half.boundary.x, -mean / std::sqrt(1 - mean * mean), 1e-9);
}

TEST(Clip, LeavesWhatIsInsideAndNothingOfWhatIsOutside) {
  std::mt19937 random(2);
  for (int i = 0; i < 100; ++i) {
    const MomentsSplat splat = random_splat(random);
    MomentsSplat inside = splat;
    EXPECT_FALSE(clip(inside, {Box{dvec3(-5), dvec3(5)}, {}}));
    EXPECT_EQ(inside.center, splat.center);
    EXPECT_EQ(inside.mass, splat.mass);
    EXPECT_EQ(clipped(splat, dvec3(5), {dvec3(20), dvec3(30)}).mass, 0);
  }
}

TEST(Clip, TakesThinAndEmptySplats) {
  MomentsSplat point;
  point.mass = 1;
  EXPECT_EQ(clipped(point, dvec3(1), {dvec3(0), dvec3(2)}).mass, 1);
  EXPECT_EQ(clipped(point, dvec3(3), {dvec3(0), dvec3(2)}).mass, 0);
  MomentsSplat plane;
  plane.mass = 1;
  plane.deviations = {1, 1, 0};
  const MomentsSplat cut = clipped(plane, dvec3(0), {{0, -9, -1}, {9, 9, 1}});
  EXPECT_NEAR(cut.mass, 0.5, mass_error);
  EXPECT_EQ(cut.deviations.z, 0);
  EXPECT_EQ(clipped(MomentsSplat(), dvec3(0), {dvec3(0), dvec3(2)}).mass, 0);
}

TEST(Clip, OctantsGoByTheirPoint) {
  OctantSplat inside{{0, 0, 0}, 1, 1, 0}, outside{{2, 0, 0}, 1, 1, 0};
  EXPECT_FALSE(clip(inside, {Box{dvec3(-1), dvec3(1)}, {}}));
  EXPECT_TRUE(clip(outside, {Box{dvec3(-1), dvec3(1)}, {}}));
  EXPECT_EQ(inside.value, 1);
  EXPECT_TRUE(std::isnan(outside.value));
}

// Planes of any direction cut as faces of a box do.
TEST(Clip, TwoSidesOfAPlaneMakeTheWhole) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> unit(-1, 1);
  int cut = 0;
  for (int i = 0; i < 3000; ++i) {
    const MomentsSplat whole = random_splat(random);
    const Plane plane = make_plane(whole.center + random_vector(unit, random), random_vector(unit, random) + 1e-3);
    MomentsSplat front = whole, behind = whole;
    clip(front, {std::nullopt, {plane}});
    clip(behind, {std::nullopt, {make_plane(plane.point, -plane.normal)}});
    ASSERT_NEAR(front.mass + behind.mass, whole.mass, 2e-3 * whole.mass);
    for (int k = 0; k < 3; ++k)
      ASSERT_NEAR(front.mass * front.center[k] + behind.mass * behind.center[k], whole.mass * whole.center[k],
                  6e-3 * whole.mass);
    ASSERT_NEAR(front.mass * front.value + behind.mass * behind.value, whole.mass * whole.value, 4e-3 * whole.mass);
    ASSERT_TRUE(front.mass == 0 || plane.distance(front.center) >= -1e-12);
    cut += front.mass > 0.1 * whole.mass && behind.mass > 0.1 * whole.mass ? 1 : 0;
  }
  EXPECT_GT(cut, 500);

  // Along an axis: the same numbers as a box.
  for (int axis = 0; axis < 3; ++axis) {
    const MomentsSplat whole = random_splat(random);
    dvec3 normal(0);
    normal[axis] = 1;
    MomentsSplat by_plane = whole, by_box = whole;
    clip(by_plane, {std::nullopt, {{whole.center + 0.05, normal}}});
    clip(by_box, {half_space(axis, whole.center[axis] + 0.05, infinity), {}});
    EXPECT_NEAR(by_plane.mass, by_box.mass, 1e-12);
    EXPECT_NEAR(glm::length(by_plane.center - by_box.center), 0, 1e-12);
    EXPECT_NEAR(glm::length(by_plane.boundary - by_box.boundary), 0, 1e-9);
    EXPECT_NEAR(by_plane.value, by_box.value, 1e-12);
  }
}

// Ranges inside are drawn as they are, ranges outside not at all, others as a row of as many records.
TEST(Clip, RangesAreDrawnWholeOrNotAtAllOrAsClippedRows) {
  std::mt19937 random(4);
  std::vector<MomentsSplat> splats;
  for (int i = 0; i < 100; ++i) splats.push_back(random_splat(random));
  const dvec3 origin(1e6, 5, -3);
  const double length = 0.5;
  DrawList list;
  append(list, pack_row(splats, origin, length), 0, 100);
  ASSERT_EQ(list.ranges.size(), 1u);
  const auto box = [&](double low, double high) {
    return ClipRegion{Box{origin + length * low, origin + length * high}, {}};
  };
  using Part = ClippedRange::Part;
  EXPECT_EQ(clip(list.ranges[0], box(-9, 9), length).part, Part::all);
  EXPECT_EQ(clip(list.ranges[0], box(9, 11), length).part, Part::none);
  const ClippedRange some = clip(list.ranges[0], box(-0.1, 9), length);
  ASSERT_EQ(some.part, Part::some);
  ASSERT_EQ(some.row.shapes->size(), 100u);
  double mass = 0, expected = 0;
  for (std::uint32_t i = 0; i < 100; ++i) {
    mass += unpack(some.row, i).mass;
    expected += clipped(splats[i], dvec3(0), {dvec3(-0.1), dvec3(9)}).mass;
  }
  EXPECT_NEAR(mass / expected, 1, std::exp2(2.0 / 256) - 1);

  const std::vector<OctantSplat> points = {{{0, 0, 0}, 1, 1, 0}, {{2, 0, 0}, 1, 1, 0}};
  DrawList octants;
  append(octants, pack_row(points, origin, length), 0, 2);
  EXPECT_EQ(clip(octants.ranges[0], box(-3, 3), length).part, Part::all);
  EXPECT_EQ(clip(octants.ranges[0], box(3, 4), length).part, Part::none);
  const auto beyond = [&](double at) {
    return ClipRegion{std::nullopt, {make_plane(origin + length * at, {1, 0, 0})}};
  };
  EXPECT_EQ(clip(list.ranges[0], beyond(-9), length).part, Part::all);
  EXPECT_EQ(clip(list.ranges[0], beyond(9), length).part, Part::none);
  EXPECT_EQ(clip(list.ranges[0], beyond(0), length).part, Part::some);
  const ClippedRange half = clip(octants.ranges[0], box(-1, 1), length);
  ASSERT_EQ(half.part, Part::some);
  EXPECT_EQ(unpack_octant(half.row, 0).value, 1);
  EXPECT_TRUE(std::isnan(unpack_octant(half.row, 1).value));
}

TEST(ClipBox, WhatIsOutsideIsNeitherReadNorDrawn) {
  const TestVolume volume = sample_volume(20000, 3);
  const StreamerOptions options{64u << 20, "a1", KernelKind::moments};
  const auto mass_of = [](const FrameSplats& frame) { return test::mass_of(frame.list); };
  Camera camera{.position = {0.5, 0.5, 6}, .focal_point = dvec3(0.5)};
  View view = make_view(camera, 256, 256).value();
  Detail all{.tolerance_percent = 0};

  const auto streamer = Streamer::open(source_of(volume), options).value();
  const double whole = mass_of(**streamer->request(view, opaque(), all));
  double parts = 0;
  for (const double low : {-infinity, 0.3}) {
    view.clip.box = half_space(0, low, low < 0 ? 0.3 : infinity);
    parts += mass_of(**streamer->request(view, opaque(), all));
  }
  EXPECT_NEAR(parts / whole, 1, 1e-3);

  view.clip.box = Box{dvec3(0.6), dvec3(0.7)};
  const auto other = Streamer::open(source_of(volume), options).value();
  const auto splats = other->request(view, opaque(), all).value()->splats;
  EXPECT_LT(splats, 20000 / 5);  // a thousandth of the space, with nodes that reach into it
  EXPECT_LT(other->statistics().bytes_read, streamer->statistics().bytes_read / 2);

  // `advance` ends in the same frame.
  const auto paging = Streamer::open(source_of(volume), options).value();
  const FrameSplats* frame = nullptr;
  for (int calls = 0; calls < 1000 && !(frame && frame->progress.settled); ++calls)
    frame = paging->advance(view, opaque(), all, 60).value();
  EXPECT_TRUE(frame->progress.complete);
  EXPECT_EQ(mass_of(*frame), mass_of(**other->request(view, opaque(), all)));
  // Another box gives another frame.
  view.clip.box = Box{dvec3(0.6), dvec3(0.69)};
  const double before = mass_of(*frame);
  EXPECT_LT(mass_of(**paging->advance(view, opaque(), all, 60)), before);
}

}  // namespace
}  // namespace splatvol::test
