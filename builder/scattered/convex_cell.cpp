#include "builder/scattered/convex_cell.h"

#include <algorithm>
#include <bit>

namespace splatvol {
namespace {

// Along a face, to the left of which edge `number` leads away from a vertex, this edge leads on.
std::uint32_t next_edge(std::uint32_t number) { return number == 0 ? 2 : number - 1; }

}  // namespace

void ConvexCell::make_room(std::size_t count) {
  if (count <= vertices_.size()) return;
  vertices_.resize(2 * count);
  edges_.resize(2 * count);
  heights_.resize(2 * count);
}

void ConvexCell::reset(const dvec3& low, const dvec3& high) {
  make_room(8);
  count_ = 8;
  planes_.clear();
  faces_.clear();
  for (unsigned corner = 0; corner < 8; ++corner) {
    vertices_[corner] = {corner & 1 ? high.x : low.x, corner & 2 ? high.y : low.y, corner & 4 ? high.z : low.z};
    const std::uint32_t x = corner & 1, y = 2 + (corner >> 1 & 1), z = 4 + (corner >> 2);  // planes
    // Seen from outside, the axes go round a corner one way or the other.
    if (std::popcount(corner) % 2 == 0)
      edges_[corner] = {Edge{corner ^ 1, 0, y}, Edge{corner ^ 4, 2, x}, Edge{corner ^ 2, 1, z}};
    else
      edges_[corner] = {Edge{corner ^ 1, 0, z}, Edge{corner ^ 2, 2, x}, Edge{corner ^ 4, 1, y}};
  }
  for (int axis = 0; axis < 3; ++axis)
    for (const double side : {-1.0, 1.0}) {
      dvec3 normal{0};
      normal[axis] = side;
      planes_.push_back({normal, no_label});
    }
}

bool ConvexCell::clip(const dvec3& normal, double offset, std::uint32_t label) {
  outside_.resize(count_);
  std::size_t outside = 0;
  for (std::uint32_t v = 0; v < count_; ++v) {
    heights_[v] = glm::dot(normal, vertices_[v]) - offset;
    outside_[outside] = v;
    outside += heights_[v] > 0 ? 1 : 0;
  }
  if (outside == 0) return false;
  outside_.resize(outside);
  faces_.clear();
  planes_.push_back({normal, label});
  const std::uint32_t first = count_;
  make_room(count_ + 3 * outside);
  cross_edges();
  const bool joined = join_crossings(first);
  if (joined) forget_outside();
  // With three faces at each vertex, a closed cell has fewer than two vertices for each face, or a few more by
  // rounding. Sizes that are many decades apart can round it open: then it would grow with every cut, and nothing is
  // left of it.
  constexpr std::size_t most_for_a_face = 8;
  if (!joined || count_ > most_for_a_face * planes_.size()) count_ = 0;
  return true;
}

// Puts a vertex on each edge from outside to inside. The inside part of the edge becomes edge 0 of the new vertex, and
// the outside part leads to the new vertex, too.
void ConvexCell::cross_edges() {
  crossings_.clear();
  for (const std::uint32_t v : outside_)
    for (std::uint32_t k = 0; k < 3; ++k) {
      const Edge edge = edges_[v][k];
      if (heights_[edge.to] > 0) continue;
      const double share = heights_[edge.to] / (heights_[edge.to] - heights_[v]);
      vertices_[count_] = vertices_[edge.to] + share * (vertices_[v] - vertices_[edge.to]);
      heights_[count_] = 0;
      edges_[count_][0] = edge;
      Edge& inside = edges_[edge.to][edge.number];
      inside.to = count_, inside.number = 0;
      edges_[v][k].to = count_++;
      crossings_.push_back({v, k});
    }
}

// Goes along the outside vertices of each cut face: from the crossing out of the inside to the crossing back.
// `first`: the first new vertex. Returns false if the way round a face does not end.
bool ConvexCell::join_crossings(std::uint32_t first) {
  const auto cap = static_cast<std::uint32_t>(planes_.size() - 1);
  for (std::uint32_t c = 0; c < crossings_.size(); ++c) {
    std::uint32_t vertex = crossings_[c].vertex, edge = next_edge(crossings_[c].edge);
    for (std::uint32_t steps = 0; edges_[vertex][edge].to < first; ++steps) {
      if (steps > first) return false;
      const Edge& along = edges_[vertex][edge];
      vertex = along.to;
      edge = next_edge(along.number);
    }
    const std::uint32_t leaves = first + c, returns = edges_[vertex][edge].to;
    const Edge& in = edges_[leaves][0];
    edges_[leaves][2] = {returns, 1, edges_[in.to][in.number].plane};
    edges_[returns][1] = {leaves, 2, cap};
  }
  return true;
}

// Moves the last vertices to where outside ones are.
void ConvexCell::forget_outside() {
  for (const std::uint32_t v : outside_) {
    while (count_ > 0 && heights_[count_ - 1] > 0) --count_;
    if (v >= count_) break;
    --count_;
    vertices_[v] = vertices_[count_];
    edges_[v] = edges_[count_];
    heights_[v] = 0;
    for (const Edge& edge : edges_[v]) edges_[edge.to][edge.number].to = v;
  }
}

double ConvexCell::largest_normal_squared() const {
  double largest = 0;
  for (std::uint32_t v = 0; v < count_; ++v)
    for (const Edge& edge : edges_[v])
      if (planes_[edge.plane].label != no_label)
        largest = std::max(largest, squared_length(planes_[edge.plane].normal));
  return largest;
}

std::span<const ConvexCell::Face> ConvexCell::faces() const {
  if (!faces_.empty()) return faces_;
  loops_.clear();
  seen_.assign(3 * std::size_t{count_}, 0);
  for (std::uint32_t v = 0; v < count_; ++v)
    for (std::uint32_t k = 0; k < 3; ++k) {
      if (seen_[3 * v + k] != 0) continue;
      const Plane& plane = planes_[edges_[v][k].plane];
      const auto begin = static_cast<std::uint32_t>(loops_.size());
      for (std::uint32_t at = v, edge = k; seen_[3 * at + edge] == 0;) {
        seen_[3 * at + edge] = 1;
        loops_.push_back(at);
        const Edge& along = edges_[at][edge];
        at = along.to;
        edge = next_edge(along.number);
      }
      faces_.push_back({plane.normal, plane.label, begin, static_cast<std::uint32_t>(loops_.size())});
    }
  return faces_;
}

// Adds up the tetrahedra between one vertex and the triangles of the faces. A uniform tetrahedron has these moments:
// E[x] is the mean of the corners, and E[x x^T] = (square of the corners' sum + sum of the corners' squares) / 20.
SpatialMoments ConvexCell::moments() const {
  if (count_ == 0) return {};
  double volume = 0;
  dvec3 first{0};
  SymmetricMatrix second;
  const dvec3 apex = vertices_[0];
  weights_.assign(count_, 0);
  for (const Face& face : faces()) {
    const auto corners = loop(face);
    const dvec3 a = vertices_[corners[0]] - apex;
    dvec3 b = vertices_[corners[1]] - apex;
    for (std::size_t k = 2; k < corners.size(); ++k) {
      const dvec3 c = vertices_[corners[k]] - apex, sum = a + b + c;
      const double part = glm::dot(a, glm::cross(b, c));
      volume += part;
      first += part * sum;
      add_square(second, part, sum);
      for (const std::size_t corner : {std::size_t{0}, k - 1, k}) weights_[corners[corner]] += part;
      b = c;
    }
  }
  if (!(volume > 0)) return {};
  for (std::size_t v = 0; v < count_; ++v) add_square(second, weights_[v], vertices_[v] - apex);
  SpatialMoments moments;
  moments.mass = volume / 6;
  const dvec3 mean = first / (4 * volume);
  moments.centroid = apex + mean;
  const double share = 1 / (20 * volume);
  moments.covariance = {second.xx * share - mean.x * mean.x, second.yy * share - mean.y * mean.y,
                        second.zz * share - mean.z * mean.z, second.xy * share - mean.x * mean.y,
                        second.xz * share - mean.x * mean.z, second.yz * share - mean.y * mean.z};
  return moments;
}

}  // namespace splatvol
