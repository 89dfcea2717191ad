// A column's payload to and from a chunk. Internal to format.
#pragma once

#include "format/codec.h"
#include "format/columns.h"

namespace splatvol::format {

/// Packs and hashes the payload of `points` points, which ends with whole planes. The entry has no summary, or the
/// given one.
[[nodiscard]] PackedChunk pack_payload(const Bytes& payload, std::size_t points);
[[nodiscard]] PackedChunk pack_payload(const Bytes& payload, std::size_t points, const ValueSummary& summary);

/// Maps signed numbers to unsigned ones, small to small: 0, -1, 1, -2 ... become 0, 1, 2, 3 ...
[[nodiscard]] inline std::uint64_t zigzag(std::int64_t number) {
  return static_cast<std::uint64_t>(number) << 1 ^ static_cast<std::uint64_t>(number >> 63);
}
[[nodiscard]] inline std::int64_t unzigzag(std::uint64_t code) {
  return static_cast<std::int64_t>(code >> 1) ^ -static_cast<std::int64_t>(code & 1);
}

}  // namespace splatvol::format
