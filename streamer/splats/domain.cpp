#include "streamer/splats/domain.h"

#include <cmath>
#include <variant>
#include <vector>

#include "base/math.h"
#include "streamer/splats/streamer.h"

namespace splatvol {
namespace {

// Half of the edges of the box round a splat, and its centre, relative to its block.
struct SplatExtent {
  dvec3 center, half;
};

SplatExtent extent_of(const RecordRow& row, std::uint32_t record) {
  if (std::holds_alternative<std::vector<OctantShape>>(row.shapes->records())) {
    const OctantSplat splat = unpack_octant(row, record);
    return {dvec3(splat.position), dvec3(0.5 * static_cast<double>(splat.size))};
  }
  const MomentsSplat splat = unpack(row, record);
  const dmat3 axes = glm::mat3_cast(splat.orientation);
  SplatExtent extent{splat.center, dvec3(0)};
  for (int k = 0; k < 3; ++k) {
    const dvec3 across(axes[0][k], axes[1][k], axes[2][k]);
    extent.half[k] = std::sqrt(3.0) * glm::length(across * splat.deviations);
  }
  return extent;
}

}  // namespace

// sqrt(3) deviations each way are exact for a splat that is a uniform box.
Result<Box> find_domain(Streamer& streamer) {
  const Cube& cube = streamer.info().cube;
  Camera camera{.position = cube.origin + 4 * cube.edge, .focal_point = cube.origin + 0.5 * cube.edge};
  SPLATVOL_TRY_ASSIGN(view, make_view(camera, 64, 64));
  TransferFunction all{.colors = {{0, dvec3(1)}}, .densities = {{0, 1}}};
  Detail detail{.resolution = 0};
  SPLATVOL_TRY_ASSIGN(coarsest, streamer.request(view, all, detail));
  Box domain;
  const double length = streamer.units().length;
  for (const DrawRange& range : coarsest->list.ranges) {
    const dvec3& origin = range.row.shapes->blocks()[range.block].origin;
    for (std::uint32_t i = range.begin; i < range.begin + range.count; ++i) {
      const auto [center, half] = extent_of(range.row, i);
      domain.include({origin + length * (center - half), origin + length * (center + half)});
    }
  }
  return domain;
}

}  // namespace splatvol
