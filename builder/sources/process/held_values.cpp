#include "builder/sources/process/held_values.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace splatvol {

PackedColumn pack_column(std::span<const double> values) {
  // A number beyond single precision must not be converted to it.
  const bool single = std::ranges::all_of(values, [](double value) {
    return std::isnan(value) || (std::abs(value) <= std::numeric_limits<float>::max() &&
                                 static_cast<double>(static_cast<float>(value)) == value);
  });
  if (single) return std::vector<float>(values.begin(), values.end());
  return std::vector<double>(values.begin(), values.end());
}

void HeldValues::get(std::size_t attribute, std::span<const std::uint32_t> points, std::span<double> values) const {
  std::visit(
      [&](const auto& column) {
        std::ranges::transform(points, values.begin(), [&](std::uint32_t point) { return double{column[point]}; });
      },
      columns_[attribute]);
}

}  // namespace splatvol
