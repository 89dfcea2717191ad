// Which tetrahedra of a Delaunay triangulation belong to the domain: not those that bridge its holes and concavities.
#pragma once

#include <algorithm>
#include <span>
#include <vector>

#include "base/math.h"
#include "builder/mesh/moments.h"

namespace splatvol {

/// Infinite where the corners lie on a plane as far as rounding can tell.
[[nodiscard]] double circumradius(std::span<const dvec3> positions, const Tetrahedron& corners);

/// Of each tetrahedron. In parallel.
[[nodiscard]] std::vector<double> circumradii(std::span<const dvec3> positions,
                                              std::span<const Tetrahedron> tetrahedra);

/// Tetrahedra at a point whose circumradius is more than this many times the smallest there say nothing of what is
/// usual: nobody need know how many there are across a void.
inline constexpr double max_radius_spread = 4;

/// What is usual at each point, 0 where it has no tetrahedra. In a boundary layer every circumradius is about the
/// larger spacing, in a hole it is that of the hole. Half of the tetrahedra at a point of the boundary may lie outside,
/// so the usual circumradius at a point is the lower quartile; and where nearly all do, at edges, its neighbours know
/// better: so it depends on the tetrahedra of the points that share one with it. In parallel. Requires radii of all
/// tetrahedra.
[[nodiscard]] std::vector<double> usual_radii(std::size_t points, std::span<const Tetrahedron> tetrahedra,
                                              std::span<const double> radii);

/// The largest circumradius with which a tetrahedron is kept, as an alpha shape whose alpha follows the points.
[[nodiscard]] inline double largest_kept(std::span<const double> usual, const Tetrahedron& corners) {
  // Over 2, thin bodies fill up; under it, points at random lose tetrahedra inside.
  constexpr double max_radius_ratio = 2;
  return max_radius_ratio * std::max({usual[corners[0]], usual[corners[1]], usual[corners[2]], usual[corners[3]]});
}

/// Whether rounding alone keeps the points apart from a plane. Layers of cells, however thin, hold far more.
[[nodiscard]] bool is_flat(std::span<const dvec3> positions, std::span<const Tetrahedron> tetrahedra);

}  // namespace splatvol
