// Streamlines of a scene: their tubes in pictures, and in sessions.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "player/scene_streamlines.h"
#include "player/scene_surfaces.h"
#include "tests/player/moving_cube.h"
#include "tests/player/session_fixture.h"

namespace splatvol::test {
namespace {

using testing::HasSubstr;

SceneStreamlines some() {
  return {.vector = "U", .seeds = SeedLine{{0.5, 0.2, 0.5}, {0.5, 0.8, 0.5}, 3}, .radius = 0.05, .color = {1, 0, 0}};
}

SceneColoring by_speed() {
  return {"speed", {.lo = 1, .hi = 2, .colors = {{0, {0, 0, 1}}, {1, {0, 1, 0}}}, .densities = {{0, 1}}}};
}

struct Streamlines : SessionFixture {
  Streamlines() { write_moving(path("v.svol")); }

  // Looks along z at the whole cube, whose volume is not seen.
  [[nodiscard]] Scene scene() const {
    Scene scene = value_of(Player::open(path("v.svol")))->scene();
    scene.camera = {.projection = Camera::Projection::orthographic,
                    .parallel_height = 1,
                    .position = {0.5, 0.5, 3},
                    .focal_point = {0.5, 0.5, 0}};
    scene.width = scene.height = 100;
    scene.transfer_function.densities = {{0, 0}};
    return scene;
  }
  [[nodiscard]] Image picture(const Scene& of) const {
    const auto player = value_of(Player::open(path("v.svol"), of, {.device = Device::cpu}));
    EXPECT_TRUE(player->draw_picture({.exact = true}));
    return value_of(player->image());
  }
};

TEST_F(Streamlines, AreDrawnAsTubesWithTheirColours) {
  Scene with = scene();
  with.streamlines = {some()};
  const Image red = picture(with);
  const auto pixel = [](const Image& image, int x, int y) {
    return image.pixels[static_cast<std::size_t>(y * 100 + x)];
  };
  for (const int y : {20, 50, 80})
    for (const int x : {5, 50, 95}) {
      EXPECT_EQ(pixel(red, x, y).a, 1);
      EXPECT_GT(pixel(red, x, y).r, 0.9);
      EXPECT_EQ(pixel(red, x, y).g, 0);
    }
  for (const int y : {35, 65}) EXPECT_EQ(pixel(red, 50, y).a, 0);

  with.streamlines[0].color_by = by_speed();
  const Image colored = picture(with);
  for (const int x : {10, 50, 90}) {
    const double share = (x + 0.5) / 100, light = pixel(colored, x, 50).g + pixel(colored, x, 50).b;
    EXPECT_NEAR(pixel(colored, x, 50).g / light, share, 0.01);
  }
  with.streamlines[0].shown = false;
  EXPECT_EQ(pixel(picture(with), 50, 50).a, 0);
}

TEST_F(Streamlines, LinesStayWhileTheyAreTheSame) {
  const auto player = value_of(Player::open(path("v.svol"), scene(), {.device = Device::cpu, .takes_tubes = true}));
  const StreamlineFile file = player->streamline_file();
  const auto read = [&](const SceneStreamlines& of, std::span<const SceneTubes> before) {
    return value_of(read_scene_streamlines(std::vector{of}, file, before));
  };
  auto first = read(some(), {});
  EXPECT_EQ(first[0].seeds, 3U);
  EXPECT_EQ(first[0].lines->size(), 3U);
  SceneStreamlines other = some();
  other.radius = 0.01;
  auto thinner = read(other, first);
  EXPECT_EQ(thinner[0].lines, first[0].lines);
  EXPECT_NE(thinner[0].surface.mesh->points, first[0].surface.mesh->points);
  first.clear();
  other.seeds = std::vector{dvec3(0.1, 0.1, 0.1), dvec3(2)};
  const auto moved = read(other, thinner);
  EXPECT_EQ(moved[0].lines->size(), 1U);
  EXPECT_EQ(moved[0].field, thinner[0].field) << "its chunks stay";
  thinner.clear();
  int calls = 0;
  const auto told = value_of(read_scene_streamlines(
      std::vector{some()}, file, {}, [&](const auto& tubes) { calls += tubes[0].lines->empty() ? 0 : 1; }));
  EXPECT_GE(calls, 1) << "the first line comes at once";
}

TEST_F(Streamlines, HaveTheirMemory) {
  const auto player = value_of(Player::open(
      path("v.svol"), scene(), {.memory = std::uint64_t{8} << 20, .device = Device::cpu, .takes_tubes = true}));
  const StreamlineFile file = player->streamline_file();
  const MemoryShare& share = file.memory->streamlines;
  SceneStreamlines one = some();
  const auto count = [&](std::size_t lines) { std::get<SeedLine>(one.seeds).count = lines; };
  count(20);
  auto few = value_of(read_scene_streamlines(std::vector{one}, file, {}));
  {
    one.radius = 0.02;
    const auto others = value_of(read_scene_streamlines(std::vector{one}, file, few));
    std::uint64_t bytes = 0;
    for (const SceneTubes& tubes : {few[0], others[0]})
      bytes += drawn_bytes(tubes.surface.mesh->points.size(), tubes.surface.mesh->triangles.size());
    EXPECT_GT(share.used(), bytes) << "those that are shown, and those that are made";
  }
  few.clear();
  EXPECT_EQ(share.used(), 0);

  for (const std::size_t lines : {1000, 500}) {
    count(lines);
    const auto many = read_scene_streamlines(std::vector{one}, file, {});
    EXPECT_THAT(message_of(many), HasSubstr("than the 0.7 MiB that memory has for them")) << lines;
    EXPECT_THAT(message_of(many), HasSubstr("v.svol: the streamlines of U")) << lines;
  }
  count(20);
  EXPECT_TRUE(read_scene_streamlines(std::vector{one}, file, {})) << "nothing is left of those that failed";
}

TEST_F(Streamlines, ComeToASession) {
  const auto session = open(path("v.svol"));
  const Image without = settled(*session);
  session->scene.streamlines = {some()};
  const Image with = settled(*session);
  EXPECT_GT(compare_images(with, without)->rmse, 0.01);
  ASSERT_EQ(session->streamline_counts().size(), 1U);
  EXPECT_EQ(session->streamline_counts()[0].lines, 3U);
  EXPECT_TRUE(session->troubles().empty());

  // Another view needs no lines, and other seeds do.
  session->scene.streamlines[0].seeds = SeedLine{{0.5, 0.2, 0.5}, {0.5, 3, 0.5}, 2};
  EXPECT_GT(compare_images(settled(*session), with)->rmse, 0.001);
  EXPECT_EQ(session->streamline_counts()[0].lines, 1U);
  EXPECT_EQ(session->streamline_counts()[0].seeds, 2U);
  session->scene.streamlines[0].seeds = std::vector{dvec3(9)};
  EXPECT_EQ(compare_images(settled(*session), without)->max, 0);
  ASSERT_EQ(session->troubles().size(), 1U);
  EXPECT_THAT(session->troubles()[0], HasSubstr("no seed has a streamline"));
  session->scene.streamlines = {some()};
  EXPECT_EQ(compare_images(settled(*session), with)->max, 0);
}

// Each step of this series is a file.
TEST_F(Streamlines, AreThoseOfTheStep) {
  write_moving(path("s-0.svol"));
  write_moving(path("s-1.svol"), 1);
  write("s.svols", R"({"steps": [{"time": 0, "file": "s-0.svol"}, {"time": 1, "file": "s-1.svol"}],
    "attributes": [{"name": "speed", "unit": "", "min": 1, "max": 2}]})");
  const auto series = open(path("s.svols"));
  series->scene.streamlines = {some()};
  const Image last = settled(*series);
  ASSERT_TRUE(series->show_step(0));
  const Image first = settled(*series);
  EXPECT_GT(compare_images(first, last)->rmse, 0.01);
  ASSERT_TRUE(series->show_step(1));
  EXPECT_EQ(compare_images(settled(*series), last)->max, 0);
}

TEST_F(Streamlines, ThatCannotBeAreAnError) {
  Scene with = scene();
  with.streamlines = {some()};
  with.streamlines[0].vector = "V";
  EXPECT_THAT(message_of(Player::open(path("v.svol"), with, {.device = Device::cpu})), HasSubstr("vectors: U"));
  write_two_attributes(path("points.svol"));
  with.attribute = "a0";
  EXPECT_THAT(message_of(Player::open(path("points.svol"), with, {.device = Device::cpu})), HasSubstr("no vector"));
}

}  // namespace
}  // namespace splatvol::test
