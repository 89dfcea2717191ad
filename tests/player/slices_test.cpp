// Slices and clip planes in pictures of files, against closed forms and exact pictures.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "builder/series/series_build.h"
#include "player/player.h"
#include "player/progressive_refinement.h"
#include "renderer/reference/slice.h"
#include "renderer/slice_values.h"
#include "tests/builder/support/built_mesh.h"
#include "tests/support/temp_folder.h"

namespace splatvol {
namespace {

using ::testing::HasSubstr;
using Field = std::function<double(dvec3)>;

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

double linear(dvec3 p) { return 3 + p.x - 2 * p.y + 0.5 * p.z; }
double waves(dvec3 p) { return std::sin(9 * p.x) * std::cos(7 * p.y) + p.z; }

double margin_in_cube(const dvec3& p) { return std::min({p.x, p.y, p.z, 1 - p.x, 1 - p.y, 1 - p.z}); }

// A value on the plane, and where.
struct Place {
  dvec3 position;
  double value;
};

class Slices : public test::FolderTest {
 protected:
  // A lattice in the unit cube, moved.
  std::unique_ptr<Player> open(const Field& field, const dvec3& move = dvec3(0), std::uint32_t cells = 16,
                               KernelKind kernel = KernelKind::moments) {
    mesh_ = test::lattice(cells, [&](dvec3 p) { return p + move; });
    const Field moved = [&](dvec3 p) { return field(p - move); };
    values_ = test::sample(mesh_, moved);
    test::build_mesh(mesh_, moved, path("m.svol"));
    auto player =
        Player::open(path("m.svol"), std::nullopt, {.device = Device::cpu, .drawing = {.kernel = kernel}}).value();
    Scene scene = player->scene();
    scene.width = 120;
    scene.height = 90;
    scene.camera.position = move + dvec3(1.9, 2.3, 3.1);
    scene.camera.focal_point = move + dvec3(0.5);
    scene.camera.up = {0.1, 1, 0};
    scene.camera.vertical_fov_degrees = 35;
    scene.camera.parallel_height = 1.8;
    EXPECT_TRUE(player->set_scene(scene));
    return player;
  }

  static Image draw(Player& player, const Scene& scene, const Detail& detail = {.tolerance_percent = 0}) {
    const Status set = player.set_scene(scene);
    EXPECT_TRUE(set) << set.error().message;
    const auto drawn = player.draw({detail});
    EXPECT_TRUE(drawn) << drawn.error().message;
    return player.image().value();
  }

  // The player's scene with an oblique slice.
  static Scene with_slice(const Player& player) {
    Scene scene = player.scene();
    scene.slices = {{.point = dvec3(0.5), .normal = {0.3, -0.2, 0.7}}};
    return scene;
  }

  // The values on the first slice of the frame, with their places, and NaN in all other pixels that meet the plane.
  static std::vector<Place> places(const Player& player) {
    const View& view = player.view();
    const Plane& plane = view.slices.front().plane;
    const std::vector<double> depths = slice_depths(view, plane);
    const auto values = slice_values(player.frame()->sliced, player.streamer().units(), view, plane, depths);
    std::vector<Place> result;
    for (std::size_t i = 0; i < depths.size(); ++i) {
      if (!std::isfinite(depths[i])) {
        EXPECT_TRUE(std::isnan(values[i]));
        continue;
      }
      const std::size_t column = i % view.width, row = i / view.width;
      const double a = (static_cast<double>(column) + 0.5 - 0.5 * view.width) / view.focal;
      const double b = (0.5 * view.height - static_cast<double>(row) - 0.5) / view.focal;
      const double w = view.orthographic ? 1 : depths[i];
      result.push_back({view.eye + a * w * view.right + b * w * view.up + depths[i] * view.forward, values[i]});
    }
    return result;
  }

  // Expects the linear field, and `more`, wherever the slice is deeper in the unit cube than `margin`.
  static void expect_linear(const Player& player, double margin, double tolerance, double more = 0) {
    int inside = 0;
    for (const auto& [position, value] : places(player)) {
      if (margin_in_cube(position) <= margin) continue;
      ++inside;
      ASSERT_NEAR(value, linear(position) + more, tolerance);
    }
    EXPECT_GT(inside, 500);
  }

  [[nodiscard]] std::vector<double> exact(const View& view) const {
    const Plane& plane = view.slices.front().plane;
    return exact_slice({mesh_.points, values_, mesh_.tetrahedra}, view, plane, slice_depths(view, plane)).value();
  }

  // Root mean square of the error on the first slice, where both have a value.
  [[nodiscard]] double error_of(const Player& player) const {
    const View& view = player.view();
    const Plane& plane = view.slices.front().plane;
    const auto truth = exact(view);
    const auto values =
        slice_values(player.frame()->sliced, player.streamer().units(), view, plane, slice_depths(view, plane));
    double sum = 0, count = 0;
    for (std::size_t i = 0; i < values.size(); ++i)
      if (!std::isnan(truth[i]) && !std::isnan(values[i])) sum += std::pow(truth[i] - values[i], 2), ++count;
    EXPECT_GT(count, 500);
    return std::sqrt(sum / count);
  }

  test::Mesh mesh_;
  std::vector<double> values_;
};

// On planes through many points and through none, from outside and inside, and far from the origin. Material ends where
// the cube does, but for a part of a cell's edge.
TEST_F(Slices, ALinearFieldIsExactUpToTheCubesFaces) {
  for (const dvec3 move : {dvec3(0), dvec3(1e6, -2e6, 5e5)}) {
    const auto player = open(linear, move);
    for (const bool orthographic : {false, true})
      for (const dvec3 eye : {dvec3(1.9, 2.3, 3.1), dvec3(0.3, 0.8, 0.9)})
        for (const dvec3 normal : {dvec3(0, 0, 1), dvec3(1, 1, 1), dvec3(0.3, -0.2, 0.7), dvec3(1, -1, 0)}) {
          Scene scene = player->scene();
          using Projection = Camera::Projection;
          scene.camera.projection = orthographic ? Projection::orthographic : Projection::perspective;
          scene.camera.position = move + eye;
          scene.slices = {{.point = move + dvec3(0.5), .normal = normal}};
          draw(*player, scene);
          int inside = 0, wrong = 0;
          for (const Place& place : places(*player)) {
            const dvec3 at = place.position - move;
            const double margin = margin_in_cube(at);
            if (margin > 0.02) {
              ++inside;
              ASSERT_NEAR(place.value, linear(at), 4e-3) << at.x << " " << at.y << " " << at.z;
            } else if (margin < -0.02) {
              wrong += std::isnan(place.value) ? 0 : 1;
            }
          }
          EXPECT_GT(inside, 150);
          EXPECT_EQ(wrong, 0);
        }
  }
}

TEST_F(Slices, TheyFollowTheSplats) {
  const auto player = open(waves, dvec3(0), 24);
  Scene scene = with_slice(*player);
  std::vector<double> errors;
  for (const std::size_t resolution : {0, 1, 2, 9}) {
    draw(*player, scene, {.resolution = resolution});
    errors.push_back(error_of(*player));
  }
  EXPECT_TRUE(std::ranges::is_sorted(errors, std::greater<>())) << errors[0] << " " << errors[1] << " " << errors[2];
  EXPECT_LT(errors.back(), 0.004 * 4) << "of a range of 4";

  // A frame sharpens until it has the splats of all that is near.
  std::uint64_t before = 0;
  for (;;) {
    ASSERT_TRUE(player->draw({Detail{.tolerance_percent = 0}}, 0));
    EXPECT_GE(player->frame()->sliced.splats, before);
    before = player->frame()->sliced.splats;
    if (player->frame()->progress.settled) break;
  }
  EXPECT_EQ(error_of(*player), errors.back());
}

// The transfer function shows nothing: of the volume only what is near the plane is read.
TEST_F(Slices, ShowWhatTheTransferFunctionHides) {
  const auto player = open(waves, dvec3(0), 40);
  Scene scene = player->scene();
  scene.transfer_function.densities = {{0, 0}, {1, 0}};
  draw(*player, scene);
  EXPECT_EQ(player->frame()->splats, 0U);
  scene.slices = {{.point = {0.5, 0.5, 0.1}, .normal = {0.01, 0.02, 1}}};
  for (const Detail& detail : {Detail{.tolerance_percent = 0}, Detail{.goal = ErrorGoal{0.002, 1'000'000}}}) {
    const Image picture = draw(*player, scene, detail);
    EXPECT_LT(error_of(*player), 0.02);
    EXPECT_LT(player->frame()->splats, player->info().point_count() / 2);
    const auto truth = exact(player->view());
    for (std::size_t i = 0; i < truth.size(); i += 7) {
      if (std::isnan(truth[i]) || picture.pixels[i].a == 0) continue;
      EXPECT_EQ(picture.pixels[i].a, 1);
      EXPECT_LT(glm::length(dvec3(picture.pixels[i]) - scene.transfer_function.color(truth[i])), 0.25);
    }
  }
  scene.slices[0].shown = false;
  draw(*player, scene);
  EXPECT_EQ(player->frame()->splats, 0U);
}

TEST_F(Slices, GoalsSpendSplatsOnSlices) {
  const auto player = open(waves, dvec3(0), 40);
  Scene scene = with_slice(*player);
  scene.transfer_function.densities = {{0, 0}, {1, 0}};
  double last = 1e9;
  for (const std::uint64_t splats : {300, 6000, 30000}) {
    draw(*player, scene, {.goal = ErrorGoal{0, splats}});
    EXPECT_LT(error_of(*player), last) << splats << " splats: " << player->frame()->splats;
    last = error_of(*player);
  }
  const auto search = player->draw_picture({.max_error = 0.01});
  ASSERT_TRUE(search) << search.error().message;
  EXPECT_LT(error_of(*player), 0.05);
}

// The volume shows nothing: pictures of it alone would not differ.
TEST_F(Slices, SharpenUntilTheyAreExactEnough) {
  const auto player = open(waves, dvec3(0), 40);
  Scene scene = with_slice(*player);
  scene.transfer_function.densities = {{0, 0}, {1, 0}};
  ASSERT_TRUE(player->set_scene(scene));
  ProgressiveRefinement refinement({.splats = Quality{.max_error = 0.002}, .first_splats = 1024});
  std::vector<double> errors;
  while (!refinement.is_done()) {
    ASSERT_TRUE(player->draw_next(refinement));
    errors.push_back(error_of(*player));
    ASSERT_LT(errors.size(), 20U);
  }
  EXPECT_GE(errors.size(), 3U);
  EXPECT_LT(errors.back(), 0.3 * errors.front());
}

// Besides, a slice that is off or beside the data leaves the picture as it is, to the last bit.
TEST_F(Slices, AnOpaqueSliceHidesTheVolumeBehind) {
  const auto player = open(waves);
  Scene scene = player->scene();
  const Image volume = draw(*player, scene);
  EXPECT_FALSE(player->has_drawn_surfaces());
  for (const SceneSlice& none :
       {SceneSlice{.point = dvec3(0.5), .shown = false}, SceneSlice{.point = dvec3(0.5), .opacity = 0},
        SceneSlice{.point = {0, -5, 0}, .normal = {0, 1, 0}},
        SceneSlice{.point = scene.camera.position, .normal = {1, 2, 3}}}) {
    scene.slices = {none};
    EXPECT_EQ(compare_images(draw(*player, scene), volume)->max, 0);
    EXPECT_FALSE(player->has_drawn_surfaces());
  }
  scene.slices = {{.point = dvec3(0.5), .normal = {0, 0, 1}}};
  const Image cut = draw(*player, scene);
  EXPECT_TRUE(player->has_drawn_surfaces());
  EXPECT_EQ(cut.at(60, 45).a, 1);
  EXPECT_EQ(cut.at(0, 0), volume.at(0, 0));

  // Almost clear, alone and crossing another one: the volume, drawn in parts.
  scene.slices[0].opacity = 1e-6;
  scene.slices.push_back({.point = dvec3(0.5), .normal = {1, 0, 0}, .opacity = 1e-6});
  EXPECT_LT(compare_images(draw(*player, scene), volume)->rmse, 1e-3);

  // A host's surfaces and slices exclude each other.
  const auto depths = std::make_shared<SurfaceDepths>(SurfaceDepths{120, 90, std::vector<float>(120 * 90, 2.5F)});
  EXPECT_THAT(player->set_surface_depths(depths).error().message, HasSubstr("give one of them"));
  scene.slices.clear();
  draw(*player, scene);
  ASSERT_TRUE(player->set_surface_depths(depths));
  scene.slices = {{.point = dvec3(0.5)}};
  EXPECT_THAT(player->set_scene(scene).error().message, HasSubstr("give one of them"));
}

TEST_F(Slices, MissingValuesAreHoles) {
  const auto player = open([](dvec3 p) { return p.x < 0.45 ? nan : linear(p); }, dvec3(0), 24);
  Scene scene = player->scene();
  scene.slices = {{.point = dvec3(0.5), .normal = {0, 0, 1}}};
  draw(*player, scene);
  int holes = 0, whole = 0;
  for (const Place& place : places(*player)) {
    if (margin_in_cube(place.position) < 0.05) continue;
    if (place.position.x < 0.37) {
      EXPECT_TRUE(std::isnan(place.value));
      ++holes;
    } else if (place.position.x > 0.55) {
      EXPECT_NEAR(place.value, linear(place.position), 0.02);
      ++whole;
    }
  }
  EXPECT_GT(holes, 100);
  EXPECT_GT(whole, 100);
}

TEST_F(Slices, TheKernelOctantHasThemToo) {
  const auto player = open(linear, dvec3(0), 24, KernelKind::octant);
  Scene scene = with_slice(*player);
  draw(*player, scene);
  expect_linear(*player, 0.08, 0.1);
}

TEST_F(Slices, DoNotDependOnThreads) {
  const auto player = open(waves, dvec3(0), 24);
  Scene scene = with_slice(*player);
  scene.slices[0].opacity = 0.5;
  const Image picture = draw(*player, scene);
  const oneapi::tbb::global_control one(oneapi::tbb::global_control::max_allowed_parallelism, 1);
  EXPECT_EQ(compare_images(draw(*player, scene), picture)->max, 0);
}

TEST_F(Slices, FollowTheStep) {
  const auto step = [](int number) {
    return test::mesh_step(0.5 * number, test::lattice(12), [number](dvec3 p) { return linear(p) + number; });
  };
  const std::string path = this->path("series.svol");
  ASSERT_TRUE(build_series({step(0), step(1), step(2)}, path, {}, [](const char*, double) {}));
  const auto player = Player::open(path, std::nullopt, {.device = Device::cpu}).value();
  Scene scene = with_slice(*player);
  for (const std::size_t number : {2, 0, 1}) {
    ASSERT_TRUE(player->show_step(number));
    draw(*player, scene);
    expect_linear(*player, 0.03, 0.01, static_cast<double>(number));
  }
}

// A clip plane along an axis cuts as a clip box does. A slice in a clip plane shows its face, with the values of whole
// splats.
TEST_F(Slices, ClipPlanesCutTheVolumeAndLeaveTheFace) {
  const auto player = open(waves, dvec3(0), 24);
  Scene scene = player->scene();
  const Image whole = draw(*player, scene);
  scene.clip_box = Box{{-9, -9, -9}, {9, 9, 0.47}};
  const Image by_box = draw(*player, scene);
  EXPECT_GT(compare_images(by_box, whole)->rmse, 0.01);
  scene.clip_box.reset();
  scene.clip_planes = {{.point = {7, 7, 0.47}, .normal = {0, 0, -3}}};
  EXPECT_LT(compare_images(draw(*player, scene), by_box)->max, 1e-5);

  scene.slices = {{.point = {0, 0, 0.47}, .normal = {0, 0, 1}}};
  // In front of the face is next to nothing: clipped splats end there.
  const Image face = draw(*player, scene);
  EXPECT_LT(error_of(*player), 0.02);
  const auto truth = exact(player->view());
  for (std::size_t i = 0; i < truth.size(); ++i) {
    if (std::isnan(truth[i]) || face.pixels[i].a < 1) continue;
    EXPECT_LT(glm::length(dvec3(face.pixels[i]) - scene.transfer_function.color(truth[i])), 0.12) << i;
  }

  scene.slices.clear();
  scene.clip_planes = {{.point = {0, 0, 2}, .normal = {0, 0, 1}}};
  draw(*player, scene);
  EXPECT_EQ(player->frame()->splats, 0U);
  scene.clip_planes[0].active = false;
  EXPECT_EQ(compare_images(draw(*player, scene), whole)->max, 0);
}

}  // namespace
}  // namespace splatvol
