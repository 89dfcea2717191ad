// Integrals over the cells of a .svol file.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include "splatvol/geometry.h"

namespace splatvol {

/// What a clip plane leaves: all on the side of its normal.
struct HalfSpace {
  dvec3 point{0};         // of the plane
  dvec3 normal{1, 0, 0};  // any length but 0

  [[nodiscard]] bool operator==(const HalfSpace&) const = default;
};

/// The values of an attribute from `low` to `high`. Infinities: no limit.
struct ValueRange {
  std::string attribute;
  double low = -std::numeric_limits<double>::infinity();
  double high = std::numeric_limits<double>::infinity();

  [[nodiscard]] bool operator==(const ValueRange&) const = default;
};

/// The attributes to integrate, and the region. A point is in the region if it lies in the box and in all half-spaces,
/// and if the values there lie in all ranges. Cells count with the parts of them that lie in the region.
struct IntegralRequest {
  std::vector<std::string> attributes = {};  // empty: all
  std::optional<Box> box = std::nullopt;
  std::vector<HalfSpace> clip_planes = {};
  std::vector<ValueRange> ranges = {};

  [[nodiscard]] bool operator==(const IntegralRequest&) const = default;
};

/// The integral of an attribute over a volume or an area. Without either, the mean, the extremes and their positions
/// are NaN.
struct ValueIntegral {
  std::string name;
  std::string unit;     // of the values, such as "m/s"; empty: not known
  double integral = 0;  // of the values
  double mean = std::numeric_limits<double>::quiet_NaN();
  double low = std::numeric_limits<double>::quiet_NaN(), high = low;  // the least and the greatest value
  dvec3 low_position{low}, high_position{low};                        // where the first in the file has it
};

/// Over cells.
struct Integral : ValueIntegral {
  double volume = 0;          // of the parts with a value
  double missing_volume = 0;  // of those without
};

/// Integrals over a part of the cells of a file.
struct Integrals {
  double volume = 0;          // in the region
  double unknown_volume = 0;  // in the box and the half-spaces, without a value of a range's attribute; not in `volume`
  std::vector<Integral> attributes;
  std::uint64_t left_out = 0;  // cells of the file of shapes that this version does not know
};

/// The surface on which an attribute has a value.
struct ContourSurface {
  std::string attribute;
  double value = 0;

  [[nodiscard]] bool operator==(const ContourSurface&) const = default;
};

/// A surface in the cells: a contour, or the slice by a plane. It is cut by the region of the integrals.
struct SurfaceRequest {
  std::variant<ContourSurface, HalfSpace> surface;
  IntegralRequest integrals = {};

  /// Attributes that are the components of a vector, for its flux. All empty: none.
  std::array<std::string, 3> vector = {};
};

/// Over a surface.
struct SurfaceIntegral : ValueIntegral {
  double area = 0;          // of the parts with a value
  double missing_area = 0;  // of those without
};

/// Integrals over a surface.
struct SurfaceIntegrals {
  double area = 0;
  double unknown_area = 0;  // in the box and the half-spaces, without a value of a range's attribute; not in `area`
  std::vector<SurfaceIntegral> attributes = {};

  /// Of the vector through the surface: along the normal of a slice, and through a contour to where values are lower.
  /// Parts where the vector has no value do not count. NaN without a vector.
  double flux = std::numeric_limits<double>::quiet_NaN();

  /// Inside a contour that is closed and that nothing cuts, where values are higher; negative if it is the border of a
  /// hole. Else NaN.
  double enclosed_volume = std::numeric_limits<double>::quiet_NaN();

  std::uint64_t left_out = 0;  // cells of the file of shapes that this version does not know
};

}  // namespace splatvol
