// A check of the files of an EnSight Gold case before VTK's reader sees them: it takes what a file lacks for values.
#pragma once

#include <optional>
#include <string>

#include "base/error.h"
#include "builder/sources/vtk/ensight_case.h"

namespace splatvol {

/// Walks through the geometry and all variables of a case at a time step, text or binary. Fails if a file ends before
/// an array or a time step that it declares does, or a variable has values for a part that the geometry lacks. Says
/// nothing about files that are not there, nor about what follows something unknown. For the older format EnSight 6,
/// it refuses rectilinear and uniform blocks, and checks nothing else. Safe on untrusted files.
///
/// A file of values may lack parts. One that is cut right before a part is whole by the rules of the format: then the
/// part has no values.
///
/// `path`: of the case. `time`: the one asked for; without it, the last.
[[nodiscard]] Status check_ensight_files(const std::string& path, const EnsightCase& files, std::optional<double> time);

}  // namespace splatvol
