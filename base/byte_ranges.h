// Reads of a file that are joined, and made before their bytes are needed.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <shared_mutex>
#include <span>
#include <vector>

#include "base/error.h"
#include "base/file.h"
#include "base/memory_budget.h"

namespace splatvol {

/// Of a request for many ranges: what a range costs, in bytes, and the most of both. Servers refuse requests with more.
inline constexpr std::uint64_t bytes_of_part = 256;
inline constexpr std::size_t most_parts = 100;
inline constexpr std::uint64_t most_part_bytes = std::uint64_t{1} << 20;

/// Joins ranges between which there are at most `gap` bytes. Returns them in ascending order, without overlap.
[[nodiscard]] std::vector<ByteRange> join_ranges(std::vector<ByteRange> ranges, std::uint64_t gap);

/// Joins ranges as if a request cost as much as 256 KiB: over the smallest gaps that are no larger, until two ranges
/// are left, and one more for each 256 KiB of all.
[[nodiscard]] std::vector<ByteRange> join_to_few(std::vector<ByteRange> ranges);

/// The bytes of a file, with a count of those that were read, and of the requests for them. Where reads do not wait, it
/// counts nothing: the same bytes are read in each try. Thread-safe.
class CountedSource {
 public:
  explicit CountedSource(std::unique_ptr<ByteSource> source) : source_(std::move(source)) {}

  [[nodiscard]] const ByteSource& source() const { return *source_; }

  /// Whether one request has served many ranges, so that others will.
  [[nodiscard]] bool has_read_parts() const { return has_read_parts_; }

  [[nodiscard]] std::uint64_t requests() const { return requests_; }
  [[nodiscard]] std::uint64_t bytes_read() const { return bytes_read_; }

  /// Returns how many of these bytes had been read before.
  [[nodiscard]] std::uint64_t bytes_read_again() const { return bytes_read_again_; }

  /// Whether these bytes were read ahead.
  [[nodiscard]] bool holds(const ByteRange& range) const {
    const std::shared_lock lock(mutex_);
    return find_held(range) != nullptr;
  }

  /// As ByteSource::read. Takes bytes that were read ahead from memory.
  [[nodiscard]] Status read(std::uint64_t offset, std::span<std::byte> out);

  /// As ByteSource::prefetch.
  [[nodiscard]] bool prefetch(std::span<const ByteRange> ranges) { return source_->prefetch(ranges); }

  /// As ByteSource::read_parts.
  [[nodiscard]] Result<bool> read_parts(std::span<const ByteSource::Part> parts);

 private:
  friend class BytesAhead;
  struct Held {
    std::uint64_t begin;
    std::vector<std::byte> bytes;
  };
  [[nodiscard]] bool take_held(std::uint64_t offset, std::span<std::byte> out) const;
  [[nodiscard]] const std::byte* find_held(const ByteRange& range) const;
  void count(std::uint64_t offset, std::uint64_t bytes);

  std::unique_ptr<ByteSource> source_;
  std::atomic<std::uint64_t> requests_ = 0, bytes_read_ = 0, bytes_read_again_ = 0;
  std::mutex count_mutex_;
  std::map<std::uint64_t, std::uint64_t> ranges_;  // that were read, apart from each other: ends by begins
  std::atomic<bool> holds_any_ = false, has_read_parts_ = false;
  mutable std::shared_mutex mutex_;
  std::vector<const Held*> held_;
};

/// Bytes that were read before they are needed. While it lives, its source takes them from here.
class BytesAhead {
 public:
  /// Reads ranges, by few requests, several at once: by requests for many ranges if the source can, else joined to few.
  /// Reserves their bytes. Returns null, and reads nothing, if a quarter of the share has no room for them.
  [[nodiscard]] static Result<std::shared_ptr<const BytesAhead>> read(std::shared_ptr<CountedSource> source,
                                                                      std::vector<ByteRange> ranges,
                                                                      MemoryShare& share);

  /// Reads ranges: by requests for many ranges if the source can, else one by one, joined over gaps of at most `gap`
  /// bytes. The caller has memory for them, and for the gaps unless the source has_read_parts().
  [[nodiscard]] static Result<std::shared_ptr<const BytesAhead>> read_together(std::shared_ptr<CountedSource> source,
                                                                               std::vector<ByteRange> ranges,
                                                                               std::uint64_t gap);
  BytesAhead(const BytesAhead&) = delete;
  BytesAhead& operator=(const BytesAhead&) = delete;
  ~BytesAhead();

 private:
  explicit BytesAhead(std::shared_ptr<CountedSource> source) : source_(std::move(source)) {}
  [[nodiscard]] static Result<std::shared_ptr<const BytesAhead>> read(std::shared_ptr<CountedSource> source,
                                                                      const std::vector<ByteRange>& ranges,
                                                                      const std::vector<ByteRange>& joined,
                                                                      std::size_t at_once, MemoryShare* share);
  [[nodiscard]] bool make_room(std::span<const ByteRange> ranges, MemoryShare* share);
  [[nodiscard]] Result<bool> read_parts();
  [[nodiscard]] Status read_singly(std::size_t at_once);
  void give_to_source() const;

  std::shared_ptr<CountedSource> source_;
  Reservation reservation_;
  std::vector<CountedSource::Held> held_;
};

}  // namespace splatvol
