// Tests that take minutes: `ctest -L long` runs all of their cases, scripts/test a sample (tests/CMakeLists.txt, LONG).
#pragma once

#include <cstdlib>
#include <vector>

namespace splatvol::test {

/// Whether a test takes all of its cases.
inline bool is_long() {
  static const bool is_set = std::getenv("SPLATVOL_LONG") != nullptr;
  return is_set;
}

/// Returns all cases, or the first `count` of them as a sample.
template <class Case>
std::vector<Case> sample_of(std::vector<Case> cases, std::size_t count = 1) {
  if (!is_long() && count < cases.size()) cases.erase(cases.begin() + static_cast<std::ptrdiff_t>(count), cases.end());
  return cases;
}

}  // namespace splatvol::test
