#include "tools/svtruth_surfaces.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

#include "base/names.h"
#include "sampler/box_tree.h"
#include "sampler/tetrahedron.h"

namespace splatvol {
namespace {

// Appends `other`, with all its triangles behind those of `mesh`.
void append(const TriangleMesh& other, TriangleMesh& mesh) {
  const auto first = static_cast<std::uint32_t>(mesh.points.size());
  mesh.points.insert(mesh.points.end(), other.points.begin(), other.points.end());
  for (std::size_t i = 0; i < other.triangles.size(); ++i) {
    const auto [a, b, c] = other.triangles[i];
    mesh.triangles.push_back({first + a, first + b, first + c});
    mesh.two_sided.push_back(other.is_two_sided(i));
  }
}

// A tetrahedron with its values.
struct Sampled {
  TetrahedronCorners corners;
  std::array<double, 4> values;
};

Sampled sampled_of(const TetMesh& mesh, std::size_t tetrahedron) {
  auto numbers = mesh.tetrahedra[tetrahedron];
  std::ranges::sort(numbers);
  Sampled sampled;
  for (std::size_t k = 0; k < 4; ++k) {
    sampled.corners[k] = mesh.points[numbers[k]];
    sampled.values[k] = mesh.values[mesh.constant ? tetrahedron : numbers[k]];
  }
  return sampled;
}

}  // namespace

Result<TriangleMesh> join_patches(const std::string& path, const std::string& pattern, const Boundary& boundary) {
  std::vector<std::string> names;
  for (const Patch& patch : boundary.patches) names.push_back(patch.name);
  SPLATVOL_TRY_ASSIGN(found, find_patches(path, pattern, names));
  TriangleMesh joined;
  for (const std::size_t number : found) append(boundary.patches[number].mesh, joined);
  return joined;
}

std::vector<double> sample_mesh(const TetMesh& mesh, std::span<const dvec3> positions) {
  constexpr double infinity = std::numeric_limits<double>::infinity();
  std::vector<double> values(positions.size(), std::numeric_limits<double>::quiet_NaN());
  std::vector<double> distances(positions.size(), infinity);  // from the tetrahedron that has the value
  const BoxTree tree(positions);
  for (std::size_t t = 0; t < mesh.tetrahedra.size() && !tree.empty(); ++t) {
    const Sampled sampled = sampled_of(mesh, t);
    if (!std::ranges::all_of(sampled.values, [](double value) { return std::isfinite(value); })) continue;
    Box box;
    for (const dvec3& corner : sampled.corners) box.include(corner);
    // A position on a face may be a little outside of all tetrahedra, after rounding.
    const double reach = std::max(rounding_of(box.low), rounding_of(box.high));
    box.low -= reach, box.high += reach;
    tree.visit_near(box, [&](std::uint32_t i) {
      if (!(distances[i] > 0) || squared_distance(box, positions[i]) > 0) return;
      if (const auto weights = weights_in(sampled.corners, positions[i])) {
        distances[i] = 0, values[i] = value_at(sampled.values, *weights);
        return;
      }
      const auto nearest = nearest_on(sampled.corners, positions[i], reach);
      if (nearest && nearest->distance < distances[i])
        distances[i] = nearest->distance, values[i] = value_at(sampled.values, nearest->weights);
    });
  }
  return values;
}

}  // namespace splatvol
