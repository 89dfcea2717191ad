// Checks of the sizes that the headers of NetCDF, HDF5 and ADF files state.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "base/error.h"

namespace splatvol {

/// Fails if the file at `path` ends before one of its variables does (NetCDF's own format, versions 1, 2 and 5), or
/// before the end that it states (HDF5, and ADF of CGNS). Says nothing about other files. Safe on untrusted files.
[[nodiscard]] Status check_file_end(const std::string& path);

/// Counts the records of a file in NetCDF's own format by its size, if its header leaves their number open, as that of
/// a stream does. Empty for all other files. Safe on untrusted files.
[[nodiscard]] Result<std::optional<std::uint64_t>> count_open_records(const std::string& path);

}  // namespace splatvol
