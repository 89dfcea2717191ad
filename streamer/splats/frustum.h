// Tells whether nodes are in view.
#pragma once

#include <array>

#include "base/math.h"
#include "scene/scene.h"

namespace splatvol {

/// Whether all of a cube is on the side of the plane to which its normal points.
[[nodiscard]] bool lies_inside(const Cube& cube, const Plane& plane);

/// Whether some of a cube may lie outside of a region.
[[nodiscard]] bool is_clipped(const Cube& cube, const ClipRegion& clip);

/// Whether a ball of radius `reach` round a position in the cube may meet the plane. Never wrongly false.
[[nodiscard]] bool meets(const Cube& cube, double reach, const Plane& plane);

/// The part of space that may appear in the image. It is in front of the eye, and inside of the view's clip region. It
/// projects into the image, or no farther outside than a splat without size reaches.
class Frustum {
 public:
  /// `smallest_reach_pixels`: how far from its centre a splat without size is drawn.
  Frustum(const View& view, double smallest_reach_pixels);

  /// Whether a ball of radius `reach` round any point of the cube may touch the frustum. Never wrongly false.
  [[nodiscard]] bool touches(const Cube& cube, double reach) const;

  /// Whether any point of a box, which may be flat, may be in the frustum. Never wrongly false.
  [[nodiscard]] bool touches(const Box& box) const;

  /// Returns the least view depth of the cube; 0 or less if the cube reaches the eye's plane.
  [[nodiscard]] double nearest_depth(const Cube& cube) const;

  /// Returns the share of the image's shorter side that a length covers at a view depth, in per cent. In perspective,
  /// it is infinite at the eye's plane and behind.
  [[nodiscard]] double covered_percent(double length, double depth) const;

 private:
  struct Side {
    dvec3 normal;   // inwards, length 1
    double offset;  // signed distance of the eye
  };
  [[nodiscard]] double farthest(const Side& side, const Cube& cube) const;

  View view_;
  std::array<Side, 5> sides_;
};

}  // namespace splatvol
