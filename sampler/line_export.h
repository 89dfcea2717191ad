// Exports the values along a line through the cells that a file keeps.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>

#include "base/error.h"
#include "base/math.h"
#include "base/replaceable.h"
#include "format/splat_reader.h"
#include "format/volume.h"

namespace splatvol {

struct LineReport {
  std::uint64_t rows = 0;
  double length = 0;  // of the line
  double inside = 0;  // of its parts in cells with a value of all attributes
  std::uint64_t file_bytes = 0;
  std::map<std::string, std::string> renamed =
      {};  // usual name of a column: its name, where an attribute has the usual one
};

/// Writes a table as CSV (RFC 4180). Its columns are arc length, x, y, z and the attributes of the selection, and the
/// first line has their names. Rows are those of follow_line(). With `samples`, at least 2, there are as many rows, in
/// equal steps. Numbers read back to the same bits. Outside of cells, and where a value is missing, stands `nan`. The
/// selection's resolution and box do not matter.
///
/// Fails if the file keeps no cells, as follow_line() does, if the selection has two attributes of one name, or if
/// `path` may not be replaced: a table has no mark.
[[nodiscard]] Result<LineReport> export_line(const format::Volume& volume, const std::string& path,
                                             const format::SplatSelection& selection, const dvec3& start,
                                             const dvec3& end, std::optional<std::size_t> samples,
                                             Replace replace = Replace::exports);

}  // namespace splatvol
