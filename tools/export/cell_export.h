// Exports the cells of a mesh that a file keeps as a .vtu file.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "base/error.h"
#include "base/replaceable.h"
#include "format/splat_reader.h"
#include "format/volume.h"

namespace splatvol {

struct CellsReport {
  std::uint64_t cells = 0;
  std::uint64_t points = 0;    // corners of these cells
  std::uint64_t left_out = 0;  // cells of chunks that meet the box, of a shape or field that this program does not know
  std::uint64_t split = 0;     // cells that are written as their tetrahedra: a reader would split them otherwise
  double volume = 0;           // of the cells: each counts as positive
  std::uint64_t file_bytes = 0;
};

/// Writes the cells of a CellExtraction with their points and values.
///
/// Each chunk of cells is read once: ranks of corners go into the file first, and become numbers of points once all
/// points are known. A temporary file beside `path` takes 8 bytes for each cell of its own. The output is of the
/// version 1.0 with appended raw data, and has the mark of an export (base/replaceable.h). It appears whole or not at
/// all. Fails as CellExtraction does, if the selection has two attributes of one name, or if `path` may not be
/// replaced.
[[nodiscard]] Result<CellsReport> export_cells(const format::Volume& volume, const std::string& path,
                                               const format::SplatSelection& selection,
                                               const std::function<void(double)>& progress,
                                               Replace replace = Replace::exports);

}  // namespace splatvol
