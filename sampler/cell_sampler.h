// Values between the corners of the cells that a file keeps.
#pragma once

#include <span>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "sampler/cell_tetrahedra.h"

namespace splatvol {

/// Returns the values of the cells' first attribute at positions, in world units: the linear interpolation in the
/// tetrahedron that a position is in, or the value of its cell. NaN where no cell with a value is. Of several cells at
/// a position, the first of the file counts. A position that rounding has moved out of all cells
/// (CellTetrahedra::reach), or that is at most `reach` beside them, has the value of the nearest point of a cell.
///
/// Requires fewer than 2^32 - 1 positions. Reads chunks whose boxes have positions in them. Takes about 40 bytes for
/// each position. Does not depend on threads.
[[nodiscard]] Result<std::vector<double>> sample_cells(const CellTetrahedra& cells, std::span<const dvec3> positions,
                                                       double reach = 0);

}  // namespace splatvol
