// Whether the parts of an OpenVDB file are where it says.
#pragma once

#include "base/error.h"
#include "base/file.h"

namespace splatvol {

/// Checks, of files as OpenVDB writes them since 2013 (file version 222), that grids and metadata end within the file:
/// OpenVDB takes their lengths as they come and reads on past the end. Older files pass unseen. Safe on untrusted
/// files.
[[nodiscard]] Status check_vdb_header(ByteSource& file);

}  // namespace splatvol
