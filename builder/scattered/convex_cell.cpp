#include "builder/scattered/convex_cell.h"

#include <algorithm>
#include <array>
#include <utility>

namespace splatvol {
namespace {

constexpr std::uint32_t nowhere = std::numeric_limits<std::uint32_t>::max();

}  // namespace

void ConvexCell::reset(const dvec3& low, const dvec3& high) {
  vertices_.clear();
  for (unsigned corner = 0; corner < 8; ++corner)
    vertices_.emplace_back(corner & 1 ? high.x : low.x, corner & 2 ? high.y : low.y, corner & 4 ? high.z : low.z);
  loops_ = {0, 4, 6, 2, 1, 3, 7, 5, 0, 1, 5, 4, 2, 6, 7, 3, 0, 2, 3, 1, 4, 5, 7, 6};
  faces_.clear();
  for (std::uint32_t face = 0; face < 6; ++face) {
    dvec3 normal{0};
    normal[static_cast<int>(face / 2)] = face % 2 ? 1 : -1;
    faces_.push_back({normal, no_label, 4 * face, 4 * face + 4});
  }
}

std::uint32_t ConvexCell::cross(std::uint32_t inside, std::uint32_t outside) {
  for (std::uint32_t c = 0; c < crossings_.size(); ++c)
    if (crossings_[c].inside == inside && crossings_[c].outside == outside) return c;
  const double share = heights_[inside] / (heights_[inside] - heights_[outside]);
  crossings_.push_back({inside, outside, static_cast<std::uint32_t>(new_vertices_.size()), nowhere});
  new_vertices_.push_back(vertices_[inside] + share * (vertices_[outside] - vertices_[inside]));
  return static_cast<std::uint32_t>(crossings_.size() - 1);
}

// Clips a face. Where its border leaves the kept part and returns, the face gets a new edge; the new face has this edge
// the other way round.
void ConvexCell::clip_face(const Face& face) {
  const auto begin = static_cast<std::uint32_t>(new_loops_.size());
  std::uint32_t left = nowhere, first_return = nowhere;
  const auto corners = loop(face);
  for (std::size_t k = 0; k < corners.size(); ++k) {
    const std::uint32_t a = corners[k], b = corners[k + 1 < corners.size() ? k + 1 : 0];
    const bool a_stays = heights_[a] <= 0, b_stays = heights_[b] <= 0;
    if (a_stays) new_loops_.push_back(renamed_[a]);
    if (a_stays == b_stays) continue;
    const std::uint32_t crossing = a_stays ? cross(a, b) : cross(b, a);
    new_loops_.push_back(crossings_[crossing].vertex);
    if (a_stays)
      left = crossing;
    else if (left != nowhere)
      crossings_[crossing].next = left;
    else
      first_return = crossing;
  }
  if (first_return != nowhere) crossings_[first_return].next = left;
  const auto end = static_cast<std::uint32_t>(new_loops_.size());
  if (end > begin) new_faces_.push_back({face.normal, face.label, begin, end});
}

void ConvexCell::add_cap(const dvec3& normal, std::uint32_t label) {
  for (Crossing& start : crossings_) {
    if (start.next == nowhere) continue;
    const auto begin = static_cast<std::uint32_t>(new_loops_.size());
    for (Crossing* at = &start; at->next != nowhere;) {
      new_loops_.push_back(at->vertex);
      at = &crossings_[std::exchange(at->next, nowhere)];
    }
    new_faces_.push_back({normal, label, begin, static_cast<std::uint32_t>(new_loops_.size())});
  }
}

bool ConvexCell::clip(const dvec3& normal, double offset, std::uint32_t label) {
  heights_.clear();
  for (const dvec3& vertex : vertices_) heights_.push_back(glm::dot(normal, vertex) - offset);
  if (std::ranges::none_of(heights_, [](double height) { return height > 0; })) return false;
  crossings_.clear();
  new_vertices_.clear();
  new_faces_.clear();
  new_loops_.clear();
  renamed_.assign(vertices_.size(), nowhere);
  for (std::size_t v = 0; v < vertices_.size(); ++v) {
    if (heights_[v] > 0) continue;
    renamed_[v] = static_cast<std::uint32_t>(new_vertices_.size());
    new_vertices_.push_back(vertices_[v]);
  }
  for (const Face& face : faces_) clip_face(face);
  add_cap(normal, label);
  vertices_.swap(new_vertices_);
  faces_.swap(new_faces_);
  loops_.swap(new_loops_);
  return true;
}

// Adds up the tetrahedra between one vertex and the triangles of the faces. A uniform tetrahedron has these moments:
// E[x] is the mean of the corners, and E[x x^T] = (square of the corners' sum + sum of the corners' squares) / 20.
SpatialMoments ConvexCell::moments() const {
  double volume = 0;
  dvec3 first{0};
  SymmetricMatrix second;
  if (vertices_.empty()) return {};
  const dvec3 apex = vertices_[0];
  for (const Face& face : faces_) {
    const auto corners = loop(face);
    for (std::size_t k = 2; k < corners.size(); ++k) {
      const std::array edges = {vertices_[corners[0]] - apex, vertices_[corners[k - 1]] - apex,
                                vertices_[corners[k]] - apex};
      const double part = glm::dot(edges[0], glm::cross(edges[1], edges[2])) / 6;
      const dvec3 sum = edges[0] + edges[1] + edges[2];
      volume += part;
      first += part / 4 * sum;
      add_square(second, part / 20, sum);
      for (const dvec3& edge : edges) add_square(second, part / 20, edge);
    }
  }
  if (!(volume > 0)) return {};
  SpatialMoments moments;
  moments.mass = volume;
  const dvec3 mean = first / volume;
  moments.centroid = apex + mean;
  moments.covariance = {second.xx / volume - mean.x * mean.x, second.yy / volume - mean.y * mean.y,
                        second.zz / volume - mean.z * mean.z, second.xy / volume - mean.x * mean.y,
                        second.xz / volume - mean.x * mean.z, second.yz / volume - mean.y * mean.z};
  return moments;
}

}  // namespace splatvol
