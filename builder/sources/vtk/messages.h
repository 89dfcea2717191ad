// VTK's messages as errors.
#pragma once

#include <functional>
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

/// Runs `call` while VTK prints nothing. The first error that VTK reports, or an exception, becomes an Error of one
/// line that begins with `path`. Names of VTK's classes, addresses and source files are left out. Not thread-safe: VTK
/// has one window for messages in the whole process.
[[nodiscard]] Status run_vtk(const std::string& path, const std::function<void()>& call);

}  // namespace splatvol
