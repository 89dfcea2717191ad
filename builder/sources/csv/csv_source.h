// Scattered points from .csv files.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "builder/sources/array_union.h"
#include "builder/sources/source.h"

namespace splatvol {

/// Opens .csv files as one point set: lines in order, files in order (builder/sources/csv/csv_table.h tells the
/// columns). Fields stand between commas, semicolons or tabs. An empty field, or "nan", is a missing value.
///
/// The attributes are those of all files; a file that lacks one has missing values there. A line of another width, or
/// with a text where the first line of values has a number, is an error that names it. Memory holds two pieces, and the
/// 2 MiB of text of one. Fails as open_source; safe on untrusted files. `paths` must not be empty.
[[nodiscard]] Result<std::unique_ptr<Source>> open_csv_files(const std::vector<std::string>& paths,
                                                             const SourceOptions& options);

/// Lists the columns that are attributes, by the headings of the files. Fails as open_csv_files.
[[nodiscard]] Result<std::vector<ArrayShape>> list_csv_arrays(const std::vector<std::string>& paths,
                                                              const SourceOptions& options);

}  // namespace splatvol
