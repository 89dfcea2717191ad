// PLOT3D says nothing about how it was written: this finds out.
#pragma once

#include "base/error.h"
#include "base/file.h"

namespace splatvol {

/// The variant of the format that a binary grid and its solution are written in.
struct Plot3dFormat {
  bool multi_grid = false;    // begins with the number of blocks
  bool record_marks = false;  // Fortran: every record between its lengths
  bool big_endian = false;
  bool blanking = false;  // an integer for every point: 0 in holes
  int dimensions = 3;     // or 2
  int precision = 4;      // bytes of a number, or 8
};

/// Finds the variant whose headers make sense, agree in both files, and give the files' exact sizes (padding to whole
/// sectors of 512 bytes is let pass). Overflow's solutions, which have more variables, must agree in their headers
/// only. Safe on untrusted bytes.
[[nodiscard]] Result<Plot3dFormat> detect_plot3d(ByteSource& grid, ByteSource& solution);

}  // namespace splatvol
