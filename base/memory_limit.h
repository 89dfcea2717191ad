// The memory that this process may use.
#pragma once

#include <cstdint>
#include <limits>
#include <string>

namespace splatvol {

/// Returns the bytes that this process may use: the smallest of the machine's memory, what its own limits (ulimit -v,
/// -d) leave beside the program and its libraries, and the limits of its control group and all groups above, version 1
/// or 2. Ignores limits that cannot be read. `root` is put in front of /proc and /sys.
[[nodiscard]] std::uint64_t memory_limit(const std::string& root = "");

/// Returns the address space that this process may still take under its limit (ulimit -v).
[[nodiscard]] std::uint64_t free_address_space();
inline constexpr std::uint64_t unlimited_address_space = std::numeric_limits<std::uint64_t>::max();

/// Whether this process could take so many bytes more now, within its limit of address space (ulimit -v).
[[nodiscard]] bool is_addressable(std::uint64_t bytes);

}  // namespace splatvol
