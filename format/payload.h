// A column's payload to and from a chunk. Internal to format.
#pragma once

#include "format/codec.h"
#include "format/columns.h"

namespace splatvol::format {

/// Packs and hashes a payload. The entry has no summary, or the given one.
[[nodiscard]] PackedChunk pack_payload(const Bytes& payload);
[[nodiscard]] PackedChunk pack_payload(const Bytes& payload, const ValueSummary& summary);

}  // namespace splatvol::format
