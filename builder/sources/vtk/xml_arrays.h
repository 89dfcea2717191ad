// The arrays that the header of an XML file announces.
#pragma once

#include <string>
#include <vector>

#include "base/error.h"
#include "builder/sources/array_union.h"

namespace splatvol {

/// Lists the arrays of each piece of the file at `path` that has points: those that give attributes, as array_shapes
/// (builder/sources/vtk/attributes.h) lists them when the piece has been read. With `but_surfaces`, pieces with
/// polygons or strips are left out. Reads no appended data. Fails if the file is no whole XML file; trusts nothing else
/// in it.
[[nodiscard]] Result<std::vector<std::vector<ArrayShape>>> xml_arrays(const std::string& path, bool but_surfaces);

}  // namespace splatvol
