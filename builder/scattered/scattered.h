// Tetrahedra that join points without cells.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "builder/mesh/moments.h"

namespace splatvol {

/// How the points are joined to a volume.
enum class Connectivity {
  automatic,  // the input's cells if it has any, else by the number of points
  mesh,
  delaunay,  // delaunay_tetrahedra
  none,      // Voronoi cells: SampledCells
  boxes,     // BoxEstimate
};

/// Returns the first point at each position, by ascending x, then y, then z. Requires finite positions, and no more
/// points than an index can name.
[[nodiscard]] std::vector<std::uint32_t> distinct_points(std::span<const dvec3> positions);

/// Returns the tetrahedra of the Delaunay triangulation, without those that bridge holes and concavities of the domain:
/// their circumradius is out of proportion to the usual one at their corners, whatever the aspect ratio there. Corners
/// are in ascending order, tetrahedra in lexicographic order, for any number of threads. The first of coincident points
/// takes part, the others have no tetrahedra. Empty if no four points span a volume; an estimate still shows such
/// points. Fails with more points than an index can name, and if this thread's stop is requested. Looks for
/// one about once a second, and tells `progress` then, in [0, 1]; it may be empty. Requires finite positions.
[[nodiscard]] Result<std::vector<Tetrahedron>> delaunay_tetrahedra(std::span<const dvec3> positions,
                                                                   const std::function<void(double)>& progress = {});

}  // namespace splatvol
