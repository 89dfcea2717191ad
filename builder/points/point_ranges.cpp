#include "builder/points/point_ranges.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "builder/mesh/usable_numbers.h"

namespace splatvol {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

// Single precision loses the detail of a narrow range far from zero (pressures round 101325 Pa); an offset keeps it.
double choose_offset(double low, double high) {
  const double largest = std::max(std::abs(low), std::abs(high));
  const bool fine = largest * std::exp2(-24) <= (high - low) * std::exp2(-16);
  return largest == 0 || fine ? 0.0 : low + (high - low) / 2;
}

// Single precision holds numbers from 1e-38 to 3e38, and their squares within the roots of these. A scale brings
// smaller values to 1, and larger ones to the upper root: then values 1e57 times as small are still there.
double choose_scale(double largest) {
  constexpr int most_bits = 63;
  const double most = std::exp2(most_bits);
  if (largest > most) return std::exp2(std::ilogb(largest) - most_bits);
  return largest == 0 || largest >= 1 / most ? 1.0 : std::exp2(std::ilogb(largest));
}

}  // namespace

PointRanges::PointRanges(std::size_t attributes)
    : low(attributes, infinity), high(attributes, -infinity), least(attributes, infinity) {}

void PointRanges::include_value(std::size_t attribute, double value) {
  value += 0.0;  // not -0: the ranges do not depend on the order of the points
  // Every comparison with NaN is false.
  if (value < low[attribute]) low[attribute] = value;
  if (value > high[attribute]) high[attribute] = value;
  if (value != 0 && std::abs(value) < least[attribute]) least[attribute] = std::abs(value);
}

void PointRanges::include(const PointRanges& other) {
  box.include(other.box);
  for (std::size_t a = 0; a < low.size(); ++a) {
    low[a] = std::min(low[a], other.low[a]);
    high[a] = std::max(high[a], other.high[a]);
    least[a] = std::min(least[a], other.least[a]);
  }
}

Result<Cube> bounding_cube(const Box& box) {
  const dvec3 extent = box.high - box.low;
  const double edge = std::max({extent.x, extent.y, extent.z});
  if (edge > 0 && edge < least_extent)
    return fail(ErrorCode::invalid_data, "the points lie within {:g} of each other: give lengths in a smaller unit",
                edge);
  return Cube{box.low + 0.0, edge > 0 ? edge : 1.0};  // not -0, as in PointRanges
}

format::Attribute describe_attribute(const std::string& name, double low, double high) {
  format::Attribute attribute;
  attribute.name = name;
  if (!(low <= high)) return attribute;
  attribute.offset = choose_offset(low, high);
  attribute.scale = choose_scale(std::max(high - attribute.offset, attribute.offset - low));
  // The range is that of the stored values, so that bins agree with these to the last bit.
  attribute.min = attribute.value(static_cast<float>(attribute.stored(low)));
  attribute.max = attribute.value(static_cast<float>(attribute.stored(high)));
  return attribute;
}

}  // namespace splatvol
