// The error of our own readers.
#pragma once

#include <stdexcept>

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

}  // namespace splatvol
