#include "builder/sources/openfoam/foam_rounding.h"

#include <algorithm>
#include <cmath>

#include "builder/mesh/usable_numbers.h"

namespace splatvol {
namespace {

constexpr int significant_bits = 40;
constexpr double least_steps = 4096;  // of the shortest edge

}  // namespace

void PointRounding::include(const FoamMesh& mesh) {
  for (std::size_t face = 0; face < mesh.faces.size(); ++face) {
    const auto corners = mesh.faces[face];
    dvec3 before = mesh.points[corners.back()];
    for (const std::uint32_t corner : corners) {
      const dvec3 p = mesh.points[corner];
      const double squared = squared_length(p - before);
      before = p;
      if (!is_usable_position(p)) continue;
      for (int axis = 0; axis < 3; ++axis) largest_ = std::max(largest_, std::abs(p[axis]));
      if (squared > 0) shortest_ = std::min(shortest_, squared);
    }
  }
}

double PointRounding::step() const {
  if (!(largest_ > 0)) return 0;
  const double step = std::ldexp(1.0, std::ilogb(largest_) + 1 - significant_bits);
  return std::sqrt(shortest_) >= least_steps * step ? step : 0;
}

void round_points(double step, std::span<dvec3> points) {
  for (dvec3& p : points) {
    if (!is_usable_position(p)) continue;
    for (int axis = 0; axis < 3; ++axis) p[axis] = std::nearbyint(p[axis] / step) * step + 0.0;  // no -0
  }
}

}  // namespace splatvol
