// Small files of other programs' formats, for fuzz_seeds.
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace splatvol::fuzz {

/// Returns inputs, each with the name of its fuzzer.
[[nodiscard]] std::vector<std::pair<std::string, std::string>> foreign_seeds();

}  // namespace splatvol::fuzz
