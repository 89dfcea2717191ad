// Parts of files as text.
#pragma once

#include <cstdint>
#include <string>

#include "base/error.h"
#include "base/file.h"

namespace splatvol {

/// Reads `most` bytes from `offset` on, or fewer at the end of the file.
[[nodiscard]] Result<std::string> read_text(ByteSource& file, std::uint64_t offset, std::uint64_t most);

}  // namespace splatvol
