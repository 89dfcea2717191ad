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
#include "player/session.h"
#include "renderer/reference/reference.h"
#include "tests/builder/support/built_mesh.h"
#include "tests/support/results.h"
#include "tests/viewer/viewer_fixture.h"
#include "viewer/probe.h"

namespace splatvol::test {
namespace {

double waves(dvec3 p) { return double{static_cast<float>(p.x + 0.3 * std::sin(8 * p.y))}; }

struct ExactAtRest : FolderTest {
  static void build(const Mesh& mesh, const std::string& path, bool keeps_cells = true) {
    build_mesh(mesh, waves, path, {.exact = {.positions = true, .values = true}, .keep_cells = keeps_cells});
  }
  static ViewSettings on_processor() {
    return {.device = Device::cpu, .in_current_context = false, .works_aside = false};
  }
  [[nodiscard]] std::unique_ptr<Session> open(const ViewSettings& settings, const std::string& name = "m.svol") const {
    return value_of(Session::open(path(name), "", settings, host));
  }
  void draw(Session& session, double seconds = long_time) const {
    ASSERT_EQ(message_of(session.draw(width_, height_, seconds)), "");
  }
  Image settled(Session& session) const {
    std::uint64_t segments = 0;
    for (int frames = 0; frames == 0 || (!session.is_settled() && frames < 10000); ++frames) {
      draw(session);
      if (!session.exact() || !session.scene.contours.empty()) continue;  // blocks with edges have all samples
      EXPECT_GE(session.exact()->segments, segments) << "the picture sharpens";
      segments = session.exact()->segments;
    }
    EXPECT_TRUE(session.is_settled());
    return value_of(session.image());
  }
  static Image truth(const Mesh& mesh, const Scene& scene) {
    const std::vector<double> values = test::sample(mesh, waves);
    const std::vector<std::array<std::uint32_t, 4>> tetrahedra(mesh.tetrahedra.begin(), mesh.tetrahedra.end());
    return value_of(render_reference({mesh.points, values, tetrahedra}, scene)).image;
  }
  static double difference(const Image& a, const Image& b) { return compare_images(a, b).value().rmse; }

  int width_ = 120, height_ = 90;
  const Mesh mesh_ = jittered(12, 0.2);
};

TEST_F(ExactAtRest, IsThePictureOfTheReference) {
  build(mesh_, path("m.svol"));
  for (const bool hurries : {true, false}) {
    ViewSettings settings = on_processor();
    settings.hurries = hurries;
    const auto session = open(settings);
    const Image first = settled(*session);
    EXPECT_LE(difference(first, truth(mesh_, session->scene)), 1e-4);
    ASSERT_TRUE(session->exact());
    EXPECT_GT(session->exact()->segments, 1000u);
    ASSERT_TRUE(session->frame()) << "for probes";

    session->scene.camera.position += dvec3(0.1);
    draw(*session, 0.001);
    const Image second = settled(*session);
    EXPECT_LE(difference(second, truth(mesh_, session->scene)), 1e-4);
    EXPECT_TRUE(session->exact());
  }
}

TEST_F(ExactAtRest, ProbesHaveTheMeshsOwnValues) {
  build(mesh_, path("m.svol"));
  build(mesh_, path("without.svol"), false);
  const auto session = open(on_processor());
  settled(*session);
  const auto cells = value_of(ProbedCells::open(session->steps(), 0, "value"));
  ASSERT_TRUE(cells);
  const Looking looking = looking_through(session->view(), 0.5 * width_, 0.5 * height_);
  auto probe = ProbedFrame(session->frame()->list, session->units())
                   .probe({session->drawn_scene().transfer_function, nullptr}, looking);
  ASSERT_TRUE(probe);
  cells->take_values(looking.ray, *probe);
  const std::vector<double> values = test::sample(mesh_, waves);
  EXPECT_NEAR(probe->value, value_in(mesh_, values, probe->position), 1e-9);
  std::size_t inside = 0;
  for (std::size_t i = 0; i < probe->samples.size(); i += 8) {
    const Probe::Sample& sample = probe->samples[i];
    const double expected = value_in(mesh_, values, looking.ray.origin + sample.distance * looking.ray.direction);
    EXPECT_EQ(std::isnan(sample.value), std::isnan(expected)) << i;
    EXPECT_TRUE(std::isnan(expected) || std::abs(sample.value - expected) < 1e-9) << i;
    inside += std::isnan(expected) ? 0 : 1;
  }
  EXPECT_GT(inside, 16);
  EXPECT_FALSE(value_of(ProbedCells::open(open(on_processor(), "without.svol")->steps(), 0, "value")));
}

// Exact pictures move, with samples some pixels apart, and exact ones follow at rest. No splats come between.
TEST_F(ExactAtRest, MovesExactly) {
  const Mesh mesh = jittered(24, 0.2);  // of several nodes
  build(mesh, path("m.svol"));
  ViewSettings settings = on_processor();
  settings.moving.seconds = 10;  // however slow the machine is at the moment
  const auto session = open(settings);
  settled(*session);
  const std::uint64_t serial = session->frame()->serial;
  const auto light_of = [](const Image& picture) {
    dvec3 sum(0);
    for (const vec4& pixel : picture.pixels) sum += dvec3(pixel);
    return sum.x + sum.y + sum.z;
  };
  for (int step = 0; step < 3; ++step) {
    session->scene.camera.position += dvec3(0.05);
    draw(*session, 0.001);
    ASSERT_TRUE(session->exact());
    EXPECT_FALSE(session->refinement());
    EXPECT_EQ(session->frame()->serial, serial) << "splats were chosen";
    const Image picture = value_of(session->image());
    const Image exact = truth(mesh, session->scene);
    EXPECT_LE(difference(picture, exact), 0.02);
    EXPECT_NEAR(light_of(picture) / light_of(exact), 1, 0.01);
  }
  const std::uint64_t splats = session->frame()->splats;
  Camera& camera = session->scene.camera;
  camera.position += 0.97 * (camera.focal_point - camera.position);
  draw(*session, 0.001);
  for (int frames = 0; !session->is_settled() && frames < 10000; ++frames) {
    draw(*session);
    ASSERT_TRUE(session->exact());
  }
  EXPECT_LE(difference(value_of(session->image()), truth(mesh, session->scene)), 1e-4);
  EXPECT_LT(session->frame()->splats, splats) << "probes need the splats of this view";

  // Slices move exactly, too.
  session->scene.slices = {{.point = mesh.points[mesh.points.size() / 2], .normal = {0, 0, 1}}};
  settled(*session);
  session->scene.camera.position += dvec3(0.05);
  draw(*session, 0.001);
  EXPECT_TRUE(session->exact());
}

// Splats have none: whoever asks for splats sees contours at rest all the same.
TEST_F(ExactAtRest, HasContours) {
  build(mesh_, path("m.svol"));
  build(mesh_, path("points.svol"), false);
  ViewSettings settings = on_processor();
  settings.most_exact_segments = 0;
  settings.quality = {.tolerance_percent = 1};
  const auto session = open(settings);
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
  const auto mover = open(on_processor());
  mover->scene.contours = session->scene.contours;
  settled(*mover);
  mover->scene.camera.position += dvec3(0.05);
  draw(*mover, 0.001);
  if (mover->exact()) {
    EXPECT_LE(difference(value_of(mover->image()), truth(mesh_, mover->scene)), 0.05);
  }

  const auto without = open(on_processor(), "points.svol");
  without->scene.contours = session->scene.contours;
  settled(*without);
  ASSERT_EQ(without->troubles().size(), 1u);
  EXPECT_NE(without->troubles()[0].find("only these have contours"), std::string::npos) << without->troubles()[0];
}

TEST_F(ExactAtRest, IsWhatASceneAsksFor) {
  build(mesh_, path("m.svol"));
  build(mesh_, path("points.svol"), false);
  ViewSettings settings = on_processor();
  settings.most_exact_segments = 1000;
  const auto session = open(settings);
  settled(*session);
  EXPECT_FALSE(session->exact());
  EXPECT_FALSE(session->used_scene().use.quality.exact);

  ASSERT_EQ(message_of(session->use({.quality = {.exact = true}})), "");
  settled(*session);
  EXPECT_TRUE(session->exact());
  EXPECT_TRUE(session->used_scene().use.quality.exact);
  EXPECT_FALSE(session->used_scene().use.quality.max_error);

  const auto without = open(on_processor(), "points.svol");
  ASSERT_EQ(message_of(without->use({.quality = {.exact = true}})), "");
  settled(*without);
  ASSERT_EQ(without->troubles().size(), 1u);
  EXPECT_NE(without->troubles()[0].find("keeps no cells"), std::string::npos) << without->troubles()[0];
}

TEST_F(ExactAtRest, HasTheSamplingOfAScene) {
  build(mesh_, path("m.svol"));
  const auto session = open(on_processor());
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
  build(jittered(24, 0.2), path("m.svol"));
  width_ = 600, height_ = 450;
  const auto session = open(on_processor());
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
  build(mesh_, path("m.svol"));
  build(mesh_, path("points.svol"), false);
  const auto without = open(on_processor(), "points.svol");
  const Image splats = settled(*without);
  EXPECT_FALSE(without->exact());

  ViewSettings settings = on_processor();
  settings.most_exact_segments = 1000;
  const auto session = open(settings);
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
  build(mesh_, path("m.svol"));
  std::string bytes = *read_text_file(path("m.svol"));
  const auto volume = *format::Volume::open(*open_file(path("m.svol")));
  const auto cells = std::ranges::find(volume->sections(), format::SectionKind::cells, &format::SectionEntry::kind);
  ASSERT_NE(cells, volume->sections().end());
  bytes[cells->offset + cells->packed_bytes / 2] ^= 0x55;
  std::ofstream(path("damaged.svol"), std::ios::binary) << bytes;

  ViewSettings settings = on_processor();
  settings.most_exact_segments = 0;
  const Image splats = settled(*open(settings));
  const auto session = open(on_processor(), "damaged.svol");
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
  build(mesh_, path("m.svol"));
  const auto player = value_of(Player::open(path("m.svol"), std::nullopt, {.device = Device::cpu}));
  const auto light = [&](int spacing) {
    EXPECT_EQ(message_of(player->draw(Recipe::of_cells(spacing))), "");
    dvec3 sum(0);
    for (const vec4& pixel : value_of(player->image()).pixels) sum += dvec3(pixel);
    return sum.x + sum.y + sum.z;
  };
  const double exact = light(1);
  for (const int spacing : {2, 4}) EXPECT_NEAR(light(spacing) / exact, 1, 0.01) << spacing;
}

// Where a graphics card draws what moves, the processor draws the picture at rest, and the window shows it.
class ExactViewer : public ViewerFixture {};

TEST_F(ExactViewer, ShowsTheProcessorsPicture) {
  build_mesh(jittered(12, 0.2), waves, path("m.svol"), {.keep_cells = true});
  std::vector<Image> screens;
  for (const Device device : {Device::gl, Device::cpu}) {
    resize(300, 200);
    open({.volume = path("m.svol"), .settings = {.device = device}});
    settle();
    EXPECT_TRUE(viewer->session()->exact());
    press(key::tab);  // without the panel
    settle();
    screens.push_back(screen());
  }
  EXPECT_LE(compare_images(screens[0], screens[1])->max, 0.02);
}

}  // namespace
}  // namespace splatvol::test
