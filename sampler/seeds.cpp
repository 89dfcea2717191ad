#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <glm/common.hpp>
#include <limits>
#include <numbers>
#include <utility>

#include "base/names.h"
#include "base/triangle_mesh.h"
#include "sampler/streamlines.h"

namespace splatvol {
namespace {

// The share of the way of a seed, of so many.
double share_of(std::size_t number, std::size_t count) {
  return count == 1 ? 0.5 : static_cast<double>(number) / static_cast<double>(count - 1);
}

std::vector<dvec3> on(const std::vector<dvec3>& seeds) { return seeds; }

std::vector<dvec3> on(const SeedLine& line) {
  std::vector<dvec3> seeds;
  for (std::size_t i = 0; i < line.count; ++i) seeds.push_back(glm::mix(line.start, line.end, share_of(i, line.count)));
  return seeds;
}

std::vector<dvec3> on(const SeedRectangle& rectangle) {
  std::vector<dvec3> seeds;
  for (std::size_t j = 0; j < rectangle.counts[1]; ++j)
    for (std::size_t i = 0; i < rectangle.counts[0]; ++i)
      seeds.push_back(rectangle.corner + share_of(i, rectangle.counts[0]) * (rectangle.first - rectangle.corner) +
                      share_of(j, rectangle.counts[1]) * (rectangle.second - rectangle.corner));
  return seeds;
}

std::vector<dvec3> on(const SeedPatch& /*patch*/) { return {}; }

double area_of(const TriangleMesh& mesh, const std::array<std::uint32_t, 3>& triangle) {
  const dvec3& a = mesh.points[triangle[0]];
  return 0.5 * glm::length(glm::cross(mesh.points[triangle[1]] - a, mesh.points[triangle[2]] - a));
}

// Each seed has the same share of the area, in the order of the triangles.
Result<std::vector<dvec3>> positions_on(const SeedPatch& patch, const format::Volume& volume, std::uint64_t memory) {
  if (!volume.info().boundary)
    return fail(ErrorCode::invalid_argument,
                "{}: holds no boundary, and so no patch \"{}\": svbuild --boundary keeps it", volume.name(),
                patch.patch);
  std::vector<std::string> names;
  for (const format::PatchInfo& info : volume.info().boundary->patches) names.push_back(info.name);
  SPLATVOL_TRY_ASSIGN(patches, find_patches(volume.name(), patch.patch, names));
  std::uint64_t bytes = 0;
  for (const std::size_t number : patches) {
    const format::PatchInfo& info = volume.info().boundary->patches[number];
    bytes += sizeof(dvec3) * info.points + sizeof(TriangleMesh::triangles[0]) * info.triangles;
  }
  if (bytes > memory)
    return fail(ErrorCode::out_of_budget, "{}: the patch \"{}\" takes {} bytes, and memory has room for {}",
                volume.name(), patch.patch, bytes, memory);
  SPLATVOL_TRY_ASSIGN(mesh, volume.read_boundary(patches));
  double all = 0;
  for (const auto& triangle : mesh.triangles) all += area_of(mesh, triangle);
  if (!(all > 0))
    return fail(ErrorCode::invalid_argument, "{}: the patch \"{}\" has no area for seeds", volume.name(), patch.patch);
  std::vector<dvec3> seeds;
  double before = 0;
  for (const auto& triangle : mesh.triangles) {
    const double area = area_of(mesh, triangle);
    while (seeds.size() < patch.count) {
      const double number = static_cast<double>(seeds.size()) + 0.5;
      const double share = (number / static_cast<double>(patch.count) * all - before) / area;
      if (!(share < 1)) break;
      const double side = std::sqrt(std::max(share, 0.0)), across = std::fmod(number / std::numbers::phi, 1.0);
      const auto& [a, b, c] = triangle;
      seeds.push_back((1 - side) * mesh.points[a] + side * ((1 - across) * mesh.points[b] + across * mesh.points[c]));
    }
    before += area;
  }
  return seeds;
}

}  // namespace

double count_of(const Seeds& seeds) {
  const auto count = [](const auto& shape) -> double {
    if constexpr (requires { shape.counts; })
      return static_cast<double>(shape.counts[0]) * static_cast<double>(shape.counts[1]);
    else if constexpr (requires { shape.count; })
      return static_cast<double>(shape.count);
    else
      return static_cast<double>(shape.size());
  };
  return std::visit(count, seeds);
}

std::vector<dvec3> positions_on(const Seeds& seeds) {
  return std::visit([](const auto& shape) { return on(shape); }, seeds);
}

Result<std::vector<dvec3>> positions_of(const Seeds& seeds, const format::Volume& volume, std::uint64_t memory) {
  if (const double count = count_of(seeds); count > static_cast<double>(most_seeds))
    return fail(ErrorCode::invalid_argument, "{}: {} seeds; at most {} are followed at once", volume.name(), count,
                most_seeds);
  const auto* line = std::get_if<SeedLine>(&seeds);
  if (line && line->start == line->end)
    return fail(ErrorCode::invalid_argument, "{}: the line of seeds has no length", volume.name());
  const auto* of = std::get_if<SeedRectangle>(&seeds);
  if (of && !(glm::length(glm::cross(of->first - of->corner, of->second - of->corner)) > 0))
    return fail(ErrorCode::invalid_argument, "{}: the rectangle of seeds has no area", volume.name());
  std::vector<dvec3> positions = positions_on(seeds);
  if (const auto* patch = std::get_if<SeedPatch>(&seeds))
    SPLATVOL_TRY_SET(positions, positions_on(*patch, volume, memory));
  for (const dvec3& seed : positions)
    if (!std::isfinite(seed.x + seed.y + seed.z))
      return fail(ErrorCode::invalid_argument, "{}: a seed's position is not finite", volume.name());
  if (positions.empty()) return fail(ErrorCode::invalid_argument, "{}: streamlines need a seed", volume.name());
  return positions;
}

}  // namespace splatvol
