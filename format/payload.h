// A column's payload to and from a chunk. Internal to format.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>
#include <string_view>
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

/// Codes of all points, for each of `fields` fields.
template <class Code, int fields>
class PlanesOf {
 public:
  explicit PlanesOf(std::size_t count) : count_(count), codes_(fields * count) {}

  Code* operator[](int field) { return codes_.data() + static_cast<std::size_t>(field) * count_; }
  void append_to(Bytes& payload) {
    for (int k = 0; k < fields; ++k) append_planes<Code>(payload, std::span<const Code>((*this)[k], count_));
  }

 private:
  std::size_t count_;
  std::vector<Code> codes_;
};

/// Reads the record that a payload begins with.
template <class Header>
Result<Header> read_header(std::span<const std::byte> payload, std::string_view what) {
  if (payload.size() < sizeof(Header)) return fail(ErrorCode::invalid_data, "{}: payload too short [R17]", what);
  return read_record<Header>(payload, 0);
}

[[nodiscard]] inline bool is_scale(double number) { return number >= 0 && std::isfinite(number); }

[[nodiscard]] inline bool all_zero(std::span<const std::uint8_t> bytes) {
  return std::ranges::all_of(bytes, [](std::uint8_t byte) { return byte == 0; });
}

/// Maps signed numbers to unsigned ones, small to small: 0, -1, 1, -2 ... become 0, 1, 2, 3 ...
[[nodiscard]] inline std::uint64_t zigzag(std::int64_t number) {
  return static_cast<std::uint64_t>(number) << 1 ^ static_cast<std::uint64_t>(number >> 63);
}
[[nodiscard]] inline std::int64_t unzigzag(std::uint64_t code) {
  return static_cast<std::int64_t>(code >> 1) ^ -static_cast<std::int64_t>(code & 1);
}

}  // namespace splatvol::format
