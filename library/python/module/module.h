// The parts of the module splatvol._core. Contracts are in the package's Python sources, which alone call it.
#pragma once

#include <nanobind/nanobind.h>

namespace splatvol::python {

void add_build(nanobind::module_& module);
void add_conversion(nanobind::module_& module);
void add_file(nanobind::module_& module);
void add_pictures(nanobind::module_& module);
void add_renderer(nanobind::module_& module);

}  // namespace splatvol::python
