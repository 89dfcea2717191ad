// Finds the variant of a PLOT3D file, which the file does not declare.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/file.h"

namespace splatvol {

/// The variant of the format of a binary grid, and of the solution or functions on it.
struct Plot3dFormat {
  bool multi_grid = false;    // begins with the number of blocks
  bool record_marks = false;  // Fortran: the length stands before and after every record
  bool big_endian = false;
  bool blanking = false;  // an integer for every point: 0 in holes
  int dimensions = 3;     // or 2
  int precision = 4;      // bytes of a number, or 8

  /// Where a block's functions lie in the file: number after number of all points, one function after the other.
  struct Functions {
    std::uint64_t count = 0, points = 0, offset = 0;
  };
  std::vector<Functions> functions = {};  // [block]; empty: the second file is a solution
};

/// Finds the variant whose headers make sense, agree in both files, and give the files' exact sizes. `values`: a
/// solution or functions; one that is called .q or .sol is a solution. Padding to whole sectors of 512 bytes may
/// follow. Overflow's solutions have more variables; only their headers must agree, and their sizes suffice. Safe on
/// untrusted bytes.
[[nodiscard]] Result<Plot3dFormat> detect_plot3d(ByteSource& grid, ByteSource& values);

/// The names of the functions in the file at `path`: those in the file NAME.nam beside it, one in each line before a
/// semicolon, or "f1", "f2", ... without it. Fails if it names another number of functions.
[[nodiscard]] Result<std::vector<std::string>> plot3d_function_names(const std::string& path, std::size_t count);

/// Reads a function of a block, a number for each point. Requires a block and a function that there are.
[[nodiscard]] Result<std::vector<double>> read_plot3d_function(ByteSource& file, const Plot3dFormat& format,
                                                               std::size_t block, std::size_t function);

}  // namespace splatvol
