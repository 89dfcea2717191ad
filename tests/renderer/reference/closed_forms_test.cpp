// The picture against closed forms: slabs, ramps, boxes, the meshed ball.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/renderer/reference/meshes.h"
#include "tests/support/results.h"

namespace splatvol::test {
namespace {

constexpr double exact = 1e-6;  // pictures are 32-bit floats
constexpr double slab_extinction = 3;

double constant(dvec3) { return 0.5; }

/// The six directions along the axes, with an up for each.
struct Axis {
  dvec3 direction, up;
};
constexpr Axis axes[] = {{{0, 0, -1}, {0, 1, 0}}, {{0, 0, 1}, {0, 1, 0}}, {{1, 0, 0}, {0, 1, 0}},
                         {{-1, 0, 0}, {0, 0, 1}}, {{0, 1, 0}, {0, 0, 1}}, {{0, -1, 0}, {1, 0, 0}}};

/// Rays exactly along an axis, through the mesh's vertices, along its edges and inside its faces: pixels lie 1/16 apart
/// from the centre of a box with vertices 1/4 apart.
TEST(Slab, RaysInsideFacesEdgesAndVerticesCountOnce) {
  const Mesh mesh = make_box(4, constant);
  for (const Axis& axis : axes) {
    Scene scene = make_scene(slab_extinction, 15, 15);
    make_orthographic(scene, 15.0 / 16);
    look(scene, dvec3(0.5) - 4.0 * axis.direction, dvec3(0.5), axis.up);
    for (const vec4& pixel : render(mesh, scene).image.pixels) expect_alpha(pixel.a, slab_extinction, 1, exact);
  }
}

// Halves of a box with a value each: no pixel shows a mixture, and a half without a value is not there.
TEST(Slab, ConstantCellsKeepTheirValues) {
  const Mesh mesh = make_box(2, constant);
  Scene scene = make_scene(0, 16, 16);
  scene.transfer_function.densities = {{0, 0}, {1, slab_extinction}};
  make_orthographic(scene, 0.9);
  look(scene, {0.5, 0.5, 4}, dvec3(0.5));
  constexpr double left = 0.25, right = 0.75;
  for (const double right_value : {right, std::numeric_limits<double>::quiet_NaN()}) {
    std::vector<double> values;
    for (const Tetrahedron& corners : mesh.tetrahedra) {
      double x = 0;
      for (const std::uint32_t corner : corners) x += mesh.points[corner].x / 4;
      values.push_back(x < 0.5 ? left : right_value);
    }
    const auto picture = value_of(render_reference({mesh.points, values, mesh.tetrahedra, true}, scene));
    for (int x = 0; x < 16; ++x) {
      const double value = x < 8 ? left : std::isnan(right_value) ? 0 : right;
      expect_alpha(picture.image.at(x, 5).a, slab_extinction * value, 1, exact);
    }
    EXPECT_FALSE(render_reference({mesh.points, mesh.values, mesh.tetrahedra, true}, scene));
  }
}

TEST(Slab, RaysEndAtSurfaces) {
  const Mesh mesh = make_box(4, constant);
  Scene scene = make_scene(slab_extinction, 16, 12);
  for (const bool orthographic : {false, true}) {
    if (orthographic) make_orthographic(scene, 0.5);
    look(scene, {0.5, 0.5, 3}, dvec3(0.5));
    scene.camera.vertical_fov_degrees = 5;
    SurfaceDepths surfaces{16, 12, {}};
    for (int i = 0; i < 16 * 12; ++i) surfaces.depths.push_back(1.5F + 0.01F * static_cast<float>(i));
    surfaces.depths[0] = 0;
    surfaces.depths[1] = std::numeric_limits<float>::infinity();
    surfaces.depths[2] = std::numeric_limits<float>::quiet_NaN();
    const TetMesh tets{mesh.points, mesh.values, mesh.tetrahedra};
    const auto picture = value_of(render_reference(tets, scene, {.surface_depths = &surfaces}));
    const Image whole = render(mesh, scene).image;
    const View view = make_view(scene).value();
    for (std::size_t i = 0; i < surfaces.depths.size(); ++i) {
      const double x = (static_cast<double>(i % 16) - 7.5) / view.focal;
      const double y = (static_cast<double>(i / 16) - 5.5) / view.focal;
      const double along = orthographic ? 1 : std::sqrt(1 + x * x + y * y);  // of a unit of depth
      const double depth = std::isnan(surfaces.depths[i]) ? 9 : surfaces.depths[i];
      if (depth < 2) expect_alpha(picture.image.pixels[i].a, slab_extinction, 0, exact);
      if (depth >= 2 && depth < 2.95) {
        const double length = (depth - 2) * along;  // the box begins at a depth of 2
        EXPECT_NEAR(picture.image.pixels[i].a, -std::expm1(-slab_extinction * length), exact) << i;
      }
      if (depth <= 3.1) continue;
      EXPECT_EQ(picture.image.pixels[i], whole.pixels[i]) << i;
    }
    surfaces.width = 15;
    EXPECT_FALSE(render_reference(tets, scene, {.surface_depths = &surfaces}));
  }
}

// Two clip boxes cut the mesh in two parts, whose transmittances multiply to that of the whole.
TEST(Slab, AClipBoxCutsRaysWhereItsFacesAre) {
  const Mesh mesh = make_box(4, constant);
  Scene scene = make_scene(slab_extinction, 40, 30);
  look(scene, {1.7, 2.1, 2.9}, dvec3(0.5));
  const Image whole = render(mesh, scene).image;
  for (int axis = 0; axis < 3; ++axis) {
    Box low{dvec3(-1), dvec3(2)}, high{dvec3(-1), dvec3(2)};
    low.high[axis] = high.low[axis] = 0.37;
    scene.clip_box = low;
    const Image first = render(mesh, scene).image;
    scene.clip_box = high;
    const Image second = render(mesh, scene).image;
    double largest = 0;
    for (std::size_t i = 0; i < whole.pixels.size(); ++i) {
      EXPECT_NEAR((1 - first.pixels[i].a) * (1 - second.pixels[i].a), 1 - whole.pixels[i].a, exact);
      largest = std::max(largest, static_cast<double>(first.pixels[i].a));
    }
    EXPECT_GT(largest, 0.3);
  }
  scene.clip_box = Box{dvec3(-2), dvec3(-1)};
  for (const vec4& pixel : render(mesh, scene).image.pixels) EXPECT_EQ(pixel.a, 0);
}

// Two half spaces cut the mesh in two parts, as two clip boxes do. A plane along an axis is a face of a box.
TEST(Slab, ClipPlanesCutRaysWhereTheyAre) {
  const Mesh mesh = make_box(4, constant);
  for (const bool orthographic : {false, true}) {
    Scene scene = make_scene(slab_extinction, 40, 30);
    look(scene, {1.7, 2.1, 2.9}, dvec3(0.5));
    if (orthographic) scene.camera.projection = Camera::Projection::orthographic;
    scene.camera.parallel_height = 2;
    const Image whole = render(mesh, scene).image;
    for (const dvec3 normal : {dvec3(1, 2, -0.5), dvec3(0, 0, -3), scene.camera.position - dvec3(0.5)}) {
      scene.clip_planes = {{dvec3(0.4), normal}};
      const Image first = render(mesh, scene).image;
      scene.clip_planes[0].normal = -normal;
      const Image second = render(mesh, scene).image;
      for (std::size_t i = 0; i < whole.pixels.size(); ++i)
        EXPECT_NEAR((1 - first.pixels[i].a) * (1 - second.pixels[i].a), 1 - whole.pixels[i].a, exact);
      EXPECT_GT(compare_images(first, second)->rmse, 0.02);
      scene.clip_planes.push_back({dvec3(0.4), normal});
      for (const vec4& pixel : render(mesh, scene).image.pixels) EXPECT_NEAR(pixel.a, 0, exact) << "nothing is between";
    }
    scene.clip_planes = {{{0, 0, 0.37}, {0, 0, 2}, false}};
    EXPECT_EQ(compare_images(render(mesh, scene).image, whole)->max, 0) << "it is not active";
    scene.clip_planes[0].active = true;
    const Image cut = render(mesh, scene).image;
    scene.clip_planes.clear();
    scene.clip_box = Box{{-1, -1, 0.37}, dvec3(2)};
    EXPECT_LT(compare_images(render(mesh, scene).image, cut)->max, 1e-6);
  }
}

TEST(Slab, RaysOnTheOuterFacesCountOnceOrNotAtAll) {
  const Mesh mesh = make_box(4, constant);
  Scene scene = make_scene(slab_extinction, 17, 17);
  make_orthographic(scene, 17.0 / 16);
  look(scene, {0.5, 0.5, 3}, dvec3(0.5));
  const Image image = render(mesh, scene).image;
  for (int x = 0; x < 17; ++x)
    for (const vec4& pixel : {image.at(x, 0), image.at(x, 16), image.at(0, x), image.at(16, x)})
      if (pixel.a != 0) expect_alpha(pixel.a, slab_extinction, 1, exact);
}

TEST(Slab, PerspectiveAlongAnAxisThroughVertices) {
  const Mesh mesh = make_box(4, constant);
  for (const Axis& axis : axes) {
    Scene scene = make_scene(slab_extinction, 65, 33);
    look(scene, dvec3(0.5) - 2.5 * axis.direction, dvec3(0.5), axis.up);
    // Front vertices lie 2 from the eye and 1/4 apart: exactly 8 pixels where f = 64.
    scene.camera.vertical_fov_degrees = 360 / std::numbers::pi * std::atan(16.5 / 64);
    expect_box(mesh, scene, slab_extinction);
  }
}

TEST(Slab, AlongTheDiagonalEdges) {
  const Mesh mesh = make_box(4, constant);
  Scene scene = make_scene(slab_extinction, 31, 31);
  look(scene, dvec3(-2), dvec3(2));
  for (const bool orthographic : {false, true}) {
    if (orthographic) make_orthographic(scene, 1.7);
    expect_box(mesh, scene, slab_extinction);
  }
}

TEST(Box, ObliqueViewFromOutsideAndInside) {
  const Mesh mesh = make_box(5, constant);
  for (const dvec3 eye : {dvec3(2.3, 1.9, 3.1), dvec3(0.41, 0.63, 0.57)}) {
    Scene scene = make_scene(2, 67, 45);
    look(scene, eye, {0.53, 0.31, 0.2});
    for (const bool orthographic : {false, true}) {
      if (orthographic) make_orthographic(scene, 2);
      expect_box(mesh, scene, 2);
    }
  }
}

/// Eyes exactly on a vertex, on an edge, on a face, and on the box's surface, looking along edges and elsewhere.
TEST(Box, EyeOnVertexEdgeAndFace) {
  const Mesh mesh = make_box(4, constant);
  const dvec3 eyes[] = {{0.5, 0.5, 0.5},      {0.5, 0.5, 0.375}, {0.625, 0.625, 0.625},
                        {0.625, 0.5, 0.5625}, {0.5, 0.5, 1},     {0, 0, 0}};
  const dvec3 directions[] = {{0, 0, -1}, {1, 0, 0}, {1, 1, 1}, {0.3, -0.2, 0.9}};
  for (const dvec3& eye : eyes)
    for (const dvec3& direction : directions) {
      Scene scene = make_scene(2, 33, 33);
      look(scene, eye, eye + direction);
      scene.camera.vertical_fov_degrees = 90;
      for_each_ray(scene, render(mesh, scene).image, [&](const WorldRay& ray, const vec4& pixel) {
        SCOPED_TRACE(testing::Message() << "eye " << eye.x << " " << eye.y << " " << eye.z << ", direction "
                                        << direction.x);
        // A ray inside the box's surface may count or not: a slightly smaller box would lose it.
        const double smaller = box_length({(ray.origin - 0.5) * (1 + 1e-9) + 0.5, ray.direction});
        if (std::abs(smaller - box_length(ray)) < 1e-6) expect_alpha(pixel.a, 2, box_length(ray), exact);
      });
    }
}

/// A picture of the unit cube along the z axis, from +z or -z. Pixels lie 1/16 apart.
Scene scene_along_z(double extinction, double z = 5) {
  Scene scene = make_scene(extinction, 15, 15);
  make_orthographic(scene, 15.0 / 16);
  look(scene, {0.5, 0.5, z}, dvec3(0.5));
  return scene;
}

/// The value is the coordinate along the ray: optical depth 4 (z1 - z0)^2 / 2 and so on, for any cells.
TEST(Ramp, AlongTheRay) {
  Scene scene = scene_along_z(0);
  scene.transfer_function.densities = {{0, 0}, {1, 4}};
  const Mesh mesh = make_box(4, [](dvec3 p) { return p.z; });
  for (const vec4& pixel : render(mesh, scene).image.pixels) expect_alpha(pixel.a, 2, 1, exact);
  look(scene, {0.5, 0.5, 0.25}, {0.5, 0.5, 0});
  for (const vec4& pixel : render(mesh, scene).image.pixels) expect_alpha(pixel.a, 4 * 0.25 * 0.25 / 2, 1, exact);
}

TEST(Ramp, AcrossTheRay) {
  Scene scene = scene_along_z(0);
  scene.transfer_function.densities = {{0, 0}, {1, 4}};
  const Mesh mesh = make_box(4, [](dvec3 p) { return p.x; });
  for_each_ray(scene, render(mesh, scene).image,
               [](const WorldRay& ray, const vec4& pixel) { expect_alpha(pixel.a, 4 * ray.origin.x, 1, exact); });
}

TEST(Ramp, ObliqueInPerspective) {
  const dvec3 gradient(0.3, 0.5, 0.2);
  Scene scene = make_scene(0, 31, 31);
  scene.transfer_function.densities = {{0, 1}, {1, 5}};
  look(scene, {2.3, 1.9, 3.1}, dvec3(0.5));
  const Mesh mesh = make_box(3, [&](dvec3 p) { return glm::dot(gradient, p); });
  for_each_ray(scene, render(mesh, scene).image, [&](const WorldRay& ray, const vec4& pixel) {
    const dvec2 interval = box_interval(ray);
    if (interval.x >= interval.y) return expect_alpha(pixel.a, 0, 0, exact);
    const double value = glm::dot(gradient, ray.origin + 0.5 * (interval.x + interval.y) * ray.direction);
    expect_alpha(pixel.a, 1 + 4 * value, interval.y - interval.x, exact);
  });
}

/// Red = value = z, seen from +z with density 1: the integral of (1 - u) exp(-u) over [0, 1] is 1/e.
TEST(Emission, LinearColor) {
  Scene scene = scene_along_z(1);
  scene.transfer_function.colors = {{0, {0, 0, 0}}, {1, {1, 0, 2}}};
  const Mesh mesh = make_box(4, [](dvec3 p) { return p.z; });
  for (const vec4& pixel : render(mesh, scene).image.pixels) {
    EXPECT_NEAR(pixel.r, 1 / std::numbers::e, exact);
    EXPECT_EQ(pixel.g, 0);
    EXPECT_NEAR(pixel.b, 2 / std::numbers::e, 2 * exact);
  }
}

/// The order matters: the same slab from behind gives the integral of u exp(-u), 1 - 2/e.
TEST(Emission, FromBehind) {
  Scene scene = scene_along_z(1, -5);
  scene.transfer_function.colors = {{0, {0, 0, 0}}, {1, {1, 0, 0}}};
  const Mesh mesh = make_box(4, [](dvec3 p) { return p.z; });
  for (const vec4& pixel : render(mesh, scene).image.pixels) EXPECT_NEAR(pixel.r, 1 - 2 / std::numbers::e, exact);
}

/// Opaque red above z = 0.6, blue of density 2 below; the jump lies inside a layer of cells.
TEST(Jump, IsFoundInsideACell) {
  Scene scene = scene_along_z(0, -5);
  scene.transfer_function.colors = {{0, {0, 0, 1}}, {0.6, {0, 0, 1}}, {0.6, {1, 0, 0}}, {1, {1, 0, 0}}};
  scene.transfer_function.densities = {{0, 2}, {0.6, 2}, {0.6, 50}, {1, 50}};
  const Mesh mesh = make_box(4, [](dvec3 p) { return p.z; });
  for (const vec4& pixel : render(mesh, scene).image.pixels) {
    const double blue = -std::expm1(-1.2);
    EXPECT_NEAR(pixel.b, blue, exact);
    EXPECT_NEAR(pixel.r, (1 - blue) * -std::expm1(-20), exact);
  }
}

TEST(Jump, ValuesExactlyOnItTakeTheLaterSide) {
  Scene scene = make_scene(0, 3, 3);
  scene.transfer_function.densities = {{0, 2}, {0.5, 2}, {0.5, 1}, {1, 1}};
  make_orthographic(scene, 0.5);
  look(scene, {0.5, 0.5, 5}, dvec3(0.5));
  for (const vec4& pixel : render(make_box(2, constant), scene).image.pixels) expect_alpha(pixel.a, 1, 1, exact);
}

/// Returns the length of a ray inside the convex hull of the ball's outer triangles.
double polyhedron_length(const Mesh& ball, const WorldRay& ray) {
  double enter = 0;
  double leave = std::numeric_limits<double>::infinity();
  for (const auto& [center, a, b, c] : ball.tetrahedra) {
    dvec3 normal = glm::cross(ball.points[b] - ball.points[a], ball.points[c] - ball.points[a]);
    if (glm::dot(normal, ball.points[a]) < 0) normal = -normal;
    const double height = glm::dot(normal, ball.points[a] - ray.origin);
    const double slope = glm::dot(normal, ray.direction);
    if (slope > 0)
      leave = std::min(leave, height / slope);
    else
      enter = std::max(enter, height / slope);
  }
  return std::max(leave - enter, 0.0);
}

/// The eye outside, inside, and at the centre, where all cells meet.
TEST(Ball, MatchesItsPolyhedron) {
  const Mesh ball = make_ball(3);
  ASSERT_EQ(ball.tetrahedra.size(), 1280U);
  for (const dvec3 eye : {dvec3(2.5, 1.1, 3.2), dvec3(0.4, -0.3, 0.2), dvec3(0)}) {
    Scene scene = make_scene(1.5, 61, 61);
    look(scene, eye, eye == dvec3(0) ? dvec3(1, 0.2, 0.1) : dvec3(0));
    scene.camera.vertical_fov_degrees = 35;
    for_each_ray(scene, render(ball, scene).image, [&](const WorldRay& ray, const vec4& pixel) {
      expect_alpha(pixel.a, 1.5, polyhedron_length(ball, ray), exact);
    });
  }
}

/// Refinement brings the polyhedron closer to the ball, whose chord is 2 sqrt(1 - b^2).
TEST(Ball, NearsTheRoundBall) {
  const Mesh ball = make_ball(5);
  Scene scene = make_scene(1.5, 21, 21);
  make_orthographic(scene, 1.6);
  look(scene, {0, 0, 5}, dvec3(0));
  for_each_ray(scene, render(ball, scene).image, [](const WorldRay& ray, const vec4& pixel) {
    const double squared = ray.origin.x * ray.origin.x + ray.origin.y * ray.origin.y;
    if (squared < 0.9) expect_alpha(pixel.a, 1.5, 2 * std::sqrt(1 - squared), 5e-3);
  });
}

}  // namespace
}  // namespace splatvol::test
