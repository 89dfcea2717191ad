// One of VTK's data sets to one Piece.
#pragma once

#include <memory>
#include <span>
#include <string>

#include "base/error.h"
#include "builder/sources/source.h"
#include "builder/sources/vtk/channels.h"

class vtkDataSet;

namespace splatvol {

/// Points, values of `channels`, and the cells as tetrahedra, as open_source promises them. Fails where cells are
/// damaged or not supported, or a channel is not there; `path` begins the message. Safe on untrusted data sets.
[[nodiscard]] Result<std::unique_ptr<Piece>> make_piece(const std::string& path, vtkDataSet& data,
                                                        std::span<const VtkChannel> channels);

}  // namespace splatvol
