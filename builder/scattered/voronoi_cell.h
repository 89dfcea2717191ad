// Voronoi cells from known neighbours, their trimming, and their values.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/math.h"
#include "builder/mesh/moments.h"
#include "builder/scattered/convex_cell.h"

namespace splatvol {

/// Returns the item that sorting would put at this share of the way, in [0, 1]. Reorders the items; requires one.
[[nodiscard]] double quantile(std::vector<double>& items, double share);

/// Makes the cell of a point, relative to the point, from some of the others: a part of `domain`. Labels are the
/// others.
void make_cell(std::span<const dvec3> positions, std::uint32_t point, std::span<const std::uint32_t> others,
               const Box& domain, ConvexCell& cell);

/// Returns the square of the largest distance of a vertex.
[[nodiscard]] double farthest_squared(const ConvexCell& cell);

/// Returns the usual distance of a cell's vertices, which are the centres of Delaunay tetrahedra: the lower quartile,
/// as in trimming.h. Points on a plane have vertices only on the domain's box, or at random far away. Then the distance
/// to the farthest neighbour stands in. `items`: scratch memory.
[[nodiscard]] double usual_radius(const ConvexCell& cell, std::vector<double>& items);

/// Cuts off vertices that are out of proportion, as they fill holes and concavities of the domain. A cut runs through
/// the point, parallel to the nearest face on the other side: so a boundary layer ends along the wall, however thin it
/// is. If nothing is on the other side (points on a plane), the cell gets the thickness of the spacing. `usual`: by
/// label, 0 where it is not known; `own`: that of the cell.
void trim(ConvexCell& cell, std::span<const double> usual, double own);

/// The gradient of a value at a point, and the range of the point's and its neighbours' values.
struct ValueFit {
  dvec3 gradient{0};
  double min, max;
};

/// Fits the gradient over the neighbours whose values are not missing (NaN); 0 if there are none.
[[nodiscard]] ValueFit fit_value(std::span<const dvec3> positions, std::uint32_t point,
                                 std::span<const std::uint32_t> neighbours, std::span<const double> values);

/// Returns the moments of a value that is linear in a cell. No mass if the value is missing.
[[nodiscard]] ValueMoments value_in_cell(const SpatialMoments& cell, double value, const ValueFit& fit);

}  // namespace splatvol
