// Checks that the grids of an OpenVDB file lie within it.
#pragma once

#include "base/error.h"
#include "base/file.h"

namespace splatvol {

/// Checks that grids and metadata end within the file, because OpenVDB allocates the sizes that a file declares. Checks
/// file version 222 (2013) and later; older files pass. Fails if the file is newer than this OpenVDB, which would only
/// warn. Safe on untrusted files.
[[nodiscard]] Status check_vdb_header(ByteSource& file);

}  // namespace splatvol
