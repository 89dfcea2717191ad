// Sorting of records in memory by their Morton keys: of their indices, the records stay.
#pragma once

#include <bit>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>

#include "builder/sorting/morton.h"

namespace splatvol {

/// Fills in the key of every record. Called for some hundreds or thousands of records where that can be; must be
/// thread-safe and not throw.
using KeyFunction = std::function<void(std::span<const std::byte> records, std::span<MortonKey> keys)>;

/// Records side by side in memory.
struct RecordSpan {
  const std::byte* data = nullptr;
  std::size_t count = 0;
  std::size_t record_bytes = 0;

  [[nodiscard]] const std::byte* operator[](std::size_t i) const { return data + i * record_bytes; }
};

/// The lowest bits of a word that hold an index below `count`; a piece of the key fills the others.
[[nodiscard]] constexpr std::uint64_t index_mask(std::size_t count) {
  return (std::uint64_t{1} << std::bit_width(count)) - 1;
}

/// Puts the indices of the records into `words`, in the order of ascending keys, equal keys in that of ascending
/// indices: of word i the bits of index_mask(count). In parallel; beyond the words it takes some KiB a thread.
/// Requires words.size() == records.count < 2^32.
void sort_by_key(const RecordSpan& records, const KeyFunction& key, std::span<std::uint64_t> words);

}  // namespace splatvol
