#include "builder/scattered/convex_cell.h"

#include <algorithm>
#include <bit>

namespace splatvol {
namespace {

// Along a face, to the left of which edge `number` leads away from a vertex, this edge leads on.
std::uint32_t next_edge(std::uint32_t number) {
  // 2, 0, 1: a branch would be guessed wrong.
  return 0b01'00'10U >> 2 * number & 3;
}

}  // namespace

void ConvexCell::make_room(std::size_t count) {
  if (count <= vertices_.size()) return;
  vertices_.resize(2 * count);
  edges_.resize(2 * count);
  heights_.resize(2 * count);
  outside_.resize(2 * count);
  crossings_.resize(6 * count);
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
      planes_.emplace_back(normal, no_label);
    }
}

bool ConvexCell::clip(const dvec3& normal, double offset, std::uint32_t label) {
  for (std::uint32_t v = 0; v < count_; ++v) heights_[v] = glm::dot(normal, vertices_[v]) - offset;
  std::size_t count = 0;
  for (std::uint32_t v = 0; v < count_; ++v) {
    outside_[count] = v;
    count += heights_[v] > 0 ? 1 : 0;
  }
  if (count == 0) return false;
  faces_.clear();
  planes_.emplace_back(normal, label);
  make_room(count_ + 3 * count);
  const std::span outside = std::span(outside_).first(count);
  const std::span crossings = find_crossings(outside);
  const bool joined = join(crossings);
  if (joined) replace(outside, crossings);
  // With three faces at each vertex, a closed cell has fewer than two vertices for each face, or a few more by
  // rounding. Sizes that are many decades apart can round it open: then it would grow with every cut, and nothing is
  // left of it.
  constexpr std::size_t most_for_a_face = 8;
  if (!joined || count_ > most_for_a_face * planes_.size()) count_ = 0;
  return true;
}

// Lists the edges from outside to inside. From outside, each then leads to its crossing: numbers from count_ on.
std::span<ConvexCell::Crossing> ConvexCell::find_crossings(std::span<const std::uint32_t> outside) {
  std::uint32_t count = 0;
  for (const std::uint32_t v : outside)
    for (std::uint32_t k = 0; k < 3; ++k) {
      crossings_[count].vertex = v, crossings_[count].edge = k;
      count += heights_[edges_[v][k].to] > 0 ? 0 : 1;
    }
  for (std::uint32_t c = 0; c < count; ++c) {
    Crossing& crossing = crossings_[c];
    const std::uint32_t v = crossing.vertex;
    Edge& edge = edges_[v][crossing.edge];
    const double share = heights_[edge.to] / (heights_[edge.to] - heights_[v]);
    crossing.position = vertices_[edge.to] + share * (vertices_[v] - vertices_[edge.to]);
    crossing.inside = edge;
    edge.to = count_ + c;
    // The last new vertices take the places of the outside ones.
    const std::size_t from_end = count - 1 - c;
    crossing.place = from_end < outside.size() ? outside[from_end] : count_ + c;
  }
  return std::span(crossings_).first(count);
}

// Goes along the outside vertices of each cut face: from the crossing out of the inside to the crossing back. Returns
// false if the way round a face does not end.
bool ConvexCell::join(std::span<Crossing> crossings) {
  for (Crossing& crossing : crossings) {
    std::uint32_t vertex = crossing.vertex, edge = next_edge(crossing.edge);
    for (std::uint32_t steps = 0; edges_[vertex][edge].to < count_; ++steps) {
      if (steps > count_) return false;
      const Edge& along = edges_[vertex][edge];
      vertex = along.to;
      edge = next_edge(along.number);
    }
    crossing.back = edges_[vertex][edge].to - count_;
  }
  return true;
}

// Puts a vertex at each crossing, whose edge 0 leads inside. Moves the last vertices to where other outside ones are.
void ConvexCell::replace(std::span<const std::uint32_t> outside, std::span<const Crossing> crossings) {
  const auto cap = static_cast<std::uint32_t>(planes_.size() - 1);
  for (const Crossing& crossing : crossings) {
    const std::uint32_t place = crossing.place, back = crossings[crossing.back].place;
    Edge& inside = edges_[crossing.inside.to][crossing.inside.number];
    vertices_[place] = crossing.position;
    heights_[place] = 0;
    edges_[place][0] = crossing.inside;
    edges_[place][2] = {back, 1, inside.plane};
    edges_[back][1] = {place, 2, cap};
    inside.to = place, inside.number = 0;
  }
  const std::size_t replaced = std::min(crossings.size(), outside.size());
  count_ += static_cast<std::uint32_t>(crossings.size() - replaced);
  for (const std::uint32_t v : outside.subspan(replaced)) {
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
  const std::size_t edges = 3 * std::size_t{count_};
  loops_.resize(edges);
  seen_.assign(edges, 0);
  std::uint32_t end = 0;
  for (std::uint32_t v = 0; v < count_; ++v)
    for (std::uint32_t k = 0; k < 3; ++k) {
      if (seen_[3 * v + k] != 0) continue;
      const Plane& plane = planes_[edges_[v][k].plane];
      const std::uint32_t begin = end;
      for (std::uint32_t at = v, edge = k; seen_[3 * at + edge] == 0;) {
        seen_[3 * at + edge] = 1;
        loops_[end++] = at;
        const Edge& along = edges_[at][edge];
        at = along.to;
        edge = next_edge(along.number);
      }
      faces_.emplace_back(plane.normal, plane.label, begin, end);
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
