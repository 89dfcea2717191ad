// A check of the files of an EnSight case before VTK's reader sees them: it takes what a file lacks for values.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "base/error.h"
#include "builder/sources/ensight/ensight_case.h"
#include "builder/sources/source.h"

namespace splatvol {

/// The values of a variable.
struct EnsightValues {
  /// A value that its text file has stars for: VTK's reader gives 0.
  struct Gap {
    std::size_t part;  // in the order of the geometry
    std::size_t component;
    std::uint64_t index;  // of the point or cell in the part
  };
  std::string variable;
  bool per_element;
  std::optional<std::size_t> complex_part;  // as in EnsightFiles
  std::size_t components;                   // of a value
  std::vector<Gap> gaps = {};

  std::set<std::size_t> parts = {};  // that the file has values of

  /// All values of each part: [point or cell][component], in VTK's order of components. Cells without ghosts.
  std::map<std::size_t, std::vector<float>> of_parts = {};
};

struct EnsightFindings {
  std::vector<EnsightValues> variables;         // those that can be followed
  std::map<std::size_t, std::uint64_t> ghosts;  // parts that have some, and how many. VTK's reader leaves them out
  std::vector<std::uint64_t> part_numbers;      // in the order of the geometry; empty if that cannot be followed

  /// Set if all is known: then `variables` have the values, and VTK's reader is needed for this geometry only.
  std::optional<EnsightFile> geometry;
  bool is_binary = false;
};

/// Walks through the geometry and all variables of a case at a time step, text or binary. Fails if a file ends before
/// an array or a time step that it declares does, or a variable has values for a part that the geometry lacks. Fails
/// also at a word of a text file that is no number; values that are stars, or "1.#IND", are returned instead. Says
/// nothing about files that are not there. Behind something unknown, and in the older format EnSight 6, it only refuses
/// lines of numbers with stars and commas. It refuses rectilinear and uniform blocks of EnSight 6. Safe on untrusted
/// files.
///
/// A file of values may lack parts. One that is cut right before a part is whole by the rules of the format: then the
/// part has no values. A variable that begins after the time has no values at all.
///
/// Reads the values too, of the variables that the options select, if all of them can be followed: VTK 9.1 loses those
/// behind a part without points and of other time sets, fails at ghosts, and does not end at some sets of files.
///
/// `path`: of the case.
[[nodiscard]] Result<EnsightFindings> check_ensight_files(const std::string& path, const EnsightCase& files,
                                                          const SourceOptions& options);

}  // namespace splatvol
