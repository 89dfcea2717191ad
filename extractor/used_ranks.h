// Which points of a file the exported cells name, and the numbers that the export gives them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "format/layout.h"

namespace splatvol {

/// A set of ranks. Takes 1.25 bits a rank in those pages of ranks (format::rank_page_points) that have one, and 8 bytes
/// for every page. Const functions are thread-safe.
class UsedRanks {
 public:
  /// `points`: ranks are below it.
  explicit UsedRanks(std::uint64_t points);

  void add(std::span<const std::uint64_t> ranks);

  /// Numbers the ranks from 0 on, in their order. Called once, after the last add(). Returns how many there are.
  std::uint64_t number();

  [[nodiscard]] bool has(std::uint64_t rank) const;

  /// Returns the number of a rank. Requires has(), and number() before.
  [[nodiscard]] std::uint64_t number_of(std::uint64_t rank) const;

  [[nodiscard]] std::size_t page_count() const { return pages_.size(); }

  /// Returns the ranks of a page that were added, ascending.
  [[nodiscard]] std::vector<std::uint64_t> ranks_of_page(std::size_t page) const;

 private:
  static constexpr std::size_t words = format::rank_page_points / 64;
  struct Page {
    std::array<std::uint64_t, words> bits{};
    std::array<std::uint16_t, words> before{};  // ranks of the page in the words before
    std::uint64_t first = 0;                    // number of the first rank
  };
  std::vector<std::unique_ptr<Page>> pages_;  // null: no rank of it
};

}  // namespace splatvol
