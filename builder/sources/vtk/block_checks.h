// Guards for VTK's readers of Exodus, EnSight and CGNS, which print, hang or end the program if a file is damaged.
#pragma once

#include <optional>
#include <vector>

#include "builder/sources/vtk/data_sets.h"
#include "builder/sources/vtk/ensight_checks.h"

namespace splatvol {

/// Fails if a file is not of its kind at all, or if it is cut off (builder/sources/vtk/netcdf_checks.h). Passes other
/// kinds. Safe on untrusted bytes.
[[nodiscard]] Status check_blocks(const VtkFile& file);

/// Parts of a case that VTK's reader misreads, and what may be wrong.
struct CaseDoubts {
  EnsightFindings findings = {};
  bool open_end = false;  // the case file ends with a digit: a number may be cut off
};

/// Checks the case file of EnSight, and the files of its step at `time`, as check_ensight_files does. Fails also if the
/// case file has lines on which VTK 9.1 never ends: unknown sections, entries that are cut off, or names in quotation
/// marks. Passes other kinds. Safe on untrusted bytes.
[[nodiscard]] Result<CaseDoubts> check_case_files(const VtkFile& file, std::optional<double> time);

/// Fails if a case of EnSight declares more time steps than VTK's reader has found. Passes other kinds.
[[nodiscard]] Status check_steps(const VtkFile& file, std::size_t found);

/// Lists the variables of an EnSight case, but complex ones, which have two files. Fails if the case cannot be read.
[[nodiscard]] Result<std::vector<ArrayShape>> ensight_arrays(const std::string& path);

}  // namespace splatvol
