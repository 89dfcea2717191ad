// Packets of fixed-size records, packed: how they lie in temporary files.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>

#include "base/temp_file.h"

namespace splatvol {

// Records are packed in groups. In a group, every column of 32 bits is stored as its minimum and, bit by bit, the
// differences to it: neighbours in Morton order share the high bits of their coordinates, and the low bits of floating
// point numbers do not compress at all. Not larger than byte planes packed by zstd, in a third of the time.
inline constexpr std::size_t packed_group = 128;

/// Bytes that `count` records may take as a packet, and that a buffer for it must have.
[[nodiscard]] constexpr std::size_t packet_bound(std::size_t count, std::size_t record_bytes) {
  constexpr std::size_t header = 8, slack = 8;  // pack and unpack touch up to 8 bytes behind the packet
  const std::size_t columns = (record_bytes + 3) / 4, groups = (count + packed_group - 1) / packed_group;
  return header + columns * (4 * count + groups) + slack;
}

/// Says where the records from `first` on lie; called for at most packed_group of them at a time.
using LocateRecords = std::function<void(std::size_t first, std::span<const std::byte*> records)>;

/// Packs `count` records into the front of `out`, which has packet_bound bytes; returns how many it took. Requires at
/// least one record, fewer than 2^31 bytes of them. Thread-safe.
[[nodiscard]] std::size_t pack_records(std::size_t count, const LocateRecords& locate, std::size_t record_bytes,
                                       std::span<std::byte> out);

/// Reads the packets of a part of a file in their order, and gives their disk space back.
class PacketReader {
 public:
  /// Of the bytes [begin, end) of `file`. Reads as much at a time as `buffer` holds: at least packet_bound of the
  /// largest packet. File and buffer stay the caller's. Thread-safe towards other readers of the file.
  PacketReader(TempFile& file, std::uint64_t begin, std::uint64_t end, std::size_t record_bytes,
               std::span<std::byte> buffer)
      : file_(&file), next_(begin), end_(end), released_(begin), record_bytes_(record_bytes), buffer_(buffer) {}

  /// Unpacks the next packet into the front of `out`, which has room for it; returns its number of records, 0 at the
  /// end.
  [[nodiscard]] Result<std::size_t> next(std::span<std::byte> out);

 private:
  Status refill();

  TempFile* file_;
  std::uint64_t next_, end_;  // what is still to be read
  std::uint64_t released_;
  std::size_t record_bytes_;
  std::span<std::byte> buffer_;
  std::span<const std::byte> unread_;  // of the buffer
};

}  // namespace splatvol
