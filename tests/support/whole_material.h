// The material of points and of the clusters that coarser resolutions draw in their place, all in memory: an oracle.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "builder/mesh/boundary.h"
#include "builder/reduction/batch_reduction.h"
#include "builder/mesh/moments.h"
#include "builder/output/splat_columns.h"
#include "tests/support/whole_reduction.h"

namespace splatvol::test {

/// What the points of a resolution stand for: a part of the volume each, and the values in it.
struct Material {
  std::vector<SpatialMoments> moments;                   // [member]
  std::vector<std::vector<ValueMoments>> value_moments;  // [attribute][member]
  std::vector<BoundaryPlane> planes;                     // [member]; empty where the material has no known boundary

  [[nodiscard]] BoundaryPlane plane(std::size_t member) const {
    return planes.empty() ? BoundaryPlane{} : planes[member];
  }
};

[[nodiscard]] Material material_of(const PointBatch& points);

/// Adds up the material of each resolution's clusters, which are the leaves of the octree over the next finer one.
/// `finest` is of all points. Resolutions from coarse to fine, as the result.
[[nodiscard]] std::vector<Material> merge_clusters(std::span<const dvec3> positions,
                                                   std::span<const Resolution> resolutions, Material finest);

/// A resolution's splats: centroid, shape, number and octant. Densities are 1.
[[nodiscard]] std::vector<StoredSplat> splats_of(std::span<const dvec3> positions, const Resolution& resolution,
                                              const Material& material);

/// Fits the densities of the finest resolution's splats.
void fit_finest_densities(std::span<StoredSplat> splats);

}  // namespace splatvol::test
