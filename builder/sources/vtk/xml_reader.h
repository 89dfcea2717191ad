// VTK's XML files, and those that name their pieces.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"
#include "builder/sources/data_sets.h"

class vtkXMLReader;
template <class T>
class vtkSmartPointer;

namespace splatvol {

/// Returns the reader of XML files by the type that they state, such as "UnstructuredGrid"; empty for types that are
/// not read. Each piece of a file is a data set.
[[nodiscard]] std::optional<FileReader> xml_reader_of(std::string_view type);

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
