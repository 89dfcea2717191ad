// Values along a line through the cells that a file keeps.
#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "sampler/cell_tetrahedra.h"

namespace splatvol {

/// Values along a line from a start to an end. Rows follow each other along it.
struct LineRows {
  std::vector<double> arc_lengths;          // [row]: from the start, world units
  std::vector<dvec3> positions;             // [row]
  std::vector<std::vector<double>> values;  // [attribute][row]; NaN: no cell, or no value
};

/// Returns the tetrahedra of a chunk: those that are held, or what it has read into `scratch`. Called by several
/// threads.
using ReadTetrahedra =
    std::function<Result<const Tetrahedra*>(const format::CellChunkEntry& entry, Tetrahedra& scratch)>;

/// Follows a line through the cells, and returns a row wherever it crosses from a tetrahedron to another, and at its
/// ends. Between two rows, all values are linear. Where they jump, two rows have one position: at borders of cells of
/// their own and of blocks, and where the line leaves all cells or enters one. A gap is two rows of NaN.
///
/// Where cells overlap, the first of the file with a value counts. Lines on faces and edges, and gaps that rounding
/// opens, are as in sample_cells(). Reads the chunks of cells whose boxes meet the line, and holds their tetrahedra on
/// the line. Does not depend on threads. Fails if cells have shapes that this program does not know, or unless the line
/// is finite and longer than 0. `read`: who reads chunks of these cells; empty: they do, and a file that is far is
/// asked for several at once.
[[nodiscard]] Result<LineRows> follow_line(const CellTetrahedra& cells, const dvec3& start, const dvec3& end,
                                           const ReadTetrahedra& read = {});

/// Returns the value of an attribute at an arc length of the rows: linear between them. Where values jump, takes the
/// value in front, or the other if that is NaN. Requires rows, and an arc length between the first and the last.
[[nodiscard]] double value_on_line(const LineRows& rows, std::size_t attribute, double arc_length);

/// Returns the values at positions in equal steps along the line, both ends included: those of follow_line() between
/// its rows, as value_on_line(). Requires at least two positions.
[[nodiscard]] LineRows in_equal_steps(const LineRows& rows, const dvec3& start, const dvec3& end,
                                      std::size_t positions);

}  // namespace splatvol
