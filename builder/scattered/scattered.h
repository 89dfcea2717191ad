// Splat moments of points that come without cells.
#pragma once

#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "builder/mesh/moments.h"
#include "builder/scattered/voronoi_cell.h"

namespace splatvol {

/// How the points are joined to a volume.
enum class Connectivity {
  automatic,  // the input's cells if it has any, else delaunay or none by the number of points
  mesh,
  delaunay,  // delaunay_tetrahedra
  none,      // Voronoi cells: ScatteredEstimate, or SampledCells if there are many
  boxes,     // BoxEstimate
};

/// Returns the first point at each position, by ascending x, then y, then z. Requires finite positions, and no more
/// points than an index can name.
[[nodiscard]] std::vector<std::uint32_t> distinct_points(std::span<const dvec3> positions);

/// Returns the tetrahedra of the Delaunay triangulation, without those that bridge holes and concavities of the domain:
/// their circumradius is out of proportion to the usual one at their corners, whatever the aspect ratio there. Corners
/// are in ascending order, tetrahedra in lexicographic order, for any number of threads. The first of coincident points
/// takes part, the others have no tetrahedra. Empty if no four points span a volume; an estimate still shows such
/// points. Fails with more points than an index can name, and if this thread's stop is requested. Looks for
/// one about once a second, and tells `progress` then, in [0, 1]; it may be empty. Requires finite positions.
[[nodiscard]] Result<std::vector<Tetrahedron>> delaunay_tetrahedra(std::span<const dvec3> positions,
                                                                   const std::function<void(double)>& progress = {});

/// Moments without a triangulation: each point stands for its Voronoi cell, which is found from the points around it.
/// Masses add up to the volume of the domain, which ends at its outer points, as with delaunay_tetrahedra. Points on
/// one plane, on one line or at one position get the thickness of their spacing. The first of coincident points has the
/// whole cell, the others have no mass.
class ScatteredEstimate {
 public:
  /// Estimates all cells; does not depend on the number of threads. Fails with more points than an index can name.
  /// Requires finite positions, which must outlive this.
  [[nodiscard]] static Result<ScatteredEstimate> create(std::span<const dvec3> positions);

  /// [point]
  [[nodiscard]] const std::vector<SpatialMoments>& spatial() const { return spatial_; }

  /// Returns the moments of an attribute: linear within each cell, with the gradient that fits the neighbours' values
  /// best. A point has no mass if its own value is missing (NaN). Requires values.size() == spatial().size(). [point]
  [[nodiscard]] std::vector<ValueMoments> values(std::span<const double> values) const;

  /// Returns these moments of one point.
  [[nodiscard]] ValueMoments value(std::size_t point, std::span<const double> values) const;

  /// Returns these gradients; 0 where there is none. [point]
  [[nodiscard]] std::vector<dvec3> gradients(std::span<const double> values) const;

  /// Returns this gradient of one point.
  [[nodiscard]] dvec3 gradient(std::size_t point, std::span<const double> values) const {
    return std::isnan(values[point]) ? dvec3(0) : fit(point, values).gradient;
  }

 private:
  class Builder;

  [[nodiscard]] ValueFit fit(std::size_t point, std::span<const double> values) const {
    return fit_value(positions_, static_cast<std::uint32_t>(point), neighbours(point), values);
  }

  [[nodiscard]] std::span<const std::uint32_t> neighbours(std::size_t point) const {
    return std::span(neighbours_).subspan(begins_[point], begins_[point + 1] - begins_[point]);
  }

  std::span<const dvec3> positions_;
  std::vector<SpatialMoments> spatial_;
  std::vector<std::uint64_t> begins_;  // [point]: of its neighbours; then the end
  std::vector<std::uint32_t> neighbours_;
};

}  // namespace splatvol
