// Parts of a tetrahedron.
#pragma once

#include <array>
#include <vector>

#include "sampler/tetrahedron.h"

namespace splatvol {

/// A tetrahedron in another one.
struct TetrahedronPart {
  std::array<CornerWeights, 4> vertices;
  double share;  // of the other's volume, above 0
};

/// Returns the whole of a tetrahedron.
[[nodiscard]] TetrahedronPart whole_tetrahedron();

/// Returns the mean of a part's vertices.
[[nodiscard]] CornerWeights centroid_of(const TetrahedronPart& part);

/// Returns the tetrahedra of the parts in which a linear function is not negative. `corners`: its values at the corners
/// of the whole, finite. Shares and weights are sums of products of numbers above 0: each is exact up to a few units in
/// the last place, however thin the part.
[[nodiscard]] std::vector<TetrahedronPart> cut_parts(const std::vector<TetrahedronPart>& parts,
                                                     const std::array<double, 4>& corners);

}  // namespace splatvol
