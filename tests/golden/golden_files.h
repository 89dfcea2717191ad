// The golden files, and the lines of the texts beside them.
#pragma once

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

namespace splatvol::test {

inline std::vector<std::filesystem::path> golden_files() {
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(SPLATVOL_GOLDEN))
    if (entry.path().extension() == ".svol") files.push_back(entry.path());
  std::ranges::sort(files);
  return files;
}

inline std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  for (std::size_t begin = 0; begin < text.size();) {
    const std::size_t end = std::min(text.find('\n', begin), text.size());
    lines.push_back(text.substr(begin, end - begin));
    begin = end + 1;
  }
  return lines;
}

}  // namespace splatvol::test
