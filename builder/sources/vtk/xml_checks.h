// Checks of XML files before VTK's readers see them: the readers trust what a file declares.
#pragma once

#include <string>
#include <vector>

#include "base/error.h"
#include "builder/sources/vtk/xml_arrays.h"

class vtkXMLDataElement;

namespace splatvol {

/// Checks the elements of the file at `path`. Fails if an array has an unknown type or belongs to another time step
/// than the first, or if two neighbouring arrays have the same name. Fails if pieces of a structured grid or of a
/// surface have other arrays than the first. Fails if the header of a compressed array is damaged
/// (builder/sources/vtk/compression.h), or if the file ends before an array does. Fails if memory cannot hold the cells
/// and points of a piece. Returns what xml_arrays does. Safe on untrusted files.
[[nodiscard]] Result<std::vector<XmlPiece>> check_xml(const std::string& path);

/// Whether all pieces of a file are stated to have no points, as VTK writes those of empty grids. check_xml() and VTK's
/// readers refuse such files. Safe on untrusted files.
[[nodiscard]] Result<bool> is_empty_xml(const std::string& path);

/// Checks that the pieces that a parallel file of a structured grid names fill its extent. Pieces with ghosts overlap,
/// and pass. `grid`: the element of the grid; other kinds have no extent, and pass.
[[nodiscard]] Status check_parallel_pieces(const std::string& path, vtkXMLDataElement& grid);

}  // namespace splatvol
