// Code that all rasterizers share.
#pragma once

#include <chrono>
#include <cstddef>
#include <utility>
#include <vector>

#include "base/error.h"
#include "renderer/rasterizer.h"
#include "renderer/transfer_table.h"
#include "scene/scene.h"
#include "splat/constants.h"
#include "splat/splat.h"

namespace splatvol {

/// What Rasterizer::draw checks first. Fails if the device does not draw pictures of the view's size, or samples as far
/// apart as this.
[[nodiscard]] Status check_drawing(const Capabilities& device, const View& view, int sample_spacing);

/// Fails unless a range of a draw list has records of this kernel, and lies within its row.
[[nodiscard]] Status check_range(const DrawRange& range, KernelKind kernel);

/// Rounds to single precision. Numbers beyond its range become the largest that it has, so that no product is NaN.
[[nodiscard]] float nearest_float(double number);

/// Returns a transfer function with extinctions per drawing unit. Extinctions are at most 1e20 there, so that optical
/// depths fit into single precision: whatever is drawn is opaque at far less. Fails if the function has no control
/// points or an empty domain.
[[nodiscard]] Result<TransferFunction> in_drawing_units(TransferFunction function, const DrawingUnits& units);

/// A function's axis for stored values x, in single precision: t = start + (x - low) * inverse_domain.
struct StoredAxis {
  int kind = 0;              // 0: x itself; 1: log(x - zero); 2: asinh((x - zero) * unit)
  float low = 0;             // the beginning of the domain, on the axis; 0 if single precision cannot hold it
  float start = 0;           // t of `low`
  float inverse_domain = 1;  // 1 / (high - low), on the axis
  float zero = 0;            // the stored value of 0
  float unit = 1;
};
[[nodiscard]] StoredAxis stored_axis(const TransferFunction& function, double value_offset, double value_scale);

/// The mean factors of an opacity, by mean and spread of its attribute's values as in TransferTable.
struct OpacityTable {
  StoredAxis axis;
  std::size_t columns = 0, rows = 0;
  std::vector<float> factors;      // row by row; empty: there is no opacity
  std::vector<float> row_spreads;  // in units of the domain
};

/// Returns the table of SceneOpacity::function; an empty one for null. Fails if the function has no control points, an
/// empty domain, or a factor outside of [0, 1].
[[nodiscard]] Result<OpacityTable> make_opacity_table(const TransferFunction* opacity, const DrawingUnits& units);

/// The size of a kernel's transfer table.
struct TableSize {
  std::size_t columns, rows;
};
[[nodiscard]] constexpr TableSize table_size(KernelKind kernel) {
  constexpr std::size_t margins = 2 * TransferTable::margin;
  return kernel == KernelKind::octant ? TableSize{4097 + margins, 1} : TableSize{513 + margins, 64};
}

/// Largest deviation and distance of t of a splat's values on a linear axis: squares stay finite however narrow the
/// domain is. Mean and deviation shrink by one factor, which changes next to nothing in what the splat shows of the
/// domain: a jump.
using drawing::farthest_t;
using drawing::largest_t_deviation;

/// Entries of level 0 of the peaks (make_peak_levels).
inline constexpr int peak_entries = 1024;

/// Returns an orthographic view along one of the world's axes, for sorting.
[[nodiscard]] View view_along(int axis, const dvec3& eye);

/// Measures the seconds between calls of `lap`; the first call counts from construction.
class Stopwatch {
 public:
  double lap() {
    const auto now = std::chrono::steady_clock::now();
    return std::chrono::duration<double>(now - std::exchange(start_, now)).count();
  }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
};

}  // namespace splatvol
