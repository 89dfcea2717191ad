// The material of points and of the clusters that coarser resolutions draw in their place.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "builder/boundary.h"
#include "builder/moments.h"
#include "builder/morton.h"
#include "builder/reduction.h"
#include "format/columns.h"

namespace splatvol {

/// A splat's standard deviations along its principal axes, the shortest and the longest; 0 for no material. What is too
/// thin for rounding (a deviation of 0 beside others) does not count as shortest.
struct Extent {
  double shortest = 0;
  double longest = 0;
};

/// What the points of a resolution stand for: a part of the volume each, and the values in it. 132 bytes a point, and
/// 88 for each attribute.
struct Material {
  std::vector<SpatialMoments> moments;                   // [member]
  std::vector<std::vector<ValueMoments>> value_moments;  // [attribute][member]
  std::vector<BoundaryPlane> planes;                     // [member]; empty where the material has no known boundary
  std::vector<Extent> extents;                           // [member]
  std::vector<float> densities;                          // [member]: factors for drawing

  /// As the file stores it.
  [[nodiscard]] format::SplatShape shape(std::size_t member) const;
};

/// Adds up the material of each resolution's clusters, which are the leaves of the octree over the next finer one, and
/// finds what drawing it takes. `finest` is of all points; its extents and densities are not used. Resolutions from
/// coarse to fine, as the result. Does not depend on the number of threads.
[[nodiscard]] std::vector<Material> merge_clusters(std::span<const MortonKey> keys, std::span<const dvec3> positions,
                                                   std::span<const Resolution> resolutions, Material finest);

/// Bounds what values the material takes, as the file stores them: less `offset`.
[[nodiscard]] format::ValueSummary summarize(const ValueMoments& value, double offset, const format::ValueBins& bins);

}  // namespace splatvol
