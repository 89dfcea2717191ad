// Cells of higher order whose nodes form a full lattice, divided into linear cells.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "base/math.h"
#include "builder/mesh/tetrahedra.h"

namespace splatvol {

/// Divides a cell with a node at every place of a lattice: a hexahedron, a wedge (triangle in x and y, axis z) or a
/// tetrahedron of the same order in all directions, but for a wedge's `axial_order`.
///
/// `parametric`: where each node lies in the unit cell, in the file's order. Returns the local nodes of linear cells of
/// the same shape, node_count(shape) for each; nothing where the nodes are not such a lattice.
[[nodiscard]] std::optional<std::vector<std::uint32_t>> divide_lattice(CellShape shape, int order, int axial_order,
                                                                       std::span<const dvec3> parametric);

/// The order of a lattice of `nodes` nodes, at most 32; nothing where none has so many. `linear_axis`: see above, order
/// 1 along a wedge's axis.
[[nodiscard]] std::optional<int> lattice_order(CellShape shape, bool linear_axis, std::size_t nodes);

}  // namespace splatvol
