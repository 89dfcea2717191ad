// Files with data sets, as a Source.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "builder/sources/data_sets.h"
#include "builder/sources/source.h"

namespace splatvol {

/// Opens files as pieces of one data set. The attributes are those of all pieces: where a piece lacks one, its values
/// are missing. Reads the first piece with points for that, and the headers of all others. next() fails if a piece has
/// an array that no header announced. Contract as open_source; `files` must not be empty. `step`: the step that the
/// files are, if they are one.
[[nodiscard]] Result<std::unique_ptr<Source>> open_files(std::vector<InputFile> files, const SourceOptions& options,
                                                         const std::optional<TimeStep>& step = {},
                                                         InputLists lists = {});

}  // namespace splatvol
