#include "builder/mesh/boundary.h"

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <functional>
#include <limits>
#include <utility>

#include "builder/mesh/lanes.h"

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

// Turns of tetrahedra: the sign of the volume, or 0 if it is 0 up to rounding.
LaneBits turns_of(const TetrahedronLanes& corners) {
  const LaneVectors ab = corners.b - corners.a, ac = corners.c - corners.a, ad = corners.d - corners.a;
  const auto length = [](const LaneVectors& edge) {
    Lanes square = dot(edge, edge);
    take_root(square);
    return square;
  };
  const Lanes volume = dot(ab, cross(ac, ad));
  const Lanes rounding = 4 * std::numeric_limits<double>::epsilon() * length(ab) * length(ac) * length(ad);
  return (volume < -rounding) - (volume > rounding);
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
      const auto& [a, b, c, d] = tetrahedra[t];
      const auto [low, high] = std::minmax(a, b);
      const auto [other_low, other_high] = std::minmax(c, d);
      add(std::min(low, other_low), t);
      add(std::min({std::max(low, other_low), high, other_high}), t);
    }
  });
  return lists;
}

// Sides that only one tetrahedron has; and pairs of sides that coincide, where one tetrahedron or both are flat.
struct Sides {
  std::vector<Side> outer;
  std::vector<std::pair<Side, Side>> at_flat;
};

// Matches the sides at one vertex after the other.
class SideMatcher {
 public:
  SideMatcher(std::span<const Tetrahedron> tetrahedra, std::span<const std::int8_t> turns)
      : tetrahedra_(tetrahedra), turns_(turns) {}

  // Adds the sides whose lowest vertex is `vertex`. `incident`: all tetrahedra that have such a side, ascending.
  void match(std::uint32_t vertex, std::span<const std::uint32_t> incident, Sides& sides) {
    collect(vertex, incident);
    count();
    std::erase_if(faces_, [&](const Face& face) {
      return face.count > 2 || (face.count == 2 && turns_[face.first / 4] != 0 && turns_[face.last / 4] != 0);
    });
    std::ranges::sort(faces_, {}, &Face::vertices);
    for (const Face& face : faces_)
      if (face.count == 1)
        sides.outer.push_back(face.first);
      else
        sides.at_flat.emplace_back(face.first, face.last);
  }

 private:
  // A side, and its two higher vertices.
  struct Candidate {
    std::uint64_t vertices;
    Side side;
  };

  // A face, and its sides.
  struct Face {
    std::uint64_t vertices;
    Side first, last;
    std::size_t count;
  };

  // Lists the sides whose lowest vertex is `vertex`. All are written, so that there are no branches that the processor
  // cannot foresee.
  void collect(std::uint32_t vertex, std::span<const std::uint32_t> incident) {
    candidates_.resize(3 * incident.size());
    count_ = 0;
    for (const std::uint32_t t : incident) {
      const Tetrahedron& corners = tetrahedra_[t];
      if (names_twice(corners)) continue;
      const std::size_t own = place_of(vertex, corners);
      for (std::size_t k = 1; k < 4; ++k) {
        const std::uint32_t a = corners[(own + k % 3 + 1) % 4], b = corners[(own + (k + 1) % 3 + 1) % 4];
        const std::uint32_t low = std::min(a, b), high = std::max(a, b);
        candidates_[count_] = {std::uint64_t{low} << 32 | high, 4 * Side{t} + (own + k) % 4};
        count_ += low > vertex ? 1 : 0;
      }
    }
  }

  // Finds the faces of the listed sides, by a hash table.
  void count() {
    const std::size_t mask = std::bit_ceil(2 * count_ + 1) - 1;
    slots_.assign(mask + 1, 0);
    faces_.clear();
    for (const Candidate& candidate : std::span(candidates_).first(count_)) {
      std::size_t slot = candidate.vertices * 0x9e3779b97f4a7c15u >> 32 & mask;
      while (slots_[slot] != 0 && faces_[slots_[slot] - 1].vertices != candidate.vertices) slot = (slot + 1) & mask;
      if (slots_[slot] == 0) {
        faces_.push_back({candidate.vertices, candidate.side, candidate.side, 0});
        slots_[slot] = static_cast<std::uint32_t>(faces_.size());
      }
      Face& face = faces_[slots_[slot] - 1];
      face.last = candidate.side;
      ++face.count;
    }
  }

  static bool names_twice(const Tetrahedron& corners) {
    const auto& [a, b, c, d] = corners;
    return (a == b) | (a == c) | (a == d) | (b == c) | (b == d) | (c == d);
  }

  std::span<const Tetrahedron> tetrahedra_;
  std::span<const std::int8_t> turns_;
  std::vector<Candidate> candidates_;
  std::size_t count_ = 0;  // of candidates
  std::vector<Face> faces_;
  std::vector<std::uint32_t> slots_;  // 1 + number of a face; 0: empty
};

Sides match_all_sides(std::size_t vertices, std::span<const Tetrahedron> tetrahedra, std::span<const std::int8_t> turns,
                      const IndexLists& incident) {
  constexpr std::size_t task_vertices = 4096;
  std::vector<Sides> found((vertices + task_vertices - 1) / task_vertices);
  tbb::parallel_for(std::size_t{0}, found.size(), [&](std::size_t task) {
    SideMatcher matcher(tetrahedra, turns);
    const std::size_t end = std::min(vertices, (task + 1) * task_vertices);
    for (std::size_t v = task * task_vertices; v < end; ++v) {
      if (v + 1 < end)
        for (const std::uint32_t t : incident[v + 1]) __builtin_prefetch(&tetrahedra[t]);
      matcher.match(static_cast<std::uint32_t>(v), incident[v], found[task]);
    }
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
  return find_outer_faces(positions, tetrahedra, tetrahedra_at_low_vertices(positions.size(), tetrahedra));
}

std::vector<OuterFace> find_outer_faces(std::span<const dvec3> positions, std::span<const Tetrahedron> tetrahedra,
                                        const IndexLists& incident) {
  std::vector<std::int8_t> turns(tetrahedra.size());
  visit_side_by_side(positions, tetrahedra, [&](std::size_t t, std::size_t count, const TetrahedronLanes& corners) {
    const LaneBits of_lanes = turns_of(corners);
    for (std::size_t l = 0; l < count; ++l) turns[t + l] = static_cast<std::int8_t>(of_lanes[l]);
  });
  Sides sides = match_all_sides(positions.size(), tetrahedra, turns, incident);
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
