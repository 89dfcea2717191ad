// A box that is large enough for material that its points bring along.
#pragma once

#include <algorithm>
#include <cmath>

#include "base/math.h"
#include "builder/mesh/moments.h"

namespace splatvol {

/// Returns a bound on the deviation of material along any direction.
[[nodiscard]] inline double deviation_bound(const SpatialMoments& moments) {
  const SymmetricMatrix& s = moments.covariance;
  return std::sqrt(std::max(0.0, s.xx + s.yy + s.zz));
}

/// Returns a box round points whose material deviates by at most `deviation`, grown about its middle until its longest
/// side is twice as long. No cluster in the cube round this box then deviates by more than the cube's edge, which is
/// the bound of the file (spec 8). Most boxes stay as they are: a few large cells have a box of points that is smaller
/// than they are.
[[nodiscard]] inline Box grown_for_material(const Box& box, double deviation) {
  const double least = 2 * deviation;
  const dvec3 extent = box.extent();
  if (!(box.low.x <= box.high.x) || std::max({extent.x, extent.y, extent.z}) >= least) return box;
  const dvec3 growth = glm::max(dvec3(0), 0.5 * (dvec3(least) - extent));
  return {box.low - growth, box.high + growth};
}

}  // namespace splatvol
