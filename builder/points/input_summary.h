// Facts about an input as a whole.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/math.h"
#include "builder/mesh/cell_census.h"
#include "format/volume_info.h"

namespace splatvol {

/// Counts of the input's points.
struct PointCensus {
  std::uint64_t read = 0;
  std::uint64_t not_finite = 0;  // dropped: a coordinate is not usable (is_usable_position)
  std::uint64_t merged = 0;      // copies of an earlier vertex of cells
  std::uint64_t unlike = 0;      // of the merged, with other values: in a series (VertexCopies::same_place, same_block)
  std::uint64_t coincident = 0;  // kept, though an earlier point has the same position
  std::uint64_t in_no_cell = 0;  // kept, though the input has cells and none uses them
  std::uint64_t left_out = 0;    // dropped: no cell uses them, and they lie outside of the box round all cells
};

/// Which attributes with the same values are stored once.
struct JoinedAttributes {
  bool join = true;
  std::vector<std::string> apart = {};  // names that become no alias; "U" holds for "U[0]" too
};

struct InputSummary {
  Box box;                                    // round the points
  Cube cube;                                  // round the box
  std::vector<format::Attribute> attributes;  // name, unit, offset, scale, range
  std::vector<double> least;                  // [attribute]: PointRanges::least
  std::vector<std::uint64_t> fills;           // [attribute]: numbers read that stood for none
  std::vector<format::Alias> aliases;         // other attributes of the source, with the values of one of these
  std::vector<std::size_t> stored;            // [attribute of the source]: index of the attribute that has its values
  CellCensus cells;
  PointCensus census;  // PointStream::next() counts merged and coincident points
  bool has_material = false;
  std::uint64_t bytes_to_read = 0;  // held at most while the input was read, besides the source's own copy of a piece
};

}  // namespace splatvol
