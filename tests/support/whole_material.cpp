#include "tests/support/whole_material.h"

#include <utility>

namespace splatvol::test {
namespace {

// Adds up the moments of each leaf's members about the one that stays. `kept`: the ones that stay, leaf by leaf.
template <class Moments>
std::vector<Moments> merge_leaves(const std::vector<Moments>& moments, std::span<const dvec3> positions,
                                  const Resolution& finer, std::span<const std::uint64_t> kept) {
  std::vector<Moments> merged(kept.size());
  for (std::size_t k = 0; k < kept.size(); ++k)
    for (std::uint64_t m = finer.begins[k]; m < finer.begins[k + 1]; ++m)
      merge(merged[k], moments[m], positions[finer.members[m]] - positions[kept[k]]);
  return merged;
}

std::vector<BoundaryPlane> merge_leaf_planes(const std::vector<BoundaryPlane>& planes, std::span<const dvec3> positions,
                                             const Resolution& finer, std::span<const std::uint64_t> kept) {
  if (planes.empty()) return {};
  std::vector<BoundaryPlane> merged;
  for (std::size_t k = 0; k < kept.size(); ++k) {
    std::vector<dvec3> shifts;
    for (std::uint64_t m = finer.begins[k]; m < finer.begins[k + 1]; ++m)
      shifts.push_back(positions[finer.members[m]] - positions[kept[k]]);
    merged.push_back(merge_planes(std::span(planes).subspan(finer.begins[k], shifts.size()), shifts));
  }
  return merged;
}

}  // namespace

Material material_of(const PointBatch& points) { return {points.moments, points.value_moments, points.planes}; }

std::vector<Material> merge_clusters(std::span<const dvec3> positions, std::span<const Resolution> resolutions,
                                     Material finest) {
  std::vector<Material> materials(resolutions.size());
  materials.back() = std::move(finest);
  for (std::size_t r = resolutions.size() - 1; r > 0; --r) {
    const std::span<const std::uint64_t> kept = resolutions[r - 1].members;
    materials[r - 1].moments = merge_leaves(materials[r].moments, positions, resolutions[r], kept);
    for (const auto& moments : materials[r].value_moments)
      materials[r - 1].value_moments.push_back(merge_leaves(moments, positions, resolutions[r], kept));
    materials[r - 1].planes = merge_leaf_planes(materials[r].planes, positions, resolutions[r], kept);
  }
  return materials;
}

std::vector<StoredSplat> splats_of(std::span<const dvec3> positions, const Resolution& resolution,
                                   const Material& material) {
  std::vector<StoredSplat> splats;
  for (std::size_t m = 0; m < resolution.size(); ++m) {
    StoredSplat& splat = splats.emplace_back(
        make_stored_splat(positions[resolution.members[m]], 0, material.moments[m], material.plane(m)));
    splat.depth = resolution.depths[m];
    splat.count = resolution.counts[m];
  }
  return splats;
}

}  // namespace splatvol::test
