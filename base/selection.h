// Selection of the nth item, without branches that the processor would have to guess.
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>
#include <span>

namespace splatvol {

namespace selection {

/// Moves the items that belong(item) is true of to the front; returns their number. Not stable.
template <class T, class Belongs>
std::size_t partition(std::span<T> items, const Belongs& belongs) {
  std::size_t front = 0;
  for (T& item : items) {
    const std::size_t step = belongs(item) ? 1 : 0;
    const T moved = item;
    item = items[front];
    items[front] = moved;
    front += step;
  }
  return front;
}

template <class T, class Less>
const T& median_of_3(const T& a, const T& b, const T& c, const Less& less) {
  const bool ab = less(a, b), bc = less(b, c), ac = less(a, c);
  return ab == bc ? b : ab == ac ? c : a;
}

/// The median of three medians of samples. Requires at least one item.
template <class T, class Less>
const T& median_of_9(std::span<const T> items, const Less& less) {
  const auto sample = [&](std::size_t s) -> const T& { return items[(2 * s + 1) * items.size() / 18]; };
  const auto median = [&](std::size_t s) -> const T& {
    return median_of_3(sample(s), sample(s + 3), sample(s + 6), less);
  };
  return median_of_3(median(0), median(1), median(2), less);
}

template <class T, class Less>
void insertion_sort(std::span<T> items, const Less& less) {
  for (std::size_t i = 1; i < items.size(); ++i) {
    const T moved = items[i];
    std::size_t at = i;
    for (; at > 0 && less(moved, items[at - 1]); --at) items[at] = items[at - 1];
    items[at] = moved;
  }
}

}  // namespace selection

/// Selects as std::nth_element does: item `nth` becomes the one that sorting would put there, no item before it is
/// larger, and no item behind it is smaller. Two to three times as fast, if a few instructions copy an item and `less`
/// has no branches.
template <class T, class Less>
void select_nth(std::span<T> items, std::size_t nth, const Less& less) {
  constexpr std::size_t few = 12;
  for (int rounds = 3 * static_cast<int>(std::bit_width(items.size())); items.size() > few; --rounds) {
    if (rounds == 0) {
      std::nth_element(items.begin(), items.begin() + static_cast<std::ptrdiff_t>(nth), items.end(), less);
      return;
    }
    const T pivot = selection::median_of_9(std::span<const T>(items), less);
    const std::size_t smaller = selection::partition(items, [&](const T& item) { return less(item, pivot); });
    // If none is smaller, the items that equal the pivot come to the front.
    const std::size_t front =
        smaller > 0 ? smaller : selection::partition(items, [&](const T& item) { return !less(pivot, item); });
    if (nth < front) {
      if (smaller == 0) return;
      items = items.first(front);
    } else {
      items = items.subspan(front);
      nth -= front;
    }
  }
  selection::insertion_sort(items, less);
}

}  // namespace splatvol
