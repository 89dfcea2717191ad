#include "streamer/draw_list.h"

#include <cmath>

namespace splatvol {
namespace {

Material material_of(const MomentsSplat& splat) {
  Material m;
  m.center = dvec3(splat.position);
  m.mass = static_cast<double>(splat.mass);
  m.deviations = dvec3(splat.deviations);
  const dvec3 q(splat.orientation);
  m.orientation = glm::dquat(std::sqrt(std::max(0.0, 1 - glm::dot(q, q))), q.x, q.y, q.z);
  m.value = static_cast<double>(splat.value);
  m.value_deviation = static_cast<double>(splat.value_deviation);
  for (int k = 0; k < 3; ++k) {
    m.correlations[k] = static_cast<std::int8_t>(splat.correlations >> 8 * k & 255) / 127.0;
    m.boundary[k] = (static_cast<std::int32_t>(splat.boundary << (22 - 10 * k)) >> 22) / 128.0;
  }
  return m;
}

RecordRow row_of(std::span<const MomentsSplat> splats, const dvec3& origin, double length) {
  std::vector<Material> materials;
  for (const MomentsSplat& splat : splats) materials.push_back(material_of(splat));
  return pack_row(materials, origin, length);
}

RecordRow row_of(std::span<const OctantSplat> splats, const dvec3& origin, double length) {
  return pack_row(splats, origin, length);
}

}  // namespace

DrawList pack_draw_list(SplatSpan splats, std::span<const SplatBatch> batches, const DrawingUnits& units) {
  DrawList list;
  for (const SplatBatch& batch : batches)
    std::visit(
        [&](const auto& span) {
          const RecordRow row = row_of(span.subspan(batch.first, batch.count), batch.origin, units.length);
          append(list, row, 0, static_cast<std::uint32_t>(batch.count), batch.weight);
        },
        splats);
  return list;
}

void set_weights(DrawList& list, std::span<const SplatBatch> batches) {
  std::size_t range = 0;
  for (const SplatBatch& batch : batches)
    for (std::uint64_t count = 0; count < batch.count; ++range) {
      list.ranges[range].weight = batch.weight;
      count += list.ranges[range].count;
    }
}

}  // namespace splatvol
