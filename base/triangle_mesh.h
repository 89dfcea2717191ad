// Triangles of a surface.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "base/math.h"

namespace splatvol {

/// A surface of triangles. Coordinates are at most 1e50 in size.
struct TriangleMesh {
  std::vector<dvec3> points;                            // world units
  std::vector<std::array<std::uint32_t, 3>> triangles;  // indices into points, in any orientation
};

}  // namespace splatvol
