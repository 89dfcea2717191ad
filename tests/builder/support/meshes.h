// Meshes for the builder's tests: lattices of cubes, each cut into six tetrahedra, under any mapping.
#pragma once

#include <functional>
#include <limits>
#include <random>
#include <vector>

#include "base/math.h"
#include "builder/mesh/moments.h"
#include "builder/sources/source.h"
#include "tests/support/random.h"

namespace splatvol::test {

struct Mesh {
  std::vector<dvec3> points;
  std::vector<Tetrahedron> tetrahedra;
};

/// Boxes that fill [0, 1]^3, then mapped. `cells`: their number along each axis.
inline Mesh lattice(
    const std::array<std::uint32_t, 3>& cells, const std::function<dvec3(dvec3)>& map = [](dvec3 p) { return p; }) {
  Mesh mesh;
  const auto [nx, ny, nz] = cells;
  for (std::uint32_t z = 0; z <= nz; ++z)
    for (std::uint32_t y = 0; y <= ny; ++y)
      for (std::uint32_t x = 0; x <= nx; ++x) mesh.points.push_back(map(dvec3(x, y, z) / dvec3(nx, ny, nz)));
  const std::array<std::uint32_t, 3> stride = {1, nx + 1, (nx + 1) * (ny + 1)};
  for (std::uint32_t z = 0; z < nz; ++z)
    for (std::uint32_t y = 0; y < ny; ++y)
      for (std::uint32_t x = 0; x < nx; ++x)
        for (const auto& [a, b, c] : {std::array{0, 1, 2}, {1, 2, 0}, {2, 0, 1}, {0, 2, 1}, {2, 1, 0}, {1, 0, 2}}) {
          const std::uint32_t first = x + y * stride[1] + z * stride[2];
          const std::uint32_t second = first + stride[static_cast<std::size_t>(a)];
          const std::uint32_t third = second + stride[static_cast<std::size_t>(b)];
          mesh.tetrahedra.push_back({first, second, third, third + stride[static_cast<std::size_t>(c)]});
        }
  return mesh;
}

inline Mesh lattice(
    std::uint32_t cells, const std::function<dvec3(dvec3)>& map = [](dvec3 p) { return p; }) {
  return lattice(std::array{cells, cells, cells}, map);
}

/// Moves each point by up to `share` of the spacing along each axis.
inline Mesh jittered(std::uint32_t cells, double share) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> uniform(-share / cells, share / cells);
  Mesh mesh = lattice(cells);
  for (dvec3& p : mesh.points) p += random_vector(uniform, random);
  return mesh;
}

/// Tetrahedra that share no points, of any shape and orientation.
inline Mesh random_tetrahedra(std::uint32_t count) {
  std::mt19937_64 random(11);
  std::uniform_real_distribution<double> uniform(0, 1);
  Mesh mesh;
  for (std::uint32_t t = 0; t < count; ++t) {
    for (int k = 0; k < 4; ++k) mesh.points.push_back(random_vector(uniform, random));
    mesh.tetrahedra.push_back({4 * t, 4 * t + 1, 4 * t + 2, 4 * t + 3});
  }
  return mesh;
}

inline double volume(const Mesh& mesh) {
  double sum = 0;
  for (const auto& [a, b, c, d] : mesh.tetrahedra) {
    const dvec3 &p = mesh.points[a], &q = mesh.points[b], &r = mesh.points[c], &s = mesh.points[d];
    sum += std::abs(glm::dot(q - p, glm::cross(r - p, s - p))) / 6;
  }
  return sum;
}

inline std::vector<double> sample(const Mesh& mesh, const std::function<double(dvec3)>& field) {
  std::vector<double> values;
  for (const dvec3& p : mesh.points) values.push_back(field(p));
  return values;
}

/// The value at a position by Cramer's rule, in the first tetrahedron that has the position; NaN: none has it.
inline double value_in(const Mesh& mesh, const std::vector<double>& values, const dvec3& position) {
  for (const auto& [a, b, c, d] : mesh.tetrahedra) {
    const dvec3& origin = mesh.points[a];
    const dmat3 edges(mesh.points[b] - origin, mesh.points[c] - origin, mesh.points[d] - origin);
    const dvec3 weights = glm::inverse(edges) * (position - origin);
    if (weights.x < 0 || weights.y < 0 || weights.z < 0 || weights.x + weights.y + weights.z > 1) continue;
    return values[a] + glm::dot(weights, dvec3(values[b], values[c], values[d]) - values[a]);
  }
  return std::numeric_limits<double>::quiet_NaN();
}

/// The material of every vertex: of all of it, and of a value.
struct MeshMaterial {
  std::vector<SpatialMoments> moments;
  std::vector<ValueMoments> value_moments;
  std::vector<dvec3> gradients;
};

inline MeshMaterial material_of(const Mesh& mesh, const std::vector<double>& values) {
  const VertexMaterial material(mesh.points, mesh.tetrahedra);
  VertexBlock block;
  MeshMaterial result;
  const auto add = [&](std::size_t, const SpatialMoments& moments, std::span<const VertexValue> found) {
    result.moments.push_back(moments);
    result.value_moments.push_back(found[0].moments);
    result.gradients.push_back(found[0].gradient);
  };
  material.find_values(0, mesh.points.size(), {&values, 1}, true, block, add);
  return result;
}

/// The moments of every vertex's part of the tetrahedra.
inline std::vector<SpatialMoments> moments_of(const Mesh& mesh) {
  return material_of(mesh, std::vector<double>(mesh.points.size())).moments;
}

inline std::vector<ValueMoments> value_moments_of(const Mesh& mesh, const std::vector<double>& values) {
  return material_of(mesh, values).value_moments;
}

inline std::vector<dvec3> gradients_of(const Mesh& mesh, const std::vector<double>& values) {
  return material_of(mesh, values).gradients;
}

}  // namespace splatvol::test
