// Meshes that come out of a .svol file.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "splatvol/geometry.h"

namespace splatvol {

/// Values at the points or in the cells of a mesh: of an attribute, or of a vector.
struct MeshValues {
  std::string name;
  std::string unit;  // such as "m/s"; empty: not known
  std::size_t components = 1;
  std::vector<double> numbers;  // those of a point or cell side by side; NaN: missing
};

/// Cells, in the layout of VTK's unstructured grids and of MeshArrays.
struct CellMesh {
  std::vector<dvec3> points;
  std::vector<std::int64_t> connectivity;  // points of cell after cell
  std::vector<std::int64_t> offsets;       // [cell]: where its points begin; then their end
  std::vector<std::uint8_t> types;         // [cell]: VTK's number
  std::vector<MeshValues> point_values;
  std::vector<MeshValues> cell_values;
  std::uint64_t left_out = 0;  // cells of shapes that this version does not know
  std::uint64_t split = 0;     // cells that are there as their tetrahedra
};

/// The surface on which an attribute has one value.
struct ContourMesh {
  std::vector<dvec3> points;
  std::vector<std::array<std::int64_t, 3>> triangles;  // of points; counter-clockwise seen from the lower values
  std::vector<MeshValues> point_values;
  std::uint64_t left_out = 0;  // cells of the file of shapes that this version does not know
};

}  // namespace splatvol
