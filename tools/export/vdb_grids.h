// Writes voxels to a .vdb file, through OpenVDB.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "base/replaceable.h"

namespace splatvol {

/// Grids of single precision over the same voxels, made of bricks of 8 x 8 x 8 voxels.
class VdbGrids {
 public:
  VdbGrids(const std::vector<std::string>& names, const dvec3& origin, double voxel);
  ~VdbGrids();

  /// Adds a brick to a grid, which must not have it yet. `first`: its first voxel, multiples of 8. `values`: [voxel],
  /// with z running fastest, then y, then x; NaN: not active.
  void add_brick(std::size_t grid, const std::array<std::int32_t, 3>& first, const std::array<float, 512>& values);

  /// Marks a grid as the one that holds the share of material (base/vdb_share.h).
  void mark_share(std::size_t grid);

  /// Notes the unit of a grid's values, as the grid's metadata "unit".
  void set_unit(std::size_t grid, const std::string& unit);

  /// Writes the file, with the mark of an export, and returns its length. The file appears whole or not at all. Equal
  /// grids give equal bytes.
  [[nodiscard]] Result<std::uint64_t> write(const std::string& path, Replace replace = Replace::exports) const;

 private:
  struct Grids;
  std::unique_ptr<Grids> grids_;
};

}  // namespace splatvol
