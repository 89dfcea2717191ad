// Reads of a file that are joined, and made before their bytes are needed.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <shared_mutex>
#include <span>
#include <vector>

#include "base/error.h"
#include "base/file.h"
#include "format/codec.h"

namespace splatvol::format {

/// Bytes of a file, from `begin` up to `end`.
struct ByteRange {
  std::uint64_t begin = 0, end = 0;

  [[nodiscard]] bool operator==(const ByteRange&) const = default;
};

/// Returns ranges that cover all of `ranges`, ascending, without gaps that are cheap to read through. Of a far source a
/// request costs as much as 256 KiB: the smallest gaps are closed until two ranges are left, and one more for each
/// 256 KiB of all.
[[nodiscard]] std::vector<ByteRange> join_ranges(std::vector<ByteRange> ranges);

/// The bytes of a file, with a count of those that were read. Thread-safe.
class CountedSource {
 public:
  explicit CountedSource(std::unique_ptr<ByteSource> source) : source_(std::move(source)) {}

  [[nodiscard]] const ByteSource& source() const { return *source_; }
  [[nodiscard]] std::uint64_t bytes_read() const { return bytes_read_; }

  /// As ByteSource::read. Takes bytes that were read ahead from memory.
  [[nodiscard]] Status read(std::uint64_t offset, std::span<std::byte> out);

 private:
  friend class BytesAhead;
  struct Held {
    std::uint64_t begin;
    Bytes bytes;
  };
  [[nodiscard]] bool take_held(std::uint64_t offset, std::span<std::byte> out) const;

  std::unique_ptr<ByteSource> source_;
  std::atomic<std::uint64_t> bytes_read_ = 0;
  std::atomic<bool> holds_any_ = false;
  mutable std::shared_mutex mutex_;
  std::vector<const Held*> held_;
};

/// Bytes that were read before they are needed. While it lives, its source takes them from here.
class BytesAhead {
 public:
  /// Reads ranges, several at once.
  [[nodiscard]] static Result<std::shared_ptr<const BytesAhead>> read(std::shared_ptr<CountedSource> source,
                                                                      std::span<const ByteRange> ranges);
  BytesAhead(const BytesAhead&) = delete;
  BytesAhead& operator=(const BytesAhead&) = delete;
  ~BytesAhead();

 private:
  explicit BytesAhead(std::shared_ptr<CountedSource> source) : source_(std::move(source)) {}

  std::shared_ptr<CountedSource> source_;
  std::vector<CountedSource::Held> held_;
};

}  // namespace splatvol::format
