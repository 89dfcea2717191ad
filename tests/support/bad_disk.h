// A disk that changes what was written to it.
#pragma once

#include <sys/stat.h>
#include <unistd.h>

#include <cstddef>
#include <cstdlib>
#include <filesystem>
#include <vector>

namespace splatvol::test {

/// Flips the bits of a byte in each file of this process that has no name and at least a byte. `part`: where, in [0,
/// 1). Returns the number of files. Parts of a file that were given back stay.
inline std::size_t damage_temporary_files(double part) {
  std::vector<int> descriptors;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd"))
    descriptors.push_back(std::atoi(entry.path().filename().c_str()));
  std::size_t damaged = 0;
  for (const int descriptor : descriptors) {
    struct stat status {};
    if (::fstat(descriptor, &status) != 0 || !S_ISREG(status.st_mode) || status.st_nlink > 0) continue;
    const auto at = static_cast<off_t>(part * static_cast<double>(status.st_size));
    unsigned char byte = 0;
    if (::pread(descriptor, &byte, 1, at) != 1) continue;
    byte = static_cast<unsigned char>(~byte);
    if (::pwrite(descriptor, &byte, 1, at) == 1) ++damaged;
  }
  return damaged;
}

}  // namespace splatvol::test
