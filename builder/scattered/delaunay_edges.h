// Which points are neighbours.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "base/math.h"

namespace splatvol {

/// Two points, by index.
using Edge = std::array<std::uint32_t, 2>;

/// Edges of the Delaunay triangulation of a few thousand points at most; of points on one plane or line, of the
/// triangulation there. They join all points. In any order, each once; of cospherical points the same whatever the
/// points' order. Requires finite positions, no two alike, near each other in the order for speed. Thread-safe.
[[nodiscard]] std::vector<Edge> delaunay_edges(std::span<const dvec3> positions);

}  // namespace splatvol
