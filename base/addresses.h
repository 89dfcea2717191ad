// Files by their paths or addresses.
#pragma once

#include <memory>
#include <string>

#include "base/error.h"
#include "base/file.h"

namespace splatvol {

/// Opens the file at an address (is_url): over HTTP (base/http_source.h) or ssh (base/sftp_source.h). Else opens the
/// file of this name. Refuses a mesh on a server, by its name.
[[nodiscard]] Result<std::unique_ptr<ByteSource>> open_file_or_url(const std::string& path_or_url);

}  // namespace splatvol
