// Scattered points from NumPy's .npy files.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "builder/sources/array_union.h"
#include "builder/sources/source.h"

namespace splatvol {

/// Opens tables of points as one point set: rows in order, files in order.
///
/// A file holds an array of N x (3 + k) floats or integers, in C or Fortran order, big or little endian, or N rows of a
/// structured type. `columns` names the columns in order, also those of a structured type. The columns x, y and z are
/// the positions and are required, "_" skips a column, and every other column is an attribute. By default a structured
/// type keeps its own names, without its fields that are no numbers. The columns of other arrays are called x, y, z and
/// "value" by default, or "value0", "value1", ... if several follow z.
///
/// The attributes are those of all files; a file that lacks one has missing values there. Number types and order may
/// differ. Files without names of columns need equally many. Memory holds two pieces and the
/// bytes of one, at most 16 MiB. Fails as open_source; safe on untrusted files. `paths` must not be empty.
[[nodiscard]] Result<std::unique_ptr<Source>> open_npy_files(const std::vector<std::string>& paths,
                                                             const SourceOptions& options);

/// Lists the columns that are attributes, by the headers of the files. Fails as open_npy_files.
[[nodiscard]] Result<std::vector<ArrayShape>> list_npy_arrays(const std::vector<std::string>& paths,
                                                              const SourceOptions& options);

}  // namespace splatvol
