// Neighbours among a few scattered points.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "base/math.h"

namespace splatvol {

/// Two points, by index.
using Edge = std::array<std::uint32_t, 2>;

/// Returns the edges of the Delaunay triangulation of a few thousand points at most. For points on one plane or line,
/// that is the triangulation within the plane or line. The edges join all points; each comes once, in any order. They
/// do not depend on the order of the points, even of cospherical ones. Requires finite positions, no two alike; it is
/// faster if near points are near in the order. Thread-safe.
[[nodiscard]] std::vector<Edge> delaunay_edges(std::span<const dvec3> positions);

}  // namespace splatvol
