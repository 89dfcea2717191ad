#include "streamer/splats/visibility.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <vector>

namespace splatvol {

bool extinction_within(const TransferFunction& function, double low, double high) {
  if (function.extinction(low) > 0 || function.extinction(high) > 0) return true;

  // The function is linear between control points: between two values without extinction, it is above 0 only if a
  // control point is.
  const double from = function.t_of(low), to = function.t_of(high);
  return std::ranges::any_of(function.densities, [&](const TransferFunction::Density& d) {
    return d.extinction > 0 && d.t >= from && d.t <= to;
  });
}

ValueContrast::ValueContrast(const TransferFunction& function, const format::Attribute& attribute, double length) {
  if (std::isnan(attribute.min)) return;
  const double bin_width = (attribute.max - attribute.min) / 64;
  bin_width_ = bin_width / attribute.scale;

  // Running sums over samples, of emission, extinction, and their weighted squares.
  constexpr std::size_t each = 8, count = 64 * each;
  struct Sums {
    dvec3 emission{0};
    double extinction = 0, squares = 0;
  };
  std::vector<Sums> sums(count + 1);
  for (std::size_t i = 0; i < count; ++i) {
    const double value = attribute.min + (static_cast<double>(i) + 0.5) / each * bin_width;
    const double extinction = length * function.extinction(value);
    const dvec3 emission = extinction * function.color(value);
    sums[i + 1] = {sums[i].emission + emission, sums[i].extinction + extinction,
                   sums[i].squares + glm::dot(emission, emission) + 0.5 * extinction * extinction};
  }
  for (std::size_t b = 0; b < 64; ++b)
    for (std::size_t scale = 0; scale < scales; ++scale) {
      const std::size_t half = (each << scale) / 2, middle = each * b + each / 2;
      const Sums &low = sums[middle - std::min(middle, half)], &high = sums[std::min(middle + half, count)];
      const double share = 1.0 / static_cast<double>(&high - &low);
      const dvec3 emission = share * (high.emission - low.emission);
      const double extinction = share * (high.extinction - low.extinction);
      const double variance =
          share * (high.squares - low.squares) - glm::dot(emission, emission) - 0.5 * extinction * extinction;
      bins_[b].variances[scale] = static_cast<float>(std::max(variance, 0.0));
      if (scale > 0) continue;
      bins_[b].extinction = static_cast<float>(extinction);
      bins_[b].squares = static_cast<float>(share * (high.squares - low.squares));
    }
}

ValueContrast::Node ValueContrast::of(const format::ValueSummary& summary) const {
  Node node;
  const int count = std::popcount(summary.occupancy);
  if (count == 0 || !(summary.min <= summary.max)) return node;
  if (bin_width_ > 0) node.range = (static_cast<double>(summary.max) - static_cast<double>(summary.min)) / bin_width_;
  for (std::uint64_t left = summary.occupancy; left != 0; left &= left - 1) {
    const Bin& bin = bins_[static_cast<std::size_t>(std::countr_zero(left))];
    node.extinction += bin.extinction;
    node.squares += bin.squares;
    for (std::size_t scale = 0; scale < scales; ++scale) node.variances[scale] += bin.variances[scale];
  }
  node.extinction /= count;
  node.squares /= count;
  for (float& variance : node.variances) variance /= static_cast<float>(count);
  return node;
}

// In a bin, the function is about linear.
double ValueContrast::Node::variance(double share) const {
  const double width = share * range;
  if (width <= 1) return width * width * static_cast<double>(variances[0]);
  const float scale = std::min(std::log2(static_cast<float>(width)), scales - 1.001F);
  const auto below = static_cast<std::size_t>(scale);
  const double part = scale - static_cast<float>(below);
  return (1 - part) * static_cast<double>(variances[below]) + part * static_cast<double>(variances[below + 1]);
}

// Contrasts of black have half of the squared extinction. For a factor this is all that counts.
double ShownContrast::extinction() const { return values.extinction * (opacity ? opacity->extinction : 1); }

double ShownContrast::squares() const { return values.squares * (opacity ? 2 * opacity->squares : 1); }

double ShownContrast::variance(double share) const {
  if (!opacity) return values.variance(share);
  return values.variance(share) * 2 * opacity->squares + values.squares * 2 * opacity->variance(share);
}

ValueVisibility::ValueVisibility(const Transfer& transfer, const ShownAttributes& attributes, double length,
                                 bool sliced)
    : function_(transfer.function),
      offset_(attributes.values.offset),
      scale_(attributes.values.scale),
      length_(length),
      sliced_(sliced),
      contrast_(function_, attributes.values, length) {
  const format::Attribute& attribute = attributes.values;
  if (sliced) {
    TransferFunction opaque = function_;
    opaque.densities = {{0, 1}}, opaque.density_factor = 1;
    slice_contrast_.emplace(opaque, attribute);
  }
  if (transfer.opacity && attributes.opacity) {
    TransferFunction black = *transfer.opacity;
    black.colors = {{0, dvec3(0)}};
    opacity_ = std::make_shared<const ValueVisibility>(black, *attributes.opacity);
  }
  if (std::isnan(attribute.min)) return;

  // By rounding, values near a border may be in either bin.
  const double width = (attribute.max - attribute.min) / 64;
  const double largest = std::max(std::abs(attribute.min), std::abs(attribute.max));
  const double margin = 1e-6 * width + 8 * std::numeric_limits<double>::epsilon() * largest;
  for (int b = 0; b < 64; ++b) {
    const double low = attribute.min + b * width;
    if (extinction_within(function_, low - margin, low + width + margin)) bins_ |= std::uint64_t{1} << b;
  }
}

bool ValueVisibility::shows(float min, float max, std::uint64_t occupancy) const {
  if (!(min <= max) || (occupancy & bins_) == 0) return false;
  return extinction_within(function_, offset_ + scale_ * static_cast<double>(min),
                           offset_ + scale_ * static_cast<double>(max));
}

bool ValueVisibility::shows(const ShownValues& shown) const {
  const auto& [values, opacity] = shown;
  if (opacity_ && opacity && !opacity_->shows(opacity->min, opacity->max, opacity->occupancy)) return false;
  return shows(values.min, values.max, values.occupancy);
}

ShownContrast ValueVisibility::contrast(const ShownValues& shown) const {
  ShownContrast contrast{contrast_.of(shown.values)};
  if (opacity_ && shown.opacity) contrast.opacity = opacity_->contrast_.of(*shown.opacity);
  return contrast;
}

ValueVisibility::Extinctions ValueVisibility::extinctions(const ShownValues& shown) const {
  Extinctions result = extinctions(shown.values.min, shown.values.max);
  if (!opacity_ || !shown.opacity) return result;
  const Extinctions factor = opacity_->extinctions(shown.opacity->min, shown.opacity->max);
  return {result.least * factor.least, result.most * factor.most};
}

// The function is linear between control points, so it is least and largest at control points or at the ends.
ValueVisibility::Extinctions ValueVisibility::extinctions(float min, float max) const {
  if (!(min <= max)) return {};
  const double low = offset_ + scale_ * static_cast<double>(min), high = offset_ + scale_ * static_cast<double>(max);
  const auto [least, most] = std::minmax({function_.extinction(low), function_.extinction(high)});
  Extinctions result{least, most};
  for (const TransferFunction::Density& d : function_.densities) {
    const double value = function_.value_at(d.t);
    if (!(value >= low && value <= high)) continue;
    const double extinction = function_.density_factor * d.extinction;
    result.least = std::min(result.least, extinction);
    result.most = std::max(result.most, extinction);
  }
  return result;
}

bool ValueVisibility::operator==(const ValueVisibility& other) const {
  const bool same_opacity =
      opacity_ && other.opacity_ ? *opacity_ == *other.opacity_ : opacity_ == other.opacity_;  // else both are null
  return same_opacity && bins_ == other.bins_ && sliced_ == other.sliced_ && offset_ == other.offset_ &&
         scale_ == other.scale_ && function_.lo == other.function_.lo && function_.hi == other.function_.hi &&
         function_.axis == other.function_.axis && function_.linear_width == other.function_.linear_width &&
         function_.density_factor == other.function_.density_factor && function_.densities == other.function_.densities;
}

}  // namespace splatvol
