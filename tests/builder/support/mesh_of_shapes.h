// A mesh of all shapes that a file keeps.
#pragma once

#include <fmt/format.h>

#include <string>
#include <vector>

#include "base/math.h"

namespace splatvol::test {

/// A file of VTK with one cell of each shape: hexahedron, pyramid, wedge, tetrahedron, polyhedron. The array "value" of
/// points is x + 2 y + 4 z; "number" of cells is the cell's number.
inline std::string mesh_of_shapes() {
  std::vector<dvec3> points;
  for (const double left : {0.0, 8.0})
    for (const dvec3& p : {dvec3(0, 0, 0), {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}})
      points.push_back(p + dvec3(left, 0, 0));
  for (const dvec3& p : {dvec3(0.5, 0.5, 2),
                         {2, 0, 0},
                         {2, 1, 0},
                         {2, 0.5, 1},
                         {3, 0, 0},
                         {3, 1, 0},
                         {3, 0.5, 1},
                         {5, 5, 5},
                         {6, 5, 5},
                         {5, 6, 5},
                         {5, 5, 6}})
    points.push_back(p);
  std::string positions, values;
  for (const dvec3& p : points) {
    positions += fmt::format("{} {} {}\n", p.x, p.y, p.z);
    values += fmt::format("{}\n", p.x + 2 * p.y + 4 * p.z);
  }
  return fmt::format(
      "# vtk DataFile Version 3.0\ntest\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS {0} double\n{1}CELLS 5 59\n"
      "8 0 1 2 3 4 5 6 7\n5 4 5 6 7 16\n6 17 18 19 20 21 22\n4 23 24 25 26\n"
      "31 6  4 8 12 15 11  4 9 10 14 13  4 8 9 13 12  4 11 15 14 10  4 8 11 10 9  4 12 13 14 15\n"
      "CELL_TYPES 5\n12\n14\n13\n10\n42\nPOINT_DATA {0}\nSCALARS value double 1\nLOOKUP_TABLE default\n{2}"
      "CELL_DATA 5\nSCALARS number double 1\nLOOKUP_TABLE default\n0\n1\n2\n3\n4\n",
      points.size(), positions, values);
}

}  // namespace splatvol::test
