// The material of points, and of the clusters that coarser resolutions draw instead, all in memory: an oracle.
#pragma once

#include <span>
#include <vector>

#include "builder/mesh/boundary.h"
#include "builder/mesh/moments.h"
#include "builder/output/stored_splat.h"
#include "builder/points/point_batch.h"
#include "tests/support/whole_reduction.h"

namespace splatvol::test {

/// The material of the points of a resolution.
struct Material {
  std::vector<SpatialMoments> moments;                   // [member]
  std::vector<std::vector<ValueMoments>> value_moments;  // [attribute][member]
  std::vector<BoundaryPlane> planes;                     // [member]; empty if no boundary is known

  [[nodiscard]] BoundaryPlane plane(std::size_t member) const {
    return planes.empty() ? BoundaryPlane{} : planes[member];
  }
};

[[nodiscard]] Material material_of(const PointBatch& points);

/// Adds up the material of each resolution's clusters, which are the leaves of the octree over the next finer
/// resolution. `finest`: the material of all points. Resolutions and materials go from coarse to fine.
[[nodiscard]] std::vector<Material> merge_clusters(std::span<const dvec3> positions,
                                                   std::span<const Resolution> resolutions, Material finest);

/// Makes a resolution's splats: centroid, shape and octant. Densities are 1.
[[nodiscard]] std::vector<StoredSplat> splats_of(std::span<const dvec3> positions, const Resolution& resolution,
                                                 const Material& material);

}  // namespace splatvol::test
