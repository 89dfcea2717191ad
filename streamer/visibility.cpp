#include "streamer/visibility.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace splatvol {

bool extinction_within(const TransferFunction& function, double low, double high) {
  if (function.extinction(low) > 0 || function.extinction(high) > 0) return true;

  // Between two values without extinction, a function linear in pieces can only rise by a control point.
  const auto parameter = [&](double value) { return (value - function.lo) / (function.hi - function.lo); };
  return std::ranges::any_of(function.densities, [&](const TransferFunction::Density& d) {
    return d.extinction > 0 && d.t >= parameter(low) && d.t <= parameter(high);
  });
}

ValueVisibility::ValueVisibility(const TransferFunction& function, const format::Attribute& attribute)
    : function_(function), offset_(attribute.offset) {
  if (std::isnan(attribute.min)) return;

  // Values near a border may have been put into either bin by rounding.
  const double width = (attribute.max - attribute.min) / 64;
  const double largest = std::max(std::abs(attribute.min), std::abs(attribute.max));
  const double margin = 1e-6 * width + 8 * std::numeric_limits<double>::epsilon() * largest;
  for (int b = 0; b < 64; ++b) {
    const double low = attribute.min + b * width;
    if (extinction_within(function, low - margin, low + width + margin)) bins_ |= std::uint64_t{1} << b;
  }
}

bool ValueVisibility::shows(float min, float max, std::uint64_t occupancy) const {
  if (!(min <= max) || (occupancy & bins_) == 0) return false;
  return extinction_within(function_, offset_ + static_cast<double>(min), offset_ + static_cast<double>(max));
}

bool ValueVisibility::operator==(const ValueVisibility& other) const {
  const auto same = [](const TransferFunction::Density& a, const TransferFunction::Density& b) {
    return a.t == b.t && a.extinction == b.extinction;
  };
  return bins_ == other.bins_ && offset_ == other.offset_ && function_.lo == other.function_.lo &&
         function_.hi == other.function_.hi && std::ranges::equal(function_.densities, other.function_.densities, same);
}

}  // namespace splatvol
