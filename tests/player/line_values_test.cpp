// Values along a line, over the steps of a series, and what hides a line.
#include "player/line_values.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <stop_token>

#include "base/addresses.h"
#include "base/interruption.h"
#include "tests/player/session_fixture.h"

namespace splatvol::test {
namespace {

using testing::HasSubstr;
using testing::IsEmpty;

struct LineValues : FolderTest {
  // The attributes "value" = z and "other" = x, on [0, 1]^3.
  void build(bool keeps_cells = true) const {
    Piece piece = mesh_piece(lattice(8), [](dvec3 p) { return p.z; });
    piece.values.push_back(test::sample(lattice(8), [](dvec3 p) { return p.x; }));
    PieceSource source({piece}, {.attributes = {"value", "other"}});
    require(build_volume(source, path("m.svol"),
                         {.exact = {.positions = true, .values = true}, .keep_cells = keeps_cells},
                         [](const char*, double) {}));
  }
  [[nodiscard]] format::Steps steps(const std::string& name = "m.svol") const {
    return value_of(format::Steps::open(path(name), open_file_or_url));
  }
  [[nodiscard]] std::vector<double> over_steps(const dvec3& position) {
    return value_of(read_steps(steps("s.svol"), "value", position, done_));
  }

  const LineRequest line_{{0.2, 0.3, 0}, {0.6, 0.3, 1}, {"other", "value"}};
  std::atomic<std::size_t> done_ = 0;
};

TEST_F(LineValues, HaveAllAttributesAndCrossings) {
  build();
  const LineRows rows = value_of(read_line(steps(), line_));
  ASSERT_EQ(rows.values.size(), 2);
  EXPECT_GT(rows.arc_lengths.size(), 8);
  EXPECT_DOUBLE_EQ(rows.arc_lengths.back(), line_.length());
  for (std::size_t row = 0; row < rows.arc_lengths.size(); ++row) {
    EXPECT_NEAR(rows.values[0][row], rows.positions[row].x, 1e-12);
    EXPECT_NEAR(rows.values[1][row], rows.positions[row].z, 1e-12);
  }
}

TEST_F(LineValues, SayWhyThereAreNone) {
  EXPECT_THAT(why_no_line(true, line_), IsEmpty());
  EXPECT_THAT(why_no_line(false, line_), HasSubstr("keeps no cells"));
  EXPECT_THAT(why_no_line(true, {{1, 2, 3}, {1, 2, 3}, {"value"}}), HasSubstr("one place"));
  EXPECT_THAT(why_no_line(true, {{1, 2, 3}, {NAN, 2, 3}, {"value"}}), HasSubstr("one place"));
  EXPECT_THAT(why_no_line(true, {{1, 2, 3}, {1, 2, 4}, {}}), HasSubstr("no attribute"));
  EXPECT_THAT(why_no_steps(true, {0, 1}), IsEmpty());
  EXPECT_THAT(why_no_steps(false, {0, 1}), HasSubstr("keeps no cells"));
  EXPECT_THAT(why_no_steps(true, {}), HasSubstr("no time series"));
  build(false);
  EXPECT_THAT(message_of(read_line(steps(), line_)), HasSubstr("m.svol: keeps no cells"));
  build();
  EXPECT_THAT(message_of(read_line(steps(), {{0, 0, 0}, {1, 1, 1}, {"none"}})), HasSubstr("none"));
}

TEST_F(LineValues, FollowTheSteps) {
  write_series(path("s.svol"), {.exact = {.positions = true, .values = true}, .keep_cells = true});
  const dvec3 position(0.25, 0.5, 0.75);  // a point of the mesh
  const std::vector<double> values = over_steps(position);
  ASSERT_EQ(values.size(), 3);
  EXPECT_EQ(done_, 3);
  for (int step = 0; step < 3; ++step)
    EXPECT_NEAR(values[static_cast<std::size_t>(step)], std::sin(1.25 + step) + step, 1e-6);
  EXPECT_TRUE(std::isnan(over_steps({2, 2, 2})[1])) << "no cell is there";

  std::stop_source stop;
  stop.request_stop();
  const Interruptible interruptible(stop.get_token());
  EXPECT_EQ(read_steps(steps("s.svol"), "value", position, done_).error().code, ErrorCode::cancelled);
}

// From above, 1 - z of the volume is in front of a place at z.
TEST_F(LineValues, WhatIsInFrontHidesAPlace) {
  build();
  Scene scene;
  scene.attribute = "value";
  scene.camera = {.position = {0.3, 0.4, 3}, .focal_point = {0.3, 0.4, 0}};
  scene.transfer_function = {.colors = {{0, dvec3(1)}}, .densities = {{0, 2}}};
  const std::vector<dvec3> places = {{0.3, 0.4, 0.75}, {0.3, 0.4, 0.25}, {0.3, 0.4, -1}, {0.3, 0.4, 4}};
  const auto lights = [&] {
    const auto volume = value_of(steps().volume(0));
    const auto kept = value_of(KeptCells::open(*volume, scene, own_room(std::uint64_t{16} << 20)));
    return value_of(light_from(*kept, scene, {}, value_of(make_view(scene)), places));
  };
  for (const bool orthographic : {false, true}) {
    scene.camera.projection = orthographic ? Camera::Projection::orthographic : Camera::Projection::perspective;
    const auto found = lights();
    EXPECT_NEAR(found[0], std::exp(-0.5), 1e-9);
    EXPECT_NEAR(found[1], std::exp(-1.5), 1e-9);
    EXPECT_NEAR(found[2], std::exp(-2), 1e-9) << "behind all";
    EXPECT_EQ(found[3], 0) << "behind the eye";
  }
  scene.contours = {{.values = {0.5}}};
  EXPECT_NEAR(lights()[0], std::exp(-0.5), 1e-9) << "the contour is behind";
  EXPECT_EQ(lights()[1], 0);
  scene.contours.clear();
  scene.slices = {{.point = {0, 0, 0.75}, .normal = {0, 0, 1}, .opacity = 0.5}};
  EXPECT_NEAR(lights()[0], std::exp(-0.5), 1e-9) << "the line lies in the slice";
  EXPECT_NEAR(lights()[1], 0.5 * std::exp(-1.5), 1e-9);
  scene.clip_planes = {{.point = {0, 0, 0.5}, .normal = {0, 0, -1}}};
  EXPECT_NEAR(lights()[1], std::exp(-0.5), 1e-9) << "what is cut off hides nothing";
}

}  // namespace
}  // namespace splatvol::test
