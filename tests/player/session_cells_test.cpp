// The exact picture of a file that keeps cells, at rest.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <fstream>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "base/file.h"
#include "format/volume.h"
#include "pictures/image.h"
#include "player/cell_ray.h"
#include "renderer/reference/reference.h"
#include "tests/player/session_fixture.h"
#include "tests/player/waves.h"
#include "tests/support/far_file.h"

namespace splatvol::test {
namespace {

struct ExactAtRest : SessionFixture {
  ExactAtRest() : SessionFixture(120, 90) { settings.works_aside = false; }

  void build(const Mesh& mesh, const std::string& name = "m.svol", bool keeps_cells = true) const {
    build_mesh(mesh, waves, path(name), {.exact = {.positions = true, .values = true}, .keep_cells = keeps_cells});
  }
  [[nodiscard]] std::unique_ptr<Session> open(const std::string& name = "m.svol") const {
    return SessionFixture::open(path(name));
  }
  Image settled(Session& session) const {
    std::uint64_t segments = 0;
    do {
      draw(session);
      if (!session.exact() || !session.scene.contours.empty()) continue;  // blocks with edges have all samples
      EXPECT_GE(session.exact()->segments, segments) << "the picture sharpens";
      segments = session.exact()->segments;
    } while (!session.is_settled());  // ends by the test's time limit
    return value_of(session.image());
  }
  static Image truth(const Mesh& mesh, const Scene& scene) {
    const std::vector<double> values = test::sample(mesh, waves);
    const std::vector<std::array<std::uint32_t, 4>> tetrahedra(mesh.tetrahedra.begin(), mesh.tetrahedra.end());
    return value_of(render_reference({mesh.points, values, tetrahedra}, scene)).image;
  }
  static double light_of(const Image& picture) {
    dvec3 sum(0);
    for (const vec4& pixel : picture.pixels) sum += dvec3(pixel);
    return sum.x + sum.y + sum.z;
  }
  static double difference(const Image& a, const Image& b) { return compare_images(a, b).value().rmse; }

  const Mesh mesh_ = jittered(12, 0.2);
};

TEST_F(ExactAtRest, IsThePictureOfTheReference) {
  build(mesh_);
  for (const bool hurries : {true, false}) {
    settings.hurries = hurries;
    const auto session = open();
    const Image first = settled(*session);
    EXPECT_LE(difference(first, truth(mesh_, session->scene)), 1e-4);
    ASSERT_TRUE(session->exact());
    EXPECT_GT(session->exact()->segments, 1000u);
    ASSERT_TRUE(session->cells_for_picks());

    session->scene.camera.position += dvec3(0.1);
    draw(*session, 0.001);
    const Image second = settled(*session);
    EXPECT_LE(difference(second, truth(mesh_, session->scene)), 1e-4);
    EXPECT_TRUE(session->exact());
  }
}

// Exact pictures move, with samples some pixels apart, and exact ones follow at rest. No splats come between.
TEST_F(ExactAtRest, MovesExactly) {
  const Mesh mesh = jittered(24, 0.2);  // of several nodes
  build(mesh);
  settings.moving.seconds = 10;  // however slow the machine is at the moment
  const auto session = open();
  settled(*session);
  const auto serial = [&] { return session->frame() ? session->frame()->serial : 0; };
  const std::uint64_t first = serial();
  for (int step = 0; step < 3; ++step) {
    session->scene.camera.position += dvec3(0.05);
    draw(*session, 0.001);
    ASSERT_TRUE(session->exact());
    EXPECT_FALSE(session->refinement());
    EXPECT_EQ(serial(), first) << "splats were chosen";
    const Image picture = value_of(session->image());
    const Image exact = truth(mesh, session->scene);
    EXPECT_LE(difference(picture, exact), 0.02);
    EXPECT_NEAR(light_of(picture) / light_of(exact), 1, 0.01);
  }
  Camera& camera = session->scene.camera;
  camera.position += 0.97 * (camera.focal_point - camera.position);
  draw(*session, 0.001);
  for (int frames = 0; !session->is_settled() && frames < 10000; ++frames) {
    draw(*session);
    ASSERT_TRUE(session->exact());
  }
  EXPECT_LE(difference(value_of(session->image()), truth(mesh, session->scene)), 1e-4);
  EXPECT_EQ(serial(), first) << "cells answer picks";

  // Slices move exactly, too.
  session->scene.slices = {{.point = mesh.points[mesh.points.size() / 2], .normal = {0, 0, 1}}};
  settled(*session);
  session->scene.camera.position += dvec3(0.05);
  draw(*session, 0.001);
  EXPECT_TRUE(session->exact());
}

// Splats have none: whoever asks for splats sees contours at rest all the same.
TEST_F(ExactAtRest, HasContours) {
  build(mesh_);
  build(mesh_, "points.svol", false);
  const auto session = open();
  session->settings.most_exact_segments = 0;
  session->settings.quality = {.tolerance_percent = 1};
  settled(*session);
  EXPECT_FALSE(session->exact());
  session->scene.contours = {{.values = {0.3}, .opacity = 0.5}, {.values = {0.6}, .color = dvec3(1, 1, 0)}};
  EXPECT_LE(difference(settled(*session), truth(mesh_, session->scene)), 1e-4);
  EXPECT_TRUE(session->exact());
  const TransferFunction function = session->scene.transfer_function;
  session->scene.transfer_function.densities = {{0, 0}};
  settled(*session);
  EXPECT_EQ(session->explain(), "") << "contours are there";
  session->scene.transfer_function = function;
  EXPECT_EQ(value_of(parse_scene(scene_to_json(session->used_scene().scene))).contours, session->scene.contours);
  EXPECT_TRUE(session->troubles().empty());

  // They move, too, unless the machine has no time for it.
  const auto mover = open();
  mover->scene.contours = session->scene.contours;
  settled(*mover);
  mover->scene.camera.position += dvec3(0.05);
  draw(*mover, 0.001);
  if (mover->exact()) {
    EXPECT_LE(difference(value_of(mover->image()), truth(mesh_, mover->scene)), 0.05);
  }

  const auto without = open("points.svol");
  without->scene.contours = session->scene.contours;
  settled(*without);
  ASSERT_EQ(without->troubles().size(), 1u);
  EXPECT_NE(without->troubles()[0].find("only these have contours"), std::string::npos) << without->troubles()[0];
}

// Cells of a file on a server answer picks once all are here, and ask for nothing then.
TEST_F(ExactAtRest, PicksAskNoServer) {
  build(mesh_);
  for (const bool has_time : {true, false}) {
    settings.moving.seconds = has_time ? 10 : 1e-9;
    const auto counts = std::make_shared<FarFile::Counts>();
    const auto open_far = [&](const std::string& name) -> Result<std::unique_ptr<ByteSource>> {
      return std::make_unique<FarFile>(name, true, counts);
    };
    const auto session =
        value_of(Session::open(value_of(Session::read({.file = path("m.svol")}, "", settings, open_far)), host));
    EXPECT_FALSE(session->cells_for_picks()) << "nothing was read";
    settled(*session);
    const auto cells = session->cells_for_picks();
    EXPECT_EQ(cells.has_value(), has_time);
    EXPECT_TRUE(cells || session->frame()) << "splats answer";
    if (!cells) continue;
    const std::uint64_t requests = counts->requests;
    const Looking middle = looking_through(session->view(), 0.5 * width, 0.5 * height);
    EXPECT_TRUE(value_of(pick_cells(*cells->kept, session->drawn_scene(), {}, middle.ray)));
    EXPECT_EQ(counts->requests, requests);
  }
}

TEST_F(ExactAtRest, IsWhatASceneAsksFor) {
  build(mesh_);
  build(mesh_, "points.svol", false);
  const auto session = open();
  session->settings.most_exact_segments = 1000;
  settled(*session);
  EXPECT_FALSE(session->exact());
  EXPECT_FALSE(session->used_scene().use.quality.exact);

  ASSERT_EQ(message_of(session->use({.quality = {.exact = true}})), "");
  settled(*session);
  EXPECT_TRUE(session->exact());
  EXPECT_TRUE(session->used_scene().use.quality.exact);
  EXPECT_FALSE(session->used_scene().use.quality.max_error);

  const auto without = open("points.svol");
  ASSERT_EQ(message_of(without->use({.quality = {.exact = true}})), "");
  settled(*without);
  ASSERT_EQ(without->troubles().size(), 1u);
  EXPECT_NE(without->troubles()[0].find("keeps no cells"), std::string::npos) << without->troubles()[0];
}

TEST_F(ExactAtRest, HasTheSamplingOfAScene) {
  build(mesh_);
  const auto session = open();
  const Image whole = settled(*session);
  for (const int spacing : {6, 3}) {
    ASSERT_EQ(message_of(session->use({.drawing = {.sample_spacing = spacing}})), "");
    EXPECT_GT(difference(settled(*session), whole), 0) << spacing;
    EXPECT_TRUE(session->exact());
  }
  ASSERT_EQ(message_of(session->use({.drawing = {.sample_spacing = 1}})), "");
  EXPECT_EQ(compare_images(settled(*session), whole)->max, 0);
}

TEST_F(ExactAtRest, IsGivenUpForAChange) {
  build(jittered(24, 0.2));
  width = 600, height = 450;
  const auto session = open();
  const Image whole = settled(*session);
  const Camera camera = session->scene.camera;
  int given_up = 0;
  for (int tries = 0; tries < 4; ++tries) {
    session->scene.camera.position += dvec3(0.01);
    draw(*session, 0.001);
    const auto is_being_drawn = [&] {
      return session->is_drawing() && session->refinement() && session->refinement()->has_all_splats();
    };
    for (int frames = 0; !is_being_drawn() && !session->is_settled() && frames < 10000; ++frames) draw(*session);
    given_up += session->is_drawing() ? 1 : 0;
    session->scene.camera.position += dvec3(0.01);
    for (int frames = 0; frames == 0 || (session->is_drawing() && frames < 10000); ++frames) draw(*session, 0.001);
    EXPECT_FALSE(session->refinement()) << "it moves";
    EXPECT_FALSE(session->is_settled());
  }
  EXPECT_GT(given_up, 0) << "each picture was there at once";
  session->scene.camera = camera;
  EXPECT_EQ(compare_images(settled(*session), whole)->max, 0);
  session->scene.camera.position += dvec3(0.01);
  draw(*session);  // may still be drawing at its end
}

TEST_F(ExactAtRest, NeedsCellsAndFewSegments) {
  build(mesh_);
  build(mesh_, "points.svol", false);
  const auto without = open("points.svol");
  const Image splats = settled(*without);
  EXPECT_FALSE(without->exact());

  const auto session = open();
  session->settings.most_exact_segments = 1000;
  session->scene = without->scene;  // its own camera shows all cells
  EXPECT_EQ(compare_images(settled(*session), splats)->max, 0);
  EXPECT_FALSE(session->exact());
  EXPECT_TRUE(session->troubles().empty());

  session->settings.most_exact_segments = 10'000'000;
  settled(*session);
  EXPECT_TRUE(session->exact());

  // Who asks for a tolerance or for octants looks at splats.
  session->settings.quality = {.tolerance_percent = 0};
  settled(*session);
  EXPECT_FALSE(session->exact());
  session->settings.quality = {};
  session->settings.drawing.kernel = KernelKind::octant;
  settled(*session);
  EXPECT_FALSE(session->exact());
}

TEST_F(ExactAtRest, FailsOnce) {
  build(mesh_);
  std::string bytes = *read_text_file(path("m.svol"));
  const auto volume = *format::Volume::open(*open_file(path("m.svol")));
  const auto cells = std::ranges::find(volume->sections(), format::SectionKind::cells, &format::SectionEntry::kind);
  ASSERT_NE(cells, volume->sections().end());
  bytes[cells->offset + cells->packed_bytes / 2] ^= 0x55;
  std::ofstream(path("damaged.svol"), std::ios::binary) << bytes;

  const auto of_splats = open();
  of_splats->settings.most_exact_segments = 0;
  const Image splats = settled(*of_splats);
  const auto session = open("damaged.svol");
  for (int tries = 0; tries < 2; ++tries) {
    EXPECT_EQ(compare_images(settled(*session), splats)->max, 0);
    EXPECT_FALSE(session->exact());
    EXPECT_EQ(session->troubles().size(), 1u);
    const Camera camera = session->scene.camera;
    session->scene.camera.position += dvec3(0.1);
    settled(*session);
    session->scene.camera = camera;
  }
}

TEST_F(ExactAtRest, HasTheLightOfFewerSamples) {
  build(mesh_);
  const auto player = value_of(Player::open(path("m.svol"), std::nullopt, {.device = Device::cpu}));
  const auto light = [&](int spacing) {
    EXPECT_EQ(message_of(player->draw(Recipe::of_cells(spacing))), "");
    return light_of(value_of(player->image()));
  };
  const double exact = light(1);
  for (const int spacing : {2, 4}) EXPECT_NEAR(light(spacing) / exact, 1, 0.01) << spacing;
}

}  // namespace
}  // namespace splatvol::test
