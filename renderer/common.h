// Code that all rasterizers share.
#pragma once

#include <chrono>
#include <cstddef>
#include <utility>

#include "base/error.h"
#include "scene/scene.h"
#include "streamer/splat.h"

namespace splatvol {

/// Rounds to single precision. Numbers beyond its range become the largest that it has, so that no product is NaN.
[[nodiscard]] float nearest_float(double number);

/// Returns a transfer function with extinctions per drawing unit. Fails if it has no control points or an empty domain.
[[nodiscard]] Result<TransferFunction> in_drawing_units(TransferFunction function, const DrawingUnits& units);

/// A transfer function's axis for stored values x, in single precision.
struct StoredAxis {
  int kind = 0;              // 0: x itself; 1: log(x - zero); 2: asinh((x - zero) * unit)
  float low = 0;             // the beginning of the domain, on the axis
  float inverse_domain = 1;  // 1 / (high - low), on the axis
  float zero = 0;            // the stored value of 0
  float unit = 1;
};
[[nodiscard]] StoredAxis stored_axis(const TransferFunction& function, const DrawingUnits& units);

/// The size of a kernel's transfer table.
struct TableSize {
  std::size_t columns, rows;
};
[[nodiscard]] constexpr TableSize table_size(KernelKind kernel) {
  return kernel == KernelKind::octant ? TableSize{4097, 1} : TableSize{513, 64};
}

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
