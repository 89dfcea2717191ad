// Which voxels a splat's material lies in. Lengths in voxels: voxel i is round i.
#pragma once

#include <cstdint>
#include <vector>

#include "base/math.h"
#include "format/columns.h"

namespace splatvol {

/// The kernel `moments` (docs/accuracy.md) as voxels see it: the ellipsoid of the material's covariance and that of a
/// voxel, in which density falls as (1 - rho^2)^(3/2); at a boundary the half of it that the boundary leaves.
class VoxelKernel {
 public:
  /// `shape` in voxels as well. Requires finite numbers, and voxels that std::int32_t can number.
  VoxelKernel(const dvec3& centroid, const format::SplatShape& shape);

  /// Voxels in it, about.
  [[nodiscard]] double volume() const { return volume_; }

  /// Whether it reaches into a box.
  [[nodiscard]] bool reaches(const Box& box) const;

  /// Slope of a value in it that has this covariance with the position.
  [[nodiscard]] dvec3 slope(const dvec3& covariance) const { return to_slope_ * covariance; }

  struct Run {
    std::int32_t x, y, z;  // its first voxel; the others follow along x
    std::uint32_t count;
  };

  /// Appends the voxels whose centres lie in it and in `box`, and their shares of its mass. All of its voxels, of which
  /// there is at least one, add up to 1; those of one of more than 65536, of which part is outside of the box, as far
  /// as the integral of the kernel tells. False, and unfinished, where they are more than `most`.
  [[nodiscard]] bool append(const Box& box, std::size_t most, std::vector<Run>& runs,
                            std::vector<double>& shares) const;

 private:
  template <class Visit>
  void visit_rows(const Box& box, const Visit& visit) const;

  dvec3 centroid_;
  dvec3 centre_;         // of the ellipsoid
  dmat3 square_;         // L L^T, L from the unit ball to the ellipsoid
  dmat3 inverse_;        // of it
  dmat3 to_slope_;       // inverse of the covariance
  dvec3 cut_normal_{0};  // of the boundary, outwards; 0: none
  double cut_offset_ = 0;
  double volume_;
};

}  // namespace splatvol
