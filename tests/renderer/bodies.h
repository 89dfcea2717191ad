// Bodies of box-shaped cells with one extinction, whose rays are known.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <utility>
#include <vector>

#include "pictures/image.h"
#include "scene/scene.h"
#include "splatvol/surface_depths.h"
#include "tests/renderer/draw_parts.h"

namespace splatvol::test {

/// A box of material, in points that own what is nearest to them, as a mesh's vertices do.
struct Body {
  dvec3 low, high;
  glm::ivec3 cells;  // points along an axis: one more
};

/// The value of the tests: linear.
constexpr dvec3 gradient{0.2, -0.1, 0.15};
inline double value_at(dvec3 position) { return 0.5 + glm::dot(gradient, position); }

/// The splat of a box. `face`: the distance from the middle of the box to the boundary, along one axis; 0: none.
inline MomentsSplat box_splat(dvec3 center, dvec3 size, dvec3 face) {
  std::array<int, 3> axes{0, 1, 2};
  std::ranges::stable_sort(axes, std::greater(), [&](int axis) { return size[axis]; });
  glm::dmat3 turn(0);
  for (int k = 0; k < 3; ++k) turn[k][axes[static_cast<std::size_t>(k)]] = 1;
  if (glm::determinant(turn) < 0) turn[2] = -turn[2];
  MomentsSplat splat;
  splat.center = center;
  splat.mass = size.x * size.y * size.z;
  splat.orientation = glm::quat_cast(turn);
  splat.value = value_at(center);
  const dvec3 slopes = gradient * size / std::sqrt(12);
  splat.value_deviation = glm::length(slopes);
  for (int k = 0; k < 3; ++k) {
    splat.deviations[k] = size[axes[static_cast<std::size_t>(k)]] / std::sqrt(12);
    splat.boundary[k] = glm::dot(face, turn[k]) / splat.deviations[k];
    splat.correlations[k] = glm::dot(slopes, turn[k]) / splat.value_deviation;
  }
  return splat;
}

/// Appends the splats of a body's points.
inline void add_splats(const Body& body, std::vector<MomentsSplat>& splats) {
  const dvec3 step = (body.high - body.low) / dvec3(body.cells);
  for (int z = 0; z <= body.cells.z; ++z)
    for (int y = 0; y <= body.cells.y; ++y)
      for (int x = 0; x <= body.cells.x; ++x) {
        const dvec3 point = body.low + step * dvec3(x, y, z);
        const dvec3 low = glm::max(point - 0.5 * step, body.low), high = glm::min(point + 0.5 * step, body.high);
        dvec3 face(0);  // a splat has one boundary at most
        for (int axis = 0; axis < 3 && face == dvec3(0); ++axis) {
          if (high[axis] == body.high[axis]) face[axis] = 0.5 * (high - low)[axis];
          if (low[axis] == body.low[axis]) face[axis] = -0.5 * (high - low)[axis];
        }
        splats.push_back(box_splat(0.5 * (low + high), high - low, face));
      }
}

inline std::vector<MomentsSplat> splats_of(const std::vector<Body>& bodies) {
  std::vector<MomentsSplat> splats;
  for (const Body& body : bodies) add_splats(body, splats);
  return splats;
}

inline TransferFunction uniform(double extinction) {
  TransferFunction function;
  function.colors = {{0, {1, 1, 1}}, {1, {1, 1, 1}}};
  function.densities = {{0, extinction}, {1, extinction}};
  return function;
}

inline View view_from(dvec3 eye, bool orthographic = false, int width = 128, int height = 96) {
  Camera camera{.projection = orthographic ? Camera::Projection::orthographic : Camera::Projection::perspective,
                .vertical_fov_degrees = 40,
                .parallel_height = 2.6,
                .position = eye};
  return make_view(camera, width, height).value();
}

inline DrawList list_of(const std::vector<MomentsSplat>& splats) {
  return test::make_list(splats, {{dvec3(0), 0, splats.size()}});
}

/// A pixel's ray.
struct Ray {
  dvec3 origin, direction;  // of length 1
};

inline Ray ray_of(const View& view, int x, int y) {
  const double a = (x + 0.5 - 0.5 * view.width) / view.focal, b = (y + 0.5 - 0.5 * view.height) / view.focal;
  if (view.orthographic) return {view.eye + a * view.right + b * view.up, view.forward};
  return {view.eye, glm::normalize(a * view.right + b * view.up + view.forward)};
}

/// The way of a ray through a body, in front of the eye: from its first to its second number.
inline std::pair<double, double> crossing(const Ray& ray, const Body& body) {
  const dvec3 a = (body.low - ray.origin) / ray.direction, b = (body.high - ray.origin) / ray.direction;
  const dvec3 near = glm::min(a, b), far = glm::max(a, b);
  const double begin = std::max({near.x, near.y, near.z, 0.0}), end = std::min({far.x, far.y, far.z});
  return {begin, std::max(begin, end)};
}

/// The exact picture of bodies that do not overlap. With `surfaces`, that of what is in front of them.
inline Image exact(const std::vector<Body>& bodies, double extinction, const View& view,
                   const SurfaceDepths* surfaces = nullptr) {
  Image image{view.width, view.height, {}};
  image.pixels.resize(static_cast<std::size_t>(view.width) * view.height);
  for (int y = 0; y < view.height; ++y)
    for (int x = 0; x < view.width; ++x) {
      const Ray ray = ray_of(view, x, y);
      const int pixel = (view.height - 1 - y) * view.width + x;
      const double farthest =
          surfaces ? surfaces->depths[static_cast<std::size_t>(pixel)] / glm::dot(ray.direction, view.forward)
                   : std::numeric_limits<double>::infinity();
      double length = 0;
      for (const Body& body : bodies) {
        const auto [begin, end] = crossing(ray, body);
        length += std::max(std::min(end, farthest) - begin, 0.0);
      }
      image.at(x, view.height - 1 - y) = vec4(static_cast<float>(-std::expm1(-extinction * length)));
    }
  return image;
}

}  // namespace splatvol::test
