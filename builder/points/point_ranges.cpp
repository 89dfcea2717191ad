#include "builder/points/point_ranges.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace splatvol {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

// Single precision loses the detail of a narrow range far from zero (pressures round 101325 Pa); an offset keeps it.
double choose_offset(double low, double high) {
  const double largest = std::max(std::abs(low), std::abs(high));
  const bool fine = largest * std::exp2(-24) <= (high - low) * std::exp2(-16);
  return largest == 0 || fine ? 0.0 : low + (high - low) / 2;
}

}  // namespace

PointRanges::PointRanges(std::size_t attributes) : low(attributes, infinity), high(attributes, -infinity) {}

void PointRanges::include(const PointRanges& other) {
  box.include(other.box);
  for (std::size_t a = 0; a < low.size(); ++a) {
    low[a] = std::min(low[a], other.low[a]);
    high[a] = std::max(high[a], other.high[a]);
  }
}

Result<Cube> bounding_cube(const Box& box) {
  const dvec3 extent = box.high - box.low;
  const double edge = std::max({extent.x, extent.y, extent.z});
  if (!std::isfinite(edge)) return fail(ErrorCode::invalid_data, "the points lie too far apart for double precision");
  return Cube{box.low, edge > std::numeric_limits<double>::min() ? edge : 1.0};
}

format::Attribute describe_attribute(const std::string& name, double low, double high) {
  format::Attribute attribute;
  attribute.name = name;
  if (!(low <= high)) return attribute;
  attribute.offset = choose_offset(low, high);
  // The range is that of the stored values, so that bins agree with these to the last bit.
  attribute.min = attribute.offset + static_cast<float>(low - attribute.offset);
  attribute.max = attribute.offset + static_cast<float>(high - attribute.offset);
  return attribute;
}

}  // namespace splatvol
