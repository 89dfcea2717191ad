// VTKHDF files.
#pragma once

#include <memory>

#include "base/error.h"
#include "builder/sources/data_sets.h"

namespace splatvol {

/// Opens a VTKHDF file of version 1 or 2 that holds an unstructured grid or an image, at the time step nearest to
/// `options.time`, or without one at the last. Each partition is a data set, and is read by the next() that returns it.
/// Other types and polyhedra are not supported. VTK 9.1 has a reader too, but of version 1 and without time steps.
[[nodiscard]] Result<std::unique_ptr<DataSets>> open_vtkhdf(const InputFile& file, const SourceOptions& options);

}  // namespace splatvol
