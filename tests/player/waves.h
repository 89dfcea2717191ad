// A field on a cube of meshes, and a scene that shows it.
#pragma once

#include <cmath>

#include "base/math.h"
#include "scene/scene.h"

namespace splatvol::test {

inline double waves(dvec3 p) { return double{static_cast<float>(p.x + 0.3 * std::sin(8 * p.y))}; }

/// The cube [0, 1]^3 from outside: low and high values show, those between do not.
inline Scene scene_of_waves(int width, int height) {
  Scene scene;
  scene.width = width;
  scene.height = height;
  scene.attribute = "value";
  scene.camera.position = {0.4, 0.7, 3};
  scene.camera.focal_point = dvec3(0.5);
  scene.transfer_function.lo = -0.3;
  scene.transfer_function.hi = 1.3;
  scene.transfer_function.colors = {{0, dvec3(0, 0.2, 1)}, {1, dvec3(1, 0.5, 0)}};
  scene.transfer_function.densities = {{0, 1.0}, {0.5, 0.0}, {1, 8.0}};
  return scene;
}

}  // namespace splatvol::test
