// Cells against what a camera sees.
#pragma once

#include <array>

#include "base/math.h"
#include "scene/scene.h"

namespace splatvol {

/// The part of space in front of the eye, and in the clip box where there is one, that projects into the image, or not
/// farther outside of it than a splat without size reaches.
class Frustum {
 public:
  /// `smallest_reach_pixels`: how far a splat without size is drawn.
  Frustum(const View& view, double smallest_reach_pixels);

  /// Whether a ball of radius `reach` around any point of the cube may touch the frustum; never wrongly false.
  [[nodiscard]] bool touches(const Cube& cube, double reach) const;

  /// Least view depth of the cube; 0 or less where it reaches the eye's plane.
  [[nodiscard]] double nearest_depth(const Cube& cube) const;

  /// How much of the image's shorter side a length covers at a view depth, in percent. Infinite in perspective at the
  /// eye's plane and behind it.
  [[nodiscard]] double covered_percent(double length, double depth) const;

 private:
  struct Plane {
    dvec3 normal;   // inwards, length 1
    double offset;  // signed distance of the eye
  };
  [[nodiscard]] double farthest(const Plane& plane, const Cube& cube) const;

  View view_;
  std::array<Plane, 5> planes_;
};

}  // namespace splatvol
