// VTK's messages as errors.
#pragma once

#include <functional>
#include <string>

#include "base/error.h"
#include "builder/sources/reader_error.h"

namespace splatvol {

/// Runs `call` while VTK prints nothing. The first error that VTK reports, or an exception, becomes an Error of one
/// line that begins with `path`. Names of VTK's classes, addresses and source files are left out. Not thread-safe: VTK
/// has one window for messages in the whole process.
[[nodiscard]] Status run_vtk(const std::string& path, const std::function<void()>& call);

}  // namespace splatvol
