// What a transfer function leaves visible, told from ranges and occupancy masks alone.
#pragma once

#include <array>
#include <cstdint>

#include "format/volume_info.h"
#include "scene/scene.h"

namespace splatvol {

/// Whether any value in [low, high] has extinction above 0. Requires low <= high.
[[nodiscard]] bool extinction_within(const TransferFunction& function, double low, double high);

/// How much colour times extinction varies among values that are near each other, for the 64 bins of an attribute.
class ValueContrast {
 public:
  static constexpr std::size_t levels = 8;
  using Levels = std::array<float, levels>;

  ValueContrast(const TransferFunction& function, const format::Attribute& attribute);

  /// Of the values of a node, each of its occupied bins counting alike.
  struct Node {
    double range = 0;       // from the least value to the largest, in bins
    double extinction = 0;  // mean
    double squares = 0;     // mean of colour times extinction squared, the three channels together, and of half of
                            // extinction squared: it hides
    Levels variances{};     // the same of the deviations from the mean, among values within 2^level bins

    /// Among the values within a share of the range.
    [[nodiscard]] double variance(double share) const;
  };
  [[nodiscard]] Node of(const format::ValueSummary& summary) const;

 private:
  struct Bin {
    float extinction = 0;
    float squares = 0;
    Levels variances{};
  };
  std::array<Bin, 64> bins_{};
  double bin_width_ = 0;
};

/// A transfer function, seen through the 64 bins of an attribute (spec/svol-1.md, section 7).
class ValueVisibility {
 public:
  ValueVisibility(const TransferFunction& function, const format::Attribute& attribute);

  /// Bit b is set where a value of bin b may have extinction above 0; a bin's borders count as its own.
  [[nodiscard]] std::uint64_t bins() const { return bins_; }

  /// Whether anything may be visible of stored values in [min, max] whose bins are `occupancy`; never wrongly false.
  /// An empty range (min > max) holds missing values only, and shows nothing.
  [[nodiscard]] bool shows(float min, float max, std::uint64_t occupancy) const;

  struct Extinctions {
    double least = 0, most = 0;
  };
  /// Of the stored values in [min, max]; 0 of an empty range.
  [[nodiscard]] Extinctions extinctions(float min, float max) const;

  [[nodiscard]] const ValueContrast& contrast() const { return contrast_; }

  /// Whether both leave the same values visible.
  [[nodiscard]] bool operator==(const ValueVisibility& other) const;

 private:
  TransferFunction function_;
  double offset_;
  std::uint64_t bins_ = 0;
  ValueContrast contrast_;
};

}  // namespace splatvol
