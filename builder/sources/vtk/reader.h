// VTK's readers of single data sets and of pieces, and the order of files.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "builder/sources/vtk/data_sets.h"

class vtkXMLReader;

namespace splatvol {

/// Reads VTK files in their order. The pieces of a .vtu and the blocks of a multi-block file come one by one, each read
/// by the next() that returns it. With a `selection` of attributes, readers skip the arrays that it does not need;
/// empty: all. `time` as in open_blocks. Errors come from next().
[[nodiscard]] std::unique_ptr<VtkDataSets> read_vtk_files(std::vector<VtkFile> files,
                                                          std::vector<std::string> selection,
                                                          std::optional<double> time,
                                                          CellValues cells = CellValues::averaged,
                                                          const MissingValues& missing = {});

/// Makes the reader of an XML file; null for files of other kinds.
[[nodiscard]] vtkSmartPointer<vtkXMLReader> make_xml_reader(VtkFile::Kind kind);

/// The files that a .pvtu names, relative to its own folder, in its order.
[[nodiscard]] Result<std::vector<std::string>> pvtu_pieces(const std::string& path);

}  // namespace splatvol
