// Surfaces for tests.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>
#include <numbers>
#include <string>

#include "base/triangle_mesh.h"

namespace splatvol::test {

/// A ball of `rings` times twice as many quadrilaterals between circles of latitude; triangles at the poles. Its
/// vertices lie on the sphere. It is closed: neighbours share their vertices.
inline TriangleMesh ball(dvec3 center, double radius, std::uint32_t rings) {
  TriangleMesh mesh;
  const std::uint32_t around = 2 * rings;
  mesh.points.push_back(center + dvec3(0, radius, 0));
  for (std::uint32_t ring = 1; ring < rings; ++ring)
    for (std::uint32_t i = 0; i < around; ++i) {
      const double theta = std::numbers::pi * ring / rings, phi = 2 * std::numbers::pi * i / around;
      mesh.points.push_back(
          center + radius * dvec3(std::sin(theta) * std::cos(phi), std::cos(theta), std::sin(theta) * std::sin(phi)));
    }
  mesh.points.push_back(center - dvec3(0, radius, 0));
  const auto last = static_cast<std::uint32_t>(mesh.points.size() - 1);
  const auto at = [&](std::uint32_t ring, std::uint32_t i) {
    return ring == 0 ? 0 : ring == rings ? last : 1 + (ring - 1) * around + i % around;
  };
  for (std::uint32_t ring = 0; ring < rings; ++ring)
    for (std::uint32_t i = 0; i < around; ++i) {
      if (ring > 0) mesh.triangles.push_back({at(ring, i), at(ring, i + 1), at(ring + 1, i + 1)});
      if (ring + 1 < rings) mesh.triangles.push_back({at(ring, i), at(ring + 1, i + 1), at(ring + 1, i)});
    }
  return mesh;
}

/// A parallelogram of `parts` x `parts` cells, each two triangles.
inline TriangleMesh plate(dvec3 corner, dvec3 u, dvec3 v, std::uint32_t parts = 1) {
  TriangleMesh mesh;
  for (std::uint32_t j = 0; j <= parts; ++j)
    for (std::uint32_t i = 0; i <= parts; ++i)
      mesh.points.push_back(corner + static_cast<double>(i) / parts * u + static_cast<double>(j) / parts * v);
  for (std::uint32_t j = 0; j < parts; ++j)
    for (std::uint32_t i = 0; i < parts; ++i) {
      const std::uint32_t first = j * (parts + 1) + i;
      mesh.triangles.push_back({first, first + 1, first + parts + 2});
      mesh.triangles.push_back({first, first + parts + 2, first + parts + 1});
    }
  return mesh;
}

/// The bytes of a binary .stl file.
inline std::string stl_of(const TriangleMesh& mesh) {
  std::string bytes(80, '\0');
  const auto add = [&](const auto& value) {
    const std::size_t at = bytes.size();
    bytes.resize(at + sizeof(value));
    std::memcpy(&bytes[at], &value, sizeof(value));
  };
  add(static_cast<std::uint32_t>(mesh.triangles.size()));
  for (const auto& triangle : mesh.triangles) {
    for (int i = 0; i < 3; ++i) add(0.0F);
    for (const std::uint32_t corner : triangle)
      for (int axis = 0; axis < 3; ++axis) add(static_cast<float>(mesh.points[corner][axis]));
    add(std::uint16_t{0});
  }
  return bytes;
}

}  // namespace splatvol::test
