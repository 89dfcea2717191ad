#include "library/python/module/errors.h"

#include <nanobind/nanobind.h>

#include <cerrno>
#include <cstring>

#include "library/python/module/text.h"

namespace splatvol::python {
namespace {

namespace nb = nanobind;

const char* exception_name(const Error& error) {
  switch (error.code) {
    case ErrorCode::io:
      // The system's own words end the message (base/descriptor.h).
      return error.message.ends_with(std::strerror(ENOENT)) ? "MissingFileError" : "FileError";
    case ErrorCode::invalid_data:
      return "InvalidDataError";
    case ErrorCode::unsupported:
      return "UnsupportedError";
    case ErrorCode::invalid_argument:
      return "InvalidArgumentError";
    case ErrorCode::out_of_budget:
      return "OutOfBudgetError";
    case ErrorCode::device:
      return "DeviceError";
    case ErrorCode::cancelled:
      return "CancelledError";
    case ErrorCode::pending:  // no file of the library
      break;
  }
  return "Error";
}

}  // namespace

void raise(const Error& error) {
  const nb::object type = nb::module_::import_("splatvol.errors").attr(exception_name(error));
  PyErr_SetObject(type.ptr(), text_of(error.message).ptr());
  throw nb::python_error();
}

}  // namespace splatvol::python
