// Pictures of the golden files (golden_test.cpp).
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "base/file.h"
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

TEST(Golden, EachFileIsDrawnAsBefore) {
  for (const std::filesystem::path& path : golden_files()) {
    SCOPED_TRACE(path);
    const auto picture = value_of(golden_picture(path, value_of(golden_scene(path))));
    std::filesystem::path beside = path;
    const auto stored = value_of(read_text_file(beside.replace_extension(".picture")));
    const std::vector<std::string> now = words_of(picture), then = words_of(stored);
    ASSERT_EQ(now.size(), then.size()) << path;
    // 2e-4, as the stored pictures are by AVX-512, and AVX2 rounds otherwise; 1e-3 with sanitizers: that code is
    // clang's, for one instruction set.
    constexpr int most = is_sanitized ? 66 : 13;
    for (std::size_t i = 0; i < now.size(); ++i) {
      if (now[i] == then[i]) continue;
      ASSERT_LE(std::abs(std::stoi(now[i], nullptr, 16) - std::stoi(then[i], nullptr, 16)), most)
          << path << ", number " << i;
    }
  }
}

}  // namespace
}  // namespace splatvol::test
