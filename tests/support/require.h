// What all tests of a suite need.
#pragma once

#include <cstdio>
#include <cstdlib>
#include <string>

namespace splatvol::test {

/// Ends the program with exit code 1 unless `holds`. For SetUpTestSuite: without what it makes, no
/// test of the suite means anything.
inline void require(bool holds, const std::string& message) {
  if (holds) return;
  std::fprintf(stderr, "the tests cannot be set up: %s\n", message.c_str());
  std::_Exit(1);
}

/// The same for a result or status.
template <class Result>
void require(const Result& result) {
  require(static_cast<bool>(result), result ? std::string() : result.error().message);
}

}  // namespace splatvol::test
