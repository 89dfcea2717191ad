#include "extractor/contour.h"

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

// Adds the triangles of a tetrahedron, whose vertices are on edges.
void add_triangles(const Sides& sides, std::vector<std::array<Edge, 3>>& triangles) {
  const auto& [a, b, c, d] = sides.corners;
  if (sides.inside == 1) triangles.push_back({edge_of(a, b), edge_of(a, c), edge_of(a, d)});
  if (sides.inside == 3) triangles.push_back({edge_of(a, d), edge_of(b, d), edge_of(c, d)});
  if (sides.inside != 2) return;
  triangles.push_back({edge_of(a, c), edge_of(a, d), edge_of(b, d)});
  triangles.push_back({edge_of(a, c), edge_of(b, d), edge_of(b, c)});
}

// The way from a value to another at which a third is; without overflow.
double share_of(double value, double from, double to) { return (0.5 * value - 0.5 * from) / (0.5 * to - 0.5 * from); }

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

ContourPart contour_of(const Tetrahedra& tetrahedra, double value) {
  const std::vector<double>& values = tetrahedra.values[0];
  std::vector<std::array<Edge, 3>> found;
  for (const std::array<std::uint32_t, 4>& corners : tetrahedra.corners) {
    const auto& [a, b, c, d] = corners;
    const auto [low, high] = std::minmax({values[a], values[b], values[c], values[d]});
    if (!(low < value && high >= value) || std::isnan(values[a] + values[b] + values[c] + values[d])) continue;
    add_triangles(sides_of(corners, values, value, tetrahedra.points), found);
  }

  // Vertices, each once. One whose share rounds to an end of its edge is the point there.
  std::vector<Edge> edges;
  edges.reserve(3 * found.size());
  for (std::array<Edge, 3>& triangle : found)
    for (Edge& edge : triangle) {
      const auto from = static_cast<std::uint32_t>(edge >> 32), to = static_cast<std::uint32_t>(edge);
      const double share = share_of(value, values[from], values[to]);
      if (!(share > 0)) edge = edge_of(from, from);
      if (share >= 1) edge = edge_of(to, to);
      edges.push_back(edge);
    }
  std::ranges::sort(edges);
  edges.erase(std::ranges::unique(edges).begin(), edges.end());

  ContourPart part;
  part.values.resize(tetrahedra.values.size());
  for (const Edge edge : edges) {
    const auto from = static_cast<std::uint32_t>(edge >> 32), to = static_cast<std::uint32_t>(edge);
    const double share = from == to ? 0 : share_of(value, values[from], values[to]);
    const dvec3 &start = tetrahedra.points[from], &end = tetrahedra.points[to];
    part.keys.push_back({tetrahedra.ranks[from], tetrahedra.ranks[to]});
    part.points.push_back(from == to ? start : start + share * (end - start));
    part.values[0].push_back(value);
    for (std::size_t a = 1; a < part.values.size(); ++a) {
      const std::vector<double>& of_points = tetrahedra.values[a];
      part.values[a].push_back(from == to ? of_points[from] : (1 - share) * of_points[from] + share * of_points[to]);
    }
  }
  for (const std::array<Edge, 3>& triangle : found) {
    std::array<std::uint32_t, 3> vertices{};
    for (std::size_t k = 0; k < 3; ++k)
      vertices[k] = static_cast<std::uint32_t>(std::ranges::lower_bound(edges, triangle[k]) - edges.begin());
    if (vertices[0] != vertices[1] && vertices[1] != vertices[2] && vertices[2] != vertices[0])
      part.triangles.push_back(vertices);
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
