// Exact pictures of the cells of files.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <iomanip>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "pictures/image.h"
#include "player/player.h"
#include "renderer/reference/reference.h"
#include "renderer/reference/slice.h"
#include "renderer/surfaces/draw_surfaces.h"
#include "tests/builder/support/built_input.h"
#include "tests/builder/support/built_mesh.h"
#include "tests/player/waves.h"
#include "tests/renderer/surfaces/shapes.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol {
namespace {

using testing::HasSubstr;

class ExactPictures : public test::FolderTest {
 protected:
  static BuildOptions exact() {
    BuildOptions options{.keep_cells = true};
    options.exact = {.positions = true, .values = true};
    return options;
  }

  static Scene scene() { return test::scene_of_waves(80, 60); }

  [[nodiscard]] std::unique_ptr<Player> open(const std::string& name, PlayerOptions options = {}) const {
    options.device = Device::cpu;
    options.read_surface = [](const std::string&) -> Result<TriangleMesh> {
      return test::plate({-9, -9, 0.5}, {18, 0, 0}, {0, 18, 0});  // through the middle of the lattice
    };
    return test::value_of(Player::open(path(name), scene(), options));
  }

  static Image drawn(Player& player) {
    EXPECT_EQ(test::message_of(player.draw(Recipe::of_cells())), "");
    EXPECT_TRUE(player.exact());
    return test::value_of(player.image());
  }

  static Image truth(const test::Mesh& mesh, const Scene& scene, const SurfaceDepths* depths = nullptr) {
    const std::vector<double> values = test::sample(mesh, test::waves);
    const std::vector<std::array<std::uint32_t, 4>> tetrahedra(mesh.tetrahedra.begin(), mesh.tetrahedra.end());
    return test::value_of(render_reference({mesh.points, values, tetrahedra}, scene, {.surface_depths = depths})).image;
  }

  static double rmse(const Image& a, const Image& b) { return compare_images(a, b).value().rmse; }

  const test::Mesh mesh_ = test::jittered(12, 0.2);
};

TEST_F(ExactPictures, AreThoseOfTheReference) {
  test::build_mesh(mesh_, test::waves, path("m.svol"), exact());
  const auto player = open("m.svol");
  double last = 0;
  const auto progress = [&](double share) {
    EXPECT_GE(share, last);
    EXPECT_LE(share, 1);
    last = share;
  };
  ASSERT_EQ(test::message_of(player->draw(Recipe::of_cells(), {}, progress)), "");
  EXPECT_EQ(last, 1);
  EXPECT_LE(rmse(test::value_of(player->image()), truth(mesh_, scene())), 1e-5);
  EXPECT_GT(player->exact()->segments, 1000u);
  EXPECT_EQ(player->exact()->unknown_cells, 0u);

  // Again, with another function and from elsewhere: nothing else is read.
  const std::uint64_t bytes = player->streamer().volume().bytes_read();
  Scene other = scene();
  other.camera.position = {2.4, -0.7, 2};
  other.lighting = Lighting();
  other.transfer_function.densities = {{0, 1.0}, {1, 3.0}};
  ASSERT_EQ(test::message_of(player->set_scene(other)), "");
  EXPECT_LE(rmse(drawn(*player), truth(mesh_, other)), 1e-5);
  EXPECT_LE(player->streamer().volume().bytes_read(), 2 * bytes);

  // Splats, and back.
  const Image before = drawn(*player);
  ASSERT_EQ(test::message_of(player->draw({Detail{.tolerance_percent = 0}})), "");
  EXPECT_FALSE(player->exact());
  EXPECT_GT(rmse(test::value_of(player->image()), before), 1e-5);
  EXPECT_EQ(compare_images(drawn(*player), before)->max, 0);
}

TEST_F(ExactPictures, DoNotDependOnMemory) {
  test::build_mesh(mesh_, test::waves, path("m.svol"), exact());
  EXPECT_EQ(compare_images(drawn(*open("m.svol", {.memory = std::uint64_t{4} << 20})), drawn(*open("m.svol")))->max, 0);
}

TEST_F(ExactPictures, EndAtSurfaces) {
  test::build_mesh(mesh_, test::waves, path("m.svol"), exact());
  const auto player = open("m.svol");
  auto depths = std::make_shared<SurfaceDepths>(SurfaceDepths{80, 60, std::vector<float>(80 * 60, 2.5F)});
  ASSERT_EQ(test::message_of(player->set_surface_depths(depths)), "");
  EXPECT_LE(rmse(drawn(*player), truth(mesh_, scene(), depths.get())), 1e-5);
  ASSERT_EQ(test::message_of(player->set_surface_depths(nullptr)), "");
  EXPECT_LE(rmse(drawn(*player), truth(mesh_, scene())), 1e-5);

  // Of the scene: as those of a picture of splats. A slice has about the same values there.
  for (const double opacity : {1.0, 0.4}) {
    Scene with = scene();
    with.surfaces = {{.file = "plate", .color = dvec3(0, 1, 0), .opacity = opacity}};
    with.slices = {{.point = dvec3(0.5), .normal = {1, 0, 0.2}, .opacity = 0.5}};
    ASSERT_EQ(test::message_of(player->set_scene(with)), "");
    const Image picture = drawn(*player);
    EXPECT_TRUE(player->has_drawn_surfaces());
    ASSERT_EQ(test::message_of(player->draw({Detail{.tolerance_percent = 0}})), "");
    const Image splats = test::value_of(player->image());
    EXPECT_LE(rmse(picture, splats), 0.02) << opacity;
    EXPECT_GT(rmse(picture, truth(mesh_, scene())), 0.05) << opacity;
  }
}

TEST_F(ExactPictures, OfAStepHaveItsValues) {
  std::vector<SeriesStep> steps;
  for (const double step : {0.0, 1.0})
    steps.push_back(
        test::mesh_step(step, mesh_, [=](dvec3 p) { return step == 0 ? test::waves(p) : test::waves(dvec3(p.z)); }));
  ASSERT_EQ(test::message_of(build_series(steps, path("series.svol"), exact(), [](const char*, double) {})), "");
  const auto player = open("series.svol");
  const Image last = drawn(*player);
  ASSERT_EQ(test::message_of(player->show_step(0)), "");
  EXPECT_LE(rmse(drawn(*player), truth(mesh_, scene())), 1e-5);
  ASSERT_EQ(test::message_of(player->show_step(1)), "");
  EXPECT_EQ(compare_images(drawn(*player), last)->max, 0);
  EXPECT_GT(rmse(last, truth(mesh_, scene())), 0.01);
}

// The exact picture of what a source gives.
Image truth_of(Source& source, const Scene& scene) {
  Piece all;
  all.values.resize(1);
  while (const auto piece = test::value_of(source.next())) {
    const auto first = static_cast<std::uint32_t>(all.points.size());
    all.points.insert(all.points.end(), piece->points.begin(), piece->points.end());
    all.values[0].insert(all.values[0].end(), piece->values[0].begin(), piece->values[0].end());
    for (const auto& [a, b, c, d] : piece->tetrahedra)
      all.tetrahedra.push_back({first + a, first + b, first + c, first + d});
  }
  return test::value_of(render_reference({all.points, all.values[0], all.tetrahedra}, scene)).image;
}

TEST_F(ExactPictures, OfHexahedraHaveTheirDiagonals) {
  constexpr int n = 5;
  std::ofstream file(path("hexahedra.vtk"));
  file << "# vtk DataFile Version 3.0\nhexahedra\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS "
       << (n + 1) * (n + 1) * (n + 1) << " double\n";
  std::mt19937 random(4);
  std::uniform_real_distribution<double> move(-0.25 / n, 0.25 / n);
  std::vector<float> values;
  for (int i = 0; i < (n + 1) * (n + 1) * (n + 1); ++i) {
    const dvec3 p = dvec3(i % (n + 1), i / (n + 1) % (n + 1), i / (n + 1) / (n + 1)) / double{n} +
                    dvec3(move(random), move(random), move(random));
    file << p.x << ' ' << p.y << ' ' << p.z << '\n';
    values.push_back(static_cast<float>(test::waves(p) + 0.5 * p.z * p.y));
  }
  file << "CELLS " << n * n * n << ' ' << 9 * n * n * n << '\n';
  constexpr int turns[3][8] = {{0, 1, 2, 3, 4, 5, 6, 7}, {1, 2, 3, 0, 5, 6, 7, 4}, {4, 0, 3, 7, 5, 1, 2, 6}};
  for (int cell = 0; cell < n * n * n; ++cell) {
    const int first = cell % n + (n + 1) * (cell / n % n + (n + 1) * (cell / n / n));
    const int up = n + 1, on = (n + 1) * (n + 1);
    const int corners[8] = {first,      first + 1,      first + up + 1,      first + up,
                            first + on, first + on + 1, first + on + up + 1, first + on + up};
    file << 8;
    for (const int corner : turns[random() % 3]) file << ' ' << corners[corner];
    file << '\n';
  }
  file << "CELL_TYPES " << n * n * n << '\n';
  for (int cell = 0; cell < n * n * n; ++cell) file << "12\n";
  file << "POINT_DATA " << values.size() << "\nSCALARS value float\nLOOKUP_TABLE default\n" << std::setprecision(9);
  for (const float value : values) file << value << '\n';
  file.close();
  test::build_input(path("hexahedra.vtk"), path("h.svol"), exact());
  const auto source = test::value_of(open_source({path("hexahedra.vtk")}, {}));
  const auto player = open("h.svol");
  EXPECT_LE(rmse(drawn(*player), truth_of(*source, scene())), 1e-4);
}

TEST_F(ExactPictures, OfBlocksInASeriesKeepTheValuesOfEach) {
  const auto blocks = [&](double step) {
    Piece low = test::mesh_piece(test::jittered(5, 0), test::waves);
    Piece high = low;
    low.block = 1, high.block = 2;
    for (dvec3& point : high.points) point.x += 1;
    for (double& value : high.values[0]) value = static_cast<float>(1.1 - 0.2 * step + 0.1 * value);
    return test::PieceSource({low, high});
  };
  std::vector<SeriesStep> steps;
  for (const double step : {0.0, 1.0})
    steps.push_back({"a step", step, [=]() -> Result<std::unique_ptr<Source>> {
                       return std::make_unique<test::PieceSource>(blocks(step));
                     }});
  ASSERT_EQ(test::message_of(build_series(steps, path("blocks.svol"), exact(), [](const char*, double) {})), "");
  const auto player = open("blocks.svol");
  for (const std::size_t step : {std::size_t{0}, std::size_t{1}}) {
    ASSERT_EQ(test::message_of(player->show_step(step)), "");
    test::PieceSource source = blocks(static_cast<double>(step));
    EXPECT_LE(rmse(drawn(*player), truth_of(source, scene())), 1e-5);
  }
}

TEST_F(ExactPictures, AreCancelled) {
  test::build_mesh(mesh_, test::waves, path("m.svol"), exact());
  const auto player = open("m.svol");
  const auto cancelled = player->draw(Recipe::of_cells(), {}, [&](double) { player->cancel(); });
  ASSERT_FALSE(cancelled);
  EXPECT_EQ(cancelled.error().code, ErrorCode::cancelled);
  EXPECT_THAT(cancelled.error().message, HasSubstr("m.svol: cancelled"));
  EXPECT_FALSE(player->exact());
  EXPECT_LE(rmse(drawn(*player), truth(mesh_, scene())), 1e-5);
}

// A mesh whose second attribute is the depth.
Piece with_depth(const test::Mesh& mesh, const std::function<double(dvec3)>& field) {
  Piece piece = test::mesh_piece(mesh, field);
  piece.values.emplace_back();
  for (const dvec3& p : piece.points) piece.values[1].push_back(double{static_cast<float>(p.z)});
  return piece;
}

Scene with_contours(Scene scene) {
  SceneColoring coloring{"depth", {}};
  coloring.function.colors = {{0, {1, 0, 0}}, {0.5, {0, 1, 0}}, {1, {0.2, 0.3, 1}}};
  coloring.function.densities = {{0, 1}};
  scene.contours = {{.values = {0.3, 0.5}, .color_by = coloring, .opacity = 0.6},
                    {.values = {0.8, 1.0}, .color = dvec3(1, 1, 0.5)}};
  return scene;
}

TEST_F(ExactPictures, HaveContours) {
  const Piece piece = with_depth(mesh_, test::waves);
  test::PieceSource source({piece}, {.attributes = {"value", "depth"}});
  test::require(build_volume(source, path("two.svol"), exact(), [](const char*, double) {}));
  const auto player = open("two.svol");
  const TetMesh mesh{piece.points, piece.values[0], piece.tetrahedra, false, {}, piece.values[1]};
  const auto expect_exact = [&](const Scene& scene) {
    ASSERT_EQ(test::message_of(player->set_scene(scene)), "");
    EXPECT_LE(rmse(drawn(*player), test::value_of(render_reference(mesh, scene)).image), 1e-5);
  };
  expect_exact(scene());
  expect_exact(with_contours(scene()));  // needs another attribute than before
  Scene other = with_contours(scene());
  other.transfer_function.densities = {{0, 0}, {1, 0}};
  expect_exact(other);  // chunks without visible values
  other.contours[0].shown = false;
  expect_exact(other);
  EXPECT_TRUE(player->shows_contours());
  other.contours[1].opacity = 0;
  ASSERT_EQ(test::message_of(player->set_scene(other)), "");
  EXPECT_FALSE(player->shows_contours());

  other = with_contours(scene());
  other.contours[0].color_by->attribute = "depht";
  ASSERT_EQ(test::message_of(player->set_scene(other)), "");
  EXPECT_THAT(test::message_of(player->draw(Recipe::of_cells())), HasSubstr("two.svol: no attribute \"depht\""));
  other.contours[0].values.push_back(1.0);
  EXPECT_THAT(test::message_of(player->set_scene(other)), HasSubstr("the value 1 is given twice"));
}

// Chunks without a contour are not read, nor those that no slice cuts.
TEST_F(ExactPictures, ReadWhatContoursAndSlicesNeed) {
  const test::Mesh mesh = test::jittered(30, 0.2);
  test::build_mesh(mesh, test::waves, path("m.svol"), exact());
  Scene scene = this->scene();
  scene.transfer_function.densities = {{0, 0}, {1, 0}};
  const auto chunks = [&](const Scene& shown) {
    const auto player = open("m.svol");
    EXPECT_EQ(test::message_of(player->set_scene(shown)), "");
    EXPECT_EQ(test::message_of(player->draw(Recipe::of_cells())), "");
    return player->exact()->chunks;
  };
  EXPECT_EQ(chunks(scene), 0U);
  Scene all = scene;
  all.transfer_function.densities = {{0, 1}};
  const std::uint64_t whole = chunks(all);
  Scene with = scene;
  with.contours = {{.values = {0.0}}};
  const std::uint64_t of_contour = chunks(with);
  EXPECT_GT(of_contour, 0U);
  EXPECT_LT(of_contour, whole);
  with = scene;
  with.slices = {{.point = dvec3(0.1), .normal = {1, 0, 0}}};
  const std::uint64_t of_slice = chunks(with);
  EXPECT_GT(of_slice, 0U);
  EXPECT_LT(of_slice, whole);
}

// Cells are the end of the ladder, held or not, if nobody asks for splats of a kind.
TEST_F(ExactPictures, AreDrawnWhereThereIsMuchTime) {
  test::build_mesh(mesh_, test::waves, path("m.svol"), exact());
  const auto is_exact = [&](bool holds, const Drawing& drawing) {
    const auto player = open("m.svol", {.drawing = drawing});
    if (holds) {
      EXPECT_EQ(test::message_of(player->hold_cells()), "");
    }
    for (int i = 0; i < 5; ++i) EXPECT_TRUE(player->draw_picture({.milliseconds = 1e6}));
    if (player->exact()) {
      EXPECT_EQ(player->sample_spacing(), drawing.sample_spacing.value_or(1));
      EXPECT_EQ(test::value_of(player->image()).pixels, drawn(*player).pixels);
    } else {
      EXPECT_TRUE(player->frame()->finest);
    }
    return player->exact().has_value();
  };
  EXPECT_TRUE(is_exact(true, {}));
  EXPECT_TRUE(is_exact(true, {.sample_spacing = 3}));
  EXPECT_TRUE(is_exact(false, {}));
  EXPECT_FALSE(is_exact(true, {.kernel = KernelKind::moments}));
  EXPECT_FALSE(is_exact(true, {.sort = SortMode::axis}));
}

// Reading is work.
TEST_F(ExactPictures, CountWhatIsNotRead) {
  test::build_mesh(mesh_, test::waves, path("m.svol"), exact());
  const auto player = open("m.svol");
  const auto unread = [&] { return test::value_of(player->choices({.cells = Chooser::Cells::near})).cells->unread; };
  const double before = unread();
  EXPECT_EQ(before, static_cast<double>(test::value_of(player->estimate_exact()).tetrahedra));
  EXPECT_EQ(test::message_of(player->hold_cells()), "");
  EXPECT_EQ(unread(), 0);
}

// A segment with many pieces is more work, so that less of it is drawn where nobody asks.
TEST_F(ExactPictures, CountThePiecesOfTheFunction) {
  test::build_mesh(mesh_, test::waves, path("m.svol"), exact());
  const auto player = open("m.svol");
  Scene many = scene();
  const ExactPicture few = test::value_of(player->estimate_exact());
  EXPECT_EQ(few.counted_segments(), static_cast<double>(few.segments));
  many.transfer_function.densities.clear();
  for (int i = 0; i <= 2000; ++i) many.transfer_function.densities.push_back({i / 2000.0, 1.0 + i % 2});
  ASSERT_EQ(test::message_of(player->set_scene(many)), "");
  const ExactPicture estimate = test::value_of(player->estimate_exact());
  EXPECT_EQ(estimate.segments, few.segments);
  EXPECT_GT(estimate.counted_segments(), 4 * static_cast<double>(few.segments));
  const CellCounts counts = estimate.counts();
  EXPECT_GT(work_of_cells(counts, 1e5, 1), work_of_cells({counts.tetrahedra, counts.segments}, 1e5, 1));
}

TEST_F(ExactPictures, HaveTheSlicesOfTheMesh) {
  test::build_mesh(mesh_, test::waves, path("m.svol"), exact());
  const auto player = open("m.svol");
  Scene with = scene();
  with.slices = {{.point = dvec3(0.5), .normal = {1, 0.2, 0.4}}};
  ASSERT_EQ(test::message_of(player->set_scene(with)), "");
  const Image picture = drawn(*player);
  const View& view = player->view();
  const std::vector<double> depths = slice_depths(view, view.slices[0].plane);
  const std::vector<double> mesh_values = test::sample(mesh_, test::waves);
  const std::vector<std::array<std::uint32_t, 4>> tetrahedra(mesh_.tetrahedra.begin(), mesh_.tetrahedra.end());
  const TetMesh mesh{mesh_.points, mesh_values, tetrahedra};
  const auto values = test::value_of(exact_slice(mesh, view, view.slices[0].plane, depths));
  SurfaceComposite composite;
  const std::vector<SlicePicture> slices = {color_slice(view, view.slices[0], depths, values, with.transfer_function)};
  for (const SurfaceLayer& layer : draw_surfaces({}, slices, view).layers)
    composite.add(truth(mesh_, with, &layer.depths), layer);
  EXPECT_LE(rmse(picture, composite.finish()), 1e-5);
}

// Shells of the volume stand for contours where there are no cells, or splats are asked for.
TEST_F(ExactPictures, AloneHaveContours) {
  test::build_mesh(mesh_, test::waves, path("plain.svol"), {.keep_cells = false});
  test::build_mesh(mesh_, test::waves, path("m.svol"), exact());
  Scene with = scene();
  with.transfer_function.densities = {{0, 0}, {1, 0}};
  const auto coverage = [&](const std::string& file, const Quality& quality) {
    const auto player = open(file);
    EXPECT_EQ(test::message_of(player->set_scene(with)), "");
    EXPECT_EQ(test::message_of(player->draw_picture(quality)), "");
    EXPECT_EQ(player->shows_shells(), !with.contours.empty() && !player->exact());
    const Image image = test::value_of(player->image());
    return static_cast<double>(std::ranges::count_if(image.pixels, [](const vec4& pixel) { return pixel.a > 0.5F; })) /
           static_cast<double>(image.pixels.size());
  };
  EXPECT_EQ(coverage("plain.svol", {}), 0);
  with.contours = {{.values = {0.5}}};
  const double exact_share = coverage("m.svol", {});
  EXPECT_GT(exact_share, 0.01);
  for (const Quality& quality : {Quality(), Quality{.tolerance_percent = 0}, Quality{.milliseconds = 1e6}}) {
    EXPECT_LT(std::abs(std::log(coverage("plain.svol", quality) / exact_share)), std::log(2.0));
  }
  EXPECT_EQ(coverage("m.svol", {.tolerance_percent = 0}), coverage("plain.svol", {.tolerance_percent = 0}));
}

// Whatever the time: then samples are apart.
TEST_F(ExactPictures, OfContoursInATime) {
  test::build_mesh(mesh_, test::waves, path("m.svol"), exact());
  Scene with = scene();
  with.contours = {{.values = {0.5}, .color = dvec3(1, 0, 0)}};
  with.transfer_function.densities = {{0, 0}};
  const auto of_file = [&](const std::string& file, const PlayerOptions& options = {}) {
    auto player = open(file, options);
    EXPECT_EQ(test::message_of(player->set_scene(with)), "");
    return player;
  };
  const auto whole = of_file("m.svol");
  const Image exact_picture = drawn(*whole);
  for (const Quality& quality : {Quality{.milliseconds = 1e-6}, Quality{.max_error = 1e-9, .milliseconds = 1e-6}})
    for (const std::uint64_t memory : {std::uint64_t{64} << 20, std::uint64_t{4} << 20}) {
      const auto player = of_file("m.svol", {.memory = memory});
      for (int i = 0; i < 3; ++i) ASSERT_EQ(test::message_of(player->draw_picture(quality)), "");
      ASSERT_TRUE(player->exact());
      EXPECT_GT(player->sample_spacing(), 1);
      EXPECT_LT(rmse(test::value_of(player->image()), exact_picture), 0.1);
      if (quality.max_error) continue;
      for (int i = 0; i < 3; ++i) ASSERT_EQ(test::message_of(player->draw_picture({.milliseconds = 1e7})), "");
      EXPECT_EQ(test::value_of(player->image()).pixels, exact_picture.pixels);
    }
  const auto player = of_file("m.svol");
  PaceSearch in_no_time(1e-9), in_any_time(1e3);
  ASSERT_EQ(test::message_of(player->draw_all(in_no_time)), "");
  EXPECT_TRUE(in_no_time.drawn().back().is_exact());
  ASSERT_EQ(test::message_of(player->draw_all(in_any_time)), "");
  EXPECT_EQ(in_any_time.drawn().back(), Recipe::of_cells(1));
  EXPECT_EQ(test::value_of(player->image()).pixels, exact_picture.pixels);
}

// Rays end at surfaces, and cross slices.
TEST_F(ExactPictures, MeasureErrorsAmongSurfaces) {
  test::build_mesh(mesh_, test::waves, path("m.svol"), exact());
  const auto player = open("m.svol");
  Scene with = scene();
  with.slices = {{.point = dvec3(0.5), .normal = {1, 0.2, 0.4}, .opacity = 0.5}};
  ASSERT_EQ(test::message_of(player->set_scene(with)), "");
  const Image exact_picture = drawn(*player);
  for (const double error : {0.05, 0.01}) {
    const auto picture = test::value_of(player->draw_picture({.max_error = error}));
    ASSERT_TRUE(picture.search);
    EXPECT_TRUE(picture.search->estimate.measured);
    EXPECT_TRUE(picture.search->estimate.reached);
    EXPECT_LE(rmse(test::value_of(player->image()), exact_picture), 1.15 * error);
  }
  with.slices.clear();
  ASSERT_EQ(test::message_of(player->set_scene(with)), "");
  const int width = with.width, height = with.height;
  const auto depths = std::make_shared<SurfaceDepths>(
      SurfaceDepths{width, height, std::vector<float>(static_cast<std::size_t>(width * height))});
  for (std::size_t i = 0; i < depths->depths.size(); ++i) depths->depths[i] = 2 + 0.01F * static_cast<float>(i % 50);
  ASSERT_EQ(test::message_of(player->set_surface_depths(depths)), "");
  const Image hidden = drawn(*player);
  const auto picture = test::value_of(player->draw_picture({.max_error = 0.01}));
  EXPECT_TRUE(picture.search->estimate.measured);
  EXPECT_LE(rmse(test::value_of(player->image()), hidden), 0.0115);
}

TEST_F(ExactPictures, AreDrawnWhereNothingIsAsked) {
  test::build_mesh(mesh_, test::waves, path("m.svol"), exact());
  const auto player = open("m.svol");
  const Image cells = drawn(*player);
  const auto picture = test::value_of(player->draw_picture({}));
  EXPECT_EQ(picture.chosen.quality, (Quality{.exact = true}));
  EXPECT_EQ(compare_images(test::value_of(player->image()), cells)->max, 0);

  // Who says how to draw splats wants splats: of a small file all points.
  for (const Drawing& drawing : {Drawing{.kernel = KernelKind::moments}, Drawing{.sort = SortMode::axis}}) {
    ASSERT_TRUE(player->set_drawing(drawing));
    EXPECT_EQ(test::value_of(player->draw_picture({})).chosen.quality, (Quality{.tolerance_percent = 0}));
    EXPECT_FALSE(player->exact());
    EXPECT_EQ(player->frame()->splats, player->info().point_count());
  }
  EXPECT_EQ(player->sort(), SortMode::axis);

  ASSERT_TRUE(player->set_drawing({.sample_spacing = 3}));
  ASSERT_TRUE(player->draw_picture({}));
  EXPECT_TRUE(player->exact());
  EXPECT_EQ(player->sample_spacing(), 3);
  EXPECT_FALSE(player->draw_picture({.max_splats = 5, .exact = true}));
}

TEST_F(ExactPictures, NeedCells) {
  test::build_mesh(mesh_, test::waves, path("plain.svol"));
  const auto player = open("plain.svol");
  EXPECT_THAT(test::message_of(player->draw(Recipe::of_cells())), HasSubstr("plain.svol: it keeps no cells"));
  EXPECT_FALSE(player->exact());
  EXPECT_EQ(test::message_of(player->draw({Detail()})), "");
}

}  // namespace
}  // namespace splatvol
