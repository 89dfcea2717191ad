// Tables as CSV (RFC 4180).
#pragma once

#include <cstddef>
#include <functional>
#include <map>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/file.h"

namespace splatvol {

/// Writes the names of columns: usual ones, then attributes. A usual name that an attribute has gives way to it:
/// `renamed` gets its name in the table.
[[nodiscard]] Status write_csv_header(AtomicFile& file, const std::vector<std::string>& usual,
                                      std::span<const std::string> attributes,
                                      std::map<std::string, std::string>& renamed);

/// Writes rows: numbers_of(row, numbers) sets the numbers of each. They read back to the same bits.
[[nodiscard]] Status write_csv_rows(AtomicFile& file, std::size_t rows,
                                    const std::function<void(std::size_t, std::vector<double>&)>& numbers_of);

}  // namespace splatvol
