// The least heights of tetrahedra: how far a file may move their corners.
#pragma once

#include <limits>
#include <span>
#include <vector>

#include "base/math.h"
#include "builder/mesh/moments.h"

namespace splatvol {

/// A tetrahedron with a lower height, as a share of its longest edge, is flat.
inline constexpr double flat_height = 1e-6;

/// Returns the least height of a tetrahedron: three times its volume over the area of its largest face. 0 if it is
/// flat, or if a position is not finite.
[[nodiscard]] double least_height(const dvec3& a, const dvec3& b, const dvec3& c, const dvec3& d);

/// Returns the least of the heights of the tetrahedra at each point, flat ones left out; infinity at a point without
/// any. Does not depend on the order of the tetrahedra.
[[nodiscard]] std::vector<double> least_heights(std::span<const dvec3> points, std::span<const Tetrahedron> tetrahedra);

/// The height at a point that has no tetrahedron.
inline constexpr double no_height = std::numeric_limits<double>::infinity();

/// No coordinate of a corner may move by more than this share of its height. The corner then moves by at most 1/256 of
/// the height. The least height stands on the largest face: its four corners change it by at most their four moves. So
/// no tetrahedron is turned inside out, and none loses more than 1/64 of its least height.
inline constexpr double error_per_height = 1 / (256 * 1.7320508075688772);

}  // namespace splatvol
