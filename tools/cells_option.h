// Options of programs that read meshes.
#pragma once

#include <string>

#include "builder/sources/source.h"
#include "tools/command_line.h"

namespace splatvol {

[[nodiscard]] inline CellValues cell_values_of(const std::string& name) {
  return name == "own" ? CellValues::own : CellValues::averaged;
}

/// `own`: what happens to cells of their own.
inline void add_cells_option(CommandLine& app, std::string& cells, const std::string& own) {
  app.add_option(
         "--cells", cells,
         "Values of cells: averaged (to the points, by the volumes of the cells round each) or own (" + own + ")")
      ->one_of({"averaged", "own"})
      ->capture_default_str();
}

inline void add_displacements_option(CommandLine& app, bool& without) {
  app.add_flag(
      "--no-displacements", without,
      "Leave the points of an Exodus file where its coordinates are: without it, a vector of the points that is "
      "called disp, displ or displacement moves them");
}

}  // namespace splatvol
