#include "format/boundary.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/names.h"
#include "format/payload.h"

namespace splatvol::format {
namespace {

constexpr std::uint32_t none = std::numeric_limits<std::uint32_t>::max();
constexpr std::int64_t max_number = std::int64_t{1} << 31;  // of a grid position; exclusive

// Steps of the grid along the longest edge of the box round all points. Simplified triangles are not worth more digits
// than a sixteenth of their error.
constexpr int least_bits = 12, most_bits = 24;

// The grid that positions are on.
struct Grid {
  dvec3 origin{0};
  double step = 0;

  [[nodiscard]] std::array<std::int64_t, 3> numbers(const dvec3& position) const {
    std::array<std::int64_t, 3> numbers{};
    for (int axis = 0; step > 0 && axis < 3; ++axis)
      numbers[static_cast<std::size_t>(axis)] = std::llround((position[axis] - origin[axis]) / step);
    return numbers;
  }
};

Grid choose_grid(std::span<const Patch> patches, double error) {
  Box box;
  for (const Patch& patch : patches)
    for (const dvec3& point : patch.mesh.points) box.include(point);
  if (!(box.low.x <= box.high.x)) return {};
  const dvec3 extent = box.high - box.low;
  const double longest = extent[longest_axis(extent)];
  int bits = most_bits;
  while (bits > least_bits && longest / std::ldexp(1, bits - 1) <= error / 16) --bits;
  return {box.low, longest / (std::ldexp(1, bits) - 1)};
}

// Numbers the points in the order in which triangles name them first. The code of an index is its distance from the
// number that the next new point would have.
Bytes make_payload(const TriangleMesh& mesh, const Grid& grid, PatchInfo& info) {
  std::vector<std::uint32_t> numbers(mesh.points.size(), none), codes;
  std::vector<std::array<std::int64_t, 3>> points;
  codes.reserve(3 * mesh.triangles.size());
  for (const auto& corners : mesh.triangles)
    for (const std::uint32_t corner : corners) {
      const auto next = static_cast<std::uint32_t>(points.size());
      if (numbers[corner] == none) {
        numbers[corner] = next;
        points.push_back(grid.numbers(mesh.points[corner]));
      }
      codes.push_back(next - numbers[corner]);
    }
  info.points = points.size();
  info.triangles = mesh.triangles.size();
  Bytes payload;
  if (codes.empty()) return payload;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    std::vector<std::uint32_t> differences;
    std::int64_t before = 0;
    for (const auto& point : points) {
      differences.push_back(static_cast<std::uint32_t>(zigzag(point[axis] - before)));
      before = point[axis];
    }
    append_planes<std::uint32_t>(payload, differences);
  }
  append_planes<std::uint32_t>(payload, codes);
  return payload;
}

Status append_points(const BoundaryInfo& boundary, std::uint64_t count, std::span<const std::byte>& planes,
                     TriangleMesh& mesh, std::string_view what) {
  const std::size_t first = mesh.points.size();
  mesh.points.resize(first + count);
  std::vector<std::uint32_t> differences;
  for (int axis = 0; axis < 3; ++axis) {
    planes = take_planes(planes, differences, count);
    std::int64_t number = 0;
    for (std::size_t i = 0; i < count; ++i) {
      number += unzigzag(differences[i]);
      const double coordinate = boundary.origin[axis] + boundary.quantisation_step * static_cast<double>(number);
      if (number < 0 || number >= max_number || !(std::abs(coordinate) <= 1e50))
        return fail(ErrorCode::invalid_data, "{}: a position is out of range [R21]", what);
      mesh.points[first + i][axis] = coordinate;
    }
  }
  return {};
}

Status append_triangles(const PatchInfo& patch, std::span<const std::byte> planes, TriangleMesh& mesh,
                        std::string_view what) {
  const std::size_t base = mesh.points.size() - patch.points;
  if (mesh.points.size() > none) return fail(ErrorCode::unsupported, "{}: more than 2^32 - 1 points at once", what);
  std::vector<std::uint32_t> codes;
  take_planes(planes, codes, 3 * patch.triangles);
  std::uint64_t next = 0;
  mesh.triangles.reserve(mesh.triangles.size() + patch.triangles);
  for (std::size_t i = 0; i < codes.size(); i += 3) {
    std::array<std::uint32_t, 3> corners{};
    for (std::size_t k = 0; k < 3; ++k) {
      if (codes[i + k] > next || (codes[i + k] == 0 && next == patch.points))
        return fail(ErrorCode::invalid_data, "{}: a triangle names a point that is not there [R21]", what);
      corners[k] = static_cast<std::uint32_t>(base + next - codes[i + k]);
      next += codes[i + k] == 0 ? 1 : 0;
    }
    mesh.triangles.push_back(corners);
  }
  if (next != patch.points) return fail(ErrorCode::invalid_data, "{}: no triangle names a point [R21]", what);
  return {};
}

}  // namespace

Result<PackedBoundary> pack_boundary(std::span<const Patch> patches, double error) {
  if (patches.empty() || patches.size() > max_patches)
    return fail(ErrorCode::unsupported, "the boundary has {} patches; a file holds 1 to {}", patches.size(),
                max_patches);
  std::vector<std::string> names;
  for (const Patch& patch : patches) names.push_back(patch.name);
  if (const auto duplicate = find_duplicate(std::move(names)))
    return fail(ErrorCode::invalid_argument, "two patches are called \"{}\"", *duplicate);
  const Grid grid = choose_grid(patches, error);
  PackedBoundary packed;
  packed.info = {.origin = grid.origin, .quantisation_step = grid.step, .error = error + grid.step, .patches = {}};
  Bytes table, parts;
  for (const Patch& patch : patches) {
    PatchInfo& info = packed.info.patches.emplace_back(PatchInfo{.name = patch.name});
    const Bytes payload = make_payload(patch.mesh, grid, info);
    if (payload.size() > std::numeric_limits<std::uint32_t>::max())
      return fail(ErrorCode::unsupported, "patch \"{}\" has {} triangles, which is too many", patch.name,
                  info.triangles);
    const Bytes part = pack_planes(payload, 0, std::max<std::size_t>(info.points, 1));
    append_record(table, PatchPart{hash_bytes(part), static_cast<std::uint32_t>(part.size()),
                                   static_cast<std::uint32_t>(payload.size())});
    parts.insert(parts.end(), part.begin(), part.end());
  }
  append_record(packed.section, hash_bytes(table));
  packed.section.insert(packed.section.end(), table.begin(), table.end());
  packed.section.insert(packed.section.end(), parts.begin(), parts.end());
  return packed;
}

Status append_patch(const BoundaryInfo& boundary, std::size_t patch, const PatchPart& part,
                    std::span<const std::byte> packed, TriangleMesh& mesh, std::string_view what) {
  const PatchInfo& info = boundary.patches[patch];
  SPLATVOL_TRY_ASSIGN(payload, unpack_checked(part, packed, what));
  if (info.triangles == 0) return {};  // and so no points
  std::span<const std::byte> planes = payload;
  SPLATVOL_TRY(append_points(boundary, info.points, planes, mesh, what));
  return append_triangles(info, planes, mesh, what);
}

}  // namespace splatvol::format
