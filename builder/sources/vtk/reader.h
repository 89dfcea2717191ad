// Files to VTK's data sets, through VTK's readers.
#pragma once

#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "builder/sources/source.h"

class vtkDataSet;
template <class T>
class vtkSmartPointer;

namespace splatvol {

/// A file that one of VTK's readers takes.
struct VtkFile {
  enum class Kind { unstructured, structured, rectilinear, image, poly, legacy, exodus, ensight, openfoam, cgns };
  std::string path;
  Kind kind;
};

/// The data sets of an input, one after the other. Not thread-safe.
class VtkDataSets {
 public:
  virtual ~VtkDataSets() = default;

  /// Data sets in all; a file of several that is not open yet counts as one.
  [[nodiscard]] virtual std::size_t count() const = 0;

  /// The next one; a null pointer after the last.
  [[nodiscard]] virtual Result<vtkSmartPointer<vtkDataSet>> next() = 0;

  /// The file that the last one came from.
  [[nodiscard]] virtual const std::string& path() const = 0;

  /// As Source::time_step(), of the first file that has been opened.
  [[nodiscard]] virtual std::optional<TimeStep> time_step() const { return std::nullopt; }
};

/// VTK files in their order, the pieces of a .vtu and blocks one by one, each read when it is asked for. A `selection`
/// of attributes lets readers skip the arrays that they do not need; empty: all point data. `time` as in open_blocks.
/// Never fails by itself, next() may.
[[nodiscard]] std::unique_ptr<VtkDataSets> read_vtk_files(std::vector<VtkFile> files,
                                                          std::vector<std::string> selection,
                                                          std::optional<double> time);

/// The blocks of a PLOT3D grid with its solution (binary, any variant). The format interleaves them by quantity, so
/// they are read together, here.
[[nodiscard]] Result<std::unique_ptr<VtkDataSets>> read_plot3d(const std::string& grid, const std::string& solution);

/// The files that a .pvtu names, relative to its own folder, in its order.
[[nodiscard]] Result<std::vector<std::string>> pvtu_pieces(const std::string& path);

}  // namespace splatvol
