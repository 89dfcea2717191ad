// Sorting of more records than fit into memory.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "base/error.h"
#include "builder/sorting/key_sort.h"

namespace splatvol {

struct SortOptions {
  std::size_t record_bytes = 0;
  KeyFunction key;
  std::size_t memory = 0;        // bytes to hold until finish()
  std::size_t merge_memory = 0;  // bytes to hold from then on
  std::string folder;            // for what does not fit
  const std::atomic<bool>* cancelled = nullptr;
};

/// Records in order, with their keys: spans for the same number of records.
struct SortedRecords {
  std::span<const std::byte> records;
  std::span<const MortonKey> keys;
};

/// Puts fixed-size records into ascending order of their keys; equal keys stay in the order in which they were added.
/// The records that come out, one after the other, do not depend on memory and threads, but where packets end does.
/// Works ahead of its caller on TBB's threads. One thread at a time may call it.
class ExternalSorter {
 public:
  /// Fails with out_of_budget where an amount of memory is below least_memory. Makes no file yet.
  [[nodiscard]] static Result<ExternalSorter> create(SortOptions options);
  ExternalSorter(ExternalSorter&&) noexcept;
  ExternalSorter& operator=(ExternalSorter&&) noexcept;
  ~ExternalSorter();

  /// Enough for a sort and a merge of records of this size.
  [[nodiscard]] static std::size_t least_memory(std::size_t record_bytes);

  /// Appends whole records, any number of them. Errors of the disk may come with any later call.
  [[nodiscard]] Status add(std::span<const std::byte> records);

  /// Ends the adding; called once.
  [[nodiscard]] Status finish();

  /// The next records, empty at the end; theirs until the next call. Requires finish().
  [[nodiscard]] Result<SortedRecords> next();

  /// Records added.
  [[nodiscard]] std::uint64_t count() const;

  /// Bytes that sorting `count` records may take in the folder, provided its file system takes back what is released.
  [[nodiscard]] std::uint64_t temp_bytes(std::uint64_t count) const;

  /// How often every record has been written, or is to be by what has been done so far: 0 where all is in memory.
  [[nodiscard]] int passes() const;

 private:
  class Impl;
  explicit ExternalSorter(std::unique_ptr<Impl> impl);

  std::unique_ptr<Impl> impl_;
};

}  // namespace splatvol
