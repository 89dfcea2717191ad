// Finds the variant of a PLOT3D file, which the file does not declare.
#pragma once

#include "base/error.h"
#include "base/file.h"

namespace splatvol {

/// The variant of the format of a binary grid and its solution.
struct Plot3dFormat {
  bool multi_grid = false;    // begins with the number of blocks
  bool record_marks = false;  // Fortran: the length stands before and after every record
  bool big_endian = false;
  bool blanking = false;  // an integer for every point: 0 in holes
  int dimensions = 3;     // or 2
  int precision = 4;      // bytes of a number, or 8
};

/// Finds the variant whose headers make sense, agree in both files, and give the files' exact sizes. Padding to whole
/// sectors of 512 bytes may follow. Overflow's solutions have more variables; only their headers must agree. Safe on
/// untrusted bytes.
[[nodiscard]] Result<Plot3dFormat> detect_plot3d(ByteSource& grid, ByteSource& solution);

}  // namespace splatvol
