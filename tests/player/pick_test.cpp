// What a line of sight shows in a file that keeps cells: closed forms, and the exact picture.
#include "player/pick.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>

#include "base/file.h"
#include "player/cell_ray.h"
#include "renderer/reference/reference.h"
#include "sampler/cell_sampler.h"
#include "tests/builder/support/built_mesh.h"
#include "tests/player/waves.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using Kind = Pick::Kind;

constexpr double none = std::numeric_limits<double>::quiet_NaN();

double height(dvec3 p) { return p.z; }

// The extinction is `extinction` for all values.
Scene scene_of(double extinction) {
  Scene scene;
  scene.width = 40, scene.height = 30;
  scene.attribute = "value";
  scene.camera = {.position = {0.3, 0.4, 3}, .focal_point = {0.3, 0.4, 0}};
  scene.transfer_function = {.colors = {{0, dvec3(1, 0, 0)}}, .densities = {{0, extinction}}};
  return scene;
}

// It is `extinction` times the value, from 0 to 1.
Scene scene_of_slope(double extinction) {
  Scene scene = scene_of(0);
  scene.transfer_function.densities = {{0, 0}, {1, extinction}};
  return scene;
}

// Where half of the light is lost that a ray down from z = `top` loses, if the extinction is `extinction` times z.
double middle_of_slope(double extinction, double top = 1) {
  const double lost = -std::expm1(-0.5 * extinction * top * top);
  return std::sqrt(top * top + 2 / extinction * std::log1p(-0.5 * lost));
}

// A square across the z axis, which has the value of x if a scene colours it.
Surface square(double z, double opacity, bool is_colored = false) {
  auto mesh = std::make_shared<TriangleMesh>();
  auto values = std::make_shared<SurfaceValues>();
  values->attribute = "other";
  for (const dvec2 corner : {dvec2(-1, -1), dvec2(1, -1), dvec2(1, 1), dvec2(-1, 1)}) {
    mesh->points.emplace_back(corner, z);
    values->values.push_back(corner.x);
  }
  mesh->triangles = {{0, 1, 2}, {0, 2, 3}};
  Surface surface{{.opacity = opacity, .boundary = "wall"}, mesh};
  if (is_colored) surface.values = values;
  return surface;
}

struct PickInCells : FolderTest {
  void build(const Mesh& mesh, const std::function<double(dvec3)>& field = height) {
    build(PieceSource({mesh_piece(mesh, field)}));
  }
  void build(PieceSource source) {
    require(build_volume(source, path("m.svol"), {.exact = {.positions = true, .values = true}, .keep_cells = true},
                         [](const char*, double) {}));
    volume_ = value_of(format::Volume::open(*open_file(path("m.svol"))));
  }

  [[nodiscard]] std::optional<Pick> along(const Ray& ray, const Scene& scene,
                                          const std::vector<Surface>& surfaces = {}) const {
    const auto cells = value_of(KeptCells::open(*volume_, scene, own_room(std::uint64_t{16} << 20)));
    return value_of(pick_cells(*cells, scene, surfaces, ray));
  }
  // Along the camera's axis.
  [[nodiscard]] std::optional<Pick> ahead(const Scene& scene, const std::vector<Surface>& surfaces = {}) const {
    const Camera& camera = scene.camera;
    return along({camera.position, glm::normalize(camera.focal_point - camera.position)}, scene, surfaces);
  }
  [[nodiscard]] Pick found(const Scene& scene, const std::vector<Surface>& surfaces = {}) const {
    const auto pick = ahead(scene, surfaces);
    EXPECT_TRUE(pick);
    return pick.value_or(Pick{.values = {{"", none}}});
  }

  std::shared_ptr<const format::Volume> volume_;
};

TEST_F(PickInCells, FindsHalfOfTheLight) {
  build(lattice(8));
  for (const double extinction : {0.1, 3.0, 400.0}) {
    const Pick pick = found(scene_of_slope(extinction));
    EXPECT_EQ(pick.kind, Kind::volume);
    EXPECT_EQ(pick.name, "");
    EXPECT_NEAR(pick.opacity, -std::expm1(-0.5 * extinction), 1e-12);
    EXPECT_NEAR(pick.position.z, middle_of_slope(extinction), 1e-9);
    EXPECT_EQ(pick.values[0].attribute, "value");
    EXPECT_NEAR(pick.values[0].value, pick.position.z, 1e-12);
  }
  EXPECT_FALSE(ahead(scene_of(0)));
  Scene beside = scene_of(1);
  beside.camera.position.x = beside.camera.focal_point.x = 1.5;
  EXPECT_FALSE(ahead(beside));
}

// Rows follow each crossing: values are linear in between, and the opacity is exact at each of them.
TEST_F(PickInCells, TellsAllCrossings) {
  build(jittered(8, 0.2));
  const Scene scene = scene_of_slope(3);
  const View view = value_of(make_view(scene));
  const Ray ray = looking_through(view, 20.5, 14.5).ray;
  const auto pick = along(ray, scene);
  ASSERT_TRUE(pick);
  ASSERT_GT(pick->rows.size(), 8);
  const dvec3 in = ray.at(pick->rows.front().distance);
  for (const Pick::Row& row : pick->rows) {
    const dvec3 at = ray.at(row.distance);
    EXPECT_NEAR(row.value, at.z, 1e-6) << "a linear field, in single precision";
    const double depth = 1.5 * (in.z * in.z - at.z * at.z) / std::abs(ray.direction.z);
    EXPECT_NEAR(row.opacity, -std::expm1(-depth), 1e-6);
  }
}

TEST_F(PickInCells, OfOrthographicViewsAndInsideOfTheMesh) {
  build(lattice(8));
  for (const bool orthographic : {false, true}) {
    Scene scene = scene_of_slope(3);
    if (orthographic) scene.camera.projection = Camera::Projection::orthographic;
    const Looking middle = looking_through(value_of(make_view(scene)), 20, 15);
    EXPECT_LT(glm::length(middle.ray.at(2) - dvec3(0.3, 0.4, 1)), 1e-12);
    const auto pick = along(middle.ray, scene);
    ASSERT_TRUE(pick);
    EXPECT_NEAR(pick->position.z, middle_of_slope(3), 1e-9);
    scene.camera.position.z = 0.6;
    const Pick inside = found(scene);
    EXPECT_NEAR(inside.position.z, middle_of_slope(3, 0.6), 1e-9);
    EXPECT_EQ(inside.rows.front().distance, 0);
  }
}

TEST_F(PickInCells, OfLargeCoordinates) {
  const dvec3 corner(5e5, 4.2e6, 130);
  build(lattice(8, [&](dvec3 p) { return corner + 10.0 * p; }), [&](dvec3 p) { return (p.z - corner.z) / 10; });
  Scene scene = scene_of_slope(0.3);
  scene.camera.position = corner + dvec3(3, 4, 40);
  scene.camera.focal_point = corner + dvec3(3, 4, 0);
  const Pick pick = found(scene);
  EXPECT_NEAR(pick.position.z - corner.z, 10 * middle_of_slope(3), 1e-7);
  EXPECT_NEAR(pick.values[0].value, middle_of_slope(3), 1e-8);
}

// On faces, edges and vertices of all cells there is no gap, and nothing counts twice.
TEST_F(PickInCells, AlongFacesAndEdges) {
  build(lattice(8));
  for (const dvec2 at : {dvec2(0.5, 0.5), dvec2(0.25, 0.3), dvec2(0.3, 0.3)}) {
    const auto pick = along({dvec3(at, 3), {0, 0, -1}}, scene_of_slope(3));
    ASSERT_TRUE(pick);
    EXPECT_NEAR(pick->opacity, -std::expm1(-1.5), 1e-12);
    EXPECT_NEAR(pick->position.z, middle_of_slope(3), 1e-9);
  }
}

TEST_F(PickInCells, ClipPlanesAndTheBoxCut) {
  build(lattice(8));
  Scene scene = scene_of_slope(1);
  scene.contours = {{.values = {0.7}}};
  EXPECT_EQ(found(scene).kind, Kind::contour);
  scene.clip_planes = {{.point = {0, 0, 0.5}, .normal = {0, 0, -1}}};
  const Pick cut = found(scene);
  EXPECT_EQ(cut.kind, Kind::volume) << "the contour is cut away";
  EXPECT_NEAR(cut.opacity, -std::expm1(-0.5 * 0.25), 1e-12);
  EXPECT_NEAR(cut.position.z, middle_of_slope(1, 0.5), 1e-9);
  scene.clip_planes[0].active = false;
  EXPECT_EQ(found(scene).kind, Kind::contour);
  scene.clip_box = Box{dvec3(-1), {2, 2, 0.5}};
  EXPECT_NEAR(found(scene).position.z, middle_of_slope(1, 0.5), 1e-9);
  scene.clip_box = Box{dvec3(0.6), dvec3(1)};
  EXPECT_FALSE(ahead(scene, {square(0.9, 1)})) << "the ray misses it";
}

TEST_F(PickInCells, TheLargestShareIsTheAnswer) {
  build(lattice(8));
  Scene scene = scene_of(0);
  scene.contours = {{.values = {0.5}}};
  Pick pick = found(scene);
  EXPECT_EQ(pick.kind, Kind::contour);
  EXPECT_EQ(pick.name, "contour");
  EXPECT_EQ(pick.values[0].value, 0.5);
  EXPECT_NEAR(pick.position.z, 0.5, 1e-12);
  EXPECT_EQ(pick.opacity, 1);

  scene.slices = {{.shown = false}, {.point = {0, 0, 0.7}, .normal = {0, 0, 2}}};
  pick = found(scene);
  EXPECT_EQ(pick.kind, Kind::slice) << "it is in front";
  EXPECT_EQ(pick.name, "slice 2");
  EXPECT_NEAR(pick.values[0].value, 0.7, 1e-12);
  EXPECT_NEAR(pick.position.z, 0.7, 1e-12);
  scene.slices[1].opacity = 0.4;
  EXPECT_EQ(found(scene).kind, Kind::contour) << "most of the light comes from behind";
  scene.slices[1] = {.point = {0, 0, 0.3}, .normal = {0, 0, 1}};
  EXPECT_EQ(found(scene).kind, Kind::contour) << "the slice is behind";
  scene.contours[0].opacity = 0.4;
  EXPECT_EQ(found(scene).kind, Kind::slice);
  scene.slices[1].point.z = 1;
  EXPECT_NEAR(found(scene).values[0].value, 1, 1e-12) << "a slice in the mesh's outer face";
  scene.slices[1].point.z = 1.01;
  EXPECT_EQ(found(scene).kind, Kind::contour) << "the slice has no value there";
}

// The volume in front of an opaque contour at 0.5 has 1 - exp(-extinction / 2) of the light.
TEST_F(PickInCells, TheVolumeInFrontMayHaveMore) {
  build(lattice(8));
  const double equal = 2 * std::log(2);
  Scene scene = scene_of(0.95 * equal);
  scene.contours = {{.values = {0.5}}};
  EXPECT_EQ(found(scene).kind, Kind::contour);
  scene = scene_of(1.05 * equal);
  scene.contours = {{.values = {0.5}}};
  const Pick pick = found(scene);
  EXPECT_EQ(pick.kind, Kind::volume);
  const double extinction = 1.05 * equal, seen = -std::expm1(-0.5 * extinction);
  EXPECT_NEAR(pick.position.z, 1 + std::log1p(-0.5 * seen) / extinction, 1e-9) << "nothing is seen behind";
  EXPECT_NEAR(pick.rows.back().opacity, -std::expm1(-extinction), 1e-12) << "the plot goes on behind";
}

TEST_F(PickInCells, SurfacesHaveTheValueThatColoursThem) {
  build(lattice(8));
  const Scene scene = scene_of(0.1);
  Pick pick = found(scene, {square(0.6, 1)});
  EXPECT_EQ(pick.kind, Kind::surface);
  EXPECT_EQ(pick.name, "wall");
  EXPECT_EQ(pick.values[0].attribute, "value");
  EXPECT_NEAR(pick.values[0].value, 0.6, 1e-12);
  EXPECT_EQ(pick.opacity, 1);
  pick = found(scene, {square(0.6, 1, true)});
  EXPECT_EQ(pick.values[0].attribute, "other");
  EXPECT_NEAR(pick.values[0].value, 0.3, 1e-12);
  EXPECT_NEAR(found(scene, {square(1, 1)}).values[0].value, 1, 1e-12) << "in the mesh's outer face";
  EXPECT_TRUE(std::isnan(found(scene, {square(2, 1)}).values[0].value)) << "no cell is there";
  EXPECT_NEAR(found(scene, {square(0.6, 0.4), square(0.8, 0.5)}).position.z, 0.8, 1e-12);
  Surface near = square(0.6, 1);
  near.style.near_side = NearSide::hidden;
  EXPECT_EQ(found(scene, {near}).kind, Kind::volume) << "its normal looks at the eye";
  const auto from_below = along({{0.3, 0.4, -3}, {0, 0, 1}}, scene, {near});
  ASSERT_TRUE(from_below);
  EXPECT_EQ(from_below->kind, Kind::surface);

  Surface hidden = square(0.6, 1);
  hidden.style.shown = false;
  EXPECT_EQ(found(scene, {hidden}).kind, Kind::volume);

  // On the edge of two triangles, and on their corner, a surface is met once.
  for (const double x : {0.0, 0.5, 1.0}) {
    const auto on_edge = along({dvec3(x, x, 3), {0, 0, -1}}, scene_of(0), {square(0.6, 0.5)});
    ASSERT_TRUE(on_edge) << x;
    EXPECT_EQ(on_edge->opacity, 0.5) << x;
  }
}

TEST_F(PickInCells, OtherAttributesFadeAndColour) {
  Piece piece = mesh_piece(lattice(8), height);
  piece.values.push_back(test::sample(lattice(8), height));
  piece.values.push_back(test::sample(lattice(8), [](dvec3 p) { return p.z + (p.x > 0.6 ? none : 0); }));
  for (double& value : piece.values[0]) value = 0.25;
  build(PieceSource({piece}, {.attributes = {"value", "height", "part"}}));
  Scene scene = scene_of(3);
  scene.opacity = SceneOpacity{"height", {.colors = {{0, dvec3(1)}}, .densities = {{0, 0}, {1, 1}}}};
  const Pick pick = found(scene);
  EXPECT_NEAR(pick.opacity, -std::expm1(-1.5), 1e-12);
  EXPECT_NEAR(pick.position.z, middle_of_slope(3), 1e-9);
  EXPECT_EQ(pick.values[0].value, 0.25);

  scene = scene_of(0);
  scene.attribute = "height";
  scene.contours = {
      {.values = {0.5}, .color_by = SceneColoring{"part", {.colors = {{0, dvec3(1)}}, .densities = {{0, 1}}}}}};
  const Pick colored = found(scene);
  ASSERT_EQ(colored.values.size(), 2);
  EXPECT_EQ(colored.values[1].attribute, "part");
  EXPECT_NEAR(colored.values[1].value, 0.5, 1e-12);
  EXPECT_FALSE(along({{0.9, 0.4, 3}, {0, 0, -1}}, scene)) << "the value that colours it is missing";
}

// Cells with a missing value at a corner are not there.
TEST_F(PickInCells, MissingValuesAreGaps) {
  build(lattice(8), [](dvec3 p) { return p.z > 0.8 ? none : p.z; });
  const Pick pick = found(scene_of_slope(3));
  EXPECT_NEAR(pick.position.z, middle_of_slope(3, 0.75), 1e-9);
  EXPECT_NEAR(pick.rows.front().distance, 2.25, 1e-12);
}

TEST_F(PickInCells, OneOfOverlappingCellsCounts) {
  const Mesh mesh = lattice(4), moved = lattice(4, [](dvec3 p) { return p + dvec3(0.03, 0.05, 0.02); });
  build(PieceSource({mesh_piece(mesh, [](dvec3) { return 1; }), mesh_piece(moved, [](dvec3) { return 2; })}));
  const Pick pick = found(scene_of(3));
  const auto cells = value_of(CellTetrahedra::open(*volume_, {0}, own_room(1 << 24)));
  EXPECT_EQ(pick.values[0].value, value_of(sample_cells(*cells, std::vector{pick.position}))[0]);
  EXPECT_NEAR(pick.opacity, -std::expm1(-3 * 1.02), 1e-9);
}

TEST_F(PickInCells, ContoursLieBetweenPoints) {
  build(lattice(8), [](dvec3 p) { return p.z > 0.5 ? 1 : 0; });
  Scene scene = scene_of(0);
  scene.transfer_function.densities = {{0, 0}, {1, 0}};
  scene.contours = {{.values = {0.5}}};
  EXPECT_NEAR(found(scene).position.z, 0.5625, 1e-12) << "in the middle between the points";
}

// The volume is red and the contour green: the exact picture tells their shares.
TEST_F(PickInCells, AgreesWithTheExactPicture) {
  const Mesh mesh = jittered(10, 0.2);
  build(mesh, waves);
  Scene scene = scene_of_waves(60, 45);
  scene.transfer_function.colors = {{0, dvec3(1, 0, 0)}};
  scene.transfer_function.densities = {{0, 0.2}, {1, 1.5}};
  scene.lighting = Lighting{1, 0};
  scene.contours = {{.values = {0.4}, .color = dvec3(0, 1, 0), .opacity = 0.5}};
  scene.camera.position = {3, 0.7, 0.4};  // from there, a ray passes the value once
  const std::vector<double> values = test::sample(mesh, waves);
  const std::vector<std::array<std::uint32_t, 4>> tetrahedra(mesh.tetrahedra.begin(), mesh.tetrahedra.end());
  const Image truth = value_of(render_reference({mesh.points, values, tetrahedra}, scene)).image;
  const View view = value_of(make_view(scene));
  int contours = 0, volumes = 0;
  for (int y = 0; y < truth.height; ++y)
    for (int x = 0; x < truth.width; ++x) {
      const vec4 pixel = truth.at(x, y);
      const auto pick = along(looking_through(view, x + 0.5, y + 0.5).ray, scene);
      EXPECT_NEAR(pick ? pick->opacity : 0, static_cast<double>(pixel.a), pixel.a > 2e-3 ? 1e-5 : 2e-3);
      if (!pick || std::abs(pixel.r - pixel.g) < 1e-3) continue;
      EXPECT_EQ(pick->kind, pixel.g > pixel.r ? Kind::contour : Kind::volume) << x << ' ' << y;
      ++(pick->kind == Kind::contour ? contours : volumes);
    }
  EXPECT_GT(contours, 50);
  EXPECT_GT(volumes, 50);
}

}  // namespace
}  // namespace splatvol::test
