// What programs print with --json.
#pragma once

#include <nlohmann/json.hpp>

#include "tests/support/programs.h"

namespace splatvol::test {

/// Expects that a program has succeeded. Returns the document that it has printed.
inline nlohmann::json document_of(const Outcome& outcome) {
  EXPECT_EQ(outcome.code, 0) << outcome.text;
  return nlohmann::json::parse(outcome.out, nullptr, false);
}

}  // namespace splatvol::test
