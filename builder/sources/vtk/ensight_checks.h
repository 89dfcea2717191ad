// A check of the files of an EnSight case before VTK's reader sees them: it takes what a file lacks for values.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "builder/sources/vtk/ensight_case.h"

namespace splatvol {

/// Values of a variable that VTK's reader reads wrongly, or not at all.
struct EnsightGaps {
  /// A value that its text file has stars for: VTK's reader gives 0.
  struct Gap {
    std::size_t part;  // in the order of the geometry
    std::size_t component;
    std::uint64_t index;  // of the point or cell in the part
  };
  std::string variable;
  bool per_element;
  std::size_t components;  // of a value
  std::vector<Gap> gaps;

  /// All values of cells, of each part: [cell][component], in VTK's order of components. VTK's reader fails at values
  /// of ghosts, so they are read here; empty if there are no ghosts.
  std::map<std::size_t, std::vector<float>> values = {};
};

struct EnsightFindings {
  std::vector<EnsightGaps> gaps;
  std::map<std::size_t, std::uint64_t> ghosts;  // parts that have some, and how many. VTK's reader leaves them out
};

/// Walks through the geometry and all variables of a case at a time step, text or binary. Fails if a file ends before
/// an array or a time step that it declares does, or a variable has values for a part that the geometry lacks. Fails
/// also at a word of a text file that is no number; values that are stars, or "1.#IND", are returned instead. Says
/// nothing about files that are not there. Behind something unknown, and in the older format EnSight 6, it only refuses
/// lines of numbers with stars and commas. It refuses rectilinear and uniform blocks of EnSight 6. Safe on untrusted
/// files.
///
/// A file of values may lack parts. One that is cut right before a part is whole by the rules of the format: then the
/// part has no values.
///
/// `path`: of the case. `time`: the one asked for; without it, the last.
[[nodiscard]] Result<EnsightFindings> check_ensight_files(const std::string& path, const EnsightCase& files,
                                                          std::optional<double> time);

}  // namespace splatvol
