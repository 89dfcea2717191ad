#include "renderer/sort.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>

namespace splatvol {

namespace {

constexpr int digit_bits = 11;
constexpr std::size_t digit_count = std::size_t{1} << digit_bits;
constexpr std::size_t items_per_block = std::size_t{1} << 16;  // fewer do not pay for a thread
constexpr std::size_t most_blocks = 64;

using Histogram = std::array<std::uint32_t, digit_count>;

/// One stable pass of a radix sort over `count` items by the digit at `shift`; returns how many it kept.
///
/// `key_of(i)` is an item's key; keys equal to hidden_key are dropped. `move(i, place)` puts item i where it belongs.
/// Blocks of items are counted and moved in parallel.
template <class KeyOf, class Move>
std::size_t radix_pass(std::size_t count, int shift, const KeyOf& key_of, const Move& move) {
  const std::size_t blocks = std::clamp(count / items_per_block, std::size_t{1}, most_blocks);
  const auto block_begin = [=](std::size_t block) { return count * block / blocks; };
  const auto for_each_digit = [&](std::size_t block, const auto& visit) {
    for (std::size_t i = block_begin(block); i < block_begin(block + 1); ++i)
      if (const std::uint32_t key = key_of(i); key != hidden_key) visit(i, (key >> shift) & (digit_count - 1));
  };

  std::vector<Histogram> places(blocks, Histogram{});
  tbb::parallel_for(std::size_t{0}, blocks, [&](std::size_t block) {
    for_each_digit(block, [&](std::size_t, std::uint32_t digit) { ++places[block][digit]; });
  });

  // Counts become places: digit by digit, and within a digit block by block, which keeps the pass stable.
  std::uint32_t place = 0;
  for (std::size_t digit = 0; digit < digit_count; ++digit)
    for (Histogram& histogram : places) place += std::exchange(histogram[digit], place);

  tbb::parallel_for(std::size_t{0}, blocks, [&](std::size_t block) {
    for_each_digit(block, [&](std::size_t i, std::uint32_t digit) { move(i, places[block][digit]++); });
  });
  return place;
}

}  // namespace

std::span<const std::uint32_t> KeySorter::sort(std::span<const std::uint32_t> keys) {
  front_.resize(keys.size());
  back_.resize(keys.size());
  order_.resize(keys.size());

  const std::size_t kept = radix_pass(
      keys.size(), 0, [&](std::size_t i) { return keys[i]; },
      [&](std::size_t i, std::uint32_t place) {
        front_[place] = {keys[i], static_cast<std::uint32_t>(i)};
      });
  radix_pass(
      kept, digit_bits, [&](std::size_t i) { return front_[i].key; },
      [&](std::size_t i, std::uint32_t place) { back_[place] = front_[i]; });
  radix_pass(
      kept, 2 * digit_bits, [&](std::size_t i) { return back_[i].key; },
      [&](std::size_t i, std::uint32_t place) { order_[place] = back_[i].index; });
  return std::span(order_).first(kept);
}

}  // namespace splatvol
