// Distributes a splat's material over voxels. Lengths are in voxels; the centre of voxel i is i.
#pragma once

#include <cstdint>
#include <vector>

#include "base/math.h"
#include "splat/ellipsoid.h"

namespace splatvol {

/// The kernel `moments` (docs/accuracy.md), blurred by a voxel: an ellipsoid for the sum of the covariances of the
/// material and of a voxel, in which density falls as (1 - rho^2)^(3/2). At a boundary, the half of it on the
/// material's side.
class VoxelKernel {
 public:
  /// `centroid` and `shape` are in voxels. Requires finite numbers, and voxels that std::int32_t can number.
  VoxelKernel(const dvec3& centroid, const SplatShape& shape);

  /// Returns about how many voxels are in the ellipsoid.
  [[nodiscard]] double volume() const { return volume_; }

  /// Whether the kernel reaches into a box.
  [[nodiscard]] bool reaches(const Box& box) const;

  /// Returns the field of a value in the blurred material. `shape`: that of the constructor.
  [[nodiscard]] LinearField field(const SplatShape& shape, const SplatValue& value) const;

  /// A voxel run: consecutive voxels along x.
  struct Run {
    std::int32_t x, y, z;  // the first voxel
    std::uint32_t count;
  };

  /// Appends the voxels whose centres are in the ellipsoid, at least one, and their shares of its mass. The shares add
  /// up to 1. An ellipsoid of more than 65536 voxels that is partly outside of `box` gets only the voxels in the box;
  /// their shares come from the integral of the kernel. Returns false, with incomplete results, if there are more than
  /// `most` voxels, or more rows of voxels to look at.
  [[nodiscard]] bool append(const Box& box, std::size_t most, std::vector<Run>& runs,
                            std::vector<double>& shares) const;

 private:
  template <class Visit>
  bool visit_rows(const Box& box, std::size_t most, const Visit& visit) const;

  dvec3 centroid_;
  Ellipsoid ellipsoid_;  // with a density of 1 at the centre
  dmat3 square_;         // L L^T, L from the unit ball to the ellipsoid
  dmat3 inverse_;        // of it
  double volume_;
};

}  // namespace splatvol
