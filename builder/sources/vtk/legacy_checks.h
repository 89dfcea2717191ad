// A check of legacy .vtk files before VTK's reader sees them: it fills up with zeros what a file lacks, and trusts the
// counts and indices of its cells.
#pragma once

#include <string>
#include <vector>

#include "base/error.h"
#include "builder/sources/array_union.h"

namespace splatvol {

/// Walks through the sections of the file at `path`. Fails if the file ends before an array, a line or a section that
/// it declares does. Fails also at an unknown section or type of numbers, at a word instead of a number, and if counts
/// do not fit together or a cell names a point that is not there. Safe on untrusted files.
///
/// White space must follow the last number of a text file, which may be cut otherwise. A file that is cut right before
/// a section that nothing declares is whole by the rules of the format.
///
/// Returns the arrays of points and of cells that hold numbers and are no ids: names as VTK's reader gives them, in
/// UTF-8. Skips over the numbers of a binary file; those of a text file have to be walked through.
[[nodiscard]] Result<std::vector<ArrayShape>> legacy_arrays(const std::string& path);

}  // namespace splatvol
