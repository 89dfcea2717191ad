// Counts of the cells of an input.
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <tuple>

namespace splatvol {

/// Counts of the cells of an input, which the user sees after a build.
struct CellCensus {
  std::map<std::string, std::uint64_t> cells;  // by type name: "tetrahedron", "hexahedron", "polyhedron", ...
  std::uint64_t tetrahedra = 0;                // after splitting
  std::uint64_t inverted = 0;                  // tetrahedra whose volume is negative in their cell's order
  std::uint64_t upright = 0;                   // tetrahedra whose volume is positive in their cell's order
  std::uint64_t flat = 0;                      // tetrahedra with volume exactly 0
  std::uint64_t without_volume = 0;            // vertices, lines and surface cells: only their points are kept
  std::uint64_t surfaces = 0;                  // of these: triangles, polygons and other cells with an area
  std::uint64_t lines = 0;                     // of these: lines and curves
  std::uint64_t hidden = 0;                    // blanked cells, and ghost copies of cells that another piece owns
  std::uint64_t hidden_points = 0;             // points left out: ghost copies, and points of hidden cells only
  std::uint64_t more_nodes = 0;                // linear cells with nodes beside their corners: the corners are taken
  std::uint64_t left_out_flat = 0;             // cells of their own without volume, which are no points
  std::uint64_t non_finite = 0;                // cells left out, as a corner's position is not finite
  std::uint64_t not_star_shaped = 0;           // cells that no vertex sees whole: some of their tetrahedra are inverted
  std::uint64_t left_out = 0;                  // cells of blocks that are surfaces, of which nothing is kept
  std::uint64_t unwritten = 0;                 // values that a text file has stars for, which are missing
  std::uint64_t open_ends = 0;                 // text files that end with a number: it may be cut off
  std::set<std::string> losses;                // lines that name what the input has and its reader did not give

  // Only of cells whose corners a reader has rounded to single precision (measure_single_precision).
  std::uint64_t bent = 0;       // tetrahedra that this may have bent
  std::uint64_t flattened = 0;  // flat tetrahedra that may have had a volume
  double bent_volume = 0;
  double measured_volume = 0;

  double rounded_by = 0;  // no reader has changed a coordinate by more (SourceOptions::may_round)

  CellCensus& operator+=(const CellCensus& other);
};

/// All numbers but those by type that add up, by reference. Without the losses.
template <class Census>
[[nodiscard]] auto numbers_of(Census& census) {
  return std::tie(census.tetrahedra, census.inverted, census.upright, census.flat, census.without_volume,
                  census.surfaces, census.lines, census.hidden, census.hidden_points, census.more_nodes,
                  census.left_out_flat, census.non_finite, census.not_star_shaped, census.left_out, census.unwritten,
                  census.open_ends, census.bent, census.flattened, census.bent_volume, census.measured_volume);
}

/// Describes an input whose cells are surfaces and lines, or none of whose cells has a volume: "only surface cells
/// (3040 polygons)". Empty if there is a tetrahedron with a volume, or if there are no cells besides vertices.
[[nodiscard]] std::string describe_no_volume(const CellCensus& census);

}  // namespace splatvol
