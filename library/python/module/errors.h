// Errors of the library as exceptions of Python.
#pragma once

#include <utility>

#include "splatvol/error.h"

namespace splatvol::python {

/// Throws the exception of splatvol.errors that fits the error's code. Needs the GIL.
[[noreturn]] void raise(const Error& error);

/// Returns the value of a result. Throws if there is none. Needs the GIL.
template <class T>
T value_of(Result<T> result) {
  if (!result) raise(result.error());
  if constexpr (!std::is_void_v<T>) return std::move(*result);
}

}  // namespace splatvol::python
