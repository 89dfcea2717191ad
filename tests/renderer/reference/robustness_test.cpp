// Imperfect data: missing values, broken cells, far origins, bad arguments. And the same bits for every thread count.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "tests/renderer/reference/meshes.h"
#include "tests/support/results.h"

namespace splatvol {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

double constant(dvec3) { return 0.5; }

Scene box_scene(double extinction) {
  Scene scene = make_scene(extinction, 45, 45);
  look(scene, {2.3, 1.9, 3.1}, dvec3(0.5));
  return scene;
}

TEST(Reference, MissingValuesEmptyTheirCells) {
  // All values above z = 1/2 are missing: the cells of the upper half are empty, those of the lower half whole.
  const Mesh mesh = make_box(4, [](dvec3 p) { return p.z > 0.5 ? nan : 0.5; });
  Scene scene = make_scene(3, 9, 9);
  make_orthographic(scene, 0.8);
  look(scene, {0.5, 0.5, 4}, dvec3(0.5));
  for (const vec4& pixel : render(mesh, scene).image.pixels) {
    expect_alpha(pixel.a, 3, 0.5, 1e-6);
    EXPECT_NEAR(pixel.r, pixel.a, 1e-6);
  }
}

TEST(Reference, MissingPositionsEmptyTheirCells) {
  Mesh mesh = make_box(1, constant);
  mesh.points.push_back(dvec3(nan, 0, 0));
  mesh.points.push_back(dvec3(0, std::numeric_limits<double>::infinity(), 0));
  mesh.values.insert(mesh.values.end(), 2, 0.5);
  mesh.tetrahedra.push_back({0, 1, 2, 8});
  mesh.tetrahedra.push_back({0, 1, 2, 9});
  expect_box(mesh, box_scene(2), 2);
}

TEST(Reference, InvertedCellsCountLikeOthers) {
  Mesh mesh = make_box(4, constant);
  for (std::size_t cell = 0; cell < mesh.tetrahedra.size(); cell += 2)
    std::swap(mesh.tetrahedra[cell][cell % 3], mesh.tetrahedra[cell][3]);
  expect_box(mesh, box_scene(2), 2);
}

TEST(Reference, FlatCellsAddNothing) {
  Mesh mesh = make_box(2, constant);
  add_flat_cells(mesh);
  expect_box(mesh, box_scene(2), 2);
}

TEST(Reference, OverlappingCellsAllCount) {
  Mesh mesh = make_box(3, constant);
  const std::vector<Tetrahedron> once = mesh.tetrahedra;
  mesh.tetrahedra.insert(mesh.tetrahedra.end(), once.begin(), once.end());
  expect_box(mesh, box_scene(1), 2);
}

TEST(Reference, FarFromTheOrigin) {
  Mesh mesh = make_box(4, constant);
  Scene scene = box_scene(2);
  const Image near = render(mesh, scene).image;

  // The shift is exact in binary for the eye and the vertices, so that only the arithmetic can lose digits.
  const dvec3 shift(1e7, -3e7, 5e7);
  scene.camera.position = dvec3(2.25, 1.875, 3.125) + shift;
  scene.camera.focal_point = dvec3(0.5) + shift;
  for (dvec3& point : mesh.points) point += shift;
  const Image far = render(mesh, scene).image;
  look(scene, {2.25, 1.875, 3.125}, dvec3(0.5));
  for_each_ray(scene, far,
               [](const WorldRay& ray, const vec4& pixel) { expect_alpha(pixel.a, 2, box_length(ray), 1e-6); });
  EXPECT_NE(near.pixels, far.pixels);
}

TEST(Reference, AnySizeOfWorld) {
  for (const double scale : {1e-12, 1e-3, 1e9}) {
    Mesh mesh = make_box(3, constant);
    for (dvec3& point : mesh.points) point *= scale;
    Scene scene = box_scene(2 / scale);
    scene.camera.position *= scale;
    scene.camera.focal_point *= scale;
    expect_box(mesh, scene, 2, scale);
  }
}

/// Many files mark missing values with the largest double. It counts as a value above the domain, and breaks nothing.
TEST(Reference, AnySizeOfValue) {
  const double largest = std::numeric_limits<double>::max();
  const Field fields[] = {[&](dvec3) { return largest; }, [&](dvec3 p) { return p.x > 0.5 ? largest : -largest; },
                          [](dvec3 p) { return p.x > 0.5 ? 1e300 : p.y; }};
  for (const Field& field : fields)
    for (const double scale : {1.0, 1e9}) {
      Mesh mesh = make_box(3, field);
      for (dvec3& point : mesh.points) point *= scale;
      Scene scene = box_scene(2 / scale);
      scene.lighting = Lighting{};
      scene.camera.position *= scale;
      scene.camera.focal_point *= scale;
      expect_box(mesh, scene, 2, scale);
    }
}

/// Cells of every shape: a box whose inner vertices are moved at random, but too little to fold a cell.
TEST(Reference, IrregularCellsFillTheBox) {
  Mesh mesh = make_box(6, constant);
  std::mt19937 random(5);
  std::uniform_real_distribution<double> shift(-0.02, 0.02);
  for (dvec3& point : mesh.points)
    for (int axis = 0; axis < 3; ++axis)
      if (point[axis] > 0.01 && point[axis] < 0.99) point[axis] += shift(random);
  expect_box(mesh, box_scene(2), 2);
  Scene inside = box_scene(2);
  look(inside, {0.4, 0.6, 0.55}, {0.9, 0.3, 0.2});
  expect_box(mesh, inside, 2);
}

TEST(Reference, TheSameBitsForEveryThreadCount) {
  const Mesh mesh = make_box(6, [](dvec3 p) { return p.x * p.y + std::sin(9 * p.z); });
  Scene scene = box_scene(2);
  scene.transfer_function.colors = {{0, {0, 0, 1}}, {1, {1, 1, 0}}};
  for (const auto& lighting : {std::optional<Lighting>(), std::optional(Lighting{0.25, 0.6})}) {
    scene.lighting = lighting;
    const ReferencePicture one = render(mesh, scene, 1);
    for (const int threads : {2, 7}) {
      const ReferencePicture many = render(mesh, scene, threads);
      EXPECT_EQ(one.image.pixels, many.image.pixels);
      EXPECT_EQ(one.segments, many.segments);
    }
  }
}

TEST(Reference, CountsSegmentsAndReportsProgress) {
  const Mesh mesh = make_box(4, constant);
  Scene scene = make_scene(1, 40, 24);
  make_orthographic(scene, 0.5);
  look(scene, {0.501, 0.503, 4}, dvec3(0.501, 0.503, 0));
  double last = 0;
  const auto picture = render_reference(mesh.view(), scene, {0, [&](double share) {
                                                               EXPECT_GT(share, last);
                                                               last = share;
                                                             }});
  ASSERT_TRUE(picture);
  EXPECT_EQ(last, 1);
  // Every ray meets one to three cells in each layer of cubes.
  EXPECT_GE(picture->segments, 4U * 40 * 24);
  EXPECT_LE(picture->segments, 12U * 40 * 24);
}

/// A tile with more segments than a thread may hold is drawn in parts, with the same result.
TEST(Reference, CrowdedTilesAreDrawnInParts) {
  Mesh mesh = make_box(1, constant);
  Scene scene = make_scene(1.0 / 3000, 16, 16);
  make_orthographic(scene, 0.5);
  look(scene, {0.5, 0.501, 4}, {0.5, 0.501, 0});
  const std::uint64_t segments_once = render(mesh, scene).segments;
  const std::vector<Tetrahedron> once = mesh.tetrahedra;
  for (int copy = 1; copy < 3000; ++copy) mesh.tetrahedra.insert(mesh.tetrahedra.end(), once.begin(), once.end());
  const ReferencePicture picture = render(mesh, scene);
  EXPECT_GT(picture.segments, std::uint64_t{1} << 20);
  EXPECT_EQ(picture.segments, 3000 * segments_once);
  for (const vec4& pixel : picture.image.pixels) expect_alpha(pixel.a, 1, 1, 1e-6);
}

TEST(Reference, AnEmptyMeshIsAnEmptyPicture) {
  const ReferencePicture picture = render(Mesh{}, box_scene(1));
  for (const vec4& pixel : picture.image.pixels) EXPECT_EQ(pixel, vec4(0));
  EXPECT_EQ(picture.segments, 0U);
}

TEST(Reference, RefusesBadArguments) {
  Mesh mesh = make_box(1, constant);
  const Scene scene = box_scene(1);
  mesh.tetrahedra.push_back({0, 1, 2, 8});
  EXPECT_EQ(test::message_of(render_reference(mesh.view(), scene)), "tetrahedron 6: point 8 of 8");

  mesh.tetrahedra.pop_back();
  mesh.values.pop_back();
  EXPECT_FALSE(render_reference(mesh.view(), scene));
  mesh.values.push_back(0);
  EXPECT_TRUE(render_reference(mesh.view(), scene));

  Scene blind = scene;
  blind.camera.focal_point = blind.camera.position;
  EXPECT_FALSE(render_reference(mesh.view(), blind));
}

}  // namespace
}  // namespace splatvol
