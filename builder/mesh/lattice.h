// Divides cells of higher order into linear cells. Their points must form a full lattice.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "base/math.h"
#include "builder/mesh/tetrahedra.h"

namespace splatvol {

/// Divides a cell with a point at every position of a lattice: a hexahedron, a wedge (triangle in x and y, axis z) or a
/// tetrahedron. The order is the same in all directions, except that a wedge has `axial_order` along its axis.
///
/// `parametric`: the position of each point in the unit cell, in the file's order. Returns the points of linear cells
/// of the same shape, node_count(shape) local indices for each. Empty if the points are not such a lattice.
[[nodiscard]] std::optional<std::vector<std::uint32_t>> divide_lattice(CellShape shape, int order, int axial_order,
                                                                       std::span<const dvec3> parametric);

/// Finds the order of a lattice of `points` points, at most 32; empty if there is none. `linear_axis`: the order along
/// a wedge's axis is 1.
[[nodiscard]] std::optional<int> lattice_order(CellShape shape, bool linear_axis, std::size_t points);

}  // namespace splatvol
