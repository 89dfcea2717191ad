#include "sampler/tetrahedron.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace splatvol {
namespace {

// [corner]: those of the face opposite to it, in ascending order.
constexpr std::array<std::array<std::size_t, 3>, 4> opposite = {{{1, 2, 3}, {0, 2, 3}, {0, 1, 3}, {0, 1, 2}}};

double determinant(const dvec3& a, const dvec3& b, const dvec3& c) { return glm::dot(a, glm::cross(b, c)); }

// Six times the signed volume that a position spans with the face opposite to a corner. The four add up to that of the
// tetrahedron.
double volume_at(const TetrahedronCorners& corners, std::size_t corner, const dvec3& position) {
  const auto& [a, b, c] = opposite[corner];
  const double volume = determinant(corners[a] - position, corners[b] - position, corners[c] - position);
  return corner % 2 == 0 ? volume : -volume;
}

CornerWeights volumes_of(const TetrahedronCorners& corners, const dvec3& position) {
  CornerWeights volumes{};
  for (std::size_t k = 0; k < 4; ++k) volumes[k] = volume_at(corners, k, position);
  return volumes;
}

// The share of the way from a to b of the point nearest to a position.
double nearest_share(const dvec3& a, const dvec3& b, const dvec3& position) {
  const dvec3 edge = b - a;
  const double length = squared_length(edge);
  return length > 0 ? std::clamp(glm::dot(position - a, edge) / length, 0.0, 1.0) : 0;
}

}  // namespace

double rounding_of(const dvec3& position) {
  return 8 * std::numeric_limits<double>::epsilon() *
         std::max({std::abs(position.x), std::abs(position.y), std::abs(position.z)});
}

double value_at(const std::array<double, 4>& values, const CornerWeights& weights) {
  const double mean = weights[0] * values[0] + weights[1] * values[1] + weights[2] * values[2] + weights[3] * values[3];
  const auto [low, high] = std::ranges::minmax(values);
  return std::isnan(mean) ? mean : std::clamp(mean, low, high);
}

std::optional<CornerWeights> weights_in(const TetrahedronCorners& corners, const dvec3& position) {
  CornerWeights weights{};
  bool has_positive = false, has_negative = false;
  for (std::size_t k = 0; k < 4; ++k) {
    weights[k] = volume_at(corners, k, position);
    has_positive = has_positive || weights[k] > 0;
    has_negative = has_negative || weights[k] < 0;
    if (has_positive && has_negative) return {};  // mostly found soon
  }
  const double sum = weights[0] + weights[1] + weights[2] + weights[3];
  if (!(std::abs(sum) > 0)) return {};
  for (double& weight : weights)
    if (!((weight /= sum) >= 0)) return {};
  return weights;
}

std::array<double, 3> nearest_on(const std::array<dvec3, 3>& triangle, const dvec3& position) {
  const auto& [a, b, c] = triangle;
  const dvec3 normal = glm::cross(b - a, c - a);
  if (const double area = squared_length(normal); area > 0) {
    const double of_b = glm::dot(glm::cross(position - a, c - a), normal) / area;
    const double of_c = glm::dot(glm::cross(b - a, position - a), normal) / area;
    if (of_b >= 0 && of_c >= 0 && of_b + of_c <= 1) return {1 - of_b - of_c, of_b, of_c};
  }
  std::array<double, 3> nearest{};
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t from = 0; from < 3; ++from) {
    const std::size_t to = (from + 1) % 3;
    const double share = nearest_share(triangle[from], triangle[to], position);
    const dvec3 at = triangle[from] + share * (triangle[to] - triangle[from]);
    if (const double distance = squared_length(position - at); distance < least) {
      least = distance;
      nearest = {};
      nearest[from] = 1 - share;
      nearest[to] = share;
    }
  }
  return nearest;
}

std::optional<SurfacePoint> nearest_on(const TetrahedronCorners& corners, const dvec3& position, double reach) {
  const CornerWeights volumes = volumes_of(corners, position);
  const double sum = volumes[0] + volumes[1] + volumes[2] + volumes[3];
  SurfacePoint nearest{std::numeric_limits<double>::infinity(), {}};
  for (std::size_t k = 0; k < 4; ++k) {
    const std::array<dvec3, 3> face = {corners[opposite[k][0]], corners[opposite[k][1]], corners[opposite[k][2]]};
    // Mostly, the plane of a face that separates is too far away already.
    if (volumes[k] * sum < 0 &&
        std::abs(volumes[k]) > reach * glm::length(glm::cross(face[1] - face[0], face[2] - face[0])))
      return {};
    const std::array<double, 3> weights = nearest_on(face, position);
    const dvec3 at = weights[0] * face[0] + weights[1] * face[1] + weights[2] * face[2];
    const double distance = glm::length(position - at);
    if (!(distance < nearest.distance)) continue;
    nearest = {distance, {}};
    for (std::size_t i = 0; i < 3; ++i) nearest.weights[opposite[k][i]] = weights[i];
  }
  if (!(nearest.distance <= reach)) return {};
  return nearest;
}

}  // namespace splatvol
