#include "sampler/contour.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

namespace splatvol {
namespace {

// An edge of a chunk: its points, the lower one in front.
using Edge = std::uint64_t;
Edge edge_of(std::uint32_t a, std::uint32_t b) { return std::uint64_t{std::min(a, b)} << 32 | std::max(a, b); }

// The corners of a tetrahedron, in an order of positive volume unless it is flat.
struct Sides {
  std::array<std::uint32_t, 4> corners;  // those inside, then those outside
  std::size_t inside;
};

Sides sides_of(const std::array<std::uint32_t, 4>& corners, std::span<const double> values, double value,
               std::span<const dvec3> points) {
  Sides sides{{}, 0};
  std::size_t end = 0;
  for (const std::uint32_t corner : corners)
    if (values[corner] >= value) sides.corners[end++] = corner;
  sides.inside = end;
  for (const std::uint32_t corner : corners)
    if (!(values[corner] >= value)) sides.corners[end++] = corner;
  const auto& [a, b, c, d] = sides.corners;
  // Two of one side change places.
  if (glm::dot(points[b] - points[a], glm::cross(points[c] - points[a], points[d] - points[a])) < 0)
    sides.inside >= 2 ? std::swap(sides.corners[0], sides.corners[1]) : std::swap(sides.corners[2], sides.corners[3]);
  return sides;
}

// A triangle whose vertices are on edges.
struct FoundTriangle {
  std::array<Edge, 3> edges;
  std::uint32_t tetrahedron;
};

// Adds the triangles of a tetrahedron.
void add_triangles(const Sides& sides, std::uint32_t tetrahedron, std::vector<FoundTriangle>& triangles) {
  const auto& [a, b, c, d] = sides.corners;
  const auto add = [&](Edge first, Edge second, Edge third) {
    triangles.push_back({{first, second, third}, tetrahedron});
  };
  if (sides.inside == 1) add(edge_of(a, b), edge_of(a, c), edge_of(a, d));
  if (sides.inside == 3) add(edge_of(a, d), edge_of(b, d), edge_of(c, d));
  if (sides.inside != 2) return;
  add(edge_of(a, c), edge_of(a, d), edge_of(b, d));
  add(edge_of(a, c), edge_of(b, d), edge_of(b, c));
}

// The way from a value to another at which a third is; without overflow.
double share_of(double value, double from, double to) { return (0.5 * value - 0.5 * from) / (0.5 * to - 0.5 * from); }

struct Ends {
  std::uint32_t from, to;
};
Ends ends_of(Edge edge) { return {static_cast<std::uint32_t>(edge >> 32), static_cast<std::uint32_t>(edge)}; }

// Finds all triangles. A vertex whose share rounds to an end of its edge is the point there.
std::vector<FoundTriangle> find_triangles(const Tetrahedra& tetrahedra, std::span<const double> function,
                                          double value) {
  std::vector<FoundTriangle> found;
  for (std::uint32_t t = 0; t < tetrahedra.size(); ++t) {
    const auto& [a, b, c, d] = tetrahedra.corners[t];
    const auto [low, high] = std::minmax({function[a], function[b], function[c], function[d]});
    if (!(low < value && high >= value) || std::isnan(function[a] + function[b] + function[c] + function[d])) continue;
    add_triangles(sides_of(tetrahedra.corners[t], function, value, tetrahedra.points), t, found);
  }
  for (FoundTriangle& triangle : found)
    for (Edge& edge : triangle.edges) {
      const auto [from, to] = ends_of(edge);
      const double share = share_of(value, function[from], function[to]);
      if (!(share > 0)) edge = edge_of(from, from);
      if (share >= 1) edge = edge_of(to, to);
    }
  return found;
}

// The edges that have vertices, each once.
std::vector<Edge> edges_of(std::span<const FoundTriangle> triangles) {
  std::vector<Edge> edges;
  edges.reserve(3 * triangles.size());
  for (const FoundTriangle& triangle : triangles)
    edges.insert(edges.end(), triangle.edges.begin(), triangle.edges.end());
  std::ranges::sort(edges);
  edges.erase(std::ranges::unique(edges).begin(), edges.end());
  return edges;
}

std::uint64_t mixed(std::uint64_t bits) {  // the end of SplitMix64
  bits = (bits ^ bits >> 30) * 0xbf58476d1ce4e5b9u;
  bits = (bits ^ bits >> 27) * 0x94d049bb133111ebu;
  return bits ^ bits >> 31;
}

std::uint64_t hash_of(const dvec3& point, std::uint64_t seed) {
  std::uint64_t hash = seed;
  for (int axis = 0; axis < 3; ++axis) hash = mixed(hash + std::bit_cast<std::uint64_t>(point[axis] + 0.0));
  return hash;
}

}  // namespace

ContourPart contour_of(const Tetrahedra& tetrahedra, std::span<const double> function, double value) {
  const std::vector<FoundTriangle> found = find_triangles(tetrahedra, function, value);
  const std::vector<Edge> edges = edges_of(found);
  ContourPart part;
  part.values.resize(tetrahedra.constant ? 0 : tetrahedra.values.size());
  for (const Edge edge : edges) {
    const auto [from, to] = ends_of(edge);
    const double share = from == to ? 0 : share_of(value, function[from], function[to]);
    const dvec3 &start = tetrahedra.points[from], &end = tetrahedra.points[to];
    part.keys.push_back({tetrahedra.ranks[from], tetrahedra.ranks[to]});
    part.points.push_back(from == to ? start : start + share * (end - start));
    for (std::size_t a = 0; a < part.values.size(); ++a) {
      const std::vector<double>& all = tetrahedra.values[a];
      const bool is_function = all.data() == function.data();
      part.values[a].push_back(is_function  ? value
                               : from == to ? all[from]
                                            : (1 - share) * all[from] + share * all[to]);
    }
  }
  for (const FoundTriangle& triangle : found) {
    std::array<std::uint32_t, 3> vertices{};
    for (std::size_t k = 0; k < 3; ++k)
      vertices[k] = static_cast<std::uint32_t>(std::ranges::lower_bound(edges, triangle.edges[k]) - edges.begin());
    if (vertices[0] == vertices[1] || vertices[1] == vertices[2] || vertices[2] == vertices[0]) continue;
    part.triangles.push_back(vertices);
    part.tetrahedra.push_back(triangle.tetrahedron);
  }
  return part;
}

void ContourMeasure::add(const ContourPart& part) {
  for (std::size_t t = 0; t < part.triangles.size(); ++t) {
    const auto [a, b, c] = part.corners_of(t);
    area_ += 0.5 * glm::length(glm::cross(b - a, c - a));
    volume_ += glm::dot(a - middle_, glm::cross(b - middle_, c - middle_)) / 6;
    add_edge(a, b), add_edge(b, c), add_edge(c, a);
  }
}

void ContourMeasure::add(const ContourMeasure& other) {
  area_ += other.area_;
  volume_ += other.volume_;
  for (std::size_t i = 0; i < edges_.size(); ++i) edges_[i] ^= other.edges_[i];
}

void ContourMeasure::add_edge(const dvec3& a, const dvec3& b) {
  if (a == b) return;
  for (std::size_t i = 0; i < edges_.size(); ++i) edges_[i] ^= mixed(hash_of(a, i + 1) + hash_of(b, i + 1));
}

}  // namespace splatvol
