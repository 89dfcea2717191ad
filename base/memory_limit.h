// How much memory there is for this process.
#pragma once

#include <cstdint>
#include <string>

namespace splatvol {

/// Bytes that this process may use: the least of the machine's memory and of the limits of its control group and all
/// groups above it, of version 1 or 2. What cannot be read is no limit. `root` stands before /proc and /sys.
[[nodiscard]] std::uint64_t memory_limit(const std::string& root = "");

}  // namespace splatvol
