#include "builder/mesh/heights.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <atomic>
#include <cmath>

#include "builder/mesh/tetrahedra.h"

namespace splatvol {
namespace {

// Several threads may lower one number.
void lower(double& height, double to) {
  const std::atomic_ref shared(height);
  double present = shared.load(std::memory_order_relaxed);
  while (to < present && !shared.compare_exchange_weak(present, to, std::memory_order_relaxed)) {
  }
}

}  // namespace

double least_height(const dvec3& a, const dvec3& b, const dvec3& c, const dvec3& d) {
  const dvec3 ab = b - a, ac = c - a, ad = d - a, bc = c - b, bd = d - b, cd = d - c;
  const double longest = std::sqrt(std::max({squared_length(ab), squared_length(ac), squared_length(ad),
                                             squared_length(bc), squared_length(bd), squared_length(cd)}));
  // In units of the longest edge no product is out of range.
  const double unit = 1 / longest;
  const dvec3 x = ab * unit, y = ac * unit, z = ad * unit;
  const double largest_face =
      std::sqrt(std::max({squared_length(glm::cross(x, y)), squared_length(glm::cross(y, z)),
                          squared_length(glm::cross(z, x)), squared_length(glm::cross(y - x, z - x))}));
  const double height = std::abs(glm::dot(x, glm::cross(y, z))) / largest_face;
  return height >= flat_height ? height * longest : 0;
}

std::vector<double> least_heights(std::span<const dvec3> points, std::span<const Tetrahedron> tetrahedra) {
  std::vector<double> heights(points.size(), no_height);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, tetrahedra.size(), 4096),
                    [&](const tbb::blocked_range<std::size_t>& range) {
                      for (std::size_t t = range.begin(); t < range.end(); ++t) {
                        const auto& [a, b, c, d] = tetrahedra[t];
                        const double height = least_height(points[a], points[b], points[c], points[d]);
                        if (height > 0)
                          for (const std::uint32_t corner : tetrahedra[t]) lower(heights[corner], height);
                      }
                    });
  return heights;
}

}  // namespace splatvol
