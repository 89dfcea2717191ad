// Which coordinates and values of an input can be used. Programs write fill values where there is no number.
#pragma once

#include <cmath>
#include <limits>

#include "base/math.h"

namespace splatvol {

/// Largest magnitude of a coordinate, and the least edge of a box round points that do not coincide. Products of five
/// lengths between them stay in the range of double precision.
inline constexpr double largest_coordinate = 1e50;
inline constexpr double least_extent = 1e-50;

/// Largest magnitude of a value: its square stays in the range of double precision.
inline constexpr double largest_value = 1e100;

/// Whether a number is what common programs write where there is none: NetCDF's default for numbers with a fraction, or
/// the largest number of single precision.
[[nodiscard]] inline bool is_fill_of_reals(double number) {
  constexpr double netcdf = 0x1.ep122;  // 9.969209968386869e36
  const double magnitude = std::abs(number);
  return magnitude == netcdf || magnitude == double{std::numeric_limits<float>::max()};
}

/// Whether a number is what common programs write where there is none: is_fill_of_reals, or NetCDF's default for
/// integers of 32 and 64 bits. Its defaults for shorter integers, such as 255, are ordinary values too.
[[nodiscard]] inline bool is_fill_value(double number) {
  constexpr double int32 = -2147483647, uint32 = 4294967295;
  constexpr double int64 = -9223372036854775806.0, uint64 = 18446744073709551614.0;  // as double precision has them
  return is_fill_of_reals(number) || number == int32 || number == uint32 || number == int64 || number == uint64;
}

[[nodiscard]] inline bool is_usable_coordinate(double number) {
  return std::abs(number) <= largest_coordinate && !is_fill_of_reals(number);
}

/// Whether all coordinates are finite, within `largest_coordinate`, and no fill value.
[[nodiscard]] inline bool is_usable_position(const dvec3& p) {
  return is_usable_coordinate(p.x) && is_usable_coordinate(p.y) && is_usable_coordinate(p.z);
}

}  // namespace splatvol
