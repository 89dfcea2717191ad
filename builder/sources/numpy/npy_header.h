// The headers of .npy files: NumPy's format versions 1.0 to 3.0.
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

/// A column of a table: one number of every row.
struct NpyColumn {
  enum class Kind : char { real = 'f', integer = 'i', natural = 'u', other = 0 };
  std::string name;         // of a structured type's field; may be empty
  Kind kind = Kind::other;  // other: not read as a number
  std::uint32_t bytes = 0;  // of a number: 4 or 8 (real), 1, 2, 4, 8 (integer, natural)
  bool big_endian = false;
  std::uint64_t offset = 0;  // of the first row's number in the file
};

/// A table: an array of numbers with two dimensions, or of a structured type with one.
struct NpyTable {
  std::vector<NpyColumn> columns;
  std::uint64_t rows = 0;
  std::uint64_t stride = 0;  // bytes between a column's numbers in two successive rows
  std::uint64_t data_offset = 0;
  bool structured = false;     // the columns have names
  bool columns_apart = false;  // Fortran order: one column after the other
};

/// Reads the header and compares it with the file's size. Fails if the header is damaged or of a newer version, if the
/// array is no such table, or if the file's size differs from the table's. A table has at most 4096 columns, and 1 MiB
/// in a row. Safe on untrusted files: allocates at most a small multiple of the header's bytes, which are at most 1
/// MiB.
[[nodiscard]] Result<NpyTable> read_npy_header(ByteSource& file);

/// Whether an array is more likely one with a row for each column: it has few rows, and far more columns.
[[nodiscard]] bool is_transposed(std::uint64_t rows, std::uint64_t columns);
[[nodiscard]] tl::unexpected<Error> fail_transposed(const std::string& path, std::uint64_t rows, std::uint64_t columns);

}  // namespace splatvol
