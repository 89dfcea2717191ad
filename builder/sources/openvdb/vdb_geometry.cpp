#include "builder/sources/openvdb/vdb_geometry.h"

#include <algorithm>
#include <cmath>

namespace splatvol {

using openvdb::Coord;

bool VoxelTransform::same_as(const VoxelTransform& other) const {
  const auto far_apart = [](const dvec3& a, const dvec3& b, double scale) {
    return !(glm::length(a - b) <= 1e-6 * scale);
  };
  const double edge = glm::length(edges[0]) + glm::length(edges[1]) + glm::length(edges[2]);
  for (int k = 0; k < 3; ++k)
    if (far_apart(edges[k], other.edges[k], edge)) return false;
  return !far_apart(origin, other.origin, edge);
}

SpatialMoments VoxelTransform::box_moments(double edge) const {
  const dmat3 s = edge * edge / 12 * edges * glm::transpose(edges);
  return {edge * edge * edge * std::abs(glm::determinant(edges)),
          dvec3(0),
          {s[0][0], s[1][1], s[2][2], s[1][0], s[2][0], s[2][1]}};
}

Result<VoxelTransform> voxel_transform(const std::string& path, const std::string& name,
                                       const openvdb::GridBase& grid) {
  const openvdb::math::Transform& of_grid = grid.transform();
  if (!of_grid.isLinear())
    return fail(ErrorCode::unsupported, "{}: the transform of grid \"{}\" ({}) is not linear, which is not supported",
                path, name, of_grid.mapType());
  const openvdb::Mat4R matrix = of_grid.baseMap()->getAffineMap()->getMat4();  // row vectors: position = index * matrix
  VoxelTransform transform;
  const auto row = [&](int r) { return dvec3(matrix[r][0], matrix[r][1], matrix[r][2]); };
  transform.edges = dmat3(row(0), row(1), row(2));
  transform.origin = row(3);
  const double volume = std::abs(glm::determinant(transform.edges));
  if (!(volume > 0) || !std::isfinite(volume + glm::dot(transform.origin, dvec3(1))))
    return fail(ErrorCode::invalid_data, "{}: the transform of grid \"{}\" gives its voxels no volume", path, name);
  return transform;
}

SampleLayout brick_layout() {
  SampleLayout layout;
  // The number of each sample, by its offset from the voxel before the first one.
  std::array<std::array<std::array<std::size_t, brick_edge + 2>, brick_edge + 2>, brick_edge + 2> numbers{};
  const auto number_at = [&](const Coord& offset) -> std::size_t& {
    const auto index = [](int i) { return static_cast<std::size_t>(i + 1); };
    return numbers[index(offset.x())][index(offset.y())][index(offset.z())];
  };
  const auto add = [&](const Coord& offset) {
    number_at(offset) = layout.offsets.size();
    layout.offsets.push_back(offset);
  };
  for (openvdb::Index voxel = 0; voxel < brick_voxels; ++voxel)
    add(openvdb::MaskTree::LeafNodeType::offsetToLocalCoord(voxel));
  for (const int side : {-1, brick_edge})
    for (int i = 0; i < brick_edge; ++i)
      for (int j = 0; j < brick_edge; ++j) add({side, i, j}), add({i, side, j}), add({i, j, side});

  for (std::size_t voxel = 0; voxel < brick_voxels; ++voxel) {
    Stencil stencil{voxel, {}};
    for (std::size_t axis = 0; axis < 3; ++axis)
      for (std::size_t side = 0; side < 2; ++side) {
        Coord beside = layout.offsets[voxel];
        beside[axis] += side == 0 ? -1 : 1;
        stencil.beside[axis][side] = number_at(beside);
      }
    layout.stencils.push_back(stencil);
  }
  return layout;
}

SampleLayout tile_layout(int edge) {
  const Coord middle(edge / 2);
  SampleLayout layout{{middle}, {}};
  Stencil stencil{0, {}};
  for (std::size_t axis = 0; axis < 3; ++axis)
    for (std::size_t side = 0; side < 2; ++side) {
      stencil.beside[axis][side] = layout.offsets.size();
      Coord beside = middle;
      beside[axis] = side == 0 ? -1 : edge;
      layout.offsets.push_back(beside);
    }
  layout.stencils.push_back(stencil);
  return layout;
}

LinearField fit_linear_field(const Stencil& stencil, std::span<const double> values, double edge) {
  const double own = values[stencil.own];
  const double distance = (edge + 1) / 2;  // from the point to the samples beside its box, in indices
  LinearField field{dvec3(0), own, own};
  double reach = 0, low = own, high = own;
  for (int axis = 0; axis < 3; ++axis) {
    const auto& [below, above] = stencil.beside[static_cast<std::size_t>(axis)];
    const double down = own - values[below], up = values[above] - own;
    const double rise = std::isnan(down) ? up : std::isnan(up) ? down : (down + up) / 2;
    if (std::isnan(rise)) continue;
    field.slope[axis] = rise / distance;
    reach += std::abs(field.slope[axis]) * edge / 2;
    for (const double value : {values[below], values[above]})
      low = std::fmin(low, value), high = std::fmax(high, value);
  }
  field.min = std::max(low, own - reach);
  field.max = std::min(high, own + reach);
  return field;
}

}  // namespace splatvol
