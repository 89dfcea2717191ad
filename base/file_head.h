// The first bytes of a file on a server, which most readers ask for first.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "base/file.h"

namespace splatvol {

/// Bytes of a file that are kept from its beginning on.
class FileHead {
 public:
  /// A reader of .svol files asks for at least these first, so opening costs no extra request.
  static constexpr std::size_t usual_bytes = 32u << 10;

  void keep(std::vector<std::byte> bytes) { bytes_ = std::move(bytes); }

  /// Copies what is kept of the bytes at `offset`. Returns the rest, which is to be read.
  [[nodiscard]] ByteSource::Part fill(std::uint64_t offset, std::span<std::byte> out) const {
    if (offset >= bytes_.size()) return {offset, out};
    const std::size_t kept = std::min(out.size(), bytes_.size() - static_cast<std::size_t>(offset));
    std::ranges::copy(std::span(bytes_).subspan(static_cast<std::size_t>(offset), kept), out.begin());
    return {offset + kept, out.subspan(kept)};
  }

 private:
  std::vector<std::byte> bytes_;
};

}  // namespace splatvol
