// Integrals over the cells of a .svol file.
#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "splatvol/geometry.h"

namespace splatvol {

/// What a clip plane leaves: all on the side of its normal.
struct HalfSpace {
  dvec3 point{0};         // of the plane
  dvec3 normal{1, 0, 0};  // any length but 0
};

/// The values of an attribute from `low` to `high`. Infinities: no limit.
struct ValueRange {
  std::string attribute;
  double low = -std::numeric_limits<double>::infinity();
  double high = std::numeric_limits<double>::infinity();
};

/// The attributes to integrate, and the region. A point is in the region if it lies in the box and in all half-spaces,
/// and if the values there lie in all ranges. Cells count with the parts of them that lie in the region.
struct IntegralRequest {
  std::vector<std::string> attributes = {};  // empty: all
  std::optional<Box> box = std::nullopt;
  std::vector<HalfSpace> clip_planes = {};
  std::vector<ValueRange> ranges = {};
};

/// The integral of an attribute. Without volume, the mean, the extremes and their positions are NaN.
struct Integral {
  std::string name;
  std::string unit;           // of the values, such as "m/s"; empty: not known
  double volume = 0;          // of the parts with a value
  double missing_volume = 0;  // of those without
  double integral = 0;        // of the values over the volume
  double mean = std::numeric_limits<double>::quiet_NaN();
  double low = std::numeric_limits<double>::quiet_NaN(), high = low;  // the least and the greatest value
  dvec3 low_position{low}, high_position{low};                        // where the first in the file has it
};

/// Integrals over a part of the cells of a file.
struct Integrals {
  double volume = 0;          // in the region
  double unknown_volume = 0;  // in the box and the half-spaces, without a value of a range's attribute; not in `volume`
  std::vector<Integral> attributes;
  std::uint64_t left_out = 0;  // cells of the file of shapes that this version does not know
};

}  // namespace splatvol
