// VTK's readers behind the Source interface; only vtk_source.cpp and vtk_writer.cpp see VTK's headers.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "builder/source.h"

namespace splatvol {

/// A file that one of VTK's readers takes.
struct VtkFile {
  enum class Kind { unstructured, structured, rectilinear, image, poly, legacy };
  std::string path;
  Kind kind;
};

/// Opens files as pieces of one data set: the first that has points fixes the attributes, all others must have them.
/// Contract as open_source; `files` must not be empty.
[[nodiscard]] Result<std::unique_ptr<Source>> open_vtk_files(std::vector<VtkFile> files,
                                                             const std::vector<std::string>& selection);

/// Opens a PLOT3D grid and its solution (binary, any of its variants); every block is a piece. The attributes are
/// Density, Momentum, StagnationEnergy, and Pressure for a ratio of specific heats of 1.4.
[[nodiscard]] Result<std::unique_ptr<Source>> open_plot3d(const std::string& grid, const std::string& solution,
                                                          const std::vector<std::string>& selection);

/// The files that a .pvtu names, relative to its own folder, in its order.
[[nodiscard]] Result<std::vector<std::string>> pvtu_pieces(const std::string& path);

}  // namespace splatvol
