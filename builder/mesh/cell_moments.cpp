#include "builder/mesh/cell_moments.h"

#include <array>
#include <cmath>
#include <limits>

namespace splatvol {

double tetrahedron_volume(std::span<const dvec3> positions, const Tetrahedron& corners) {
  std::array<dvec3, 3> edges;
  for (std::size_t k = 0; k < 3; ++k) edges[k] = positions[corners[k + 1]] - positions[corners[0]];
  const double volume = std::abs(glm::dot(edges[0], glm::cross(edges[1], edges[2]))) / 6;
  const double squares = squared_length(edges[0]) + squared_length(edges[1]) + squared_length(edges[2]);
  return std::isfinite(volume) && std::isfinite(squares) ? volume : 0;
}

CellMoments cell_moments(std::span<const dvec3> positions, std::span<const Tetrahedron> tetrahedra) {
  // Relative to a corner, so that a position far from the origin costs no precision.
  CellMoments cell;
  if (tetrahedra.empty()) return cell;
  const dvec3 origin = positions[tetrahedra[0][0]];
  SpatialMoments& sums = cell.moments;
  dvec3 mean(0);
  for (const Tetrahedron& corners : tetrahedra) {
    const double volume = tetrahedron_volume(positions, corners);
    if (!(volume > 0)) continue;
    dvec3 sum(0);
    for (const std::uint32_t corner : corners) sum += positions[corner] - origin;
    sums.mass += volume;
    mean += volume / sums.mass * (sum / 4.0 - mean);
  }
  if (!(sums.mass > 0)) return cell;
  cell.centroid = origin + mean;

  // Over a tetrahedron with corners d about the centroid, the mean of x x^T is (sum of d d^T + (sum d) (sum d)^T) / 20.
  for (const Tetrahedron& corners : tetrahedra) {
    const double share = tetrahedron_volume(positions, corners) / sums.mass;
    dvec3 sum(0);
    for (const std::uint32_t corner : corners) {
      const dvec3 d = positions[corner] - cell.centroid;
      add_square(sums.covariance, share / 20, d);
      sum += d;
    }
    add_square(sums.covariance, share / 20, sum);
  }
  return cell;
}

double cell_mean(std::span<const dvec3> positions, std::span<const Tetrahedron> tetrahedra,
                 std::span<const double> values) {
  double volumes = 0, mean = std::numeric_limits<double>::quiet_NaN();
  for (const Tetrahedron& corners : tetrahedra) {
    const double volume = tetrahedron_volume(positions, corners);
    double sum = 0;
    for (const std::uint32_t corner : corners) sum += values[corner] / 4;
    if (!(volume > 0) || !std::isfinite(sum)) continue;
    if (volumes == 0) mean = sum;
    volumes += volume;
    mean += volume / volumes * (sum - mean);
  }
  return mean;
}

}  // namespace splatvol
