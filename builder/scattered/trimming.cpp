#include "builder/scattered/trimming.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <cmath>
#include <cstdint>
#include <limits>

namespace splatvol {
namespace {

// Returns for each point the lower quartile of the items that append(point, items) adds; 0 if it adds none.
template <class Append>
std::vector<double> lower_quartiles(std::size_t points, const Append& append) {
  std::vector<double> result(points, 0.0);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, points, 1024), [&](const auto& range) {
    std::vector<double> items;
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      items.clear();
      append(i, items);
      if (items.empty()) continue;
      const auto middle = items.begin() + static_cast<std::ptrdiff_t>((items.size() - 1) / 4);
      std::ranges::nth_element(items, middle);
      result[i] = *middle;
    }
  });
  return result;
}

}  // namespace

double circumradius(std::span<const dvec3> positions, const Tetrahedron& corners) {
  const dvec3 &p = positions[corners[0]], a = positions[corners[1]] - p, b = positions[corners[2]] - p,
              c = positions[corners[3]] - p;
  const dvec3 bc = glm::cross(b, c);
  const double radius =
      glm::length(glm::dot(a, a) * bc + glm::dot(b, b) * glm::cross(c, a) + glm::dot(c, c) * glm::cross(a, b)) /
      (2 * std::abs(glm::dot(a, bc)));
  return std::isnan(radius) ? std::numeric_limits<double>::infinity() : radius;
}

std::vector<double> circumradii(std::span<const dvec3> positions, std::span<const Tetrahedron> tetrahedra) {
  std::vector<double> radii(tetrahedra.size());
  tbb::parallel_for(std::size_t{0}, tetrahedra.size(),
                    [&](std::size_t t) { radii[t] = circumradius(positions, tetrahedra[t]); });
  return radii;
}

std::vector<double> usual_radii(std::size_t points, std::span<const Tetrahedron> tetrahedra,
                                std::span<const double> radii) {
  const IndexLists incident = tetrahedra_at_points(points, tetrahedra);
  std::vector<double> largest(points, std::numeric_limits<double>::infinity());
  for (std::size_t t = 0; t < tetrahedra.size(); ++t)
    for (const std::uint32_t corner : tetrahedra[t])
      largest[corner] = std::min(largest[corner], max_radius_spread * radii[t]);
  const auto own = lower_quartiles(points, [&](std::size_t i, std::vector<double>& items) {
    for (const std::uint32_t t : incident[i])
      if (radii[t] <= largest[i]) items.push_back(radii[t]);
  });
  return lower_quartiles(points, [&](std::size_t i, std::vector<double>& items) {
    for (const std::uint32_t t : incident[i])
      if (radii[t] <= largest[i])
        for (const std::uint32_t corner : tetrahedra[t]) items.push_back(own[corner]);
  });
}

bool is_flat(std::span<const dvec3> positions, std::span<const Tetrahedron> tetrahedra) {
  double volumes = 0, cubes = 0;
  for (const Tetrahedron& corners : tetrahedra) {
    const dvec3 &p = positions[corners[0]], a = positions[corners[1]] - p, b = positions[corners[2]] - p,
                c = positions[corners[3]] - p;
    volumes += std::abs(glm::dot(a, glm::cross(b, c)));
    const double longest = std::sqrt(std::max({glm::dot(a, a), glm::dot(b, b), glm::dot(c, c)}));
    cubes += longest * longest * longest;
  }
  return volumes <= 1e-10 * cubes;
}

}  // namespace splatvol
