#include "tools/bisection_mesh.h"

#include <algorithm>
#include <utility>

namespace splatvol {

BisectionMesh::BisectionMesh(dvec3 low, dvec3 high) {
  for (std::uint32_t corner = 0; corner < 8; ++corner)
    points_.emplace_back(corner & 1 ? high.x : low.x, corner & 2 ? high.y : low.y, corner & 4 ? high.z : low.z);

  // Each tetrahedron follows three edges from the lowest corner to the highest, in one order of the axes.
  std::array<std::uint32_t, 3> axes = {1, 2, 4};
  do {
    elements_.push_back({{0, axes[0], axes[0] | axes[1], 7}, 3});
  } while (std::ranges::next_permutation(axes).found);
}

std::array<std::uint32_t, 4> BisectionMesh::tetrahedron(std::size_t index) const {
  auto vertices = elements_[index].vertices;
  const dvec3 a = points_[vertices[0]];
  const dvec3 normal = glm::cross(points_[vertices[1]] - a, points_[vertices[2]] - a);
  if (glm::dot(normal, points_[vertices[3]] - a) < 0) std::swap(vertices[2], vertices[3]);
  return vertices;
}

void BisectionMesh::refine(const std::vector<char>& marked) {
  middles_.clear();
  on_cut_edge_.assign(points_.size(), 0);
  const std::size_t count = elements_.size();
  for (std::size_t i = 0; i < count; ++i)
    if (marked[i]) bisect(i);
  for (bool cut = true; cut;) {
    cut = false;
    for (std::size_t i = 0; i < elements_.size(); ++i) {
      if (!has_hanging_vertex(elements_[i])) continue;
      bisect(i);
      cut = true;
    }
  }
}

std::uint64_t BisectionMesh::edge_key(std::uint32_t a, std::uint32_t b) {
  return static_cast<std::uint64_t>(std::min(a, b)) << 32 | std::max(a, b);
}

bool BisectionMesh::has_hanging_vertex(const Element& element) const {
  const auto& v = element.vertices;
  for (std::size_t i = 0; i < 4; ++i)
    for (std::size_t k = i + 1; k < 4; ++k)
      if (on_cut_edge_[v[i]] && on_cut_edge_[v[k]] && middles_.contains(edge_key(v[i], v[k]))) return true;
  return false;
}

std::uint32_t BisectionMesh::middle(std::uint32_t a, std::uint32_t b) {
  const auto [entry, is_new] = middles_.try_emplace(edge_key(a, b), static_cast<std::uint32_t>(points_.size()));
  if (!is_new) return entry->second;
  points_.push_back(0.5 * (points_[a] + points_[b]));
  on_cut_edge_.push_back(0);
  on_cut_edge_[a] = on_cut_edge_[b] = 1;
  return entry->second;
}

void BisectionMesh::bisect(std::size_t index) {
  // Maubach: x0..xd..xn with tag d becomes x0..x(d-1), z, x(d+1).. and x1..xd, z, x(d+1)..; tags run n, n-1, .., 1, n.
  const auto [x, tag] = elements_[index];
  const std::uint32_t z = middle(x[0], x[tag]);
  Element first{x, static_cast<std::uint8_t>(tag == 1 ? 3 : tag - 1)};
  Element second = first;
  first.vertices[tag] = z;
  for (std::size_t i = 0; i < tag; ++i) second.vertices[i] = x[i + 1];
  second.vertices[tag] = z;
  elements_[index] = first;
  elements_.push_back(second);
}

}  // namespace splatvol
