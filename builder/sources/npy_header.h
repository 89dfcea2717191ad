// What a .npy file holds, by its header: NumPy's format versions 1.0 to 3.0.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"
#include "base/file.h"

namespace splatvol {

/// The first bytes of every .npy file.
inline constexpr std::string_view npy_magic = "\x93NUMPY";

/// One number of every row.
struct NpyColumn {
  enum class Kind : char { real = 'f', integer = 'i', natural = 'u', other = 0 };
  std::string name;         // of a structured type's field, which may be empty
  Kind kind = Kind::other;  // other: nothing that is read as a number
  std::uint32_t bytes = 0;  // of a number: 4 or 8 (real), 1, 2, 4, 8 (integer, natural)
  bool big_endian = false;
  std::uint64_t offset = 0;  // of the first row's number, bytes from the file's start
};

/// A table: two dimensions of numbers, or one of a structured type.
struct NpyTable {
  std::vector<NpyColumn> columns;
  std::uint64_t rows = 0;
  std::uint64_t stride = 0;    // bytes from a column's number to that of the next row
  std::uint64_t data = 0;      // offset of the first row
  bool structured = false;     // columns have names
  bool columns_apart = false;  // Fortran order: one column after the other
};

/// Reads the header and holds it against the file's size. Fails where it is damaged or of a newer version, the file is
/// too short or too long for it, or the array is no such table, has more than 4096 columns or rows of more than 1 MiB.
/// Safe on untrusted files: allocates no more than some multiple of the header's bytes, which are at most 1 MiB.
[[nodiscard]] Result<NpyTable> read_npy_header(ByteSource& file);

}  // namespace splatvol
