#include "library/python/module/module.h"

#include "splatvol/version.h"

NB_MODULE(_core, module) {
  // Files that are still open when Python ends are no leak.
  nanobind::set_leak_warnings(false);
  module.doc() = "The C++ part of splatvol. Use the package splatvol instead.";
  module.attr("version") = SPLATVOL_VERSION;
  splatvol::python::add_build(module);
  splatvol::python::add_conversion(module);
  splatvol::python::add_file(module);
  splatvol::python::add_pictures(module);
  splatvol::python::add_renderer(module);
}
