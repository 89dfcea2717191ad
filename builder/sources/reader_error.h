// Errors of readers that throw.
#pragma once

#include <exception>
#include <functional>
#include <optional>
#include <stdexcept>
#include <string>

#include "base/error.h"

namespace splatvol {

/// An error that a reader of ours throws: its text is for users.
class ReaderError : public std::runtime_error {
 public:
  template <class... Args>
  explicit ReaderError(fmt::format_string<Args...> text, const Args&... args)
      : std::runtime_error(
            formatted_failure(ErrorCode::invalid_data, text, fmt::make_format_args(args...)).value().message) {}
};

/// Says what a ReaderError does, or a lack of memory; empty for other exceptions.
[[nodiscard]] std::optional<std::string> describe_exception(const std::exception& exception);

/// Runs `call`. An exception becomes an Error of one line that begins with `path`.
[[nodiscard]] Status run_reader(const std::string& path, const std::function<void()>& call);

}  // namespace splatvol
