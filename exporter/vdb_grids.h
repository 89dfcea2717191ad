// Voxels to a .vdb file, through OpenVDB.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"

namespace splatvol {

/// Grids of single precision over the same voxels, in bricks of 8 x 8 x 8.
class VdbGrids {
 public:
  VdbGrids(const std::vector<std::string>& names, const dvec3& origin, double voxel);
  ~VdbGrids();

  /// Values of one brick, [voxel], voxels along z first, then y, then x; NaN: not active. A brick may come once for
  /// each grid; `first` is its first voxel, a multiple of 8.
  void add_brick(std::size_t grid, const std::array<std::int32_t, 3>& first, const std::array<float, 512>& values);

  /// Marks a grid as the share of material (base/vdb_share.h).
  void mark_share(std::size_t grid);

  /// Writes the file, which appears whole or not at all, and has the same bytes for the same grids. Returns its length.
  [[nodiscard]] Result<std::uint64_t> write(const std::string& path) const;

 private:
  struct Grids;
  std::unique_ptr<Grids> grids_;
};

}  // namespace splatvol
