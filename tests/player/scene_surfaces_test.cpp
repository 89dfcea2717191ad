// Patches of the boundary are drawn as far as memory has room for them.
#include "player/scene_surfaces.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "base/file.h"
#include "format/boundary.h"
#include "tests/builder/support/built_mesh.h"
#include "tests/support/memory_source.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"
#include "tests/support/test_volume.h"

namespace splatvol {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

// Triangles apart from each other: drawn, each takes 3 points of 56 bytes and 12 bytes.
constexpr std::uint64_t triangle_bytes = 3 * 56 + 12;

TriangleMesh triangles(std::uint32_t count) {
  TriangleMesh mesh;
  for (std::uint32_t i = 0; i < count; ++i) {
    for (int k = 0; k < 3; ++k) mesh.points.emplace_back(i, k == 1, k == 2);
    mesh.triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
  }
  return mesh;
}

class SceneSurfaces : public testing::Test {
 protected:
  SceneSurfaces() {
    test::TestVolume volume = test::make_test_volume(test::random_points(50, 3u), {std::vector<double>(50, 1.0)});
    const std::vector<Patch> patches = {{"inlet", triangles(30)}, {"wall", triangles(100)}, {"outlet", triangles(20)}};
    auto packed = format::pack_boundary(patches, 0);
    volume.info.boundary = packed->info;
    volume.boundary = packed->section;
    bytes_ = test_volume_bytes(volume);
    volume_ = format::Volume::open(memory_source(bytes_, "a.svol")).value();
  }

  // `room`: of the triangles.
  [[nodiscard]] std::vector<Surface> read(const std::vector<SceneSurface>& styles, std::uint64_t room,
                                          std::span<const Surface> before = {}) const {
    auto surfaces = read_scene_surfaces(styles, *volume_, {}, room * triangle_bytes, before);
    EXPECT_TRUE(surfaces) << surfaces.error().message;
    return surfaces.value();
  }

  format::Bytes bytes_;
  std::shared_ptr<const format::Volume> volume_;
};

TEST_F(SceneSurfaces, TheLargestPatchesAreLeftOut) {
  const std::vector<SceneSurface> all{{.boundary = "*"}};
  const auto shown = [&](std::uint64_t room) { return read(all, room)[0].mesh->triangles.size(); };
  EXPECT_EQ(shown(150), 150U);
  EXPECT_EQ(shown(149), 50U);
  EXPECT_EQ(shown(50), 50U);
  EXPECT_EQ(shown(49), 20U);
  EXPECT_EQ(shown(19), 0U);
  EXPECT_THAT(read(all, 150)[0].left_out, IsEmpty());
  EXPECT_THAT(read(all, 30)[0].left_out, ElementsAre("inlet", "wall"));
  EXPECT_FALSE(left_out_error(read(all, 150), "a.svol"));
  const auto error = left_out_error(read(all, 30), "a.svol");
  ASSERT_TRUE(error);
  EXPECT_EQ(error->code, ErrorCode::out_of_budget);
  EXPECT_THAT(error->message, HasSubstr("a.svol: the boundary is drawn without 2 of its patches, wall, inlet"));
}

TEST_F(SceneSurfaces, HaveTheValuesOfTheCells) {
  const test::TempFolder folder;
  const auto field = [](dvec3 p) { return 3 + p.x - 2 * p.y + 0.5 * p.z; };
  test::build_mesh(test::lattice(6), field, folder.path("m.svol"),
                   {.exact = {.positions = true, .values = true}, .keep_cells = true});
  test::build_mesh(test::lattice(6), field, folder.path("plain.svol"), {.keep_cells = false});
  const auto open = [&](const char* name) {
    return test::value_of(format::Volume::open(test::value_of(open_file(folder.path(name)))));
  };
  auto mesh = std::make_shared<TriangleMesh>();
  mesh->points = {{0, 0, 0}, {1, 0.3, 0.7}, {0.25, 1, 1}, {7, 7, 7}};
  mesh->triangles = {{0, 1, 2}, {1, 2, 3}};
  std::vector<Surface> surfaces = {{{.boundary = "wall", .color_by = SceneColoring{"value", {}}}, mesh},
                                   {{.boundary = "wall"}, mesh},
                                   {{.shown = false, .color_by = SceneColoring{"value", {}}}, mesh}};
  const auto volume = open("m.svol");
  ASSERT_EQ(test::message_of(add_values(surfaces, *volume, {})), "");
  ASSERT_TRUE(surfaces[0].values);
  for (int i = 0; i < 3; ++i)
    EXPECT_NEAR(surfaces[0].values->values[static_cast<std::size_t>(i)],
                field(mesh->points[static_cast<std::size_t>(i)]), 1e-6);
  EXPECT_TRUE(std::isnan(surfaces[0].values->values[3])) << "no cell is there";
  EXPECT_FALSE(surfaces[1].values);
  EXPECT_FALSE(surfaces[2].values);
  const auto before = surfaces;
  ASSERT_EQ(test::message_of(add_values(surfaces, *volume, before)), "");
  EXPECT_EQ(surfaces[0].values, before[0].values) << "nothing is read twice";
  EXPECT_THAT(test::message_of(add_values(surfaces, *open("plain.svol"), {})),
              HasSubstr("plain.svol: it keeps no cells"));
  // Another file of a series has other values at the same triangles.
  test::build_mesh(test::lattice(6), [](dvec3) { return 7; }, folder.path("next.svol"), {.keep_cells = true});
  ASSERT_EQ(test::message_of(add_values(surfaces, *open("next.svol"), before)), "");
  EXPECT_NEAR(surfaces[0].values->values[0], 7, 1e-6);
  surfaces[0].style.color_by->attribute = "other";
  EXPECT_THAT(test::message_of(add_values(surfaces, *volume, {})), HasSubstr("no attribute \"other\""));
}

// Patches are rounded more than exact cells: some of their points are a little outside of all cells.
TEST_F(SceneSurfaces, HaveValuesAtAllPointsOfPatches) {
  const test::TempFolder folder;
  const auto field = [](dvec3 p) { return 3 + p.x - 2 * p.y + 0.5 * p.z; };
  test::build_mesh(test::lattice(6, [](dvec3 p) { return 1.7 * p + 0.3; }), field, folder.path("m.svol"),
                   {.exact = {.positions = true, .values = true}, .boundary_triangles = 1000, .keep_cells = true});
  const auto volume = test::value_of(format::Volume::open(test::value_of(open_file(folder.path("m.svol")))));
  const std::vector<SceneSurface> styles = {{.boundary = "*", .color_by = SceneColoring{"value", {}}}};
  const auto surfaces = test::value_of(read_scene_surfaces(styles, *volume, {}, 1'000'000, {}));
  const TriangleMesh& mesh = *surfaces[0].mesh;
  ASSERT_EQ(mesh.triangles.size(), 6U * 72);
  for (std::size_t i = 0; i < mesh.points.size(); ++i)
    EXPECT_NEAR(surfaces[0].values->values[i], field(mesh.points[i]), 1e-6);
}

TEST_F(SceneSurfaces, AllOfASceneShareTheRoom) {
  const std::vector<SceneSurface> styles{{.boundary = "wall"}, {.boundary = "*let"}, {.boundary = "in*"}};
  const auto size = [](const Surface& surface) { return surface.mesh->triangles.size(); };
  const std::vector<Surface> some = read(styles, 80);
  EXPECT_EQ(size(some[0]), 0U);
  EXPECT_EQ(size(some[1]), 50U);
  EXPECT_EQ(size(some[2]), 30U);
  EXPECT_EQ(volume_->read_boundary(std::vector<std::size_t>{0, 2})->points, some[1].mesh->points);
}

TEST_F(SceneSurfaces, TrianglesStayWhileTheyAreTheSame) {
  std::vector<SceneSurface> styles{{.boundary = "*let"}, {.shown = false, .boundary = "wall"}};
  const std::vector<Surface> first = read(styles, 120);
  const auto same = read(styles, 120, first);
  EXPECT_EQ(same[0].mesh, first[0].mesh);
  EXPECT_FALSE(same[1].mesh);

  styles[1].shown = true;
  const auto both = read(styles, 120, first);
  EXPECT_EQ(both[0].mesh, first[0].mesh);
  EXPECT_THAT(both[1].left_out, ElementsAre("wall"));
  EXPECT_NE(read(styles, 150, both)[1].mesh, both[1].mesh) << "now there is room";

  // What is hidden stays while it has room.
  std::vector<Surface> wall = read({{.boundary = "wall"}}, 120);
  const std::vector<SceneSurface> hidden{{.shown = false, .boundary = "wall"}, {.boundary = "outlet"}};
  EXPECT_EQ(read(hidden, 120, wall)[0].mesh, wall[0].mesh);
  EXPECT_FALSE(read(hidden, 110, wall)[0].mesh);
}

}  // namespace
}  // namespace splatvol
