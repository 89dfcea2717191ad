#include "renderer/common.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace splatvol {
namespace {

Status check_function(const TransferFunction& function) {
  if (function.colors.empty() || function.densities.empty() || !(function.lo < function.hi) ||
      (function.axis == ValueAxis::log && !(function.lo > 0)))
    return fail(ErrorCode::invalid_argument, "transfer function: no control points, or an empty domain");
  return {};
}

}  // namespace

Status check_drawing(const Capabilities& device, const View& view, int sample_spacing) {
  if (sample_spacing < 1 || sample_spacing > max_sample_spacing)
    return fail(ErrorCode::invalid_argument, "samples every {} pixels: 1 to {} are possible", sample_spacing,
                max_sample_spacing);
  const auto [least, largest] = std::minmax(view.width, view.height);
  if (least < 1 || largest > device.largest_side)
    return fail(ErrorCode::invalid_argument, "a picture of {} x {} pixels: 1 to {} on each side are possible",
                view.width, view.height, device.largest_side);
  return {};
}

Status check_range(const DrawRange& range, KernelKind kernel) {
  const bool moments = kernel == KernelKind::moments;
  if (!range.row.shapes || !range.row.values ||
      moments != std::holds_alternative<std::vector<MomentsShape>>(range.row.shapes->records()) ||
      moments != std::holds_alternative<std::vector<MomentsValue>>(range.row.values->records()))
    return fail(ErrorCode::invalid_argument, "splats of the kernel {} cannot be drawn with the other one",
                moments ? "octant" : "moments");
  const std::uint64_t end = std::uint64_t{range.begin} + range.count;
  if (end > range.row.shapes->size() || end > range.row.values->size() ||
      range.block >= range.row.shapes->blocks().size())
    return fail(ErrorCode::invalid_argument, "a range reaches beyond the {} records of its row",
                range.row.shapes->size());
  return {};
}

float nearest_float(double number) {
  constexpr double largest = std::numeric_limits<float>::max();
  return static_cast<float>(std::clamp(number, -largest, largest));
}

Result<TransferFunction> in_drawing_units(TransferFunction function, const DrawingUnits& units) {
  constexpr double most_extinction = 1e20;
  const double unit = units.length * std::exchange(function.density_factor, 1);
  for (TransferFunction::Density& density : function.densities)
    density.extinction = std::min(density.extinction * unit, most_extinction);
  SPLATVOL_TRY(check_function(function));
  return function;
}

Result<OpacityTable> make_opacity_table(const TransferFunction* opacity, const DrawingUnits& units) {
  if (!opacity) return OpacityTable{};
  TransferFunction function = *opacity;
  function.colors = {{0, dvec3(0)}};
  SPLATVOL_TRY(check_function(function));
  for (const TransferFunction::Density& factor : function.densities)
    if (!(factor.extinction >= 0 && factor.extinction <= 1))
      return fail(ErrorCode::invalid_argument, "opacity: a factor of {} is outside [0, 1]", factor.extinction);
  const TableSize size = table_size(KernelKind::moments);
  const TransferTable averaged = make_transfer_table(function, size.columns, size.rows);
  OpacityTable table{stored_axis(function, units.opacity_offset, units.opacity_scale), size.columns, size.rows, {}, {}};
  for (const vec4& entry : averaged.entries) table.factors.push_back(entry.a);
  for (std::size_t row = 0; row < size.rows; ++row)
    table.row_spreads.push_back(static_cast<float>(averaged.spread(row)));
  return table;
}

StoredAxis stored_axis(const TransferFunction& function, double value_offset, double value_scale) {
  StoredAxis axis{.zero = nearest_float(-value_offset / value_scale)};
  double low = (function.lo - value_offset) / value_scale;
  double width = (function.hi - function.lo) / value_scale;
  if (function.axis == ValueAxis::log) {
    axis.kind = 1;
    low = std::log(function.lo / value_scale);
    width = std::log(function.hi / function.lo);
  } else if (function.axis == ValueAxis::asinh) {
    axis.kind = 2;
    axis.unit = nearest_float(value_scale / function.linear_width);
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
