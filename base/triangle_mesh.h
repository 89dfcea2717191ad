// Triangles of a surface.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"

namespace splatvol {

/// A surface of triangles. Coordinates are at most 1e50 in size.
struct TriangleMesh {
  std::vector<dvec3> points;                            // world units
  std::vector<std::array<std::uint32_t, 3>> triangles;  // indices into points, in any orientation
  bool open_end = false;                                // its text file ends with a number: it may be cut off

  /// Of a boundary, [triangle]: cells are on both sides, or it is not known where they are. Empty: of no triangle. All
  /// other triangles run counterclockwise from outside.
  std::vector<bool> two_sided = {};

  [[nodiscard]] bool is_two_sided(std::size_t triangle) const { return !two_sided.empty() && two_sided[triangle]; }
};

/// Returns the middle of a triangle.
[[nodiscard]] inline dvec3 middle_of(const TriangleMesh& mesh, std::size_t triangle) {
  const auto& [a, b, c] = mesh.triangles[triangle];
  return (mesh.points[a] + mesh.points[b] + mesh.points[c]) / 3.0;
}

/// A patch: a part of a mesh's boundary that has a name.
struct Patch {
  std::string name;
  TriangleMesh mesh;
};

/// Reads the triangles of a file. Errors begin with the path.
using ReadSurface = std::function<Result<TriangleMesh>(const std::string& path)>;

}  // namespace splatvol
