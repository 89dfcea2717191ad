// Files and their pictures, drawn by the processor.
#include "player/player.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <future>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>

#include "base/interruption.h"
#include "pictures/image.h"
#include "player/statistics.h"
#include "streamer/first/default_scene.h"
#include "tests/builder/support/built_mesh.h"
#include "tests/renderer/surfaces/shapes.h"
#include "tests/support/stalled_source.h"
#include "tests/support/temp_folder.h"

namespace splatvol {
namespace {

using ::testing::HasSubstr;

class PlayerOfALattice : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    folder.emplace();
    test::build_mesh(test::lattice(24), waves, path());
  }
  static void TearDownTestSuite() { folder.reset(); }

  static double waves(dvec3 p) { return std::sin(9 * p.x) * std::cos(7 * p.y); }
  static std::string path(const std::string& name = "m.svol") { return folder->path(name); }
  static PlayerOptions on_processor() { return {.device = Device::cpu}; }

  /// Opens a file in a picture of 120 x 90 pixels. `attribute`: if it is not that of the first picture.
  static std::unique_ptr<Player> open(const PlayerOptions& options = on_processor(), const std::string& file = path(),
                                      const std::string& attribute = "") {
    auto player = Player::open(file, std::nullopt, options);
    EXPECT_TRUE(player) << player.error().message;
    Scene scene = attribute.empty() ? (*player)->scene() : (*player)->fitting_scene(attribute).value();
    scene.width = 120;
    scene.height = 90;
    EXPECT_TRUE((*player)->set_scene(scene));
    return std::move(*player);
  }

  /// All points.
  static Recipe all() { return {Detail{.tolerance_percent = 0}}; }

  static Image drawn(Player& player, std::optional<double> wait_seconds = {}) {
    const auto outcome = player.draw(all(), wait_seconds);
    EXPECT_TRUE(outcome) << outcome.error().message;
    return player.image().value();
  }

  static Image drawn(Player& player, const Scene& scene) {
    const Status status = player.set_scene(scene);
    EXPECT_TRUE(status) << status.error().message;
    return drawn(player);
  }

  static Status set_memory(Player& player, std::uint64_t bytes) {
    PlayerOptions options = player.options();
    options.memory = bytes;
    SPLATVOL_TRY_ASSIGN(file, player.reader(player.scene(), options)());
    return player.replace(std::move(file));
  }

  static inline std::optional<test::TempFolder> folder;
};

TEST_F(PlayerOfALattice, FramesWhileItLoadsEndInTheCompleteOne) {
  const Image complete = drawn(*open());
  const auto player = open();
  Image last;
  do {
    last = drawn(*player, 0);
    EXPECT_GT(player->frame()->splats, 0U) << "there is always a picture";
  } while (!player->frame()->progress.settled);
  EXPECT_TRUE(player->frame()->progress.complete);
  EXPECT_EQ(player->frame()->splats, player->info().point_count());
  EXPECT_EQ(compare_images(last, complete)->max, 0);
}

TEST_F(PlayerOfALattice, WhatIsRefusedStaysAsItWas) {
  const auto player = open();
  const Image before = drawn(*player);
  Scene scene = player->scene();
  scene.attribute = "no such";
  const Status refused = player->set_scene(scene);
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("no such"));
  EXPECT_FALSE(set_memory(*player, 1000));
  EXPECT_FALSE(player->show_step(0)) << "the file is no series";
  scene = player->scene();
  scene.width = 0;
  EXPECT_FALSE(player->set_scene(scene));
  EXPECT_EQ(player->scene().width, 120);
  EXPECT_EQ(compare_images(drawn(*player), before)->max, 0);
}

TEST_F(PlayerOfALattice, SceneMemoryAndKernelChange) {
  const auto player = open();
  const Image before = drawn(*player);
  Scene scene = player->scene();
  scene.transfer_function.densities = {{0, 0.0}, {1, 0.0}};
  EXPECT_GT(compare_images(drawn(*player, scene), before)->rmse, 0.01);
  scene.transfer_function = open()->scene().transfer_function;
  scene.lighting = Lighting();
  EXPECT_GT(compare_images(drawn(*player, scene), before)->rmse, 1e-4);
  EXPECT_FALSE(player->set_drawing({.kernel = KernelKind::octant})) << "light needs gradients, which the file lacks";
  scene.lighting.reset();
  ASSERT_TRUE(player->set_scene(scene));
  ASSERT_TRUE(player->set_drawing({.kernel = KernelKind::octant}));
  EXPECT_GT(compare_images(drawn(*player), before)->rmse, 1e-4);
  ASSERT_TRUE(player->set_drawing({.kernel = KernelKind::moments}));
  ASSERT_TRUE(set_memory(*player, player->options().memory / 2));
  EXPECT_EQ(compare_images(drawn(*player), before)->max, 0);
}

TEST_F(PlayerOfALattice, SurfacesHoldForAllFramesOfTheirSize) {
  const auto player = open();
  const Image before = drawn(*player);
  const auto depths = std::make_shared<SurfaceDepths>();
  depths->width = 120;
  depths->height = 90;
  for (int i = 0; i < 120 * 90; ++i)
    depths->depths.push_back(i % 120 < 60 ? 0 : std::numeric_limits<float>::infinity());
  ASSERT_TRUE(player->set_surface_depths(depths));
  const auto is_hidden_on_the_left = [&] {
    const Image image = drawn(*player);
    float left = 0, right = 0;
    for (int y = 0; y < 90; ++y)
      for (int x = 0; x < 120; ++x) (x < 60 ? left : right) += image.at(x, y).a;
    return left == 0 && right > 0;
  };
  EXPECT_TRUE(is_hidden_on_the_left());
  EXPECT_TRUE(is_hidden_on_the_left()) << "in the next frame too";
  EXPECT_EQ(player->sample_spacing(), 1);
  ASSERT_TRUE(player->set_drawing({.kernel = KernelKind::octant}));
  EXPECT_TRUE(is_hidden_on_the_left()) << "by another rasterizer";
  ASSERT_TRUE(player->set_drawing({.kernel = KernelKind::moments}));

  EXPECT_FALSE(player->set_surface_depths(std::make_shared<SurfaceDepths>(SurfaceDepths{1, 1, {}})));
  EXPECT_TRUE(is_hidden_on_the_left()) << "what is refused changes nothing";
  Scene scene = player->scene();
  scene.width = 100;
  ASSERT_TRUE(player->set_scene(scene));
  const auto refused = player->draw(all());
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("120 x 90 pixels, but the picture has 100 x 90"));
  scene.width = 120;
  ASSERT_TRUE(player->set_scene(scene));
  ASSERT_TRUE(player->set_surface_depths(nullptr));
  EXPECT_EQ(compare_images(drawn(*player), before)->max, 0);
}

TEST_F(PlayerOfALattice, SurfacesOfTheSceneAreSortedIn) {
  int read = 0;
  PlayerOptions options = on_processor();
  options.read_surface = [&](const std::string& path) -> Result<TriangleMesh> {
    ++read;
    if (path == "none") return fail(ErrorCode::io, "none: gone");
    return test::plate({-9, -9, 0.5}, {18, 0, 0}, {0, 18, 0});  // through the middle of the lattice
  };
  const auto player = open(options);
  Scene scene = player->scene();
  scene.camera.position = {0.5, 0.5, 3};
  scene.camera.focal_point = dvec3(0.5);
  scene.camera.up = {0, 1, 0};
  const Image whole = drawn(*player, scene);
  EXPECT_FALSE(player->has_drawn_surfaces());
  ASSERT_TRUE(player->set_surface_depths(
      std::make_shared<SurfaceDepths>(SurfaceDepths{120, 90, std::vector<float>(120 * 90, 2.5F)})));
  const Image front = drawn(*player);
  Scene with_plate = scene;
  with_plate.surfaces = {{.file = "plate", .color = {0, 0, 1}}};
  EXPECT_THAT(player->set_scene(with_plate).error().message, HasSubstr("give one of them"));
  ASSERT_TRUE(player->set_surface_depths(nullptr));

  // Opaque: the front, over the plate.
  const Image opaque = drawn(*player, with_plate);
  EXPECT_TRUE(player->has_drawn_surfaces());
  EXPECT_FALSE(player->set_surface_depths(std::make_shared<SurfaceDepths>(SurfaceDepths{120, 90, {}})));
  for (const auto& [x, y] : {std::pair{60, 45}, std::pair{10, 80}}) {
    const double tangent_x = (x + 0.5 - 60) / player->view().focal, tangent_y = (44.5 - y) / player->view().focal;
    const double blue = 0.3 + 0.7 / std::sqrt(1 + tangent_x * tangent_x + tangent_y * tangent_y);
    const vec4 expected = front.at(x, y);
    EXPECT_NEAR(opaque.at(x, y).r, expected.r, 1e-4);
    EXPECT_NEAR(opaque.at(x, y).b, expected.b + (1 - expected.a) * blue, 1e-4);
    EXPECT_EQ(opaque.at(x, y).a, 1);
  }

  // Hardly there: the picture of the volume, drawn in two parts.
  with_plate.surfaces[0].opacity = 1e-6;
  EXPECT_LT(compare_images(drawn(*player, with_plate), whole)->rmse, 1e-3);

  // Off: the same bits as without. Each file was read once.
  with_plate.surfaces[0].shown = false;
  EXPECT_EQ(compare_images(drawn(*player, with_plate), whole)->max, 0);
  EXPECT_FALSE(player->has_drawn_surfaces());
  EXPECT_EQ(read, 1);

  Scene wrong = scene;
  wrong.surfaces = {{.file = "none"}};
  EXPECT_EQ(player->set_scene(wrong).error().message, "none: gone");
  EXPECT_EQ(player->scene().surfaces, with_plate.surfaces) << "what is refused changes nothing";
}

// Builds a lattice of 24^3 cells, moved along x, with its boundary.
void build_with_boundary(const std::string& path, double moved) {
  BuildOptions options;
  options.boundary_triangles = 1000;
  const test::Mesh mesh = test::lattice(24, [&](dvec3 p) { return p + dvec3(moved, 0, 0); });
  test::build_mesh(
      mesh, [](dvec3 p) { return p.y; }, path, options);
}

TEST_F(PlayerOfALattice, TheBoundaryOfTheFileIsRead) {
  build_with_boundary(path("boundary.svol"), 0);
  const auto player = open(on_processor(), path("boundary.svol"));
  Scene scene = player->scene();
  scene.camera.position = {0.5, 0.5, 4};
  scene.camera.focal_point = dvec3(0.5);
  scene.camera.up = {0, 1, 0};
  scene.camera.vertical_fov_degrees = 30;
  (void)drawn(*player, scene);
  const std::uint64_t read = player->streamer().volume().bytes_read();
  scene.surfaces = {{.color = {0, 0, 1}, .boundary = "out*"}};
  ASSERT_TRUE(player->set_scene(scene));
  EXPECT_GT(player->streamer().volume().bytes_read(), read) << "only now";
  const Image image = drawn(*player);
  EXPECT_EQ(image.at(60, 45).a, 1);
  EXPECT_NEAR(image.at(60, 45).b, 1, 0.01) << "the front is opaque, and nothing lies before it";
  EXPECT_EQ(image.at(2, 2).a, 0);

  scene.surfaces[0].boundary = "inlet";
  EXPECT_THAT(player->set_scene(scene).error().message,
              HasSubstr("no patch \"inlet\" in its boundary; there are: side x-, side x+"));
  scene.surfaces[0].boundary = "outer";
  const auto other = open();
  EXPECT_THAT(other->set_scene(scene).error().message, HasSubstr("svbuild --boundary"));
}

// Each file of a series has a boundary of its own.
TEST_F(PlayerOfALattice, TheBoundaryIsThatOfTheStep) {
  build_with_boundary(path("s-0.svol"), 0);
  build_with_boundary(path("s-1.svol"), 0.5);
  folder->write("s.svols", R"({"steps": [{"time": 0, "file": "s-0.svol"}, {"time": 1, "file": "s-1.svol"}],
    "attributes": [{"name": "value", "unit": "", "min": 0, "max": 1}]})");
  Scene scene = open()->scene();
  scene.attribute = "value";
  scene.camera.position = {0.75, 0.5, 6};
  scene.camera.focal_point = {0.75, 0.5, 0.5};
  scene.camera.up = {0, 1, 0};
  scene.surfaces = {{.boundary = "outer"}};
  const auto player = Player::open(path("s.svols"), scene, on_processor()).value();
  const auto leftmost = [&] {
    const Image image = drawn(*player);
    for (int x = 0; x < image.width; ++x)
      if (image.at(x, image.height / 2).a == 1) return x;
    return -1;
  };
  const int last = leftmost();
  EXPECT_GT(last, 0);
  ASSERT_TRUE(player->show_step(0));
  const int first = leftmost();
  EXPECT_GT(first, 0);
  EXPECT_LT(first, last - 3);
  ASSERT_TRUE(player->show_step(1));
  EXPECT_EQ(leftmost(), last);
}

TEST_F(PlayerOfALattice, WithoutAReaderSurfacesAreRefused) {
  const auto player = open();
  Scene scene = player->scene();
  scene.surfaces = {{.file = "a.stl"}};
  EXPECT_THAT(player->set_scene(scene).error().message, HasSubstr("a.stl"));
  scene.surfaces[0].shown = false;
  EXPECT_TRUE(player->set_scene(scene));
}

TEST_F(PlayerOfALattice, ReachesAnErrorByComparingPictures) {
  const auto player = open();
  const Image finest = drawn(*player);
  constexpr double wanted = 0.02;
  const auto picture = player->draw_picture({.max_error = wanted});
  ASSERT_TRUE(picture) << picture.error().message;
  const auto& search = picture->search;
  ASSERT_TRUE(search);
  EXPECT_TRUE(search->estimate.reached);
  EXPECT_GT(search->pictures, 1);
  EXPECT_LT(player->frame()->splats, player->info().point_count());
  EXPECT_LT(compare_images(player->image().value(), finest)->rmse, 1.5 * wanted);
  const auto document = statistics_of(*search);
  EXPECT_EQ(document["pictures_for_error"], search->pictures);
}

TEST_F(PlayerOfALattice, DrawsWhatThereIsTimeFor) {
  const auto player = open();
  for (const double no_time : {0.0, -1.0, std::numeric_limits<double>::infinity(), std::nan("")})
    EXPECT_FALSE(player->draw_picture({.milliseconds = no_time})) << no_time;
  for (int i = 0; i < 30; ++i) ASSERT_TRUE(player->draw_picture({.milliseconds = 1e-3}));
  const std::uint64_t few = player->frame()->splats;
  EXPECT_LT(few, player->info().point_count() / 10);
  for (int i = 0; i < 30; ++i) ASSERT_TRUE(player->draw_picture({.milliseconds = 1e6}));
  EXPECT_TRUE(player->frame()->progress.complete);
  EXPECT_TRUE(player->frame()->finest) << "all the time in the world";
  EXPECT_GT(player->frame()->splats, few);
}

TEST_F(PlayerOfALattice, AFrameAgainIsTheSamePicture) {
  const auto player = open();
  const Image before = drawn(*player);
  ASSERT_TRUE(player->draw_again());
  EXPECT_LT(compare_images(player->image().value(), before)->rmse, 1e-5);
  EXPECT_GT(player->times().frame, 0);
}

TEST_F(PlayerOfALattice, TellsWhenDataHaveCome) {
  std::atomic<int> told = 0;
  PlayerOptions options = on_processor();
  options.on_data = [&] { ++told; };
  const auto player = open(options);
  static_cast<void>(drawn(*player, 0));
  while (told == 0) std::this_thread::yield();  // ends by the test's time limit if nothing comes
  while (!player->frame()->progress.settled) static_cast<void>(drawn(*player, 0));
  EXPECT_TRUE(player->frame()->progress.complete);
}

TEST_F(PlayerOfALattice, ACallThatWaitsForAServerCanBeCancelled) {
  std::atomic<bool> stalls = false;
  std::atomic<int> waiting = 0;
  const auto open_stalled = [&](const std::string& file) { return test::open_stalled(file, stalls, waiting); };
  auto steps = format::Steps::open(path(), open_stalled);
  ASSERT_TRUE(steps);
  const auto player = Player::open(std::move(*steps), 0, open()->scene(), on_processor()).value();
  for (const std::optional<double> wait_seconds : {std::optional<double>(), std::optional<double>(1e6)}) {
    stalls = true;
    auto frame = std::async(std::launch::async, [&] { return player->draw(all(), wait_seconds); });
    while (waiting == 0) std::this_thread::yield();
    player->cancel();
    const auto cancelled = frame.get();
    ASSERT_FALSE(cancelled);
    EXPECT_EQ(cancelled.error().code, ErrorCode::cancelled) << cancelled.error().message;
    EXPECT_EQ(player->frame(), nullptr);
    stalls = false;
  }
  EXPECT_EQ(drawn(*player).pixels.size(), 120U * 90U) << "later calls are not cancelled";
}

// Builds a file with waves, and the height.
std::string build_two_attributes(const std::string& path, double (*waves)(dvec3)) {
  const test::Mesh mesh = test::lattice(24);
  Piece piece = test::mesh_piece(mesh, waves);
  piece.values.push_back(test::mesh_piece(mesh, [](dvec3 p) { return p.z; }).values[0]);
  class TwoAttributes : public test::PieceSource {
   public:
    using PieceSource::PieceSource;
    const std::vector<std::string>& attributes() const override { return names_; }

   private:
    std::vector<std::string> names_ = {"waves", "height"};
  };
  TwoAttributes source({std::move(piece)});
  test::require(build_volume(source, path, {}, [](const char*, double) {}));
  return path;
}

// Another attribute needs its values only: the shapes of the same splats stay.
TEST_F(PlayerOfALattice, AnotherAttributeKeepsTheShapes) {
  const std::string two = build_two_attributes(path("two.svol"), waves);
  const auto bytes_of = [](const Player& player) { return player.streamer().statistics().bytes_read; };
  const auto fresh = open(on_processor(), two, "height");
  const Image expected = drawn(*fresh);

  const std::string first = fresh->info().attributes.front().name;
  const auto player = open(on_processor(), two, first);
  static_cast<void>(drawn(*player));
  const std::uint64_t before = bytes_of(*player);
  ASSERT_TRUE(player->set_scene(fresh->scene()));
  EXPECT_EQ(compare_images(drawn(*player), expected)->max, 0);
  EXPECT_LT(bytes_of(*player) - before, before / 2) << "values, and pages of the index";
}

// An opacity that hides the lower half is a clip plane, but for the cells at it. Slices show all values.
TEST_F(PlayerOfALattice, AnotherAttributeGivesTheOpacity) {
  const auto player = open(on_processor(), build_two_attributes(path("two.svol"), waves), "waves");
  Scene scene = player->scene();
  scene.transfer_function.densities = {{0, 5}};
  const Image whole = drawn(*player, scene);
  const std::uint64_t before = player->streamer().statistics().bytes_read;

  Scene faded = scene;
  faded.opacity = SceneOpacity{"height", {.colors = {{0, dvec3(1)}}, .densities = {{0.5, 0}, {0.5, 1}}}};
  const Image image = drawn(*player, faded);
  EXPECT_LT(player->streamer().statistics().bytes_read - before, before / 2) << "the shapes are there";
  Scene clipped = scene;
  clipped.clip_planes = {{.point = dvec3(0.5), .normal = {0, 0, 1}}};
  EXPECT_LT(compare_images(image, drawn(*player, clipped))->rmse, 0.02);
  EXPECT_GT(compare_images(image, whole)->rmse, 0.1);

  // Changes of the factors read nothing.
  static_cast<void>(drawn(*player, faded));
  const std::uint64_t read = player->streamer().statistics().bytes_read;
  faded.opacity->function.densities = {{0.6, 0}, {0.6, 1}};
  EXPECT_GT(compare_images(image, drawn(*player, faded))->rmse, 0.01);
  EXPECT_EQ(player->streamer().statistics().bytes_read, read);

  // Without it, all is as before.
  EXPECT_EQ(compare_images(drawn(*player, scene), whole)->max, 0);

  faded.opacity->attribute = "pressure";
  const Status refused = player->set_scene(faded);
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("pressure"));
  EXPECT_EQ(compare_images(drawn(*player), whole)->max, 0);
}

TEST_F(PlayerOfALattice, AnOpacityFitsTheData) {
  const auto player = open(on_processor(), build_two_attributes(path("two.svol"), waves), "waves");
  Scene scene = player->scene();
  const FittingOpacity fitting = fitting_opacity(player->streamer().volume(), "height").value();
  EXPECT_EQ(fitting.opacity.attribute, "height");
  const auto factors = fitting.opacity.function.densities;
  EXPECT_EQ(std::ranges::max_element(factors, {}, &TransferFunction::Density::extinction)->extinction, 1);
  show_opacity(scene, fitting);
  ASSERT_TRUE(parse_scene(scene_to_json(scene)));
  const Image image = drawn(*player, scene);
  EXPECT_GT(std::ranges::max_element(image.pixels, {}, &vec4::a)->a, 0.3F);
  EXPECT_FALSE(fitting_opacity(player->streamer().volume(), "pressure"));
}

TEST_F(PlayerOfALattice, StatisticsNameTheFrame) {
  const auto player = open();
  static_cast<void>(drawn(*player));
  const auto document = statistics_of(*player);
  EXPECT_EQ(document["file"], path());
  EXPECT_EQ(document["splats"], player->info().point_count());
  EXPECT_EQ(document["kernel"], "moments");
  EXPECT_EQ(document["complete"], true);
}

TEST_F(PlayerOfALattice, TheDomainIsTheLatticesBox) {
  const auto player = open();
  const auto domain = player->find_domain();
  ASSERT_TRUE(domain);
  EXPECT_LT(glm::length(domain->low - dvec3(0)), 0.1);
  EXPECT_LT(glm::length(domain->high - dvec3(1)), 0.1);
}

}  // namespace
}  // namespace splatvol
