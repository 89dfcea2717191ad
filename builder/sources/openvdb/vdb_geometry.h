// The geometry of OpenVDB voxels and tiles: their boxes in the world, and the voxels that their fields are sampled at.
#pragma once

#include <openvdb/openvdb.h>

#include <array>
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "builder/mesh/moments.h"

namespace splatvol {

/// From voxel indices to the world: position = edges * index + origin.
struct VoxelTransform {
  dmat3 edges{1};  // of a voxel, as columns
  dvec3 origin{0};

  [[nodiscard]] dvec3 position(const dvec3& index) const {
    return {edges[0].x * index.x + edges[1].x * index.y + edges[2].x * index.z + origin.x,
            edges[0].y * index.x + edges[1].y * index.y + edges[2].y * index.z + origin.y,
            edges[0].z * index.x + edges[1].z * index.y + edges[2].z * index.z + origin.z};
  }

  /// Whether two transforms are equal up to rounding.
  [[nodiscard]] bool same_as(const VoxelTransform& other) const;

  /// Moments of the material in a box of `edge` voxels along each axis.
  [[nodiscard]] SpatialMoments box_moments(double edge) const;
};

/// The transform of a grid. Fails if it is not linear, or if voxels have no volume; `path` and `name` begin the
/// message.
[[nodiscard]] Result<VoxelTransform> voxel_transform(const std::string& path, const std::string& name,
                                                     const openvdb::GridBase& grid);

/// Indices of the samples that a point's linear field is found from.
struct Stencil {
  std::size_t own;                                   // at the point
  std::array<std::array<std::size_t, 2>, 3> beside;  // [axis][side]: beside the point's box
};

/// The samples of all points in a brick or tile.
struct SampleLayout {
  std::vector<openvdb::Coord> offsets;  // of the samples, from the brick's or tile's first voxel
  std::vector<Stencil> stencils;        // [voxel of a brick], or of the tile
};

inline constexpr int brick_edge = 8;
inline constexpr std::size_t brick_voxels = std::size_t{1} << 9;

/// Samples of a brick: its voxels in the order of their mask, and the voxels beside its six faces.
[[nodiscard]] SampleLayout brick_layout();

/// Samples of a tile: its middle, and the voxels beside the middles of its faces.
[[nodiscard]] SampleLayout tile_layout(int edge);

/// A linear field within a box of voxels.
struct LinearField {
  dvec3 slope{0};   // for each index
  double min, max;  // within the box
};

/// Fits a linear field to the samples of a stencil: central differences, one-sided if one side is missing (NaN). A
/// point stands for a box of `edge` voxels along each axis.
[[nodiscard]] LinearField fit_linear_field(const Stencil& stencil, std::span<const double> values, double edge);

}  // namespace splatvol
