// Checks of the sizes that the headers of NetCDF, HDF5 and ADF files state.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "base/error.h"

namespace splatvol {

/// Whether a file begins like HDF5.
[[nodiscard]] inline bool is_hdf5(std::string_view start) { return start.starts_with("\x89HDF\r\n\x1a\n"); }

/// Whether a file begins like one of NetCDF's own formats, which Exodus uses.
[[nodiscard]] inline bool is_netcdf(std::string_view start) {
  return start.size() > 3 && start.starts_with("CDF") && (start[3] == 1 || start[3] == 2 || start[3] == 5);
}

/// Fails if the file at `path` ends before one of its variables does (NetCDF's own format, versions 1, 2 and 5), or
/// before the end that it states (HDF5, and ADF of CGNS). Says nothing about other files. Safe on untrusted files.
[[nodiscard]] Status check_file_end(const std::string& path);

/// Counts the records of a file in NetCDF's own format by its size, if its header leaves their number open, as that of
/// a stream does. Empty for all other files. Safe on untrusted files.
[[nodiscard]] Result<std::optional<std::uint64_t>> count_open_records(const std::string& path);

}  // namespace splatvol
