// Shapes of cells: their corners, and their splits into tetrahedra (spec/svol-1.md, section 14).
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "format/layout.h"

namespace splatvol::format {

inline constexpr std::size_t max_cell_corners = 8;

/// Returns the number of corners; 0: not all cells of this shape have as many, or this program does not know it.
[[nodiscard]] constexpr std::size_t corners_of(CellShape shape) {
  switch (shape) {
    case CellShape::tetrahedron:
      return 4;
    case CellShape::pyramid:
      return 5;
    case CellShape::wedge:
      return 6;
    case CellShape::hexahedron:
      return 8;
    case CellShape::polyhedron:
      break;
  }
  return 0;
}

/// Sorts the few corners of a cell: faster than std::sort.
inline void sort_corners(std::span<std::uint64_t> corners) {
  const auto order = [&](std::size_t a, std::size_t b) {
    const std::uint64_t low = std::min(corners[a], corners[b]), high = std::max(corners[a], corners[b]);
    corners[a] = low;
    corners[b] = high;
  };
  if (corners.size() == 4) {
    order(0, 1), order(2, 3), order(0, 2), order(1, 3), order(1, 2);
    return;
  }
  for (std::size_t i = 1; i < corners.size(); ++i) {
    const std::uint64_t corner = corners[i];
    std::size_t k = i;
    for (; k > 0 && corners[k - 1] > corner; --k) corners[k] = corners[k - 1];
    corners[k] = corner;
  }
}

/// Whether cells of this shape and field can be decoded.
[[nodiscard]] constexpr bool is_known(CellShape shape, CellField field) {
  return (corners_of(shape) > 0 || shape == CellShape::polyhedron) &&
         (field == CellField::corners || field == CellField::constant);
}

/// How a cell is split into tetrahedra: they share the corner `split & 7`. Bit 3 + i is set if quadrilateral face i is
/// split along the diagonal from its second corner, and not along that from its first. A tetrahedron has the split 0;
/// that of a polyhedron is its apex, and its surface has the rest (format/polyhedron.h).
using CellSplit = std::uint16_t;

/// The quadrilateral faces of a shape, as corners in order.
[[nodiscard]] std::span<const std::array<std::uint8_t, 4>> quadrilaterals_of(CellShape shape);

/// Splits from this on do not exist. No polyhedron.
[[nodiscard]] inline unsigned split_end(CellShape shape) {
  return shape == CellShape::tetrahedron ? 1 : 8u << quadrilaterals_of(shape).size();
}
[[nodiscard]] inline bool is_split(CellShape shape, CellSplit split) {
  return split < split_end(shape) && (split & 7u) < corners_of(shape);
}

/// Tetrahedra of a cell, as indices of its corners. Those of a convex cell whose corners are numbered as VTK numbers
/// them have a positive volume.
[[nodiscard]] std::span<const std::array<std::uint8_t, 4>> tetrahedra_of(CellShape shape, CellSplit split);

/// An order of a cell's corners: its number among all orders, which ascend.
using Permutation = std::uint16_t;

/// Returns the order of different corners; 0 if they ascend.
template <class Corner>
[[nodiscard]] Permutation permutation_of(std::span<const Corner> corners) {
  unsigned number = 0;
  for (std::size_t k = 0; k < corners.size(); ++k) {
    number *= static_cast<unsigned>(corners.size() - k);
    for (std::size_t i = k + 1; i < corners.size(); ++i) number += corners[i] < corners[k] ? 1 : 0;
  }
  return static_cast<Permutation>(number);
}

/// All orders of a shape's corners: [permutation][corner]: its place among all of the cell in ascending order.
[[nodiscard]] std::span<const std::array<std::uint8_t, max_cell_corners>> permutations_of(CellShape shape);

/// Another order of a cell's corners that is the same cell.
struct CellOrder {
  std::uint16_t code = 0;  // which order: one of orders_of(shape)
  CellSplit split = 0;     // in that order
};

/// The orders of a shape that do not turn or mirror into each other: [code][corner]: as permutations_of().
[[nodiscard]] std::span<const std::array<std::uint8_t, max_cell_corners>> orders_of(CellShape shape);

/// Finds the order among these. Requires a split of the shape.
[[nodiscard]] CellOrder find_order(CellShape shape, Permutation permutation, CellSplit split);

}  // namespace splatvol::format
