// The one error type of the project. Libraries return it; only tools print it.
#pragma once

#include <fmt/format.h>

#include <string>
#include <tl/expected.hpp>
#include <utility>

namespace splatvol {

enum class ErrorCode {
  io,                // the system refused: open, read, write, rename
  invalid_data,      // the bytes break a rule of their format
  unsupported,       // well-formed, but this version does not handle it
  invalid_argument,  // the caller asked for what cannot be
  out_of_budget,     // would not fit into the memory that was granted
  device,            // OpenGL or EGL failed
};

/// What went wrong, as one line that names the rule that was broken and where.
struct Error {
  ErrorCode code;
  std::string message;
};

template <class T>
using Result = tl::expected<T, Error>;
using Status = Result<void>;

/// Returns a failure to be returned from a function with a Result: `return fail(ErrorCode::io, "...", ...)`.
template <class... Args>
[[nodiscard]] tl::unexpected<Error> fail(ErrorCode code, fmt::format_string<Args...> format, Args&&... args) {
  return tl::unexpected<Error>(Error{code, fmt::format(format, std::forward<Args>(args)...)});
}

/// Passes an error on with the place prefixed: "mesh.vtu: not XML".
[[nodiscard]] inline tl::unexpected<Error> fail_in(const std::string& where, const Error& error) {
  return tl::unexpected<Error>(Error{error.code, where + ": " + error.message});
}

// Early return of errors. The statement form needs no value; the other declares `name` from the value.
#define SPLATVOL_TRY(expression)                                                                                   \
  do {                                                                                                             \
    if (auto try_result = (expression); !try_result) return tl::unexpected<::splatvol::Error>(try_result.error()); \
  } while (false)
#define SPLATVOL_TRY_ASSIGN(name, expression)                                          \
  auto name##_result = (expression);                                                   \
  if (!name##_result) return tl::unexpected<::splatvol::Error>(name##_result.error()); \
  auto name = std::move(*name##_result)

}  // namespace splatvol
