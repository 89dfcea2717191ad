#include "builder/sorting/key_sort.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <tuple>

namespace splatvol {
namespace {

constexpr int key_bits = 126;
constexpr std::size_t keys_at_once = 256;      // keys made in one call
constexpr std::size_t gathered_bytes = 16384;  // most bytes of records in one call, if they do not lie side by side
constexpr std::size_t few = 64;                // words that are sorted by comparisons, at most
constexpr std::size_t very_few = 8;            // words whose keys are compared as a whole, at most
constexpr std::size_t many = 1 << 14;          // words that get tasks of their own, at least
constexpr int words_ahead = 16;                // fetched into the cache before their turn: two cache lines
constexpr int least_digit_bits = 4, most_digit_bits = 8;

// Returns 64 bits of the key from its bit `first` on, counted from the highest, bit 0. Zeros follow its end.
std::uint64_t key_slice(const MortonKey& key, int first) {
  const std::uint64_t high = key.high << 1 | key.low >> 62, low = key.low << 2;
  if (first == 0) return high;
  return first < 64 ? high << first | low >> (64 - first) : low << (first - 64);
}

// Sorts words: a word is a slice of the key above the record's index. All words differ, and their order is the stable
// order of the slices, so that words may be sorted in place. If a slice does not tell records apart, the next slice
// replaces it.
class KeySort {
 public:
  KeySort(const RecordSpan& records, const KeyFunction& key)
      : records_(records), key_(key), index_bits_(static_cast<int>(std::bit_width(records.count))) {}

  void run(std::span<std::uint64_t> words) const {
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, words.size(), 16 * keys_at_once),
                      [&](const tbb::blocked_range<std::size_t>& range) {
                        for (std::size_t i = range.begin(); i < range.end(); i += keys_at_once)
                          fill_first_slice(i, words.subspan(i, std::min(keys_at_once, range.end() - i)));
                      });
    sort(words, 0);
  }

 private:
  std::uint64_t mask() const { return index_mask(records_.count); }

  void fill_first_slice(std::size_t begin, std::span<std::uint64_t> words) const {
    std::array<MortonKey, keys_at_once> keys;
    key_({records_[begin], words.size() * records_.record_bytes}, std::span(keys).first(words.size()));
    for (std::size_t i = 0; i < words.size(); ++i) words[i] = (key_slice(keys[i], 0) & ~mask()) | (begin + i);
  }

  // Fills the words with the slice from bit `first` on; their records lie anywhere.
  void fill_slice(std::span<std::uint64_t> words, int first) const {
    const std::size_t bytes = records_.record_bytes;
    if (bytes > gathered_bytes) {
      for (std::uint64_t& word : words) {
        MortonKey key;
        key_({records_[word & mask()], bytes}, {&key, 1});
        word = (key_slice(key, first) & ~mask()) | (word & mask());
      }
      return;
    }
    std::array<std::byte, gathered_bytes> gathered;
    std::array<MortonKey, keys_at_once> keys;
    const std::size_t most = std::min(keys_at_once, gathered_bytes / bytes);
    for (; !words.empty(); words = words.subspan(std::min(most, words.size()))) {
      const std::span<std::uint64_t> part = words.first(std::min(most, words.size()));
      for (const std::uint64_t word : part) __builtin_prefetch(records_[word & mask()]);
      for (std::size_t i = 0; i < part.size(); ++i)
        std::memcpy(gathered.data() + i * bytes, records_[part[i] & mask()], bytes);
      key_(std::span(gathered).first(part.size() * bytes), std::span(keys).first(part.size()));
      for (std::size_t i = 0; i < part.size(); ++i)
        part[i] = (key_slice(keys[i], first) & ~mask()) | (part[i] & mask());
    }
  }

  // Sorts words that hold the slice from bit `first` on.
  void sort(std::span<std::uint64_t> words, int first) const {
    if (words.size() <= few) {
      std::ranges::sort(words);
      for_each_tie(words, first);
      return;
    }
    std::uint64_t any = 0, all = ~std::uint64_t{0};
    for (const std::uint64_t word : words) {
      any |= word;
      all &= word;
    }
    if ((any ^ all) > mask())
      partition(words, static_cast<int>(std::bit_width(any ^ all)), first);
    else
      break_tie(words, first);
  }

  void for_each_tie(std::span<std::uint64_t> words, int first) const {
    for (std::size_t begin = 0, end; begin < words.size(); begin = end) {
      for (end = begin + 1; end < words.size() && (words[begin] ^ words[end]) <= mask();) ++end;
      if (end - begin > 1) break_tie(words.subspan(begin, end - begin), first);
    }
  }

  // Sorts words whose slices are equal.
  void break_tie(std::span<std::uint64_t> words, int first) const {
    const int next = first + 64 - index_bits_;
    if (next >= key_bits) {
      std::ranges::sort(words);
    } else if (words.size() <= very_few) {
      sort_very_few(words);
    } else if (words.size() < many) {
      fill_slice(words, next);
      sort(words, next);
    } else {
      tbb::parallel_for(tbb::blocked_range<std::size_t>(0, words.size(), many / 2),
                        [&](const tbb::blocked_range<std::size_t>& range) {
                          fill_slice(words.subspan(range.begin(), range.size()), next);
                        });
      sort(words, next);
    }
  }

  // Sorts words whose slices are equal by the whole keys: filling in slices would take longer.
  void sort_very_few(std::span<std::uint64_t> words) const {
    for (const std::uint64_t word : words) __builtin_prefetch(records_[word & mask()]);
    std::array<MortonKey, very_few> keys;
    for (std::size_t i = 0; i < words.size(); ++i) {
      MortonKey key;
      key_({records_[words[i] & mask()], records_.record_bytes}, {&key, 1});
      const std::uint64_t word = words[i];
      std::size_t k = i;
      for (; k > 0 && std::tie(key, word) < std::tie(keys[k - 1], words[k - 1]); --k) {
        keys[k] = keys[k - 1];
        words[k] = words[k - 1];
      }
      keys[k] = key;
      words[k] = word;
    }
  }

  // Sorts words that differ in their lowest `bits` bits: moves every word to the range of its highest digit (American
  // flag sort), then sorts each range. If keys are spread evenly, about 8 words share the last digit.
  void partition(std::span<std::uint64_t> words, int bits, int first) const {
    const int wanted = static_cast<int>(std::bit_width(words.size())) - 4;
    const int digit_bits = std::min(std::clamp(wanted, least_digit_bits, most_digit_bits), bits - index_bits_);
    const int shift = bits - digit_bits;
    const std::size_t digits = std::size_t{1} << digit_bits;
    const auto digit = [&](std::uint64_t word) { return word >> shift & (digits - 1); };
    std::array<std::uint32_t, (1 << most_digit_bits) + 1> begins;
    std::fill_n(begins.begin(), digits + 1, 0);
    for (const std::uint64_t word : words) ++begins[digit(word) + 1];
    for (std::size_t d = 0; d < digits; ++d) begins[d + 1] += begins[d];
    move_to(words, begins, digits, digit);

    const auto sort_digit = [&](std::size_t d) {
      if (begins[d + 1] - begins[d] > 1) sort(words.subspan(begins[d], begins[d + 1] - begins[d]), first);
    };
    if (words.size() < many)
      for (std::size_t d = 0; d < digits; ++d) sort_digit(d);
    else
      tbb::parallel_for(std::size_t{0}, digits, sort_digit);
  }

  template <class Begins, class Digit>
  static void move_to(std::span<std::uint64_t> words, const Begins& begins, std::size_t digits, const Digit& digit) {
    Begins next = begins;
    for (std::size_t d = 0; d < digits; ++d) {
      while (next[d] < begins[d + 1]) {
        std::uint64_t word = words[next[d]];
        for (std::size_t to = digit(word); to != d; to = digit(word)) {
          std::uint64_t& target = words[next[to]++];
          __builtin_prefetch(&target + words_ahead, 1);
          std::swap(word, target);
        }
        words[next[d]++] = word;
      }
    }
  }

  const RecordSpan& records_;
  const KeyFunction& key_;
  int index_bits_;
};

}  // namespace

void sort_by_key(const RecordSpan& records, const KeyFunction& key, std::span<std::uint64_t> words) {
  KeySort(records, key).run(words);
}

}  // namespace splatvol
