// The material of whole cells.
#pragma once

#include <span>

#include "base/math.h"
#include "builder/mesh/moments.h"

namespace splatvol {

/// A cell's material: its moments are about `centroid`.
struct CellMoments {
  dvec3 centroid{0};
  SpatialMoments moments;
};

/// The volume of a tetrahedron; 0 if it is flat, or too large for double precision.
[[nodiscard]] double tetrahedron_volume(std::span<const dvec3> positions, const Tetrahedron& corners);

/// Returns the exact moments of a cell from the tetrahedra that fill it, whose volumes are absolute. The mass is 0, and
/// the centroid does not count, if none has a volume. Requires indices in range.
[[nodiscard]] CellMoments cell_moments(std::span<const dvec3> positions, std::span<const Tetrahedron> tetrahedra);

/// Returns the mean over a cell of values that are linear in each of its tetrahedra. A tetrahedron with a value that is
/// not finite does not count; NaN if no tetrahedron with a volume is left. `values`: of all positions.
[[nodiscard]] double cell_mean(std::span<const dvec3> positions, std::span<const Tetrahedron> tetrahedra,
                               std::span<const double> values);

}  // namespace splatvol
