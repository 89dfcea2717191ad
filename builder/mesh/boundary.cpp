#include "builder/mesh/boundary.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <utility>

#include "builder/mesh/index_lists.h"

namespace splatvol {
namespace {

// Faces turn the same way if the cosine of the angle between their normals is larger.
constexpr double same_way = 0.8;

// Limits for the square of the plane's distance from the centroid, in deviations. A uniform slab along the plane has 3,
// a cone whose tip touches the plane has 15, and a concave corner with material on both sides has little.
constexpr double nearest_square = 1;
constexpr double farthest_square = 12;

// The face of tetrahedron side / 4 that lies opposite its corner side % 4.
using Side = std::uint64_t;

Tetrahedron sorted(Tetrahedron corners) {
  std::ranges::sort(corners);
  return corners;
}

// A tetrahedron's turn: the sign of its volume, or 0 if it is flat up to rounding.
int turn_of(std::span<const dvec3> positions, const Tetrahedron& corners) {
  std::array<dvec3, 3> edges;
  for (std::size_t k = 0; k < 3; ++k) edges[k] = positions[corners[k + 1]] - positions[corners[0]];
  const double volume = glm::dot(edges[0], glm::cross(edges[1], edges[2]));
  const double rounding = 4 * std::numeric_limits<double>::epsilon() * glm::length(edges[0]) * glm::length(edges[1]) *
                          glm::length(edges[2]);
  return volume > rounding ? 1 : volume < -rounding ? -1 : 0;
}

// The corners of a side, counterclockwise from outside if the tetrahedron's turn is 1.
std::array<std::uint32_t, 3> corners_of(Side side, std::span<const Tetrahedron> tetrahedra) {
  constexpr std::array<std::array<std::uint8_t, 3>, 4> outwards = {{{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}}};
  const Tetrahedron& corners = tetrahedra[side / 4];
  const auto& [a, b, c] = outwards[side % 4];
  return {corners[a], corners[b], corners[c]};
}

// Lists each tetrahedron under its two lowest vertices: every face has one of them as its lowest vertex.
IndexLists tetrahedra_at_low_vertices(std::size_t vertices, std::span<const Tetrahedron> tetrahedra) {
  IndexLists lists;
  lists.assign(vertices, [&](const auto& add) {
    for (std::uint32_t t = 0; t < tetrahedra.size(); ++t) {
      const auto [a, b, c, d] = sorted(tetrahedra[t]);
      if (a == b || b == c || c == d) continue;
      add(a, t);
      add(b, t);
    }
  });
  return lists;
}

// Sides that only one tetrahedron has; and pairs of sides that coincide, where one tetrahedron or both are flat.
struct Sides {
  std::vector<Side> outer;
  std::vector<std::pair<Side, Side>> at_flat;
};

// A side, found by its two higher vertices.
struct Candidate {
  std::uint64_t vertices;
  Side side;
  auto operator<=>(const Candidate&) const = default;
};

// Adds the sides whose lowest vertex is `vertex`. `candidates` is scratch memory.
void match_sides(std::uint32_t vertex, std::span<const std::uint32_t> incident, std::span<const Tetrahedron> tetrahedra,
                 std::span<const std::int8_t> turns, std::vector<Candidate>& candidates, Sides& sides) {
  candidates.clear();
  for (const std::uint32_t t : incident) {
    const Tetrahedron order = sorted(tetrahedra[t]);
    const auto add = [&](int omitted, std::uint32_t second, std::uint32_t third) {
      const auto opposite = std::ranges::find(tetrahedra[t], order[static_cast<std::size_t>(omitted)]);
      candidates.push_back(
          {std::uint64_t{second} << 32 | third, 4 * Side{t} + static_cast<Side>(opposite - tetrahedra[t].begin())});
    };
    if (order[1] == vertex) {
      add(0, order[2], order[3]);
    } else {
      add(1, order[2], order[3]);
      add(2, order[1], order[3]);
      add(3, order[1], order[2]);
    }
  }
  std::ranges::sort(candidates);
  for (std::size_t begin = 0, end = 0; begin < candidates.size(); begin = end) {
    while (end < candidates.size() && candidates[end].vertices == candidates[begin].vertices) ++end;
    const Side first = candidates[begin].side, last = candidates[end - 1].side;
    if (end - begin == 1) sides.outer.push_back(first);
    if (end - begin == 2 && (turns[first / 4] == 0 || turns[last / 4] == 0)) sides.at_flat.emplace_back(first, last);
  }
}

Sides match_all_sides(std::size_t vertices, std::span<const Tetrahedron> tetrahedra,
                      std::span<const std::int8_t> turns) {
  constexpr std::size_t task_vertices = 4096;
  const IndexLists incident = tetrahedra_at_low_vertices(vertices, tetrahedra);
  std::vector<Sides> found((vertices + task_vertices - 1) / task_vertices);
  tbb::parallel_for(std::size_t{0}, found.size(), [&](std::size_t task) {
    std::vector<Candidate> candidates;
    for (std::size_t v = task * task_vertices; v < std::min(vertices, (task + 1) * task_vertices); ++v)
      match_sides(static_cast<std::uint32_t>(v), incident[v], tetrahedra, turns, candidates, found[task]);
  });
  Sides all;
  for (const Sides& sides : found) {
    all.outer.insert(all.outer.end(), sides.outer.begin(), sides.outer.end());
    all.at_flat.insert(all.at_flat.end(), sides.at_flat.begin(), sides.at_flat.end());
  }
  return all;
}

// Gives flat tetrahedra the turn that a neighbour implies: two tetrahedra of the same turn run opposite ways round the
// face between them.
void turn_flat(std::span<const Tetrahedron> tetrahedra, std::vector<std::pair<Side, Side>> pairs,
               std::vector<std::int8_t>& turns) {
  const auto opposite = [&](Side first, Side second) {
    const auto [a, b, c] = corners_of(first, tetrahedra);
    const auto other = corners_of(second, tetrahedra);
    return other == std::array{a, c, b} || other == std::array{c, b, a} || other == std::array{b, a, c};
  };
  std::size_t left = pairs.size() + 1;
  while (pairs.size() < left) {
    left = pairs.size();
    std::erase_if(pairs, [&](const auto& pair) {
      std::int8_t &first = turns[pair.first / 4], &second = turns[pair.second / 4];
      if (first == 0 && second == 0) return false;
      const int sign = opposite(pair.first, pair.second) ? 1 : -1;
      if (first == 0) first = static_cast<std::int8_t>(sign * second);
      if (second == 0) second = static_cast<std::int8_t>(sign * first);
      return true;
    });
  }
}

// Adds up each group of planes that turn the same way, and returns the largest sum. Groups grow round the largest
// planes.
BoundaryPlane largest_group(std::vector<BoundaryPlane>& planes) {
  if (planes.size() < 2) return planes.empty() ? BoundaryPlane{} : planes[0];
  std::ranges::stable_sort(planes, std::greater<>(), [](const BoundaryPlane& p) { return squared_length(p.area); });
  std::vector<BoundaryPlane> groups;
  for (const BoundaryPlane& plane : planes) {
    BoundaryPlane* nearest = nullptr;
    double cosine = same_way;
    for (BoundaryPlane& group : groups) {
      const double between = glm::dot(group.area, plane.area) / (glm::length(group.area) * glm::length(plane.area));
      if (between > cosine) nearest = &group, cosine = between;
    }
    if (nearest == nullptr) nearest = &groups.emplace_back();
    nearest->area += plane.area;
    nearest->offset += plane.offset;
  }
  if (groups.empty()) return {};
  return *std::ranges::max_element(groups, {}, [](const BoundaryPlane& p) { return squared_length(p.area); });
}

}  // namespace

std::vector<OuterFace> find_outer_faces(std::span<const dvec3> positions, std::span<const Tetrahedron> tetrahedra) {
  std::vector<std::int8_t> turns(tetrahedra.size());
  tbb::parallel_for(std::size_t{0}, tetrahedra.size(),
                    [&](std::size_t t) { turns[t] = static_cast<std::int8_t>(turn_of(positions, tetrahedra[t])); });
  Sides sides = match_all_sides(positions.size(), tetrahedra, turns);
  turn_flat(tetrahedra, std::move(sides.at_flat), turns);
  std::vector<OuterFace> faces;
  faces.reserve(sides.outer.size());
  for (const Side side : sides.outer) {
    const auto [a, b, c] = corners_of(side, tetrahedra);
    const std::int8_t turn = turns[side / 4];
    faces.push_back({{a, turn < 0 ? c : b, turn < 0 ? b : c}, turn != 0, static_cast<std::uint32_t>(side / 4)});
  }
  return faces;
}

std::vector<BoundaryPlane> boundary_planes(std::span<const dvec3> positions, std::span<const OuterFace> faces) {
  // Pairs of a corner and a face, for the faces that count.
  std::vector<dvec3> areas(faces.size());
  std::vector<std::pair<std::uint64_t, std::size_t>> corners;
  for (std::size_t f = 0; f < faces.size(); ++f) {
    const dvec3& origin = positions[faces[f].corners[0]];
    areas[f] = glm::cross(positions[faces[f].corners[1]] - origin, positions[faces[f].corners[2]] - origin) / 2.0;
    const double area = squared_length(areas[f]);
    if (!faces[f].has_side || !(area > 0) || !std::isfinite(area)) continue;
    for (const std::uint64_t corner : faces[f].corners) corners.emplace_back(corner, f);
  }
  tbb::parallel_sort(corners.begin(), corners.end());
  std::vector<std::size_t> begins;
  for (std::size_t k = 0; k < corners.size(); ++k)
    if (k == 0 || corners[k].first != corners[k - 1].first) begins.push_back(k);
  begins.push_back(corners.size());

  std::vector<BoundaryPlane> planes(positions.size());
  tbb::parallel_for(std::size_t{0}, begins.size() - 1, [&](std::size_t i) {
    std::vector<BoundaryPlane> incident;
    for (std::size_t k = begins[i]; k < begins[i + 1]; ++k) incident.push_back({areas[corners[k].second] / 3.0, 0});
    planes[corners[begins[i]].first] = largest_group(incident);
  });
  return planes;
}

BoundaryPlane merge_planes(std::span<const BoundaryPlane> members, std::span<const dvec3> shifts) {
  std::vector<BoundaryPlane> planes;
  for (std::size_t m = 0; m < members.size(); ++m) {
    const BoundaryPlane& plane = members[m];
    if (plane.area != dvec3(0)) planes.push_back({plane.area, plane.offset + glm::dot(plane.area, shifts[m])});
  }
  return largest_group(planes);
}

dvec3 boundary_foot(const BoundaryPlane& plane, const SpatialMoments& moments, const SplatShape& shape) {
  if (plane.area == dvec3(0)) return dvec3(0);
  const double area = glm::length(plane.area);
  if (!(area > 0)) return dvec3(0);
  const dvec3 outwards = plane.area / area;
  const double distance = plane.offset / area - glm::dot(outwards, moments.centroid);
  const dmat3 axes = glm::mat3_cast(shape.orientation);
  const dvec3 normal =
      dvec3(glm::dot(outwards, axes[0]), glm::dot(outwards, axes[1]), glm::dot(outwards, axes[2])) * shape.deviations;
  const double variance = glm::dot(normal, normal);
  const double square = distance * distance / variance;
  if (!(distance > 0 && square >= nearest_square && square <= farthest_square)) return dvec3(0);
  return distance / variance * normal;
}

}  // namespace splatvol
