// Turns one of VTK's data sets into a Piece.
#pragma once

#include <memory>
#include <span>
#include <string>

#include "base/error.h"
#include "builder/sources/source.h"
#include "builder/sources/vtk/attributes.h"

class vtkDataSet;

namespace splatvol {

/// Returns the points, the values of `attributes`, and the cells as tetrahedra, as open_source promises. With cells of
/// their own the points are these cells, without those of no volume. Fails if cells are damaged or not supported, or if
/// an attribute is not there; `path` begins the message. Safe on untrusted data sets.
[[nodiscard]] Result<std::unique_ptr<Piece>> make_piece(const std::string& path, vtkDataSet& data,
                                                        std::span<const VtkAttribute> attributes, CellValues cells,
                                                        const MissingValues& missing);

}  // namespace splatvol
