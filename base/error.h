// Makes and passes on errors (splatvol/error.h). Only tools print them.
#pragma once

#include <fmt/core.h>

#include <string>
#include <utility>

#include "splatvol/error.h"

namespace splatvol {

/// Makes the failure of `fail`.
[[nodiscard]] tl::unexpected<Error> formatted_failure(ErrorCode code, fmt::string_view format,
                                                      fmt::format_args arguments);

/// Makes a failure, for a function that returns a Result: `return fail(ErrorCode::io, "...", ...)`. `?` stands for the
/// control characters of names and texts in the message.
template <class... Args>
[[nodiscard]] tl::unexpected<Error> fail(ErrorCode code, fmt::format_string<Args...> format, Args&&... args) {
  return formatted_failure(code, format, fmt::make_format_args(args...));
}

/// Passes an error on, with `where` in front of its message: "mesh.vtu: not XML".
[[nodiscard]] tl::unexpected<Error> fail_in(const std::string& where, const Error& error);

/// Whether nothing is wrong: something was not done to its end.
[[nodiscard]] inline bool is_unfinished(const Error& error) {
  return error.code == ErrorCode::cancelled || error.code == ErrorCode::pending;
}

/// Whether a result is to be tried again when bytes have come.
template <class T>
[[nodiscard]] bool is_pending(const Result<T>& result) {
  return !result && result.error().code == ErrorCode::pending;
}

// Early return of errors. The first form discards the value; the second declares `name` with it; the third assigns it.
#define SPLATVOL_TRY(expression)                                                                                   \
  do {                                                                                                             \
    if (auto try_result = (expression); !try_result) return tl::unexpected<::splatvol::Error>(try_result.error()); \
  } while (false)
#define SPLATVOL_TRY_ASSIGN(name, expression)                                          \
  auto name##_result = (expression);                                                   \
  if (!name##_result) return tl::unexpected<::splatvol::Error>(name##_result.error()); \
  auto name = std::move(*name##_result)
#define SPLATVOL_TRY_SET(variable, expression)                                     \
  do {                                                                             \
    auto try_result = (expression);                                                \
    if (!try_result) return tl::unexpected<::splatvol::Error>(try_result.error()); \
    variable = std::move(*try_result);                                             \
  } while (false)

}  // namespace splatvol
