#include "builder/sources/source.h"

namespace splatvol {

MissingValues::MissingValues(const std::vector<double>& given) {
  for (const double value : given) {
    given_.push_back(value);
    given_.push_back(static_cast<float>(value));
  }
}

std::uint64_t MissingValues::replace(std::span<double> values) const {
  std::uint64_t fills = 0;
  for (double& value : values) {
    if (!has(value)) continue;
    fills += std::isfinite(value) ? 1 : 0;
    value = missing_value;
  }
  return fills;
}

}  // namespace splatvol
