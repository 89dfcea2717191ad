// What VTK's XML readers believe of a file, checked before they see it.
#pragma once

#include <string>

#include "base/error.h"

namespace splatvol {

/// Checks the elements of the file at `path`: arrays of known types, no two of one name beside each other, and sound
/// headers of all compressed ones (builder/sources/vtk/compression.h), no piece with more cells and points than memory
/// holds. Safe on untrusted files.
[[nodiscard]] Status check_xml(const std::string& path);

}  // namespace splatvol
