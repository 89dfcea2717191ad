// Whether the parts of an OpenVDB file are where it says.
#pragma once

#include "base/error.h"
#include "base/file.h"

namespace splatvol {

/// Checks, of files as OpenVDB writes them since 2013 (file version 222), that grids and metadata end within the file:
/// OpenVDB allocates what they say. Older files pass unseen. Refuses files that are newer than this OpenVDB, which
/// would only warn. Safe on untrusted files.
[[nodiscard]] Status check_vdb_header(ByteSource& file);

}  // namespace splatvol
