#include "builder/boundary/rest_parts.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <tuple>

#include "builder/boundary/boundary_faces.h"

namespace splatvol {
namespace {

using Triangle = std::array<std::uint32_t, 3>;

constexpr std::uint32_t none = std::numeric_limits<std::uint32_t>::max();

// Sets of points, each with its lowest point as the root.
class PointSets {
 public:
  explicit PointSets(std::size_t points) : parents_(points) { std::iota(parents_.begin(), parents_.end(), 0u); }

  std::uint32_t root(std::uint32_t point) {
    while (parents_[point] != point) {
      parents_[point] = parents_[parents_[point]];
      point = parents_[point];
    }
    return point;
  }

  void join(std::uint32_t a, std::uint32_t b) {
    a = root(a), b = root(b);
    parents_[std::max(a, b)] = std::min(a, b);
  }

 private:
  std::vector<std::uint32_t> parents_;
};

// The parts in the order of their first triangles.
struct Parts {
  std::vector<std::uint32_t> of_triangle;  // `none` for triangles of other patches
  std::vector<Box> boxes;                  // [part]
};

Parts find_parts(std::span<const dvec3> points, std::span<const Triangle> triangles,
                 std::span<const std::uint32_t> patches, std::uint32_t sides) {
  const auto is_rest = [&](std::uint32_t patch) { return patch == 0 || (patch >= sides && patch < sides + box_sides); };
  PointSets sets(points.size());
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    if (!is_rest(patches[i])) continue;
    sets.join(triangles[i][0], triangles[i][1]);
    sets.join(triangles[i][1], triangles[i][2]);
  }
  Parts parts{std::vector<std::uint32_t>(triangles.size(), none), {}};
  std::vector<std::uint32_t> of_root(points.size(), none);
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    if (!is_rest(patches[i])) continue;
    std::uint32_t& part = of_root[sets.root(triangles[i][0])];
    if (part == none) {
      part = static_cast<std::uint32_t>(parts.boxes.size());
      parts.boxes.emplace_back();
    }
    parts.of_triangle[i] = part;
    for (const std::uint32_t point : triangles[i]) parts.boxes[part].include(points[point]);
  }
  return parts;
}

// Returns the numbers of the parts, the largest first.
std::vector<std::uint32_t> by_size(std::span<const Box> boxes) {
  Box all;
  for (const Box& box : boxes) all.include(box);
  const dvec3 extent = all.extent();
  const double unit = extent[longest_axis(extent)];
  const auto steps = [](double length) { return std::round(1e6 * length); };
  const auto rank = [&](std::uint32_t part) {
    const dvec3 low = (boxes[part].low - all.low) / unit;
    return std::tuple(-steps(glm::length(boxes[part].extent() / unit)), steps(low.x), steps(low.y), steps(low.z));
  };
  std::vector<std::uint32_t> order(boxes.size());
  std::iota(order.begin(), order.end(), 0u);
  std::ranges::stable_sort(order, {}, rank);
  return order;
}

std::string name_of(std::size_t part) { return fmt::format("{} {}", BoundaryFaces::rest_name, part + 1); }

std::string name_of_smaller() { return fmt::format("{} rest", BoundaryFaces::rest_name); }

}  // namespace

std::vector<std::string> names_of_sides() {
  std::vector<std::string> names;
  for (std::size_t side = 0; side < box_sides; ++side)
    names.push_back(fmt::format("side {}{}", "xyz"[side / 2], "-+"[side % 2]));
  return names;
}

std::optional<std::size_t> side_of(const Box& box, const std::array<dvec3, 3>& corners) {
  const dvec3 extent = box.extent();
  for (std::size_t side = 0; side < box_sides; ++side) {
    const auto axis = static_cast<int>(side / 2);
    // A thin sheet has two sides, too.
    const double tolerance = std::min(1e-6 * extent[longest_axis(extent)], 1e-3 * extent[axis]);
    const double place = (side % 2 == 0 ? box.low : box.high)[axis];
    if (std::ranges::all_of(corners, [&](const dvec3& p) { return std::abs(p[axis] - place) <= tolerance; }))
      return side;
  }
  return std::nullopt;
}

std::vector<std::string> split_rest(std::span<const dvec3> points, std::span<const Triangle> triangles,
                                    std::size_t most, std::uint32_t sides, std::uint32_t first,
                                    std::vector<std::uint32_t>& patches) {
  if (most < 2) return {};
  const Parts parts = find_parts(points, triangles, patches, sides);
  const bool has_sides = std::ranges::any_of(patches, [&](std::uint32_t patch) { return patch >= sides; });
  if (parts.boxes.size() < 2 && !has_sides) return {};
  const std::vector<std::uint32_t> order = by_size(parts.boxes);
  const std::size_t count = std::min(order.size(), most);
  std::vector<std::string> names;
  for (std::size_t i = 0; i < count; ++i)
    names.push_back(i + 1 == count && count < order.size() ? name_of_smaller() : name_of(i));
  std::vector<std::uint32_t> patch_of(order.size());
  for (std::size_t i = 0; i < order.size(); ++i)
    patch_of[order[i]] = first + static_cast<std::uint32_t>(std::min(i, count - 1));
  std::vector<bool> is_empty(count, true);
  for (std::size_t i = 0; i < triangles.size(); ++i) {
    if (patches[i] != 0) continue;
    patches[i] = patch_of[parts.of_triangle[i]];
    is_empty[patches[i] - first] = false;
  }
  for (std::size_t i = 0; i < count; ++i)
    if (is_empty[i]) names[i].clear();
  return names;
}

bool is_rest_part(std::string_view name) {
  if (std::ranges::count(names_of_sides(), name) > 0) return true;
  if (!name.starts_with(BoundaryFaces::rest_name)) return false;
  if (name == name_of_smaller()) return true;
  for (std::size_t part = 0; part < most_rest_parts; ++part)
    if (name == name_of(part)) return true;
  return false;
}

}  // namespace splatvol
