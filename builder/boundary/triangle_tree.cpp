#include "builder/boundary/triangle_tree.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace splatvol {
namespace {

constexpr std::uint32_t leaf_triangles = 8;

double squared_distance_to_edge(const dvec3& position, const dvec3& a, const dvec3& b) {
  const dvec3 edge = b - a;
  const double square = squared_length(edge);
  const double t = square > 0 ? std::clamp(glm::dot(position - a, edge) / square, 0.0, 1.0) : 0;
  return squared_length(a + t * edge - position);
}

}  // namespace

double squared_distance(const dvec3& position, const dvec3& a, const dvec3& b, const dvec3& c) {
  const dvec3 normal = glm::cross(b - a, c - a);
  const double square = squared_length(normal);
  const auto is_inside = [&](const dvec3& from, const dvec3& to) {
    return glm::dot(glm::cross(to - from, position - from), normal) >= 0;
  };
  if (square > 0 && is_inside(a, b) && is_inside(b, c) && is_inside(c, a)) {
    const double height = glm::dot(position - a, normal);
    return height * height / square;
  }
  return std::min({squared_distance_to_edge(position, a, b), squared_distance_to_edge(position, b, c),
                   squared_distance_to_edge(position, c, a)});
}

TriangleTree::TriangleTree(std::span<const dvec3> points, std::span<const Triangle> triangles)
    : points_(points), triangles_(triangles), order_(triangles.size()) {
  std::iota(order_.begin(), order_.end(), 0u);
  if (!order_.empty()) build(0, static_cast<std::uint32_t>(order_.size()));
}

Box TriangleTree::box_of(std::uint32_t triangle) const {
  Box box;
  for (const std::uint32_t corner : triangles_[triangle]) box.include(points_[corner]);
  return box;
}

// Halves the triangles across the longest axis of their box.
void TriangleTree::build(std::uint32_t begin, std::uint32_t end) {
  const std::size_t number = nodes_.size();
  Box box;
  for (std::uint32_t i = begin; i < end; ++i) box.include(box_of(order_[i]));
  nodes_.push_back({box, begin, end});
  if (end - begin <= leaf_triangles) return;
  const int axis = longest_axis(box.high - box.low);
  const auto middle = [&](std::uint32_t triangle) {
    const auto& [a, b, c] = triangles_[triangle];
    return points_[a][axis] + points_[b][axis] + points_[c][axis];
  };
  const std::uint32_t half = begin + (end - begin) / 2;
  std::nth_element(order_.begin() + begin, order_.begin() + half, order_.begin() + end,
                   [&](std::uint32_t p, std::uint32_t q) { return middle(p) < middle(q); });
  build(begin, half);
  nodes_[number].right = static_cast<std::uint32_t>(nodes_.size());
  build(half, end);
}

double TriangleTree::distance(const dvec3& position) const {
  double least = std::numeric_limits<double>::infinity();
  std::array<std::uint32_t, 64> stack{};
  std::size_t open = nodes_.empty() ? 0 : 1;
  while (open > 0) {
    const std::uint32_t number = stack[--open];
    const Node& node = nodes_[number];
    if (squared_distance(node.box, position) >= least) continue;
    if (node.right == 0) {
      for (std::uint32_t i = node.begin; i < node.end; ++i) {
        const auto& [a, b, c] = triangles_[order_[i]];
        least = std::min(least, squared_distance(position, points_[a], points_[b], points_[c]));
      }
      continue;
    }
    const bool left_first =
        squared_distance(nodes_[number + 1].box, position) <= squared_distance(nodes_[node.right].box, position);
    stack[open++] = left_first ? node.right : number + 1;
    stack[open++] = left_first ? number + 1 : node.right;
  }
  return std::sqrt(least);
}

bool TriangleTree::any_near(const dvec3& position, double distance,
                            const std::function<bool(std::uint32_t triangle)>& accept) const {
  std::array<std::uint32_t, 64> stack{};
  std::size_t open = nodes_.empty() ? 0 : 1;
  while (open > 0) {
    const std::uint32_t number = stack[--open];
    const Node& node = nodes_[number];
    if (squared_distance(node.box, position) > distance * distance) continue;
    if (node.right != 0) {
      stack[open++] = number + 1;
      stack[open++] = node.right;
      continue;
    }
    for (std::uint32_t i = node.begin; i < node.end; ++i)
      if (accept(order_[i])) return true;
  }
  return false;
}

}  // namespace splatvol
