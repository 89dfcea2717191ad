#include "builder/scattered/voronoi_cell.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "base/selection.h"
#include "builder/scattered/gradient_fit.h"
#include "builder/scattered/trimming.h"

namespace splatvol {
namespace {

// Least cosine of the angle between a face's normal and the direction away from a vertex, if the face lies on the other
// side of the point.
constexpr double min_facing = 0.4;

}  // namespace

double quantile(std::vector<double>& items, double share) {
  const auto nth = static_cast<std::size_t>(static_cast<double>(items.size() - 1) * share);
  // Comparing few items with all others has no branches that the processor would have to guess.
  constexpr std::size_t few = 64;
  for (std::size_t i = 0; i < items.size() && items.size() <= few; ++i) {
    std::size_t less = 0, not_more = 0;
    for (const double other : items) less += other < items[i] ? 1 : 0, not_more += other <= items[i] ? 1 : 0;
    if (less <= nth && nth < not_more) return items[i];
  }
  select_nth(std::span(items), nth, std::less<>());
  return items[nth];
}

void make_cell(std::span<const dvec3> positions, std::uint32_t point, std::span<const std::uint32_t> others,
               const Box& domain, ConvexCell& cell) {
  const dvec3 center = positions[point];
  cell.reset(domain.low - center, domain.high - center);
  for (const std::uint32_t other : others) {
    const dvec3 d = positions[other] - center;
    cell.clip(d, squared_length(d) / 2, other);
  }
}

double farthest_squared(const ConvexCell& cell) {
  double largest = 0;
  for (const dvec3& v : cell.vertices()) largest = std::max(largest, squared_length(v));
  return largest;
}

double usual_radius(const ConvexCell& cell, std::vector<double>& items) {
  const double farthest_neighbour = cell.largest_normal_squared();
  if (farthest_neighbour == 0) return glm::length(cell.vertices()[0]);
  items.clear();
  for (std::size_t v = 0; v < cell.vertices().size(); ++v)
    if (!cell.is_on_border(v)) items.push_back(squared_length(cell.vertices()[v]));
  return std::sqrt(items.empty() ? farthest_neighbour : std::min(quantile(items, 0.25), farthest_neighbour));
}

void trim(ConvexCell& cell, std::span<const double> usual, double own) {
  for (int cuts = 0; cuts < 32; ++cuts) {
    // The farthest of the vertices that are too far away.
    std::vector<double> limit(cell.vertices().size(), own);
    for (const auto& face : cell.faces())
      if (face.label != ConvexCell::no_label)
        for (const std::uint32_t v : cell.loop(face)) limit[v] = std::max(limit[v], usual[face.label]);
    const dvec3* farthest = nullptr;
    double distance = 0;
    for (std::size_t v = 0; v < limit.size(); ++v) {
      const double length = glm::length(cell.vertices()[v]);
      if (length > max_radius_ratio * limit[v] && length > distance) farthest = &cell.vertices()[v], distance = length;
    }
    if (!farthest) return;
    const ConvexCell::Face* opposite = nullptr;
    double nearest = std::numeric_limits<double>::infinity();
    for (const auto& face : cell.faces()) {
      const double length = glm::length(face.normal);
      if (face.label == ConvexCell::no_label || length >= nearest) continue;
      if (glm::dot(face.normal, *farthest) < -min_facing * length * distance) opposite = &face, nearest = length;
    }
    if (opposite)
      cell.clip(-opposite->normal, 0, ConvexCell::no_label);
    else
      cell.clip(*farthest / distance, own / 2, ConvexCell::no_label);
  }
}

// Weights are squares of inverse distances. The normal matrix is then a sum of squares of unit vectors, which is well
// conditioned in boundary layers too.
ValueFit fit_value(std::span<const dvec3> positions, std::uint32_t point, std::span<const std::uint32_t> neighbours,
                   std::span<const double> values) {
  ValueFit result;
  result.min = result.max = values[point];
  GradientFit fit;
  for (const std::uint32_t neighbour : neighbours) {
    const double difference = values[neighbour] - values[point];
    if (std::isnan(difference)) continue;
    const dvec3 offset = positions[neighbour] - positions[point];
    const double length = glm::length(offset);
    fit.add(offset / length, difference / length);
    result.min = std::min(result.min, values[neighbour]);
    result.max = std::max(result.max, values[neighbour]);
  }
  if (!fit.empty()) result.gradient = fit.gradient();
  return result;
}

ValueMoments value_in_cell(const SpatialMoments& cell, double value, const ValueFit& fit) {
  if (cell.mass == 0 || std::isnan(value)) return {};
  const dvec3& g = fit.gradient;
  const SymmetricMatrix& s = cell.covariance;
  const dvec3 covariance(s.xx * g.x + s.xy * g.y + s.xz * g.z, s.xy * g.x + s.yy * g.y + s.yz * g.z,
                         s.xz * g.x + s.yz * g.y + s.zz * g.z);
  return linear_value_moments(cell, value, g, covariance, fit.min, fit.max);
}

}  // namespace splatvol
