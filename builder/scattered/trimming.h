// Trims a Delaunay triangulation to its domain: tetrahedra that bridge holes and concavities do not belong to it.
#pragma once

#include <algorithm>
#include <span>
#include <vector>

#include "base/math.h"
#include "builder/mesh/moments.h"

namespace splatvol {

/// Returns the circumradius of a tetrahedron; infinite if its corners lie on a plane up to rounding.
[[nodiscard]] double circumradius(std::span<const dvec3> positions, const Tetrahedron& corners);

/// Returns the circumradius of each tetrahedron. In parallel.
[[nodiscard]] std::vector<double> circumradii(std::span<const dvec3> positions,
                                              std::span<const Tetrahedron> tetrahedra);

/// A tetrahedron does not count for the usual circumradius at a point if its own is more than this many times the
/// smallest at that point. The number of tetrahedra across a void then does not matter.
inline constexpr double max_radius_spread = 4;

/// Returns the usual circumradius at each point, 0 if it has no tetrahedra. In a boundary layer every circumradius is
/// about the larger spacing; in a hole it is that of the hole. Half of the tetrahedra at a boundary point may lie
/// outside, so the lower quartile is the usual one. At edges nearly all lie outside, and the neighbours know better: so
/// the tetrahedra count of all points that share one with this point. In parallel. Requires the radii of all
/// tetrahedra.
[[nodiscard]] std::vector<double> usual_radii(std::size_t points, std::span<const Tetrahedron> tetrahedra,
                                              std::span<const double> radii);

/// The largest ratio of a kept circumradius to the usual one. Above 2, the holes of thin bodies fill up; below 2,
/// random points lose tetrahedra inside.
inline constexpr double max_radius_ratio = 2;

/// Returns the largest circumradius with which a tetrahedron is kept. The result is an alpha shape whose alpha follows
/// the points.
[[nodiscard]] inline double largest_kept(std::span<const double> usual, const Tetrahedron& corners) {
  return max_radius_ratio * std::max({usual[corners[0]], usual[corners[1]], usual[corners[2]], usual[corners[3]]});
}

/// Whether the tetrahedra have volume by rounding only, as all points lie on a plane. Layers of cells, however thin,
/// hold far more volume.
[[nodiscard]] bool is_flat(std::span<const dvec3> positions, std::span<const Tetrahedron> tetrahedra);

}  // namespace splatvol
