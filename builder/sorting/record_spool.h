// Records that wait to be read once, in the order in which they came.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "builder/sorting/record_packets.h"

namespace splatvol {

/// A queue of fixed-size records. They are in memory as long as they fit, then packed in a temporary file. One thread
/// at a time.
class RecordSpool {
 public:
  /// Holds at most `memory` bytes, or a few records if that is more. Makes no file yet.
  RecordSpool(std::size_t record_bytes, std::size_t memory, std::string folder);

  /// Appends whole records. Requires that next() has not been called.
  [[nodiscard]] Status append(std::span<const std::byte> records);

  /// Returns the next records, empty after the last, and releases their disk space. They are valid until the next call.
  [[nodiscard]] Result<std::span<const std::byte>> next();

  /// The number of records appended.
  [[nodiscard]] std::uint64_t count() const { return count_; }

 private:
  Status spill();

  std::size_t record_bytes_;
  std::size_t packet_records_;
  std::size_t packet_bytes_;  // room for a packet, packed or not
  std::size_t capacity_;      // records in memory
  std::string folder_;
  std::unique_ptr<std::byte[]> memory_;  // room for a packed packet, an unpacked packet, and records
  std::span<std::byte> packed_, unpacked_, records_;
  std::size_t filled_ = 0;  // records in records_
  std::uint64_t count_ = 0;
  std::optional<TempFile> file_;
  std::optional<PacketReader> reader_;
};

}  // namespace splatvol
