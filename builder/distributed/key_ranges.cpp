#include "builder/distributed/key_ranges.h"

#include <algorithm>
#include <array>

namespace splatvol {
namespace {

constexpr int half_depths = 21;                                       // in each half of a key
constexpr std::uint64_t half_mask = (std::uint64_t{1} << 63) - 1;     // bits of a half
constexpr MortonKey no_key = {~std::uint64_t{0}, ~std::uint64_t{0}};  // larger than all keys

// The bits of a half that are below the first `depths` octants of it.
std::uint64_t bits_below(int depths) { return half_mask >> 3 * std::clamp(depths, 0, half_depths); }

std::size_t count_in_node(std::span<const MortonKey> samples, const MortonKey& key, int depth) {
  const auto begin = std::ranges::lower_bound(samples, first_key(key, depth));
  const auto end = std::ranges::upper_bound(samples, last_key(key, depth));
  return static_cast<std::size_t>(end - begin);
}

// The deepest node round a sample whose parent has enough samples for a border inside of it; 0: none.
int depth_of_border(std::span<const MortonKey> samples, const MortonKey& key, std::size_t least) {
  int depth = 0;
  while (depth < max_morton_depth && count_in_node(samples, key, depth) >= least) ++depth;
  return depth;
}

}  // namespace

MortonKey first_key(const MortonKey& key, int depth) {
  return {key.high & ~bits_below(depth), key.low & ~bits_below(depth - half_depths)};
}

MortonKey last_key(const MortonKey& key, int depth) {
  return {key.high | bits_below(depth), key.low | bits_below(depth - half_depths)};
}

MortonKey key_before(const MortonKey& key) {
  return key.low > 0 ? MortonKey{key.high, key.low - 1} : MortonKey{key.high - 1, half_mask};
}

MortonKey key_behind(const MortonKey& key) {
  if (key.low < half_mask) return {key.high, key.low + 1};
  return key.high < half_mask ? MortonKey{key.high + 1, 0} : no_key;
}

std::size_t range_of(const RangeBegins& begins, const MortonKey& key) {
  return static_cast<std::size_t>(std::ranges::upper_bound(begins, key) - begins.begin());
}

KeyBorders borders_of(const RangeBegins& begins, std::size_t range) {
  KeyBorders borders;
  if (range > 0) borders.before = key_before(begins[range - 1]);
  if (range < begins.size()) borders.behind = begins[range];
  return borders;
}

RangeBegins choose_ranges(std::span<const MortonKey> samples, std::size_t ranges, std::size_t least) {
  RangeBegins begins;
  std::size_t last = 0;  // samples before the last border
  for (std::size_t range = 1; range < ranges && !samples.empty(); ++range) {
    const std::size_t target = samples.size() * range / ranges;
    const int depth = depth_of_border(samples, samples[target], least);
    if (depth == 0) continue;
    // The node's own borders are the nearest ones.
    std::array<MortonKey, 2> candidates = {first_key(samples[target], depth),
                                           key_behind(last_key(samples[target], depth))};
    const auto before = [&](const MortonKey& key) {
      return static_cast<std::size_t>(std::ranges::lower_bound(samples, key) - samples.begin());
    };
    if (before(candidates[1]) - target < target - before(candidates[0])) std::swap(candidates[0], candidates[1]);
    for (const MortonKey& candidate : candidates) {
      if (before(candidate) <= last || before(candidate) == samples.size()) continue;
      begins.push_back(candidate);
      last = before(candidate);
      break;
    }
  }
  return begins;
}

/// The finaliser of SplitMix64 (Steele, Lea and Flood 2014).
std::uint64_t PositionSamples::mix(std::uint64_t z) {
  z += 0x9E3779B97F4A7C15;
  z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9;
  z = (z ^ z >> 27) * 0x94D049BB133111EB;
  return z ^ z >> 31;
}

void PositionSamples::thin_out() {
  limit_ /= 2;
  std::erase_if(samples_, [&](const Sample& sample) { return sample.lot > limit_; });
}

}  // namespace splatvol
