// A temporary folder, and a fixture that has one.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <system_error>
#include <vector>

#include "tests/support/require.h"

namespace splatvol::test {

/// An empty folder with a name of its own, which ends with its object.
class TempFolder {
 public:
  TempFolder() {
    std::string pattern = (std::filesystem::temp_directory_path() / "splatvol-XXXXXX").string();
    require(::mkdtemp(pattern.data()) != nullptr, pattern);
    folder_ = pattern + "/";
  }
  ~TempFolder() {
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }
  TempFolder(const TempFolder&) = delete;
  TempFolder& operator=(const TempFolder&) = delete;

  /// Returns the path of a file in the folder. Without a name: of the folder, with a slash at its end.
  [[nodiscard]] std::string path(const std::string& name = "") const { return folder_ + name; }

  /// Writes a file, and the folders that it lies in. Returns its path.
  std::string write(const std::string& name, const std::string& bytes) const {
    std::filesystem::create_directories(std::filesystem::path(path(name)).parent_path());
    // A new file each time: file systems sync one that is overwritten.
    std::filesystem::remove(path(name));
    std::ofstream(path(name), std::ios::binary) << bytes;
    return path(name);
  }

  /// Returns the bytes of a file; of one that is not there, none.
  [[nodiscard]] std::string read(const std::string& name) const {
    std::ifstream file(path(name), std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }

  /// Returns the names of the files and folders in it, sorted.
  [[nodiscard]] std::vector<std::string> names() const {
    std::vector<std::string> all;
    for (const auto& entry : std::filesystem::directory_iterator(folder_)) all.push_back(entry.path().filename());
    std::ranges::sort(all);
    return all;
  }

 protected:
  std::string folder_;  // ends in "/"
};

/// Gives each test a folder, which ends with it.
class FolderTest : public testing::Test, protected TempFolder {};

}  // namespace splatvol::test
