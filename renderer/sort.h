// Sorting of keys on the CPU, which the GPU computed.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace splatvol {

/// The key of elements that the order leaves out.
inline constexpr std::uint32_t hidden_key = 0xffffffff;

/// Orders indices by rising key; equal keys keep their order. Keeps its memory between calls. Not thread-safe.
class KeySorter {
 public:
  /// Returns the indices of the keys other than hidden_key, sorted; valid until the next call. Takes at most 2^32 - 1
  /// keys. Works in parallel for many keys; the result does not depend on threads.
  [[nodiscard]] std::span<const std::uint32_t> sort(std::span<const std::uint32_t> keys);

  [[nodiscard]] std::uint64_t memory_bytes() const {
    return sizeof(Item) * (front_.capacity() + back_.capacity()) + sizeof(std::uint32_t) * order_.capacity();
  }

 private:
  struct Item {
    std::uint32_t key;
    std::uint32_t index;
  };

  std::vector<Item> front_;
  std::vector<Item> back_;
  std::vector<std::uint32_t> order_;
};

}  // namespace splatvol
