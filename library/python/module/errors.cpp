#include "library/python/module/errors.h"

#include <nanobind/nanobind.h>

#include "library/python/module/text.h"

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
  PyErr_SetObject(type.ptr(), text_of(error.message).ptr());
  throw nb::python_error();
}

}  // namespace splatvol::python
