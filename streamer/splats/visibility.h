// Which values a transfer function shows, from ranges and occupied bins alone.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>

#include "format/volume_info.h"
#include "scene/scene.h"

namespace splatvol {

/// Whether any value in [low, high] has extinction above 0. Requires low <= high.
[[nodiscard]] bool extinction_within(const TransferFunction& function, double low, double high);

/// The variance of colour times extinction among neighbouring values, for the 64 bins of an attribute.
class ValueContrast {
 public:
  static constexpr std::size_t scales = 8;
  using Variances = std::array<float, scales>;

  /// `length`: the unit of length of all results, in world units. Single precision holds them best near 1.
  ValueContrast(const TransferFunction& function, const format::Attribute& attribute, double length = 1);

  /// The contrast of the values of a node. All its occupied bins count equally.
  struct Node {
    double range = 0;       // largest value less the least, in bins
    double extinction = 0;  // mean
    double squares = 0;     // mean of (colour times extinction)^2, summed over the channels, plus half of extinction^2,
                            // because extinction hides too
    Variances variances{};  // [scale]: the same of the deviations from the mean, among values within 2^scale bins

    /// Returns the variance among values within this share of the range.
    [[nodiscard]] double variance(double share) const;
  };
  [[nodiscard]] Node of(const format::ValueSummary& summary) const;

 private:
  struct Bin {
    float extinction = 0;
    float squares = 0;
    Variances variances{};
  };
  std::array<Bin, 64> bins_{};
  double bin_width_ = 0;
};

/// The values of a node or of a row: of the attribute that is shown, and of the opacity attribute.
struct ShownValues {
  const format::ValueSummary& values;
  const format::ValueSummary* opacity = nullptr;  // null: there is no such attribute
};

/// The contrast of what a node shows. The values of the two attributes count as independent.
struct ShownContrast {
  ValueContrast::Node values;
  std::optional<ValueContrast::Node> opacity = {};

  /// As those of ValueContrast::Node, times the opacity.
  [[nodiscard]] double extinction() const;
  [[nodiscard]] double squares() const;
  [[nodiscard]] double variance(double share) const;
};

/// The attributes that a scene shows.
struct ShownAttributes {
  // Implicit: most scenes show one only.
  ShownAttributes(const format::Attribute& shown, const format::Attribute* factor = nullptr)
      : values(shown), opacity(factor) {}

  const format::Attribute& values;
  const format::Attribute* opacity;  // null: there is none
};

/// A scene's functions, seen through the 64 bins of its attributes (spec/svol-1.md, section 7).
class ValueVisibility {
 public:
  /// `length`: of `contrast`. `sliced`: slices show values of any extinction. An opacity counts if both have it.
  ValueVisibility(const Transfer& transfer, const ShownAttributes& attributes, double length = 1, bool sliced = false);

  /// Returns the visible bins: bit b is set if a value of bin b, or at its borders, may have extinction above 0.
  [[nodiscard]] std::uint64_t bins() const { return bins_; }

  /// Whether any of the stored values in [min, max], in the bins `occupancy`, may be visible. Never wrongly false. An
  /// empty range (min > max) means that all values are missing, and gives false.
  [[nodiscard]] bool shows(float min, float max, std::uint64_t occupancy) const;

  [[nodiscard]] bool shows(const ShownValues& shown) const;

  /// The same for a row of the file, which may be on a slice.
  [[nodiscard]] bool shows_row(const ShownValues& shown) const {
    return sliced_ ? shown.values.min <= shown.values.max : shows(shown);
  }

  struct Extinctions {
    double least = 0, most = 0;
  };
  /// Returns the range of extinction, per world unit, over the stored values in [min, max]; 0 for an empty range.
  [[nodiscard]] Extinctions extinctions(float min, float max) const;
  [[nodiscard]] Extinctions extinctions(const ShownValues& shown) const;

  [[nodiscard]] ShownContrast contrast(const ShownValues& shown) const;

  /// Returns the contrast of the colours alone, as slices show them. None without slices.
  [[nodiscard]] const std::optional<ValueContrast>& slice_contrast() const { return slice_contrast_; }

  /// Returns the unit of length of `contrast`, in world units.
  [[nodiscard]] double length() const { return length_; }

  /// Whether both leave the same values visible.
  [[nodiscard]] bool operator==(const ValueVisibility& other) const;

 private:
  TransferFunction function_;
  double offset_, scale_;
  double length_;
  bool sliced_;
  std::uint64_t bins_ = 0;
  ValueContrast contrast_;
  std::optional<ValueContrast> slice_contrast_;
  std::shared_ptr<const ValueVisibility> opacity_;  // of the factors; null: there are none
};

}  // namespace splatvol
