// Last bits of coordinates that blockMesh and its like have filled with noise.
#pragma once

#include <limits>
#include <span>

#include "base/math.h"
#include "builder/sources/openfoam/foam_mesh.h"

namespace splatvol {

/// Chooses the step to which a case's points are rounded. The points of a plane or a lattice differ in their last bits.
/// Nothing of them repeats then, and a file of a lattice becomes up to twice as large.
class PointRounding {
 public:
  /// Takes in the points and faces of a mesh. All meshes of a case must share a step: their points meet.
  void include(const FoamMesh& mesh);

  /// Returns the step that keeps 40 significant bits of the largest coordinate. 0 if the shortest edge has fewer than
  /// 4,096 of them: the points are to stay as they are. An edge without length does not count.
  [[nodiscard]] double step() const;

 private:
  double largest_ = 0;                                         // coordinate of a corner
  double shortest_ = std::numeric_limits<double>::infinity();  // edge, squared
};

/// Rounds points to multiples of a step that is a power of two.
void round_points(double step, std::span<dvec3> points);

}  // namespace splatvol
