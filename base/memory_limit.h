// The memory that this process may use.
#pragma once

#include <cstdint>
#include <string>

namespace splatvol {

/// Returns the bytes that this process may use: the smallest of the machine's memory, its own limits (ulimit -v, -d),
/// and the limits of its control group and all groups above, version 1 or 2. Ignores limits that cannot be read. `root`
/// is put in front of /proc and /sys.
[[nodiscard]] std::uint64_t memory_limit(const std::string& root = "");

/// Whether this process could take so many bytes more now, within its limit of address space (ulimit -v).
[[nodiscard]] bool is_addressable(std::uint64_t bytes);

}  // namespace splatvol
