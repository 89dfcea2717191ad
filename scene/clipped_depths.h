// What the clip region leaves of a ray.
#pragma once

#include "scene/scene.h"

namespace splatvol {

/// Returns what a scene's clip box and active clip planes leave.
[[nodiscard]] ClipRegion clip_region_of(const Scene& scene);

/// Depths (view coordinate z) between which something is shown; empty unless from < to.
struct VisibleDepths {
  double from, to;
};

/// Returns the depths at which a ray is in front of the eye and in the clip region. The ray has the points (a z, b z,
/// z) in perspective, and (a, b, z) in orthographic projection.
[[nodiscard]] VisibleDepths clipped_depths(const View& view, double a, double b);

/// Returns whether the position at a depth of such a ray is outside of the clip region. One in a face of the region is
/// inside.
[[nodiscard]] bool is_clipped(const View& view, double a, double b, double depth);

/// Where rays meet a plane. The view must outlive it.
class PlaneDepths {
 public:
  PlaneDepths(const View& view, const Plane& plane);

  /// Returns the depth at which a ray meets the plane. Infinity: nowhere, outside of the clip region, or behind the
  /// eye's plane.
  [[nodiscard]] double at(double a, double b) const;

 private:
  const View& view_;
  dvec3 normal_;  // in view coordinates
  double distance_;
};

}  // namespace splatvol
