// Meshes and scenes whose pictures have closed forms.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <random>

#include "renderer/reference/cell.h"
#include "renderer/reference/reference.h"

namespace splatvol {

using Tetrahedron = std::array<std::uint32_t, 4>;

/// A mesh that owns its arrays.
struct Mesh {
  std::vector<dvec3> points;
  std::vector<double> values;
  std::vector<Tetrahedron> tetrahedra;

  [[nodiscard]] TetMesh view() const { return {points, values, tetrahedra}; }
};

/// A field on the points of a mesh.
using Field = std::function<double(dvec3)>;

/// The unit cube as n^3 cubes of six tetrahedra around their diagonal: along an axis or a diagonal, rays run inside
/// faces, edges and vertices.
inline Mesh make_box(std::uint32_t n, const Field& field) {
  Mesh mesh;
  for (std::uint32_t x = 0; x <= n; ++x)
    for (std::uint32_t y = 0; y <= n; ++y)
      for (std::uint32_t z = 0; z <= n; ++z) mesh.points.push_back(dvec3(x, y, z) / static_cast<double>(n));
  for (const dvec3& point : mesh.points) mesh.values.push_back(field(point));

  const auto corner = [n](std::uint32_t cube, std::uint32_t bits) {
    const std::uint32_t x = cube / (n * n) + (bits >> 2 & 1);
    const std::uint32_t y = cube / n % n + (bits >> 1 & 1);
    const std::uint32_t z = cube % n + (bits & 1);
    return (x * (n + 1) + y) * (n + 1) + z;
  };
  constexpr Tetrahedron corners[] = {{0, 1, 3, 7}, {0, 3, 2, 7}, {0, 2, 6, 7},
                                     {0, 6, 4, 7}, {0, 4, 5, 7}, {0, 5, 1, 7}};
  for (std::uint32_t cube = 0; cube < n * n * n; ++cube)
    for (const auto& [a, b, c, d] : corners)
      mesh.tetrahedra.push_back({corner(cube, a), corner(cube, b), corner(cube, c), corner(cube, d)});
  return mesh;
}

/// A ball of radius 1 as tetrahedra from its centre (point 0) to the triangles of a refined icosahedron.
inline Mesh make_ball(int refinements) {
  const double g = (1 + std::sqrt(5.0)) / 2;
  Mesh mesh;
  mesh.points = {{0, 0, 0},   {-1, g, 0}, {1, g, 0},  {-1, -g, 0}, {1, -g, 0},  {0, -1, g}, {0, 1, g},
                 {0, -1, -g}, {0, 1, -g}, {g, 0, -1}, {g, 0, 1},   {-g, 0, -1}, {-g, 0, 1}};
  mesh.tetrahedra = {{0, 1, 12, 6}, {0, 1, 6, 2},  {0, 1, 2, 8},   {0, 1, 8, 11}, {0, 1, 11, 12},
                     {0, 2, 6, 10}, {0, 6, 12, 5}, {0, 12, 11, 3}, {0, 11, 8, 7}, {0, 8, 2, 9},
                     {0, 4, 10, 5}, {0, 4, 5, 3},  {0, 4, 3, 7},   {0, 4, 7, 9},  {0, 4, 9, 10},
                     {0, 5, 10, 6}, {0, 3, 5, 12}, {0, 7, 3, 11},  {0, 9, 7, 8},  {0, 10, 9, 2}};
  for (std::size_t i = 1; i < mesh.points.size(); ++i) mesh.points[i] = glm::normalize(mesh.points[i]);
  for (int refinement = 0; refinement < refinements; ++refinement) {
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> middles;
    const auto middle = [&](std::uint32_t a, std::uint32_t b) {
      const auto [entry, is_new] = middles.try_emplace(std::minmax(a, b), mesh.points.size());
      if (is_new) mesh.points.push_back(glm::normalize(mesh.points[a] + mesh.points[b]));
      return entry->second;
    };
    std::vector<Tetrahedron> finer;
    for (const auto& [o, a, b, c] : mesh.tetrahedra) {
      const std::uint32_t ab = middle(a, b);
      const std::uint32_t bc = middle(b, c);
      const std::uint32_t ca = middle(c, a);
      for (const Tetrahedron& part : {Tetrahedron{o, a, ab, ca}, {o, b, bc, ab}, {o, c, ca, bc}, {o, ab, bc, ca}})
        finer.push_back(part);
    }
    mesh.tetrahedra = finer;
  }
  mesh.values.assign(mesh.points.size(), 0.5);
  return mesh;
}

/// White, with constant extinction; domain [0, 1].
inline Scene make_scene(double extinction, int width, int height) {
  Scene scene;
  scene.width = width;
  scene.height = height;
  scene.attribute = "v";
  scene.transfer_function.colors = {{0, dvec3(1)}};
  scene.transfer_function.densities = {{0, extinction}};
  return scene;
}

inline void look(Scene& scene, dvec3 position, dvec3 focal_point, dvec3 up = {0, 1, 0}) {
  scene.camera.position = position;
  scene.camera.focal_point = focal_point;
  scene.camera.up = up;
}

inline void make_orthographic(Scene& scene, double parallel_height) {
  scene.camera.projection = Camera::Projection::orthographic;
  scene.camera.parallel_height = parallel_height;
}

inline ReferencePicture render(const Mesh& mesh, const Scene& scene, int threads = 0) {
  auto picture = render_reference(mesh.view(), scene, {threads, {}});
  EXPECT_TRUE(picture) << picture.error().message;
  return picture ? std::move(*picture) : ReferencePicture{};
}

/// A ray in world coordinates; direction of length 1.
struct WorldRay {
  dvec3 origin, direction;
};

/// Returns the ray through the centre of the pixel in image column x and image row y (0 at the top).
inline WorldRay world_ray(const View& view, int x, int y) {
  const auto [a, b] = pixel_ray(view, x, view.height - 1 - y);
  const dvec3 offset = a * view.right + b * view.up;
  if (view.orthographic) return {view.eye + offset, view.forward};
  return {view.eye, glm::normalize(view.forward + offset)};
}

/// Calls check(ray, pixel) for every pixel.
template <class Check>
void for_each_ray(const Scene& scene, const Image& image, const Check& check) {
  const auto view = make_view(scene.camera, scene.width, scene.height);
  ASSERT_TRUE(view);
  ASSERT_EQ(image.pixels.size(), static_cast<std::size_t>(scene.width) * scene.height);
  for (int y = 0; y < scene.height; ++y)
    for (int x = 0; x < scene.width; ++x) {
      SCOPED_TRACE(testing::Message() << "pixel " << x << ", " << y);
      check(world_ray(*view, x, y), image.at(x, y));
    }
}

/// Returns the part of a ray inside the box [0, 1]^3, in front of the eye: from .x to .y; empty if .x >= .y.
inline dvec2 box_interval(const WorldRay& ray) {
  dvec2 interval(0, std::numeric_limits<double>::infinity());
  for (int axis = 0; axis < 3; ++axis) {
    const double origin = ray.origin[axis];
    if (ray.direction[axis] == 0) {
      if (origin < 0 || origin > 1) return {0, 0};
      continue;
    }
    const double first = -origin / ray.direction[axis];
    const double second = (1 - origin) / ray.direction[axis];
    interval = {std::max(interval.x, std::min(first, second)), std::min(interval.y, std::max(first, second))};
  }
  return interval;
}

inline double box_length(const WorldRay& ray) {
  const dvec2 interval = box_interval(ray);
  return std::max(interval.y - interval.x, 0.0);
}

/// Expects alpha = 1 - exp(-extinction * length), to a relative error.
inline void expect_alpha(double alpha, double extinction, double length, double tolerance) {
  const double expected = -std::expm1(-extinction * length);
  EXPECT_NEAR(alpha, expected, tolerance * expected + 1e-12);
}

/// Adds cells without volume to a mesh of make_box(2, ...): some in its face x = 0, some with a corner twice.
inline void add_flat_cells(Mesh& mesh) {
  std::mt19937 random(3);
  std::uniform_int_distribution<std::uint32_t> plane(0, 8);
  std::uniform_int_distribution<std::uint32_t> any(0, 26);
  for (int i = 0; i < 200; ++i) {
    mesh.tetrahedra.push_back({plane(random), plane(random), plane(random), plane(random)});  // all in x = 0
    const std::uint32_t a = any(random);
    const std::uint32_t b = any(random);
    mesh.tetrahedra.push_back({a, b, b, a});
    mesh.tetrahedra.push_back({a, a, a, a});
  }
}

/// Expects the picture of the unit cube, or of one `scale` times as large, without light. Extinction is per edge.
inline void expect_box(const Mesh& mesh, const Scene& scene, double extinction, double scale = 1) {
  for_each_ray(scene, render(mesh, scene).image, [&](const WorldRay& ray, const vec4& pixel) {
    expect_alpha(pixel.a, extinction, box_length({ray.origin / scale, ray.direction}), 1e-6);
  });
}

}  // namespace splatvol
