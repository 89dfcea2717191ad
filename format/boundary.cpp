#include "format/boundary.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "base/interruption.h"
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

// The triangles in the order of the file: two-sided ones come last.
std::vector<std::size_t> order_of_triangles(const TriangleMesh& mesh) {
  std::vector<std::size_t> order(mesh.triangles.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::ranges::stable_partition(order, [&](std::size_t i) { return !mesh.is_two_sided(i); });
  return order;
}

// Numbers the points in the order in which triangles name them first. The code of an index is its distance from the
// number that the next new point would have.
Payload make_payload(const TriangleMesh& mesh, const Grid& grid, PatchInfo& info) {
  std::vector<std::uint32_t> numbers(mesh.points.size(), none), codes;
  std::vector<std::array<std::int64_t, 3>> points;
  codes.reserve(3 * mesh.triangles.size());
  for (const std::size_t triangle : order_of_triangles(mesh))
    for (const std::uint32_t corner : mesh.triangles[triangle]) {
      const auto next = static_cast<std::uint32_t>(points.size());
      if (numbers[corner] == none) {
        numbers[corner] = next;
        points.push_back(grid.numbers(mesh.points[corner]));
      }
      codes.push_back(next - numbers[corner]);
    }
  info.points = points.size();
  info.triangles = mesh.triangles.size();
  info.two_sided = static_cast<std::uint64_t>(std::ranges::count(mesh.two_sided, true));
  Payload payload;
  if (codes.empty()) return payload;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    std::vector<std::uint32_t> differences;
    std::int64_t before = 0;
    for (const auto& point : points) {
      differences.push_back(static_cast<std::uint32_t>(zigzag(point[axis] - before)));
      before = point[axis];
    }
    payload.add(differences, sizeof(std::uint32_t), 1);
    payload.end_block();
  }
  payload.add(codes, sizeof(std::uint32_t), 1);
  return payload;
}

// Smaller payloads are unpacked at once, which is faster.
constexpr std::uint64_t most_unpacked_at_once = 1u << 25;
constexpr std::size_t numbers_at_once = 1u << 14;

// The numbers of a payload, each in four planes, from front to back.
class NumberReader {
 public:
  static Result<NumberReader> open(const PatchPart& part, std::span<const std::byte> packed, std::string_view what) {
    SPLATVOL_TRY(check_packed(part, packed, what));
    NumberReader reader(what);
    if (part.unpacked_bytes <= most_unpacked_at_once) {
      SPLATVOL_TRY_SET(reader.payload_, unpack(packed, part.unpacked_bytes, what));
      packed = reader.payload_;
    }
    for (std::size_t plane = 0; plane < planes; ++plane) reader.planes_.emplace_back(packed, part.unpacked_bytes, what);
    return reader;
  }

  // Calls visit(number) with each of the next `count` numbers. It returns the rule that the number breaks, or null.
  template <class Visit>
  Status read(std::uint64_t count, const Visit& visit) {
    for (std::size_t plane = 0; plane < planes; ++plane) SPLATVOL_TRY(planes_[plane].skip_to(begin_ + plane * count));
    begin_ += planes * count;
    std::array<std::byte, planes * numbers_at_once> bytes;
    std::array<std::uint32_t, numbers_at_once> numbers;
    for (std::uint64_t left = count; left > 0;) {
      const auto some =
          std::span(numbers).first(static_cast<std::size_t>(std::min<std::uint64_t>(left, numbers_at_once)));
      left -= some.size();
      for (std::size_t plane = 0; plane < planes; ++plane)
        SPLATVOL_TRY(planes_[plane].read(std::span(bytes).subspan(plane * some.size(), some.size())));
      read_planes<std::uint32_t>(bytes, some);
      for (const std::uint32_t number : some)
        if (const char* rule = visit(number)) return fail(ErrorCode::invalid_data, "{}: {} [R21]", what_, rule);
      SPLATVOL_TRY(check_interruption());
    }
    return {};
  }

  // Fails unless all numbers were read.
  Status finish() { return planes_.back().finish(); }

 private:
  static constexpr std::size_t planes = sizeof(std::uint32_t);
  explicit NumberReader(std::string_view what) : what_(what) {}

  std::string_view what_;
  Bytes payload_;  // empty: unpacked as it is read
  std::vector<Unpacker> planes_;
  std::uint64_t begin_ = 0;  // of the next numbers
};

// Calls add(axis, number of the point, coordinate).
template <class Add>
Status read_points(const BoundaryInfo& boundary, std::uint64_t count, NumberReader& reader, const Add& add) {
  for (int axis = 0; axis < 3; ++axis) {
    std::int64_t number = 0;
    std::size_t point = 0;
    SPLATVOL_TRY(reader.read(count, [&](std::uint32_t difference) -> const char* {
      number += unzigzag(difference);
      const double coordinate = boundary.origin[axis] + boundary.quantisation_step * static_cast<double>(number);
      if (number < 0 || number >= max_number || !(std::abs(coordinate) <= 1e50)) return "a position is out of range";
      add(axis, point++, coordinate);
      return nullptr;
    }));
  }
  return {};
}

// Calls add(point) for each corner, triangle by triangle.
template <class Add>
Status read_corners(const PatchInfo& patch, NumberReader& reader, const Add& add, std::string_view what) {
  std::uint64_t next = 0;
  SPLATVOL_TRY(reader.read(3 * patch.triangles, [&](std::uint32_t code) -> const char* {
    if (code > next || (code == 0 && next == patch.points)) return "a triangle names a point that is not there";
    add(next - code);
    next += code == 0 ? 1 : 0;
    return nullptr;
  }));
  if (next != patch.points) return fail(ErrorCode::invalid_data, "{}: no triangle names a point [R21]", what);
  return reader.finish();
}

template <class AddPoint, class AddCorner>
Status read_patch(const BoundaryInfo& boundary, std::size_t patch, const PatchPart& part,
                  std::span<const std::byte> packed, const AddPoint& add_point, const AddCorner& add_corner,
                  std::string_view what) {
  const PatchInfo& info = boundary.patches[patch];
  SPLATVOL_TRY_ASSIGN(reader, NumberReader::open(part, packed, what));
  SPLATVOL_TRY(read_points(boundary, info.points, reader, add_point));
  return read_corners(info, reader, add_corner, what);
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
    const Payload payload = make_payload(patch.mesh, grid, info);
    if (payload.bytes.size() > std::numeric_limits<std::uint32_t>::max())
      return fail(ErrorCode::unsupported, "patch \"{}\" has {} triangles, which is too many", patch.name,
                  info.triangles);
    const Bytes part = pack_blocks(payload.bytes, payload.ends);
    append_record(table, PatchPart{hash_bytes(part), static_cast<std::uint32_t>(part.size()),
                                   static_cast<std::uint32_t>(payload.bytes.size())});
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
  const std::size_t first = mesh.points.size(), first_triangle = mesh.triangles.size();
  if (first + info.points > none) return fail(ErrorCode::unsupported, "{}: more than 2^32 - 1 points at once", what);
  mesh.points.resize(static_cast<std::size_t>(first + info.points));
  std::array<std::uint32_t, 3> corners{};
  std::size_t corner = 0;
  SPLATVOL_TRY(read_patch(
      boundary, patch, part, packed,
      [&](int axis, std::size_t point, double coordinate) { mesh.points[first + point][axis] = coordinate; },
      [&](std::uint64_t point) {
        corners[corner] = static_cast<std::uint32_t>(first + point);
        corner = (corner + 1) % 3;
        if (corner == 0) mesh.triangles.push_back(corners);
      },
      what));
  if (mesh.two_sided.empty() && info.two_sided == 0) return {};
  mesh.two_sided.resize(static_cast<std::size_t>(first_triangle + info.triangles - info.two_sided), false);
  mesh.two_sided.resize(mesh.triangles.size(), true);
  return {};
}

Status check_patch(const BoundaryInfo& boundary, std::size_t patch, const PatchPart& part,
                   std::span<const std::byte> packed, std::string_view what) {
  return read_patch(
      boundary, patch, part, packed, [](int, std::size_t, double) {}, [](std::uint64_t) {}, what);
}

}  // namespace splatvol::format
