// Packets: the form that fixed-size records have in temporary files.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>

#include "base/temp_file.h"

namespace splatvol {

// The number of records that are packed together. Every column of 32 bits is stored as its minimum and the differences
// to the minimum, with as few bits as they need. Neighbours in Morton order share the high bits of their coordinates,
// and the low bits of floating point numbers do not compress at all. The result is not larger than byte planes packed
// by zstd, in a third of the time.
inline constexpr std::size_t packed_group = 128;

/// The most bytes that `count` records take as a packet. A buffer for a packet must have this size.
[[nodiscard]] constexpr std::size_t packet_bound(std::size_t count, std::size_t record_bytes) {
  constexpr std::size_t header = 16, slack = 8;  // pack and unpack touch up to 8 bytes behind the packet
  const std::size_t columns = (record_bytes + 3) / 4, groups = (count + packed_group - 1) / packed_group;
  return header + columns * (4 * count + groups) + slack;
}

/// Finds the addresses of the records from `first` on. Called for at most packed_group records at a time.
using LocateRecords = std::function<void(std::size_t first, std::span<const std::byte*> records)>;

/// Packs `count` records into the front of `out`, which has packet_bound bytes; returns the bytes that they took.
/// Requires at least one record, and fewer than 2^31 bytes of records. Thread-safe.
[[nodiscard]] std::size_t pack_records(std::size_t count, const LocateRecords& locate, std::size_t record_bytes,
                                       std::span<std::byte> out);

/// Reads the packets in a part of a file, in their order.
class PacketReader {
 public:
  /// Reads the bytes [begin, end) of `file`, as much at a time as `buffer` holds: at least packet_bound of the largest
  /// packet. Releases their disk space, unless `keep`. File and buffer must outlive this. Other threads may read the
  /// file at the same time.
  PacketReader(TempFile& file, std::uint64_t begin, std::uint64_t end, std::size_t record_bytes,
               std::span<std::byte> buffer, bool keep = false)
      : file_(&file),
        next_(begin),
        end_(end),
        released_(begin),
        record_bytes_(record_bytes),
        buffer_(buffer),
        keep_(keep) {}

  /// Unpacks the next packet into the front of `out`, which must have room for it. Returns its number of records, 0
  /// after the last packet. Fails if the file holds other bytes than were written to it.
  [[nodiscard]] Result<std::size_t> next(std::span<std::byte> out);

 private:
  Status refill();

  TempFile* file_;
  std::uint64_t next_, end_;  // the bytes not read yet
  std::uint64_t released_;
  std::size_t record_bytes_;
  std::span<std::byte> buffer_;
  bool keep_;
  std::span<const std::byte> unread_;  // in the buffer
};

}  // namespace splatvol
