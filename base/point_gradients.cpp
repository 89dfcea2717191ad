#include "base/point_gradients.h"

#include <cmath>

namespace splatvol {
namespace {

template <class PlaceOf>
void add_all(std::span<const dvec3> points, std::span<const std::array<std::uint32_t, 4>> tetrahedra,
             std::span<const double> values, const PlaceOf& place_of, std::span<GradientSum> sums) {
  const auto square = [](const dvec3& edge) { return glm::dot(edge, edge); };
  for (const auto& [p, q, r, s] : tetrahedra) {
    const dvec3 to_q = points[q] - points[p], to_r = points[r] - points[p], to_s = points[s] - points[p];
    const dvec3 across = glm::cross(to_r, to_s);
    const double volume = glm::dot(to_q, across);
    const double up_q = values[q] - values[p], up_r = values[r] - values[p], up_s = values[s] - values[p];
    if (!(std::abs(volume) > 0) || std::isnan(up_q + up_r + up_s)) continue;
    // The gradient times the volume: no division by that of a thin one.
    const dvec3 product = up_q * across + up_r * glm::cross(to_s, to_q) + up_s * glm::cross(to_q, to_r);
    const dvec3 gradient = volume < 0 ? -product : product;
    const double pq = square(to_q), pr = square(to_r), ps = square(to_s), qr = square(to_r - to_q),
                 rs = square(to_s - to_r), sq = square(to_q - to_s);
    const auto add = [&](std::uint32_t point, double squares) {
      sums[place_of(point)].add({gradient / squares, std::abs(volume) / squares});
    };
    add(p, pq * pr * ps);
    add(q, pq * qr * sq);
    add(r, pr * qr * rs);
    add(s, ps * rs * sq);
  }
}

}  // namespace

dvec3 GradientSum::mean() const {
  const dvec3 mean = gradients / weight;
  return std::isfinite(mean.x + mean.y + mean.z) ? mean : dvec3(0);
}

void add_gradients(std::span<const dvec3> points, std::span<const std::array<std::uint32_t, 4>> tetrahedra,
                   std::span<const double> values, std::span<GradientSum> sums) {
  add_all(
      points, tetrahedra, values, [](std::uint32_t point) { return point; }, sums);
}

void add_gradients(std::span<const dvec3> points, std::span<const std::array<std::uint32_t, 4>> tetrahedra,
                   std::span<const double> values, std::span<const std::uint32_t> places, std::span<GradientSum> sums) {
  add_all(
      points, tetrahedra, values, [&](std::uint32_t point) { return places[point]; }, sums);
}

std::vector<dvec3> means_of(std::span<const GradientSum> sums) {
  std::vector<dvec3> means;
  means.reserve(sums.size());
  for (const GradientSum& sum : sums) means.push_back(sum.mean());
  return means;
}

}  // namespace splatvol
