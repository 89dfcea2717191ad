// Exodus files, by VTK's reader.
#pragma once

#include <memory>

#include "builder/sources/vtk/block_readers.h"

namespace splatvol {

[[nodiscard]] std::unique_ptr<BlockReader> make_exodus_reader();

}  // namespace splatvol
