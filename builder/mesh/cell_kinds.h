// The cell types of meshes, by VTK's numbers, and how each is split into tetrahedra.
#pragma once

#include <algorithm>
#include <array>
#include <string_view>

#include "builder/mesh/tetrahedra.h"

namespace splatvol {

/// VTK's numbers of the types that readers name.
namespace vtk_cell {
inline constexpr int empty = 0, triangle = 5, triangle_strip = 6, polygon = 7, pixel = 8, quadrilateral = 9,
                     tetrahedron = 10, hexahedron = 12, wedge = 13, pyramid = 14, quadratic_triangle = 22,
                     quadratic_quadrilateral = 23, biquadratic_quadrilateral = 28, triquadratic_hexahedron = 29,
                     quadratic_linear_quadrilateral = 30, biquadratic_wedge = 32, biquadratic_triangle = 34,
                     polyhedron = 42, lagrange_triangle = 69, lagrange_quadrilateral = 70;
}  // namespace vtk_cell

enum class CellRole {
  shape,       // split directly
  lattice,     // has a point at every position of a lattice: divided into linear cells first
  polyhedron,  // given by its faces
  no_volume,
};

struct CellKind {
  int vtk_type;  // as in files
  CellRole role;
  std::string_view name;                     // in a census
  CellShape shape = CellShape::tetrahedron;  // of a shape; of a lattice: the shape of its linear cells
};

/// Supported types, by number. Convex point sets, incomplete lattices and Bezier cells are not supported: a Bezier
/// cell's values at its points are not values of the field.
inline constexpr std::array cell_kinds = {
    CellKind{0, CellRole::no_volume, "empty"},
    CellKind{1, CellRole::no_volume, "vertex"},
    CellKind{2, CellRole::no_volume, "poly-vertex"},
    CellKind{3, CellRole::no_volume, "line"},
    CellKind{4, CellRole::no_volume, "polyline"},
    CellKind{5, CellRole::no_volume, "triangle"},
    CellKind{6, CellRole::no_volume, "triangle strip"},
    CellKind{7, CellRole::no_volume, "polygon"},
    CellKind{8, CellRole::no_volume, "pixel"},
    CellKind{9, CellRole::no_volume, "quadrilateral"},
    CellKind{10, CellRole::shape, "tetrahedron", CellShape::tetrahedron},
    CellKind{11, CellRole::shape, "voxel", CellShape::voxel},
    CellKind{12, CellRole::shape, "hexahedron", CellShape::hexahedron},
    CellKind{13, CellRole::shape, "wedge", CellShape::wedge},
    CellKind{14, CellRole::shape, "pyramid", CellShape::pyramid},
    CellKind{15, CellRole::shape, "pentagonal prism", CellShape::pentagonal_prism},
    CellKind{16, CellRole::shape, "hexagonal prism", CellShape::hexagonal_prism},
    CellKind{21, CellRole::no_volume, "quadratic line"},
    CellKind{22, CellRole::no_volume, "quadratic triangle"},
    CellKind{23, CellRole::no_volume, "quadratic quadrilateral"},
    CellKind{24, CellRole::shape, "quadratic tetrahedron", CellShape::quadratic_tetrahedron},
    CellKind{25, CellRole::shape, "quadratic hexahedron", CellShape::quadratic_hexahedron},
    CellKind{26, CellRole::shape, "quadratic wedge", CellShape::quadratic_wedge},
    CellKind{27, CellRole::shape, "quadratic pyramid", CellShape::quadratic_pyramid},
    CellKind{28, CellRole::no_volume, "biquadratic quadrilateral"},
    CellKind{29, CellRole::lattice, "triquadratic hexahedron", CellShape::hexahedron},
    CellKind{30, CellRole::no_volume, "quadratic-linear quadrilateral"},
    CellKind{31, CellRole::lattice, "quadratic-linear wedge", CellShape::wedge},
    CellKind{32, CellRole::lattice, "biquadratic wedge", CellShape::wedge},
    CellKind{33, CellRole::shape, "biquadratic hexahedron", CellShape::biquadratic_hexahedron},
    CellKind{34, CellRole::no_volume, "biquadratic triangle"},
    CellKind{35, CellRole::no_volume, "cubic line"},
    CellKind{36, CellRole::no_volume, "quadratic polygon"},
    CellKind{37, CellRole::shape, "triquadratic pyramid", CellShape::triquadratic_pyramid},
    CellKind{42, CellRole::polyhedron, "polyhedron"},
    CellKind{68, CellRole::no_volume, "Lagrange curve"},
    CellKind{69, CellRole::no_volume, "Lagrange triangle"},
    CellKind{70, CellRole::no_volume, "Lagrange quadrilateral"},
    CellKind{71, CellRole::lattice, "Lagrange tetrahedron", CellShape::tetrahedron},
    CellKind{72, CellRole::lattice, "Lagrange hexahedron", CellShape::hexahedron},
    CellKind{73, CellRole::lattice, "Lagrange wedge", CellShape::wedge},
};

/// The dimension of a cell: 0 for vertices, 1 for lines, 2 for surfaces, 3 for volumes.
[[nodiscard]] constexpr int dimension_of(const CellKind& kind) {
  constexpr std::array points = {0, 1, 2};
  constexpr std::array lines = {3, 4, 21, 35, 68};
  if (kind.role != CellRole::no_volume) return 3;
  if (std::ranges::find(points, kind.vtk_type) != points.end()) return 0;
  return std::ranges::find(lines, kind.vtk_type) != lines.end() ? 1 : 2;
}

/// Returns null for a type that is not supported.
[[nodiscard]] inline const CellKind* find_cell_kind(int vtk_type) {
  const auto* kind = std::ranges::find(cell_kinds, vtk_type, &CellKind::vtk_type);
  return kind == cell_kinds.end() ? nullptr : kind;
}

}  // namespace splatvol
