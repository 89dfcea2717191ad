// VTK's readers of single data sets and of pieces, and the order of files.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "base/error.h"
#include "builder/sources/vtk/data_sets.h"

class vtkXMLReader;

namespace splatvol {

/// Reads VTK files in their order. The pieces of a .vtu and the blocks of a multi-block file come one by one, each read
/// by the next() that returns it. Readers skip the arrays that `options.selection` does not need. `options.time` as in
/// open_blocks. Errors come from next().
[[nodiscard]] std::unique_ptr<VtkDataSets> read_vtk_files(std::vector<VtkFile> files, const SourceOptions& options);

/// Makes the reader of an XML file; null for files of other kinds.
[[nodiscard]] vtkSmartPointer<vtkXMLReader> make_xml_reader(VtkFile::Kind kind);

/// Makes VTK's reader of unstructured grids, extended to file version 2.3: polyhedra in arrays of their own. It reports
/// damage to these arrays like VTK's own errors.
[[nodiscard]] vtkSmartPointer<vtkXMLReader> make_unstructured_reader();

/// What a .pvtu, .pvti, .pvtr or .pvts states.
struct ParallelFile {
  std::vector<std::string> pieces;  // files, in its order
  std::vector<ArrayShape> arrays;   // of all pieces; a file need not tell
};

/// Reads such a file. Fails if the pieces of a structured grid do not fill it.
[[nodiscard]] Result<ParallelFile> read_parallel_file(const std::string& path);

}  // namespace splatvol
