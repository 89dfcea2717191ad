#include "extractor/used_ranks.h"

#include <bit>

namespace splatvol {

using format::rank_page_points;

UsedRanks::UsedRanks(std::uint64_t points) : pages_((points + rank_page_points - 1) / rank_page_points) {}

void UsedRanks::add(std::span<const std::uint64_t> ranks) {
  for (const std::uint64_t rank : ranks) {
    std::unique_ptr<Page>& page = pages_[rank / rank_page_points];
    if (!page) page = std::make_unique<Page>();
    page->bits[rank % rank_page_points / 64] |= std::uint64_t{1} << rank % 64;
  }
}

std::uint64_t UsedRanks::number() {
  std::uint64_t count = 0;
  for (const std::unique_ptr<Page>& page : pages_) {
    if (!page) continue;
    page->first = count;
    for (std::size_t word = 0; word < words; ++word) {
      page->before[word] = static_cast<std::uint16_t>(count - page->first);
      count += static_cast<std::uint64_t>(std::popcount(page->bits[word]));
    }
  }
  return count;
}

bool UsedRanks::has(std::uint64_t rank) const {
  const std::uint64_t page = rank / rank_page_points;
  return page < pages_.size() && pages_[page] && (pages_[page]->bits[rank % rank_page_points / 64] >> rank % 64 & 1);
}

std::uint64_t UsedRanks::number_of(std::uint64_t rank) const {
  const Page& page = *pages_[rank / rank_page_points];
  const std::size_t word = rank % rank_page_points / 64;
  const std::uint64_t lower = page.bits[word] & ((std::uint64_t{1} << rank % 64) - 1);
  return page.first + page.before[word] + static_cast<std::uint64_t>(std::popcount(lower));
}

std::vector<std::uint64_t> UsedRanks::ranks_of_page(std::size_t page) const {
  std::vector<std::uint64_t> ranks;
  if (!pages_[page]) return ranks;
  std::uint64_t first = page * std::uint64_t{rank_page_points};
  for (std::uint64_t bits : pages_[page]->bits) {
    for (; bits != 0; bits &= bits - 1) ranks.push_back(first + static_cast<std::uint64_t>(std::countr_zero(bits)));
    first += 64;
  }
  return ranks;
}

}  // namespace splatvol
