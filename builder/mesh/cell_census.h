// What the cells of an input were.
#pragma once

#include <cstdint>
#include <map>
#include <string>

namespace splatvol {

/// What the cells of an input were, counted; shown to the user after a build.
struct CellCensus {
  std::map<std::string, std::uint64_t> cells;  // by type name: "tetrahedron", "hexahedron", "polyhedron", ...
  std::uint64_t tetrahedra = 0;                // after splitting
  std::uint64_t inverted = 0;                  // tetrahedra with negative volume as their cell orders them
  std::uint64_t flat = 0;                      // tetrahedra with volume exactly 0
  std::uint64_t without_volume = 0;   // vertices, lines and surface cells: their points are kept, they fill nothing
  std::uint64_t hidden = 0;           // blanked cells, and ghost copies of cells that another piece owns
  std::uint64_t non_finite = 0;       // cells left out: a corner's position is not finite
  std::uint64_t not_star_shaped = 0;  // cells that no vertex sees whole: split with some inverted tetrahedra

  CellCensus& operator+=(const CellCensus& other);
};

}  // namespace splatvol
