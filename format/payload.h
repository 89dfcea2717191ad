// A column's payload to and from a chunk; for format's own sources.
#pragma once

#include <span>
#include <string_view>

#include "base/error.h"
#include "format/codec.h"
#include "format/columns.h"

namespace splatvol::format {

/// Packs and hashes a payload; the entry has no summary.
[[nodiscard]] PackedChunk pack_payload(const Bytes& payload);

/// Checks the hash, then unpacks.
[[nodiscard]] Result<Bytes> unpack_payload(const ChunkEntry& entry, std::span<const std::byte> packed,
                                           std::string_view what);

}  // namespace splatvol::format
