// A column's payload to and from a chunk. Internal to format.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <ranges>
#include <span>
#include <string_view>
#include <vector>

#include "format/codec.h"
#include "format/columns.h"

namespace splatvol::format {

/// A header, then planes, in blocks of the chunk's zstd frame. Each block has statistics of its own. They take time and
/// some 60 bytes, and more bytes where planes in one block are unlike. Which planes share a block is fixed for each
/// column. It was found offline, by bytes and time of zstd: over all ways to group planes that follow each other, then
/// among rules for whole columns. The data were meshes of tetrahedra, of mixed cells and of polyhedra, their cells as
/// points, and scattered points. A block for each plane takes a quarter more time and 0.2 to 3 % more bytes.
struct Payload {
  Bytes bytes;
  std::vector<std::size_t> ends = {};  // of blocks

  /// Appends planes to the open block; or only the first `together` ones, and as many to each further block. The last
  /// block stays open.
  template <std::ranges::contiguous_range Numbers>
  void add(const Numbers& numbers, std::size_t width = sizeof(std::ranges::range_value_t<Numbers>),
           std::size_t together = 8) {
    const std::size_t begin = bytes.size();
    append_planes(bytes, std::span(numbers), width);
    for (std::size_t plane = together; plane < width; plane += together) ends.push_back(begin + plane * numbers.size());
  }

  /// The same for noisy numbers. Their two planes are unlike; if there are more, the lowest two are alike.
  template <std::ranges::contiguous_range Numbers>
  void add_noisy(const Numbers& numbers, std::size_t width = sizeof(std::ranges::range_value_t<Numbers>)) {
    add(numbers, width, width > 2 ? 2 : 1);
  }

  void end_block() { ends.push_back(bytes.size()); }
};

/// Packs and hashes a payload. The entry has no summary, or the given one.
[[nodiscard]] PackedChunk pack_payload(const Payload& payload);
[[nodiscard]] PackedChunk pack_payload(const Payload& payload, const ValueSummary& summary);

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
  [[nodiscard]] std::span<const Code> field(int field) { return {(*this)[field], count_}; }
  void append_to(Payload& payload, int first = 0) {
    for (int k = first; k < fields; ++k) payload.add(field(k));
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
