// Lists of indices side by side in memory: the tetrahedra at each point, the members of each cluster.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

namespace splatvol {

/// One list of indices for each key; a key is a number below their count. Memory is kept for the next lists.
class IndexLists {
 public:
  /// Makes the lists of `keys` keys. `visit(add)` calls add(key, index) for each entry; it is called twice and must
  /// give the same entries both times. A list has its entries in the order of the calls.
  template <class Visit>
  void assign(std::size_t keys, const Visit& visit) {
    // Counts stand two keys further on, so that begins_[key + 1] runs from a list's begin to its end as it is filled.
    begins_.assign(keys + 2, 0);
    visit([&](std::size_t key, std::uint32_t) { ++begins_[key + 2]; });
    for (std::size_t key = 0; key < keys; ++key) begins_[key + 2] += begins_[key + 1];
    indices_.resize(begins_.back());
    visit([&](std::size_t key, std::uint32_t index) { indices_[begins_[key + 1]++] = index; });
  }

  /// Requires assign(), and a key of it.
  [[nodiscard]] std::span<const std::uint32_t> operator[](std::size_t key) const {
    return std::span(indices_).subspan(begins_[key], begins_[key + 1] - begins_[key]);
  }

 private:
  std::vector<std::uint64_t> begins_;  // [key]: of its list; then the end of the last list
  std::vector<std::uint32_t> indices_;
};

}  // namespace splatvol
