// The material of points, and of the clusters of coarser resolutions, all in memory: an oracle.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "builder/boundary.h"
#include "builder/cell_reduction.h"
#include "builder/moments.h"
#include "builder/splat_rows.h"
#include "tests/support/whole_reduction.h"

namespace splatvol::test {

/// The material of the points of a resolution, with its values.
struct Material {
  std::vector<SpatialMoments> moments;                   // [member]
  std::vector<std::vector<ValueMoments>> value_moments;  // [attribute][member]
  std::vector<BoundaryPlane> planes;                     // [member]; empty if the material has no known boundary

  [[nodiscard]] BoundaryPlane plane(std::size_t member) const {
    return planes.empty() ? BoundaryPlane{} : planes[member];
  }
};

[[nodiscard]] Material material_of(const PointBatch& points);

/// Adds up the material of each resolution's clusters, which are the leaves of the octree over the next finer
/// resolution. `finest` is that of all points. Both the argument and the result are ordered from coarse to fine.
[[nodiscard]] std::vector<Material> merge_clusters(std::span<const dvec3> positions,
                                                   std::span<const Resolution> resolutions, Material finest);

/// Returns the splats of a resolution: centroid, shape, number and octant. Densities are 1.
[[nodiscard]] std::vector<SplatRow> splats_of(std::span<const dvec3> positions, const Resolution& resolution,
                                              const Material& material);

/// Fits the densities of the finest resolution's splats.
void fit_finest_densities(std::span<SplatRow> splats);

}  // namespace splatvol::test
