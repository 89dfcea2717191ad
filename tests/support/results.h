// What tests expect of results: their value, or their error.
#pragma once

#include <gmock/gmock.h>

#include <source_location>
#include <stdexcept>
#include <string>
#include <utility>

#include "base/error.h"

namespace splatvol::test {

/// Returns the value of a result. If it has none, reports its error at the caller's line, and ends the test by an
/// exception.
template <class T>
[[nodiscard]] T value_of(Result<T> result, std::source_location where = std::source_location::current()) {
  if (!result) {
    ADD_FAILURE_AT(where.file_name(), static_cast<int>(where.line())) << result.error().message;
    throw std::runtime_error("without a value the test cannot go on");
  }
  return std::move(*result);
}

/// Returns the message of an error of a result or status, or an empty text.
template <class T>
[[nodiscard]] std::string message_of(const tl::expected<T, Error>& result) {
  return result ? std::string() : result.error().message;
}

/// Matches a result or status that has an error of this code.
MATCHER_P(FailsWith, code, "fails with that code") { return !arg && arg.error().code == code; }

/// Matches a result or status that has an error of this code, and whose message matches.
MATCHER_P2(FailsWith, code, message, "fails with that code and message") {
  return !arg && arg.error().code == code &&
         ::testing::ExplainMatchResult(message, arg.error().message, result_listener);
}

}  // namespace splatvol::test
