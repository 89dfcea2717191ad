// Sorts more records than fit into memory.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <span>
#include <string>

#include "base/error.h"
#include "builder/sorting/key_sort.h"

namespace splatvol {

/// Copies record `i` of an array of T.
template <class T>
[[nodiscard]] T record_at(std::span<const std::byte> records, std::size_t i) {
  T record;
  std::memcpy(&record, records.data() + i * sizeof(T), sizeof(T));
  return record;
}

struct SortOptions {
  std::size_t record_bytes = 0;
  KeyFunction key;
  std::size_t memory = 0;        // bytes to hold until finish()
  std::size_t merge_memory = 0;  // bytes to hold from then on
  std::string folder;            // for temporary files
  bool rewinds = false;          // whether rewind() may be called: disk space is kept until then
};

/// Records in order, and their keys: as many keys as records.
struct SortedRecords {
  std::span<const std::byte> records;
  std::span<const MortonKey> keys;
};

/// Puts fixed-size records into ascending order of their keys; records of equal keys stay in the order in which they
/// were added. The order of all records does not depend on memory and threads; how many next() returns at a time does.
/// Works ahead of its caller on TBB's threads. One thread at a time may call it.
class ExternalSorter {
 public:
  /// Fails with out_of_budget if an amount of memory is below least_memory. Makes no file yet.
  [[nodiscard]] static Result<ExternalSorter> create(SortOptions options);
  ExternalSorter(ExternalSorter&&) noexcept;
  ExternalSorter& operator=(ExternalSorter&&) noexcept;
  ~ExternalSorter();

  /// Returns the bytes that suffice for a sort, or a merge, of records of this size.
  [[nodiscard]] static std::size_t least_memory(std::size_t record_bytes);

  /// Adds any number of whole records. An error of the disk may come with any later call.
  [[nodiscard]] Status add(std::span<const std::byte> records);

  /// Ends the adding. Call it once.
  [[nodiscard]] Status finish();

  /// Returns the next records, empty after the last. They are valid until the next call. Requires finish().
  [[nodiscard]] Result<SortedRecords> next();

  /// Starts again with the first record. Requires SortOptions::rewinds. Call it once, after next() has returned the
  /// last records.
  [[nodiscard]] Status rewind();

  /// The number of records added.
  [[nodiscard]] std::uint64_t count() const;

  /// Returns the most bytes that sorting `count` records may take in the folder, if its file system takes released
  /// bytes back.
  [[nodiscard]] std::uint64_t temp_bytes(std::uint64_t count) const;

 private:
  class Impl;
  explicit ExternalSorter(std::unique_ptr<Impl> impl);

  std::unique_ptr<Impl> impl_;
};

}  // namespace splatvol
