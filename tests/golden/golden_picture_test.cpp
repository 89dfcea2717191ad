// Pictures of the golden files (golden_test.cpp).
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "base/file.h"
#include "renderer/cpu/tile_rasterizer.h"
#include "tests/golden/golden_files.h"
#include "tests/golden/golden_picture.h"
#include "tests/support/results.h"
#include "tests/support/sanitizers.h"

namespace splatvol::test {
namespace {

/// Returns the numbers of a picture's text, with the lines of words between them.
std::vector<std::string> words_of(const std::string& text) {
  std::vector<std::string> words;
  for (const std::string& line : lines_of(text)) {
    if (line == "splats" || line == "cells")
      words.push_back(line);
    else
      for (std::size_t at = 0; at < line.size(); at += 4) words.push_back(line.substr(at, 4));
  }
  return words;
}

// Whether the rasterizers have no AVX-512 here.
bool has_narrow_vectors() {
  const std::string device = TileRasterizer(KernelKind::moments).description();
  return device.find("AVX3") == std::string::npos;
}

TEST(Golden, EachFileIsDrawnAsBefore) {
  for (const std::filesystem::path& path : golden_files()) {
    SCOPED_TRACE(path);
    const auto picture = value_of(golden_picture(path, value_of(golden_scene(path))));
    std::filesystem::path beside = path;
    const auto stored = value_of(read_text_file(beside.replace_extension(".picture")));
    const std::vector<std::string> now = words_of(picture), then = words_of(stored);
    ASSERT_EQ(now.size(), then.size()) << path;
    // 1e-4 by the instruction set of the stored pictures. Others, and clang's code with sanitizers, round otherwise.
    const int most = is_sanitized || has_narrow_vectors() ? 66 : 7;
    for (std::size_t i = 0; i < now.size(); ++i) {
      if (now[i] == then[i]) continue;
      ASSERT_LE(std::abs(std::stoi(now[i], nullptr, 16) - std::stoi(then[i], nullptr, 16)), most)
          << path << ", number " << i;
    }
  }
}

}  // namespace
}  // namespace splatvol::test
