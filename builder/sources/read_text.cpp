#include "builder/sources/read_text.h"

#include <algorithm>
#include <span>

namespace splatvol {

Result<std::string> read_text(ByteSource& file, std::uint64_t offset, std::uint64_t most) {
  offset = std::min(offset, file.size());
  std::string text(std::min(most, file.size() - offset), '\0');
  SPLATVOL_TRY(file.read(offset, std::as_writable_bytes(std::span(text))));
  return text;
}

}  // namespace splatvol
