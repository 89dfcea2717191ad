// Names of files, whose bytes are anything.
#pragma once

#include <nanobind/nanobind.h>

#include <string>

namespace splatvol::python {

/// Returns the name of a file, which the package hands over as os.fsencode gives it.
inline std::string path_of(const nanobind::bytes& path) { return {path.c_str(), path.size()}; }

/// Returns text for people: bytes that are no UTF-8 are written as \xNN.
inline nanobind::str text_of(const std::string& text) {
  PyObject* decoded = PyUnicode_DecodeUTF8(text.data(), static_cast<Py_ssize_t>(text.size()), "backslashreplace");
  if (decoded == nullptr) throw nanobind::python_error();
  return nanobind::steal<nanobind::str>(decoded);
}

}  // namespace splatvol::python
