#include "builder/mesh/heights.h"

#include <atomic>

#include "builder/mesh/lanes.h"

namespace splatvol {
namespace {

// Several threads may lower one number.
void lower(double& height, double to) {
  const std::atomic_ref shared(height);
  double present = shared.load(std::memory_order_relaxed);
  while (to < present && !shared.compare_exchange_weak(present, to, std::memory_order_relaxed)) {
  }
}

// The largest of the squared lengths.
template <class... Vectors>
Lanes largest_square(const LaneVectors& first, const Vectors&... others) {
  Lanes largest = dot(first, first);
  const auto include = [&](const Lanes& square) { largest = largest < square ? square : largest; };
  (include(dot(others, others)), ...);
  return largest;
}

// As least_height, of four tetrahedra.
Lanes least_height(const TetrahedronLanes& corners) {
  const auto& [a, b, c, d] = corners;
  const LaneVectors ab = b - a, ac = c - a, ad = d - a;
  Lanes longest = largest_square(ab, ac, ad, c - b, d - b, d - c);
  take_root(longest);
  // In units of the longest edge no product is out of range.
  const Lanes unit = 1 / longest;
  const LaneVectors x = unit * ab, y = unit * ac, z = unit * ad, xy = cross(x, y), yz = cross(y, z);
  Lanes largest_face = largest_square(xy, yz, cross(z, x), cross(y - x, z - x));
  take_root(largest_face);
  const Lanes height = magnitude(dot(x, yz)) / largest_face;
  return height >= flat_height ? height * longest : Lanes{};
}

}  // namespace

double least_height(const dvec3& a, const dvec3& b, const dvec3& c, const dvec3& d) {
  return least_height({lanes_of(a, a, a, a), lanes_of(b, b, b, b), lanes_of(c, c, c, c), lanes_of(d, d, d, d)})[0];
}

std::vector<double> least_heights(std::span<const dvec3> points, std::span<const Tetrahedron> tetrahedra) {
  std::vector<double> heights(points.size(), no_height);
  visit_side_by_side(points, tetrahedra, [&](std::size_t t, std::size_t count, const TetrahedronLanes& corners) {
    const Lanes height = least_height(corners);
    for (std::size_t l = 0; l < count; ++l)
      if (height[l] > 0)
        for (const std::uint32_t corner : tetrahedra[t + l]) lower(heights[corner], height[l]);
  });
  return heights;
}

}  // namespace splatvol
