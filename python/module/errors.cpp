#include "python/module/errors.h"

#include <nanobind/nanobind.h>

namespace splatvol::python {
namespace {

namespace nb = nanobind;

const char* exception_name(ErrorCode code) {
  switch (code) {
    case ErrorCode::io:
      return "FileError";
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
  }
  return "Error";
}

}  // namespace

void raise(const Error& error) {
  const nb::object type = nb::module_::import_("splatvol.errors").attr(exception_name(error.code));
  // Messages quote names of files, whose bytes are anything.
  PyObject* message =
      PyUnicode_DecodeUTF8(error.message.data(), static_cast<Py_ssize_t>(error.message.size()), "backslashreplace");
  if (message != nullptr) PyErr_SetObject(type.ptr(), nb::steal(message).ptr());
  throw nb::python_error();
}

}  // namespace splatvol::python
