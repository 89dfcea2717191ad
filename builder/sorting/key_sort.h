// Sorts records in memory by their Morton keys: the indices are sorted, and the records stay.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>

#include "builder/sorting/morton.h"

namespace splatvol {

/// Fills in the key of every record. It is called for some hundreds or thousands of records at a time if possible. It
/// must be thread-safe and must not throw.
using KeyFunction = std::function<void(std::span<const std::byte> records, std::span<MortonKey> keys)>;

/// Records side by side in memory.
struct RecordSpan {
  const std::byte* data = nullptr;
  std::size_t count = 0;
  std::size_t record_bytes = 0;

  [[nodiscard]] const std::byte* operator[](std::size_t i) const { return data + i * record_bytes; }
};

/// Returns the lowest bits of a word, which hold an index below `count`. A slice of the key fills the other bits.
[[nodiscard]] constexpr std::uint64_t index_mask(std::size_t count) {
  return (std::uint64_t{1} << std::bit_width(count)) - 1;
}

/// Sorts the indices of the records by ascending keys, equal keys by ascending indices. The bits of index_mask(count)
/// in words[i] then hold the index of record i in this order. In parallel; takes some KiB for each thread besides
/// `words`. Requires words.size() == records.count < 2^32.
void sort_by_key(const RecordSpan& records, const KeyFunction& key, std::span<std::uint64_t> words);

}  // namespace splatvol
