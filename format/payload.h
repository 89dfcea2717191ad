// A column's payload to and from a chunk. Internal to format.
#pragma once

#include <span>
#include <vector>

#include "format/codec.h"
#include "format/columns.h"

namespace splatvol::format {

/// Packs and hashes the payload of `points` points, which ends with whole planes. The entry has no summary, or the
/// given one.
[[nodiscard]] PackedChunk pack_payload(const Bytes& payload, std::size_t points);
[[nodiscard]] PackedChunk pack_payload(const Bytes& payload, std::size_t points, const ValueSummary& summary);

/// Checks and unpacks a chunk. The payload is valid as long as `packed`, and until the calling thread unpacks another.
[[nodiscard]] Result<std::span<const std::byte>> unpack_payload(const ChunkEntry& entry,
                                                                std::span<const std::byte> packed,
                                                                std::string_view what);

/// Reads planes into a vector of `count` numbers. Returns the planes behind them. Requires that `planes` has them.
template <class T>
std::span<const std::byte> take_planes(std::span<const std::byte> planes, std::vector<T>& numbers, std::size_t count,
                                       std::size_t width = sizeof(T)) {
  numbers.resize(count);
  read_planes<T>(planes, numbers, width);
  return planes.subspan(width * count);
}

/// Maps signed numbers to unsigned ones, small to small: 0, -1, 1, -2 ... become 0, 1, 2, 3 ...
[[nodiscard]] inline std::uint64_t zigzag(std::int64_t number) {
  return static_cast<std::uint64_t>(number) << 1 ^ static_cast<std::uint64_t>(number >> 63);
}
[[nodiscard]] inline std::int64_t unzigzag(std::uint64_t code) {
  return static_cast<std::int64_t>(code >> 1) ^ -static_cast<std::int64_t>(code & 1);
}

}  // namespace splatvol::format
