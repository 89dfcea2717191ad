// Positions in a tetrahedron.
#pragma once

#include <array>
#include <optional>

#include "base/math.h"

namespace splatvol {

/// Returns how far a computed position may be from where it should be, for one with coordinates as large as these.
[[nodiscard]] double rounding_of(const dvec3& position);

/// The corners of a tetrahedron, in ascending order of their ranks. Then two that share a face agree to the last bit on
/// which side of it a position lies.
using TetrahedronCorners = std::array<dvec3, 4>;

/// Weights of the corners, which add up to 1.
using CornerWeights = std::array<double, 4>;

/// Returns the mean of the values at the corners. It is not outside of their range.
[[nodiscard]] double value_at(const std::array<double, 4>& values, const CornerWeights& weights);

/// Returns the barycentric coordinates of a position in the tetrahedron or on its surface; none outside, or if the
/// tetrahedron is flat. At a corner, its weight is exactly 1.
[[nodiscard]] std::optional<CornerWeights> weights_in(const TetrahedronCorners& corners, const dvec3& position);

/// A point of a tetrahedron's surface.
struct SurfacePoint {
  double distance;  // from the position that it is near to
  CornerWeights weights;
};

/// Returns the nearest point of the surface to a position that is not inside; none if it is farther than `reach`. Takes
/// flat tetrahedra.
[[nodiscard]] std::optional<SurfacePoint> nearest_on(const TetrahedronCorners& corners, const dvec3& position,
                                                     double reach);

/// Returns the weights of the point of a triangle that is nearest to a position.
[[nodiscard]] std::array<double, 3> nearest_on(const std::array<dvec3, 3>& triangle, const dvec3& position);

}  // namespace splatvol
