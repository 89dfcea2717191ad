#include "scene/drawing.h"

#include <cmath>

namespace splatvol {

Status check_quality(const Quality& quality) {
  const int told = quality.max_error.has_value() + quality.max_splats.has_value() +
                   quality.tolerance_percent.has_value() + quality.resolution.has_value() +
                   quality.milliseconds.has_value() + (quality.exact ? 1 : 0);
  const bool is_of_motion = told == 2 && quality.max_error && quality.milliseconds;
  if (told > 1 && !is_of_motion)
    return fail(ErrorCode::invalid_argument,
                "give one of max_error, splats, tolerance, resolution, milliseconds and exact, or max_error with "
                "milliseconds, not {}",
                told);
  if (quality.max_error && !(*quality.max_error > 0 && std::isfinite(*quality.max_error)))
    return fail(ErrorCode::invalid_argument, "an error of {}: take one above 0", *quality.max_error);
  if (quality.max_splats && *quality.max_splats == 0)
    return fail(ErrorCode::invalid_argument, "0 splats show nothing: take more");
  if (quality.tolerance_percent && !(*quality.tolerance_percent >= 0))
    return fail(ErrorCode::invalid_argument, "a tolerance of {} % is out of range", *quality.tolerance_percent);
  if (quality.milliseconds && !(*quality.milliseconds > 0 && std::isfinite(*quality.milliseconds)))
    return fail(ErrorCode::invalid_argument, "{} milliseconds are no time to draw in", *quality.milliseconds);
  return {};
}

std::string_view name_of(KernelKind kernel) { return kernel == KernelKind::octant ? "octant" : "moments"; }

std::string_view name_of(SortMode sort) {
  if (sort == SortMode::none) return "none";
  return sort == SortMode::axis ? "axis" : "exact";
}

std::optional<KernelKind> kernel_named(std::string_view name) {
  for (const KernelKind kernel : {KernelKind::moments, KernelKind::octant})
    if (name == name_of(kernel)) return kernel;
  return {};
}

std::optional<SortMode> sort_named(std::string_view name) {
  for (const SortMode sort : {SortMode::none, SortMode::axis, SortMode::exact})
    if (name == name_of(sort)) return sort;
  return {};
}

Quality joined(const Quality& first, const Quality& second) { return first == Quality() ? second : first; }

Drawing joined(const Drawing& first, const Drawing& second) {
  const auto either = [](const auto& a, const auto& b) { return a ? a : b; };
  return {either(first.kernel, second.kernel), either(first.sort, second.sort),
          either(first.sample_spacing, second.sample_spacing)};
}

}  // namespace splatvol
