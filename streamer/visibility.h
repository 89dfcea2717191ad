// What a transfer function leaves visible, told from ranges and occupancy masks alone.
#pragma once

#include <cstdint>

#include "format/volume_info.h"
#include "scene/scene.h"

namespace splatvol {

/// Whether any value in [low, high] has extinction above 0. Requires low <= high.
[[nodiscard]] bool extinction_within(const TransferFunction& function, double low, double high);

/// A transfer function, seen through the 64 bins of an attribute (spec/svol-1.md, section 7).
class ValueVisibility {
 public:
  ValueVisibility(const TransferFunction& function, const format::Attribute& attribute);

  /// Bit b is set where a value of bin b may have extinction above 0; a bin's borders count as its own.
  [[nodiscard]] std::uint64_t bins() const { return bins_; }

  /// Whether anything may be visible of stored values in [min, max] whose bins are `occupancy`; never wrongly false.
  /// An empty range (min > max) holds missing values only, and shows nothing.
  [[nodiscard]] bool shows(float min, float max, std::uint64_t occupancy) const;

  /// Whether both leave the same values visible.
  [[nodiscard]] bool operator==(const ValueVisibility& other) const;

 private:
  TransferFunction function_;
  double offset_;
  std::uint64_t bins_ = 0;
};

}  // namespace splatvol
