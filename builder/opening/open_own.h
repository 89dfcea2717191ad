// Opens inputs of the formats that the project reads by itself.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "builder/sources/array_union.h"
#include "builder/sources/process/reader_process.h"
#include "builder/sources/source.h"

namespace splatvol {

/// Opens generated inputs, .npy and .csv files. Contract as open_source. Returns a null pointer if the input has
/// another format, which a library reads. Safe on untrusted files.
[[nodiscard]] Result<std::unique_ptr<Source>> open_own(const std::vector<std::string>& inputs,
                                                       const SourceOptions& options);

/// Opens an input of any format, those of other formats in the reader's process. Contract as open_source. Safe on
/// untrusted files.
[[nodiscard]] Result<std::unique_ptr<Source>> open_safely(ReaderProcess& reader, const std::vector<std::string>& inputs,
                                                          const SourceOptions& options);

/// As list_arrays (builder/opening/open_source.h), for the inputs that open_own opens; none for others, and for
/// generated ones.
[[nodiscard]] Result<std::optional<std::vector<ArrayShape>>> list_own_arrays(const std::vector<std::string>& inputs,
                                                                             const SourceOptions& options);

/// As list_arrays (builder/opening/open_source.h), those of other formats in the reader's process.
[[nodiscard]] Result<std::optional<std::vector<ArrayShape>>> list_safely(ReaderProcess& reader,
                                                                         const std::vector<std::string>& inputs,
                                                                         const SourceOptions& options);

/// The failure of an input whose cells cannot be points.
[[nodiscard]] tl::unexpected<Error> fail_no_cells(const std::string& input);

}  // namespace splatvol
