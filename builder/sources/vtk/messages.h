// What VTK would print becomes an Error.
#pragma once

#include <functional>
#include <string>

#include "base/error.h"

namespace splatvol {

/// Runs `call` with VTK kept silent; what it reports or throws becomes an Error that begins with `path`. VTK has one
/// window for its messages in the whole process: not thread-safe.
[[nodiscard]] Status run_vtk(const std::string& path, const std::function<void()>& call);

/// While it lives, nothing that the process writes to stderr appears: for libraries below VTK that print whatever they
/// are told. Not thread-safe.
class QuietStderr {
 public:
  QuietStderr();
  ~QuietStderr();
  QuietStderr(const QuietStderr&) = delete;
  QuietStderr& operator=(const QuietStderr&) = delete;

 private:
  int saved_;  // negative: could not be silenced
};

}  // namespace splatvol
