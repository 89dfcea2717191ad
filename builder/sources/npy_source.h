// Scattered points from NumPy's .npy files.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "builder/sources/source.h"

namespace splatvol {

/// Opens tables of points as one point set, rows in order, files in order.
///
/// A file holds an array of N x (3 + k) floats or integers, in C or Fortran order, big or little endian, or N rows of a
/// structured type. `columns` names the columns in order, those of a structured type anew: x, y, z are the positions
/// and must be there, "_" skips a column, every other is an attribute. By default a structured type's own names count,
/// where fields that are no numbers are skipped; else the columns are x, y, z and "value", or "value0", "value1", ...
/// where there are several more.
///
/// Every file must have the attributes of the first; number types and order may differ. Memory holds two pieces and one
/// piece's bytes, 16 MiB at most. Fails as open_source; safe on untrusted files. `paths` must not be empty.
[[nodiscard]] Result<std::unique_ptr<Source>> open_npy_files(const std::vector<std::string>& paths,
                                                             const SourceOptions& options);

}  // namespace splatvol
