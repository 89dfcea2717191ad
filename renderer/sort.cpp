#include "renderer/sort.h"

#include <algorithm>
#include <array>

#include "base/parallel.h"

namespace splatvol {

namespace {

constexpr int digit_bits = 11;
constexpr std::size_t digit_count = std::size_t{1} << digit_bits;
constexpr std::size_t items_per_slice = std::size_t{1} << 14;  // fewer are slower with a thread of their own
constexpr std::size_t most_slices = 64;

using Histogram = std::array<std::uint32_t, digit_count>;

/// Runs one stable pass of a radix sort over `count` items, by the digit at `shift`. Returns how many it kept.
///
/// `key_of(i)` is an item's key; keys equal to hidden_key are dropped. `move(i, to)` moves item i to index `to`.
/// Slices of the items are counted and moved in parallel.
template <class KeyOf, class Move>
std::size_t radix_pass(std::size_t count, int shift, const KeyOf& key_of, const Move& move) {
  const std::size_t slices = std::clamp(count / items_per_slice, std::size_t{1}, most_slices);
  const auto slice_begin = [=](std::size_t slice) { return count * slice / slices; };
  const auto for_each_digit = [&](std::size_t slice, const auto& visit) {
    for (std::size_t i = slice_begin(slice); i < slice_begin(slice + 1); ++i)
      if (const std::uint32_t key = key_of(i); key != hidden_key) visit(i, (key >> shift) & (digit_count - 1));
  };

  std::vector<Histogram> next_index(slices, Histogram{});
  parallel_for(std::size_t{0}, slices, [&](std::size_t slice) {
    for_each_digit(slice, [&](std::size_t, std::uint32_t digit) { ++next_index[slice][digit]; });
  });

  // Counts become indices: digit by digit, and within a digit slice by slice, which keeps the pass stable.
  std::uint32_t total = 0;
  for (std::size_t digit = 0; digit < digit_count; ++digit)
    for (Histogram& histogram : next_index) total += std::exchange(histogram[digit], total);

  parallel_for(std::size_t{0}, slices, [&](std::size_t slice) {
    for_each_digit(slice, [&](std::size_t i, std::uint32_t digit) { move(i, next_index[slice][digit]++); });
  });
  return total;
}

}  // namespace

std::span<const std::uint32_t> KeySorter::sort(std::span<const std::uint32_t> keys) {
  front_.resize(keys.size());
  back_.resize(keys.size());
  order_.resize(keys.size());

  const std::size_t kept = radix_pass(
      keys.size(), 0, [&](std::size_t i) { return keys[i]; },
      [&](std::size_t i, std::uint32_t to) {
        front_[to] = {keys[i], static_cast<std::uint32_t>(i)};
      });
  radix_pass(
      kept, digit_bits, [&](std::size_t i) { return front_[i].key; },
      [&](std::size_t i, std::uint32_t to) { back_[to] = front_[i]; });
  radix_pass(
      kept, 2 * digit_bits, [&](std::size_t i) { return back_[i].key; },
      [&](std::size_t i, std::uint32_t to) { order_[to] = back_[i].index; });
  return std::span(order_).first(kept);
}

}  // namespace splatvol
