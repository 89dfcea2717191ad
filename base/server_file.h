// Files on servers, over HTTP and by ssh, have this in common.
#pragma once

#include <algorithm>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "base/file.h"

namespace splatvol {

/// Longest time that a read waits while nothing, or next to nothing, comes.
inline constexpr std::chrono::seconds usual_stall_timeout{30};

/// ByteSource::cheap_gap(): what a server sends in the time that a request of its own takes.
inline constexpr std::uint64_t gap_on_servers = 64u << 10;

/// The message of a read that finds another file than was opened. Its size differs, or its time or tag does.
inline constexpr const char* file_changed = "the file changed on the server while it was open";

/// The first bytes of a file, which most readers ask for first.
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
