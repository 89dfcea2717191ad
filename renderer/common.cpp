#include "renderer/common.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace splatvol {

float nearest_float(double number) {
  constexpr double largest = std::numeric_limits<float>::max();
  return static_cast<float>(std::clamp(number, -largest, largest));
}

Result<TransferFunction> in_drawing_units(TransferFunction function, const DrawingUnits& units) {
  constexpr double most_extinction = 1e20;
  for (TransferFunction::Density& density : function.densities)
    density.extinction = std::min(density.extinction * units.length, most_extinction);
  if (function.colors.empty() || function.densities.empty() || !(function.lo < function.hi) ||
      (function.axis == ValueAxis::log && !(function.lo > 0)))
    return fail(ErrorCode::invalid_argument, "transfer function: no control points, or an empty domain");
  return function;
}

StoredAxis stored_axis(const TransferFunction& function, const DrawingUnits& units) {
  StoredAxis axis;
  axis.zero = nearest_float(-units.value_offset / units.value_scale);
  double low = (function.lo - units.value_offset) / units.value_scale;
  double width = (function.hi - function.lo) / units.value_scale;
  if (function.axis == ValueAxis::log) {
    axis.kind = 1;
    low = std::log(function.lo / units.value_scale);
    width = std::log(function.hi / function.lo);
  } else if (function.axis == ValueAxis::asinh) {
    axis.kind = 2;
    axis.unit = nearest_float(units.value_scale / function.linear_width);
    low = std::asinh(function.lo / function.linear_width);
    width = std::asinh(function.hi / function.linear_width) - low;
  }
  axis.inverse_domain = nearest_float(1 / width);
  constexpr double largest_low = 1e30;  // single precision holds differences from it
  if (std::abs(low) < largest_low)
    axis.low = nearest_float(low);
  else
    axis.start = nearest_float(-low / width);
  return axis;
}

View view_along(int axis, const dvec3& eye) {
  View view{};
  view.orthographic = true;
  view.eye = eye;
  view.forward[axis] = 1;
  return view;
}

}  // namespace splatvol
