#include "builder/boundary/simplify.h"

#include <meshoptimizer.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_reduce.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <span>
#include <string>
#include <tuple>
#include <utility>

#include "base/interruption.h"
#include "builder/boundary/rest_parts.h"
#include "builder/boundary/triangle_tree.h"
#include "builder/boundary/welded_surface.h"
#include "format/layout.h"

namespace splatvol {
namespace {

using Triangle = WeldedSurface::Triangle;

constexpr std::uint64_t least_held = std::uint64_t{1} << 21;  // triangles
constexpr std::uint32_t none = std::numeric_limits<std::uint32_t>::max();

// Bytes that meshoptimizer and the search for hanging nodes take for each triangle, about.
constexpr std::uint64_t work_bytes = 250;

// A triangle within another one, of a mesh with hanging nodes, lies in its plane up to this share of its own size.
constexpr double plane_tolerance = 1e-5;

// Triangles that share points.
struct Surface {
  std::vector<dvec3> points;
  std::vector<Triangle> triangles;
  std::vector<std::uint32_t> patches;  // [triangle]
};

// Triangles without a side are a patch of their own while triangles are made fewer: that of a number behind all
// patches.
void set_sides_apart(const std::vector<bool>& sides, std::size_t patches, Surface& surface) {
  for (std::size_t i = 0; i < sides.size(); ++i)
    if (!sides[i] && surface.patches[i] < patches) surface.patches[i] += static_cast<std::uint32_t>(patches);
}

dvec3 area_of(const Surface& surface, const Triangle& triangle) {
  const dvec3& a = surface.points[triangle[0]];
  return glm::cross(surface.points[triangle[1]] - a, surface.points[triangle[2]] - a) / 2.0;
}

// Whether the middle of a triangle lies on another one that faces the other way: both have a cell, so it is inside.
bool is_covered(const Surface& surface, const TriangleTree& tree, const std::vector<bool>& sides,
                std::uint32_t number) {
  const Triangle& triangle = surface.triangles[number];
  const dvec3 area = area_of(surface, triangle);
  const double tolerance = plane_tolerance * std::sqrt(glm::length(area));
  if (!sides[number] || !(tolerance > 0)) return false;
  const dvec3 middle = (surface.points[triangle[0]] + surface.points[triangle[1]] + surface.points[triangle[2]]) / 3.0;
  return tree.any_near(middle, tolerance, [&](std::uint32_t other) {
    if (other == number || !sides[other]) return false;
    const dvec3 beyond = area_of(surface, surface.triangles[other]);
    if (glm::dot(area, beyond) > -0.999 * glm::length(area) * glm::length(beyond)) return false;
    const auto& [a, b, c] = surface.triangles[other];
    return squared_distance(middle, surface.points[a], surface.points[b], surface.points[c]) <= tolerance * tolerance;
  });
}

// Removes the faces at hanging nodes. `sides`: [triangle].
void remove_covered(Surface& surface, std::vector<bool>& sides) {
  std::vector<std::uint8_t> covered(surface.triangles.size());
  {
    const TriangleTree tree(surface.points, surface.triangles);
    tbb::parallel_for(std::size_t{0}, covered.size(), [&](std::size_t i) {
      covered[i] = surface.patches[i] == 0 && is_covered(surface, tree, sides, static_cast<std::uint32_t>(i)) ? 1 : 0;
    });
  }
  std::size_t kept = 0;
  for (std::size_t i = 0; i < covered.size(); ++i) {
    if (covered[i] != 0) continue;
    sides[kept] = sides[i];
    surface.triangles[kept] = surface.triangles[i];
    surface.patches[kept++] = surface.patches[i];
  }
  sides.resize(kept);
  surface.triangles.resize(kept);
  surface.patches.resize(kept);
}

// Sorts triangles by their patches.
void group_by_patch(Surface& surface) {
  std::vector<std::uint32_t> order(surface.triangles.size());
  std::iota(order.begin(), order.end(), 0u);
  std::ranges::stable_sort(order, {}, [&](std::uint32_t i) { return surface.patches[i]; });
  std::vector<Triangle> triangles;
  std::vector<std::uint32_t> patches;
  for (const std::uint32_t i : order) {
    triangles.push_back(surface.triangles[i]);
    patches.push_back(surface.patches[i]);
  }
  surface.triangles = std::move(triangles);
  surface.patches = std::move(patches);
}

// The surface for meshoptimizer. Each patch has vertices of its own: where patches meet, vertices coincide, and the
// library keeps such seams closed.
struct Wedges {
  std::vector<std::uint32_t> indices;
  std::vector<std::uint32_t> points;   // [vertex]
  std::vector<std::uint32_t> patches;  // [vertex]
  std::vector<float> positions;        // [vertex][x, y, z]: in units of the box round all points
};

// Requires triangles that are grouped by their patches.
Wedges make_wedges(const Surface& surface) {
  Box box;
  for (const dvec3& point : surface.points) box.include(point);
  const dvec3 extent = box.extent(), middle = box.low + 0.5 * extent;
  const double unit = extent[longest_axis(extent)] > 0 ? extent[longest_axis(extent)] : 1;
  Wedges wedges;
  wedges.indices.reserve(3 * surface.triangles.size());
  std::vector<std::uint32_t> last(surface.points.size(), none);  // the vertex that a point became last
  for (std::size_t i = 0; i < surface.triangles.size(); ++i)
    for (const std::uint32_t point : surface.triangles[i]) {
      std::uint32_t& vertex = last[point];
      if (vertex == none || wedges.patches[vertex] != surface.patches[i]) {
        vertex = static_cast<std::uint32_t>(wedges.points.size());
        wedges.points.push_back(point);
        wedges.patches.push_back(surface.patches[i]);
        const dvec3 position = (surface.points[point] - middle) / unit;
        for (int axis = 0; axis < 3; ++axis) wedges.positions.push_back(static_cast<float>(position[axis]));
      }
      wedges.indices.push_back(vertex);
    }
  return wedges;
}

// Collapses edges until the triangles are few enough, as far as the shape of the surface allows.
void collapse_edges(std::uint64_t most, Surface& surface) {
  const Wedges wedges = make_wedges(surface);
  std::vector<std::uint32_t> left(wedges.indices.size());
  constexpr float any_error = 1;  // of the extent
  left.resize(meshopt_simplify(left.data(), wedges.indices.data(), wedges.indices.size(), wedges.positions.data(),
                               wedges.points.size(), 3 * sizeof(float), 3 * most, any_error, 0, nullptr));
  surface.triangles.clear();
  surface.patches.clear();
  for (std::size_t i = 0; i < left.size(); i += 3) {
    surface.triangles.push_back({wedges.points[left[i]], wedges.points[left[i + 1]], wedges.points[left[i + 2]]});
    surface.patches.push_back(wedges.patches[left[i]]);
  }
}

// Joins the points in cells of a grid until the triangles are few enough. `patches`: number of them.
Status cluster_vertices(std::uint64_t most, std::size_t patches, Surface& surface) {
  Box box;
  for (const dvec3& point : surface.points) box.include(point);
  WeldedSurface welded(box, most);
  for (std::size_t i = 0; i < surface.triangles.size(); ++i) {
    const auto& [a, b, c] = surface.triangles[i];
    const std::uint32_t patch = surface.patches[i];
    SPLATVOL_TRY(welded.add({{surface.points[a], surface.points[b], surface.points[c]}, patch, patch < patches}));
  }
  surface = {welded.points(), welded.triangles(), welded.patches()};
  set_sides_apart(welded.sides(), patches, surface);
  return {};
}

// The largest distance from a point to the triangles.
double distance_to(const Surface& surface, std::span<const dvec3> points) {
  const TriangleTree tree(surface.points, surface.triangles);
  return tbb::parallel_reduce(
      tbb::blocked_range<std::size_t>(0, points.size()), 0.0,
      [&](const tbb::blocked_range<std::size_t>& range, double largest) {
        for (std::size_t i = range.begin(); i < range.end(); ++i) largest = std::max(largest, tree.distance(points[i]));
        return largest;
      },
      [](double a, double b) { return std::max(a, b); });
}

// The points that triangles name.
std::vector<dvec3> used_points(const Surface& surface) {
  std::vector<bool> used(surface.points.size());
  for (const Triangle& triangle : surface.triangles)
    for (const std::uint32_t point : triangle) used[point] = true;
  std::vector<dvec3> points;
  for (std::size_t i = 0; i < used.size(); ++i)
    if (used[i]) points.push_back(surface.points[i]);
  return points;
}

// The triangles of one patch: those with a side, and those without.
std::array<std::span<const Triangle>, 2> triangles_of(const Surface& surface, std::size_t patch, std::size_t patches) {
  std::array<std::span<const Triangle>, 2> triangles;
  for (std::size_t i = 0; i < 2; ++i) {
    const auto [begin, end] = std::ranges::equal_range(surface.patches, patch + i * patches);
    triangles[i] =
        std::span(surface.triangles)
            .subspan(static_cast<std::size_t>(begin - surface.patches.begin()), static_cast<std::size_t>(end - begin));
  }
  return triangles;
}

// Orders triangles so that neighbours follow each other: that packs well. `numbers`: scratch memory, [point]: `none`.
TriangleMesh make_mesh(const Surface& surface, const std::array<std::span<const Triangle>, 2>& triangles,
                       std::vector<std::uint32_t>& numbers) {
  TriangleMesh mesh;
  std::vector<std::uint32_t> used;
  for (const std::span<const Triangle> some : triangles) {
    std::vector<std::uint32_t> indices;
    for (const Triangle& triangle : some)
      for (const std::uint32_t point : triangle) {
        if (numbers[point] == none) {
          numbers[point] = static_cast<std::uint32_t>(used.size());
          used.push_back(point);
        }
        indices.push_back(numbers[point]);
      }
    if (!indices.empty()) meshopt_optimizeVertexCache(indices.data(), indices.data(), indices.size(), used.size());
    for (std::size_t i = 0; i < indices.size(); i += 3)
      mesh.triangles.push_back({indices[i], indices[i + 1], indices[i + 2]});
  }
  for (const std::uint32_t point : used) {
    mesh.points.push_back(surface.points[point]);
    numbers[point] = none;
  }
  if (triangles[1].empty()) return mesh;
  mesh.two_sided.resize(triangles[0].size(), false);
  mesh.two_sided.resize(mesh.triangles.size(), true);
  return mesh;
}

// A part of the rest must not get the name of a patch that the input has.
bool splits_rest(const BoundaryFaces& faces) {
  return !faces.input_names_rest() && std::ranges::none_of(faces.names(), is_rest_part);
}

// Whether there is room for the sides as patches.
bool has_sides(const BoundaryFaces& faces) {
  return splits_rest(faces) && faces.names().size() + box_sides + most_rest_parts <= format::max_patches;
}

// Splits the rest into parts. Returns the names of the patches: those of the input, the sides, the parts.
std::vector<std::string> split_rest_of(const BoundaryFaces& faces, Surface& surface) {
  std::vector<std::string> names = faces.names();
  if (!splits_rest(faces)) return names;
  const std::size_t room = format::max_patches - std::min(names.size() - 1, format::max_patches);
  const auto add = [&](const std::vector<std::string>& more) { names.insert(names.end(), more.begin(), more.end()); };
  const auto sides = static_cast<std::uint32_t>(names.size());
  if (has_sides(faces)) add(names_of_sides());
  add(split_rest(surface.points, surface.triangles, std::min(room, most_rest_parts), sides,
                 static_cast<std::uint32_t>(names.size()), surface.patches));
  return names;
}

// Returns the patches of the input by their names, then the parts of the rest, then the sides. `named`: number of the
// first side, if there are sides, or of the first part.
std::vector<std::uint32_t> order_of_patches(std::span<const std::string> names, std::size_t named) {
  std::vector<std::uint32_t> order(names.size());
  std::iota(order.begin(), order.end(), 0u);
  const auto rank = [&](std::uint32_t number) {
    const bool is_rest = number == 0 || number >= named, is_part = names[number].starts_with(BoundaryFaces::rest_name);
    return std::tuple(is_rest, is_rest && !is_part, is_rest ? std::string() : names[number], number);
  };
  std::ranges::sort(order, {}, rank);
  return order;
}

// Requires triangles that are grouped by their patches. `named`: as above. Patches of the input and parts may be empty:
// they have lost their triangles.
std::vector<Patch> make_patches(const Surface& surface, std::span<const std::string> names, std::size_t named) {
  std::vector<Patch> patches;
  std::vector<std::uint32_t> numbers(surface.points.size(), none);
  const auto stays_empty = [&](std::uint32_t number) {
    return number != 0 && (number < named || names[number].starts_with(BoundaryFaces::rest_name));
  };
  for (const std::uint32_t number : order_of_patches(names, named)) {
    const auto triangles = triangles_of(surface, number, names.size());
    const bool is_empty = triangles[0].empty() && triangles[1].empty();
    if (is_empty && !stays_empty(number)) continue;
    patches.push_back({names[number], make_mesh(surface, triangles, numbers)});
  }
  if (patches.empty()) patches.push_back({names[0], {}});
  return patches;
}

// `most`: triangles to hold at once. Triangles of the rest on a side of the box get the number of its patch.
Result<WeldedSurface> weld(BoundaryFaces& faces, std::uint64_t most, std::uint64_t& count) {
  SPLATVOL_TRY(faces.check_any());
  WeldedSurface welded(faces.box(), most);
  const std::size_t first_side = faces.names().size();
  const bool with_sides = has_sides(faces);
  SPLATVOL_TRY(faces.visit([&](BoundaryTriangle triangle) {
    ++count;
    if (with_sides && triangle.patch == 0)
      if (const auto side = side_of(faces.box(), triangle.corners))
        triangle.patch = static_cast<std::uint32_t>(first_side + *side);
    return welded.add(triangle);
  }));
  return welded;
}

Result<Boundary> make_boundary(BoundaryFaces& faces, std::uint64_t most_held, std::uint64_t most) {
  Boundary boundary;
  Surface surface;
  std::vector<bool> sides;
  double moved = 0;
  {
    SPLATVOL_TRY_ASSIGN(welded, weld(faces, most_held, boundary.triangles));
    moved = welded.moved();
    surface = {welded.points(), welded.triangles(), welded.patches()};
    sides = welded.sides();
    boundary.held_bytes = std::min(boundary.triangles, most_held) * (WeldedSurface::triangle_bytes + work_bytes);
    if (moved == 0) {
      remove_covered(surface, sides);
      boundary.triangles = surface.triangles.size();
    }
  }
  const std::vector<std::string> names = split_rest_of(faces, surface);
  set_sides_apart(sides, names.size(), surface);
  group_by_patch(surface);
  SPLATVOL_TRY(check_interruption());
  boundary.error = moved;
  if (surface.triangles.size() > most) {
    const std::vector<dvec3> before = used_points(surface);
    collapse_edges(most, surface);
    if (surface.triangles.size() > most) {
      SPLATVOL_TRY(cluster_vertices(most, names.size(), surface));
      group_by_patch(surface);
    }
    boundary.error += distance_to(surface, before);
    SPLATVOL_TRY(check_interruption());
  }
  boundary.kept = surface.triangles.size();
  boundary.patches = make_patches(surface, names, faces.names().size());
  return boundary;
}

}  // namespace

Result<Boundary> whole_boundary(BoundaryFaces& faces) {
  constexpr auto all = std::numeric_limits<std::uint64_t>::max();
  return make_boundary(faces, all, all);
}

Result<Boundary> simplified_boundary(BoundaryFaces& faces, std::uint64_t most_triangles) {
  return make_boundary(faces, std::max(least_held, 2 * most_triangles), most_triangles);
}

}  // namespace splatvol
