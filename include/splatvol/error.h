// The error type of the project. Libraries return errors; they never print, never exit, and let no exception out.
#pragma once

#include <string>
#include <tl/expected.hpp>

namespace splatvol {

enum class ErrorCode {
  io,                // the system refused: open, read, write, rename
  invalid_data,      // the bytes break a rule of their format
  unsupported,       // well-formed, but this version does not handle it
  invalid_argument,  // the caller asked for something that is not possible
  out_of_budget,     // it would not fit into the granted memory
  device,            // OpenGL or EGL failed
  cancelled,         // the caller changed its mind
  pending,           // bytes have not come yet, and no read waits: the same again will do later
};

/// A failure. Its message is one line, which names the file and the broken rule.
struct Error {
  ErrorCode code;
  std::string message;
};

/// A value, or the reason why there is none.
template <class T>
using Result = tl::expected<T, Error>;
using Status = Result<void>;

}  // namespace splatvol
