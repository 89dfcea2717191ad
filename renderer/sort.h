// Sorting of what the GPU measured, on the CPU.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace splatvol {

/// The key of an element that the order leaves out.
inline constexpr std::uint32_t hidden_key = 0xffffffff;

/// Orders indices by rising key; equal keys keep their places. Keeps its memory between calls. Not thread-safe.
class KeySorter {
 public:
  /// Indices of the keys other than hidden_key, sorted; valid until the next call. At most 2^32 - 1 keys. Works in
  /// parallel where that pays; the result does not depend on it.
  [[nodiscard]] std::span<const std::uint32_t> sort(std::span<const std::uint32_t> keys);

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
