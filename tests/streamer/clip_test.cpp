// Clipping splats at the faces of a box.
#include "streamer/clip.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <limits>
#include <numbers>
#include <random>

#include "tests/streamer/fixture.h"
#include "tests/support/random.h"

namespace splatvol {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

// Masses are of single precision, correlations are bytes.
constexpr double mass_error = 1e-6;

MomentsSplat random_splat(std::mt19937& random) {
  std::uniform_real_distribution<float> unit(-1, 1);
  std::normal_distribution<double> normal;
  MomentsSplat splat{};
  splat.position = {unit(random), unit(random), unit(random)};
  splat.deviations = {0.5f, 0.2f, 0.05f};
  glm::dquat q = test::random_quaternion(normal, random);
  q = glm::normalize(q);
  if (q.w < 0) q = -q;
  splat.orientation = vec3(float(q.x), float(q.y), float(q.z));
  splat.mass = 2 + unit(random);
  splat.value = unit(random);
  splat.value_deviation = 0.3f;
  splat.correlations = 0x40'10'E0'30;
  return splat;
}

Box half_space(int axis, double from, double to) {
  Box box{dvec3(-infinity), dvec3(infinity)};
  box.low[axis] = from;
  box.high[axis] = to;
  return box;
}

MomentsSplat clipped(MomentsSplat splat, const dvec3& origin, const Box& box) {
  clip(std::span(&splat, 1), {box.low - origin, box.high - origin});
  return splat;
}

double centre(const MomentsSplat& splat, int axis) { return static_cast<double>(splat.position[axis]); }

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
    const auto mass = [](const MomentsSplat& splat) { return static_cast<double>(splat.mass); };
    // A face beyond three deviations cuts off all or nothing, which is off by a thousandth of the mass.
    ASSERT_NEAR(mass(low) + mass(high), mass(whole), 2e-3 * mass(whole));
    for (int k = 0; k < 3; ++k)
      ASSERT_NEAR(mass(low) * centre(low, k) + mass(high) * centre(high, k), mass(whole) * centre(whole, k),
                  5e-3 * mass(whole));
    ASSERT_NEAR(mass(low) * static_cast<double>(low.value) + mass(high) * static_cast<double>(high.value),
                mass(whole) * static_cast<double>(whole.value), 5e-3 * mass(whole));
    ASSERT_LE(low.value_deviation, whole.value_deviation);
    ASSERT_LE(low.deviations.x, whole.deviations.x);
  }
}

TEST(Clip, HalfABallHasClosedForms) {
  MomentsSplat splat{};
  splat.position = {0.25f, 0, 0};
  splat.deviations = vec3(2);
  splat.mass = 1;
  splat.value = 7;
  splat.value_deviation = 3;
  splat.correlations = 127;  // the value rises along x alone
  const MomentsSplat half = clipped(splat, dvec3(0), half_space(0, 0.25, infinity));
  const double mean = std::sqrt(2 / std::numbers::pi);
  EXPECT_NEAR(half.mass, 0.5, mass_error);
  EXPECT_NEAR(half.position.x, 0.25 + 2 * mean, 1e-5);
  EXPECT_NEAR(half.deviations.x, 2 * std::sqrt(1 - mean * mean), 1e-5);
  EXPECT_FLOAT_EQ(half.deviations.y, 2);
  EXPECT_NEAR(half.value, 7 + 3 * mean, 1e-5);
  EXPECT_NEAR(half.value_deviation, 3 * std::sqrt(1 - mean * mean), 1e-5);
  // The face is the boundary of the splat: the foot is at the distance of the new centroid from the face.
  const int foot = static_cast<int>(half.boundary << 22) >> 22;
  EXPECT_NEAR(foot / 128.0, -mean / std::sqrt(1 - mean * mean), 1.0 / 128);
}

TEST(Clip, LeavesWhatIsInsideAndNothingOfWhatIsOutside) {
  std::mt19937 random(2);
  for (int i = 0; i < 100; ++i) {
    const MomentsSplat splat = random_splat(random);
    const MomentsSplat inside = clipped(splat, dvec3(5), {dvec3(0), dvec3(10)});
    EXPECT_EQ(std::memcmp(&inside, &splat, sizeof(splat)), 0);
    EXPECT_EQ(clipped(splat, dvec3(5), {dvec3(20), dvec3(30)}).mass, 0);
  }
}

TEST(Clip, TakesThinAndEmptySplats) {
  MomentsSplat point{};
  point.mass = 1;
  EXPECT_EQ(clipped(point, dvec3(1), {dvec3(0), dvec3(2)}).mass, 1);
  EXPECT_EQ(clipped(point, dvec3(3), {dvec3(0), dvec3(2)}).mass, 0);
  MomentsSplat plane{};
  plane.mass = 1;
  plane.deviations = {1, 1, 0};
  const MomentsSplat cut = clipped(plane, dvec3(0), {{0, -9, -1}, {9, 9, 1}});
  EXPECT_NEAR(cut.mass, 0.5, mass_error);
  EXPECT_EQ(cut.deviations.z, 0);
  EXPECT_EQ(clipped(MomentsSplat{}, dvec3(0), {dvec3(0), dvec3(2)}).mass, 0);
}

TEST(Clip, OctantsGoByTheirPoint) {
  OctantSplat inside{{0, 0, 0}, 1, 1, 0}, outside{{2, 0, 0}, 1, 1, 0};
  clip(std::span(&inside, 1), {dvec3(-1), dvec3(1)});
  clip(std::span(&outside, 1), {dvec3(-1), dvec3(1)});
  EXPECT_EQ(inside.value, 1);
  EXPECT_TRUE(std::isnan(outside.value));
}

TEST(ClipBox, WhatIsOutsideIsNeitherReadNorDrawn) {
  const test::TestVolume volume = test::sample_volume(20000, 3);
  const StreamerOptions options{64u << 20, "a1", KernelKind::moments};
  const auto mass_of = [](const FrameSplats& frame) {
    double mass = 0;
    for (const MomentsSplat& splat : std::get<std::span<const MomentsSplat>>(frame.data))
      mass += static_cast<double>(splat.mass);
    return mass;
  };
  Camera camera;
  camera.position = {0.5, 0.5, 6};
  camera.focal_point = dvec3(0.5);
  View view = make_view(camera, 256, 256).value();
  DetailOptions all;
  all.tolerance_percent = 0;

  const auto streamer = Streamer::open(test::source_of(volume), options).value();
  const double whole = mass_of(**streamer->request(view, test::opaque(), all));
  double parts = 0;
  for (const double low : {-infinity, 0.3}) {
    view.clip_box = half_space(0, low, low < 0 ? 0.3 : infinity);
    parts += mass_of(**streamer->request(view, test::opaque(), all));
  }
  EXPECT_NEAR(parts / whole, 1, 1e-3);

  view.clip_box = Box{dvec3(0.6), dvec3(0.7)};
  const auto other = Streamer::open(test::source_of(volume), options).value();
  const auto splats = other->request(view, test::opaque(), all).value()->splats;
  EXPECT_LT(splats, 20000 / 5);  // a thousandth of the space, with nodes that reach into it
  EXPECT_LT(other->statistics().bytes_read, streamer->statistics().bytes_read / 2);

  // `advance` ends in the same frame.
  const auto paging = Streamer::open(test::source_of(volume), options).value();
  const FrameSplats* frame = nullptr;
  for (int calls = 0; calls < 1000 && !(frame && frame->progress.settled); ++calls)
    frame = paging->advance(view, test::opaque(), all, 60).value();
  EXPECT_TRUE(frame->progress.complete);
  EXPECT_EQ(mass_of(*frame), mass_of(**other->request(view, test::opaque(), all)));
  // Another box gives another frame.
  view.clip_box = Box{dvec3(0.6), dvec3(0.69)};
  const double before = mass_of(*frame);
  EXPECT_LT(mass_of(**paging->advance(view, test::opaque(), all, 60)), before);
}

}  // namespace
}  // namespace splatvol
