// Tells whether nodes are in view.
#pragma once

#include <array>

#include "base/math.h"
#include "scene/scene.h"

namespace splatvol {

/// The part of space that may appear in the image. It is in front of the eye, and inside the clip box if there is one.
/// It projects into the image, or no farther outside than a splat without size reaches.
class Frustum {
 public:
  /// `smallest_reach_pixels`: how far from its centre a splat without size is drawn.
  Frustum(const View& view, double smallest_reach_pixels);

  /// Whether a ball of radius `reach` round any point of the cube may touch the frustum. Never wrongly false.
  [[nodiscard]] bool touches(const Cube& cube, double reach) const;

  /// Returns the least view depth of the cube; 0 or less if the cube reaches the eye's plane.
  [[nodiscard]] double nearest_depth(const Cube& cube) const;

  /// Returns the share of the image's shorter side that a length covers at a view depth, in per cent. In perspective,
  /// it is infinite at the eye's plane and behind.
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
