// Opens an input of any format.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "builder/sources/array_union.h"
#include "builder/sources/source.h"

namespace splatvol {

/// Opens an input of any format:
/// - VTK files (.vtu, .pvtu, .vts, .vtr, .vti, .vtp, legacy .vtk); several are pieces of one data set.
/// - Exodus, EnSight, OpenFOAM and CGNS files, known by their extensions; they count as VTK files, and their blocks are
///   pieces (builder/sources/data_sets.h).
/// - .npy files; several are one point set (builder/sources/numpy/npy_source.h).
/// - .csv and .tsv files; several are one point set (builder/sources/csv/csv_source.h).
/// - a PLOT3D grid and its solution, as two paths in this order.
/// - OpenVDB files (builder/sources/openvdb/vdb_source.h).
/// - "gen:..." for a generated input (builder/sources/generator.h).
/// - a folder: an OpenFOAM case, or all files in it with known extensions. Their order is that of their names, with
///   numbers compared by size. Pieces that a .pvtu names are read once.
///
/// Cells become tetrahedra (builder/mesh/tetrahedra.h). Hidden cells and ghost copies are left out, with the points
/// that only they use. Of a linear cell with more nodes than corners, only the corners count. String arrays, ghost
/// flags and ids are no attributes. Values that are not finite become NaN. Points with positions that are not finite
/// stay, but no tetrahedron uses them.
///
/// Arrays of cells become attributes too, as CellValues tells. An array whose name is taken is called "NAME (cells)",
/// or "NAME (points)" if cells are points of their own.
///
/// The attributes are those of all files and blocks. Where one of them lacks an attribute, its values are missing.
/// Arrays of one name have the same number of components, else the input is refused. The headers of all files are read
/// first for that; next() fails if a file has an array that its header did not announce.
///
/// Fails if a file is missing or damaged, or of a kind or version that cannot be read right. Fails also if a file has
/// no arrays of numbers or lacks a selected attribute; the message lists its attributes. Only .npy
/// and .csv files may have `columns`, only files with time steps a `time`, and only meshes in files cells of their own.
/// next() fails if two files have the same points: these are time steps (builder/sources/repeated_pieces.h). As safe on
/// untrusted files as VTK's and OpenVDB's readers.
[[nodiscard]] Result<std::unique_ptr<Source>> open_source(const std::vector<std::string>& inputs,
                                                          const SourceOptions& options);

/// Lists the arrays that the headers of an input announce, at the time that the options choose, without those that the
/// selection does not need. Reads no values of points or cells, but walks through text files. None if only open_source
/// would tell. Fails as open_source, as far as that is read. As safe on untrusted files as open_source.
[[nodiscard]] Result<std::optional<std::vector<ArrayShape>>> list_arrays(const std::vector<std::string>& inputs,
                                                                         const SourceOptions& options);

}  // namespace splatvol
