// The data sets of several files, in the order of the files.
#pragma once

#include <memory>
#include <vector>

#include "builder/sources/data_sets.h"

namespace splatvol {

/// Reads files in their order. Their data sets come one by one, each read by the next() that returns it. Readers skip
/// the arrays that `options.selection` does not need. Errors come from next().
[[nodiscard]] std::unique_ptr<DataSets> read_files(std::vector<InputFile> files, const SourceOptions& options);

}  // namespace splatvol
