#include "builder/scattered/scattered.h"

#include <tbb/parallel_sort.h>

#include <algorithm>
#include <numeric>
#include <tuple>

namespace splatvol {

std::vector<std::uint32_t> distinct_points(std::span<const dvec3> positions) {
  std::vector<std::uint32_t> points(positions.size());
  std::iota(points.begin(), points.end(), 0u);
  const auto coordinates = [&](std::uint32_t i) {
    const dvec3& p = positions[i];
    return std::tie(p.x, p.y, p.z);
  };
  tbb::parallel_sort(points.begin(), points.end(), [&](std::uint32_t i, std::uint32_t j) {
    return coordinates(i) != coordinates(j) ? coordinates(i) < coordinates(j) : i < j;
  });
  const auto repeated =
      std::ranges::unique(points, [&](std::uint32_t i, std::uint32_t j) { return coordinates(i) == coordinates(j); });
  points.erase(repeated.begin(), repeated.end());
  return points;
}

}  // namespace splatvol
