// Cells as such, beside the tetrahedra that they are split into.
#pragma once

#include <array>
#include <cstdint>

#include "format/cell_shapes.h"

namespace splatvol {

/// A cell of several tetrahedra that a file can keep as one. Of a polyhedron, these tell all, and also whether it can.
struct WholeCell {
  format::CellShape shape = format::CellShape::hexahedron;
  format::CellSplit split = 0;
  std::uint32_t first = 0;                                           // of its tetrahedra, which follow each other
  std::uint32_t count = 0;                                           // of them
  std::array<std::uint32_t, format::max_cell_corners> corners = {};  // points of the piece; none of a polyhedron
};

}  // namespace splatvol
