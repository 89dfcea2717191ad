// Splat moments of points that come without cells.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "builder/mesh/moments.h"

namespace splatvol {

/// What joins the points to a volume.
enum class Connectivity {
  automatic,  // the input's cells where it has some, else one of the others by the number of points
  mesh,
  delaunay,  // delaunay_tetrahedra
  none,      // ScatteredEstimate
};

/// The first point at each position, by ascending x, then y, then z. Requires finite positions, and indices that fit.
[[nodiscard]] std::vector<std::uint32_t> distinct_points(std::span<const dvec3> positions);

/// Tetrahedra of the Delaunay triangulation, less those that bridge holes and concavities of the domain: their
/// circumradius is out of proportion to what is usual at their corners, whatever the aspect ratio there. Corners in
/// ascending order, tetrahedra in lexicographic order; the same for any order of insertion and number of threads. Of
/// coincident points the first takes part and the others have no tetrahedra. Empty where no four points span a volume;
/// an estimate still shows these. Fails with more points than an index can name. Requires finite positions, in Morton
/// order for speed.
[[nodiscard]] Result<std::vector<Tetrahedron>> delaunay_tetrahedra(std::span<const dvec3> positions);

/// Moments without a triangulation: each point stands for its Voronoi cell, found by itself from the points around it.
/// So masses add up to the volume of the domain, which ends at its outer points as that of delaunay_tetrahedra does;
/// points on one plane, one line or in one place get the thickness of their spacing. Of coincident points the first has
/// the whole cell, the others have no mass.
class ScatteredEstimate {
 public:
  /// Does not depend on the number of threads. Fails with more points than an index can name. Requires finite
  /// positions, which must outlive this.
  [[nodiscard]] static Result<ScatteredEstimate> create(std::span<const dvec3> positions);

  /// [position]
  [[nodiscard]] const std::vector<SpatialMoments>& spatial() const { return spatial_; }

  /// Of an attribute, linear within each cell with the gradient that fits the values of the points beside it best; no
  /// mass where its own value is missing (NaN). Requires values.size() == spatial().size(). [position]
  [[nodiscard]] std::vector<ValueMoments> values(std::span<const double> values) const;

  /// That gradient; 0 where there is none. [position]
  [[nodiscard]] std::vector<vec3> gradients(std::span<const double> values) const;

 private:
  /// What the values of the points beside it say of a point.
  struct Fit {
    dvec3 gradient{0};
    double min, max;  // of these values and its own
  };
  [[nodiscard]] Fit fit(std::size_t point, std::span<const double> values) const;

  std::span<const dvec3> positions_;
  std::vector<SpatialMoments> spatial_;
  std::vector<std::uint64_t> begins_;  // neighbours of point i: from begins_[i] to begins_[i + 1]
  std::vector<std::uint32_t> neighbours_;
};

}  // namespace splatvol
