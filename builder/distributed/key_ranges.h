// Ranges of Morton keys, one for each rank that reduces, and the samples that choose them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "base/math.h"
#include "builder/sorting/octree_nodes.h"

namespace splatvol {

/// The first and the last key of the octree node at `depth` that holds `key`, and the keys beside a key.
[[nodiscard]] MortonKey first_key(const MortonKey& key, int depth);
[[nodiscard]] MortonKey last_key(const MortonKey& key, int depth);
[[nodiscard]] MortonKey key_before(const MortonKey& key);  // requires one
[[nodiscard]] MortonKey key_behind(const MortonKey& key);  // larger than all keys if there is none

/// The keys at which the ranges but the first begin, ascending: range r belongs to rank r. Each is the first key of an
/// octree node.
using RangeBegins = std::vector<MortonKey>;

[[nodiscard]] std::size_t range_of(const RangeBegins& begins, const MortonKey& key);

[[nodiscard]] KeyBorders borders_of(const RangeBegins& begins, std::size_t range);

/// Cuts the keys into at most `ranges` ranges with about as many of the samples in each. An octree node across a border
/// has at least `least` samples, so that it is not too small to be cut. There are fewer ranges if the samples do not
/// allow more. `samples`: ascending.
[[nodiscard]] RangeBegins choose_ranges(std::span<const MortonKey> samples, std::size_t ranges, std::size_t least);

/// Keeps each position with the same probability. The probability halves when there are too many.
class PositionSamples {
 public:
  struct Sample {
    std::uint64_t lot;  // uniform; kept if it is below the limit
    dvec3 position;
  };

  explicit PositionSamples(std::size_t most) : most_(most) {}

  /// `number`: unique among the points of all ranks.
  void add(std::uint64_t number, const dvec3& position) {
    const std::uint64_t lot = mix(number);
    if (lot > limit_) return;
    samples_.push_back({lot, position});
    if (samples_.size() > most_) thin_out();
  }

  /// Whether add() would keep the position: for callers to whom a position costs something.
  [[nodiscard]] bool keeps(std::uint64_t number) const { return mix(number) <= limit_; }

  [[nodiscard]] std::uint64_t limit() const { return limit_; }
  [[nodiscard]] const std::vector<Sample>& samples() const { return samples_; }

  /// The probability that a limit stands for.
  [[nodiscard]] static double probability(std::uint64_t limit) { return (static_cast<double>(limit) + 1) * 0x1p-64; }

 private:
  static std::uint64_t mix(std::uint64_t z);
  void thin_out();

  std::size_t most_;
  std::uint64_t limit_ = std::numeric_limits<std::uint64_t>::max();
  std::vector<Sample> samples_;
};

}  // namespace splatvol
