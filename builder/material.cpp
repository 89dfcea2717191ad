#include "builder/material.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <utility>

#include "builder/density.h"

namespace splatvol {
namespace {

// Of each leaf, the members' moments about the one that stays: `kept` in the next coarser resolution.
template <class Moments>
std::vector<Moments> merge_leaves(const std::vector<Moments>& finer, std::span<const dvec3> positions,
                                  std::span<const std::uint64_t> leaves, std::span<const std::uint64_t> members,
                                  std::span<const std::uint64_t> kept) {
  std::vector<Moments> merged(kept.size());
  tbb::parallel_for(std::size_t{0}, kept.size(), [&](std::size_t k) {
    for (std::uint64_t m = leaves[k]; m < leaves[k + 1]; ++m)
      merge(merged[k], finer[m], positions[members[m]] - positions[kept[k]]);
  });
  return merged;
}

std::vector<BoundaryPlane> merge_leaf_planes(const std::vector<BoundaryPlane>& finer, std::span<const dvec3> positions,
                                             std::span<const std::uint64_t> leaves,
                                             std::span<const std::uint64_t> members,
                                             std::span<const std::uint64_t> kept) {
  if (finer.empty()) return {};
  std::vector<BoundaryPlane> merged(kept.size());
  tbb::parallel_for(std::size_t{0}, kept.size(), [&](std::size_t k) {
    std::vector<dvec3> shifts;
    for (std::uint64_t m = leaves[k]; m < leaves[k + 1]; ++m)
      shifts.push_back(positions[members[m]] - positions[kept[k]]);
    merged[k] = merge_planes(std::span(finer).subspan(leaves[k], shifts.size()), shifts);
  });
  return merged;
}

std::vector<PlacedShape> place_shapes(const Material& material, std::span<const dvec3> positions,
                                      std::span<const std::uint64_t> members) {
  std::vector<PlacedShape> shapes(members.size());
  tbb::parallel_for(std::size_t{0}, members.size(), [&](std::size_t m) {
    shapes[m] = {positions[members[m]] + material.moments[m].centroid, material.shape(m)};
  });
  return shapes;
}

// From fine to coarse: a splat looks where its parts are.
void find_densities(std::span<const MortonKey> keys, std::span<const dvec3> positions,
                    std::span<const Resolution> resolutions, std::span<Material> materials) {
  std::vector<PlacedShape> finer;
  std::vector<std::uint64_t> leaves;
  for (std::size_t r = resolutions.size(); r-- > 0;) {
    std::vector<PlacedShape> shapes = place_shapes(materials[r], positions, resolutions[r].members);
    fit_densities(shapes, finer, leaves);
    for (const PlacedShape& placed : shapes) materials[r].densities.push_back(static_cast<float>(placed.shape.density));
    leaves = leaf_begins(keys, resolutions[r]);
    finer = std::move(shapes);
  }
}

std::vector<Extent> find_extents(const std::vector<SpatialMoments>& moments) {
  std::vector<Extent> extents(moments.size());
  tbb::parallel_for(std::size_t{0}, moments.size(), [&](std::size_t m) {
    const dvec3 deviations = shape_of(moments[m]).deviations;  // descending
    int shortest = 2;
    while (shortest > 0 && !(deviations[shortest] > 0)) --shortest;
    extents[m] = {deviations[shortest], deviations[0]};
  });
  return extents;
}

}  // namespace

format::SplatShape Material::shape(std::size_t member) const {
  format::SplatShape shape = shape_of(moments[member]);
  if (!planes.empty()) shape.boundary = boundary_foot(planes[member], moments[member], shape);
  if (!densities.empty()) shape.density = static_cast<double>(densities[member]);
  return shape;
}

std::vector<Material> merge_clusters(std::span<const MortonKey> keys, std::span<const dvec3> positions,
                                     std::span<const Resolution> resolutions, Material finest) {
  std::vector<Material> materials(resolutions.size());
  materials.back() = std::move(finest);
  for (std::size_t r = resolutions.size() - 1; r > 0; --r) {
    const Material& finer = materials[r];
    const std::vector<std::uint64_t> leaves = leaf_begins(keys, resolutions[r]);
    const auto merge_all = [&](const auto& moments) {
      return merge_leaves(moments, positions, leaves, resolutions[r].members, resolutions[r - 1].members);
    };
    materials[r - 1].moments = merge_all(finer.moments);
    for (const auto& moments : finer.value_moments) materials[r - 1].value_moments.push_back(merge_all(moments));
    materials[r - 1].planes =
        merge_leaf_planes(finer.planes, positions, leaves, resolutions[r].members, resolutions[r - 1].members);
  }
  for (Material& material : materials) material.extents = find_extents(material.moments);
  find_densities(keys, positions, resolutions, materials);
  return materials;
}

format::ValueSummary summarize(const ValueMoments& value, double offset, const format::ValueBins& bins) {
  if (!(value.mass > 0)) return {};
  const auto low = static_cast<float>(value.min - offset), high = static_cast<float>(value.max - offset);
  const std::uint64_t all = ~std::uint64_t{0};
  return {low, high, all << bins.bin(low) & all >> (63 - bins.bin(high))};
}

}  // namespace splatvol
