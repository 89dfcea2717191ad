// The format of a file by its contents.
#pragma once

#include <optional>
#include <string>

#include "base/error.h"
#include "base/input_formats.h"

namespace splatvol {

/// How a file begins.
struct FileHeader {
  std::optional<InputFormat> format = {};  // none: it is not known
  std::string type = {};                   // of VTK's XML files: "UnstructuredGrid", ...
  int major = 0;                           // version, of VTK's files
  int minor = 0;
};

/// Finds the format of a file by its first 64 KiB and its name. A grid of PLOT3D looks like no other format, and is not
/// known. Fails if the file cannot be read, or its version is no number.
[[nodiscard]] Result<FileHeader> read_header(const std::string& path);

/// Whether a file is a table, whatever its name is.
[[nodiscard]] bool is_table(const std::string& path);

}  // namespace splatvol
