// Guards for VTK's readers of Exodus, EnSight and CGNS, which print, hang or end the program where a file is damaged.
#pragma once

#include "builder/sources/vtk/reader.h"

namespace splatvol {

/// Fails where a file is not at all of its kind, and where a case file of EnSight has lines over which VTK 9.1 never
/// gets: sections that it does not know, entries that are cut off. Passes other kinds. Safe on untrusted bytes.
[[nodiscard]] Status check_blocks(const VtkFile& file);

}  // namespace splatvol
