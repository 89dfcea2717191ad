// How fine a picture is to be (splatvol/quality.h), and how its splats are drawn.
#pragma once

#include <optional>
#include <string_view>

#include "base/error.h"
#include "splat/splat.h"
#include "splatvol/quality.h"

namespace splatvol {

/// Fails with invalid_argument if more than one member is set, or if a number is out of range.
[[nodiscard]] Status check_quality(const Quality& quality);

enum class SortMode {
  none,   // in the order of the draw list
  axis,   // back to front along the world's axis nearest to the line of sight
  exact,  // back to front, by distance to the eye (perspective) or depth (orthographic)
};

inline constexpr int max_sample_spacing = 64;

/// How splats are drawn, for experts and measurements. A member that is not set has the best value.
struct Drawing {
  std::optional<KernelKind> kernel = {};  // moments
  std::optional<SortMode> sort = {};      // exact

  /// Pixels from one sample of the picture to the next, from 1 to max_sample_spacing: the rest is interpolated. Not
  /// set: as many as lose nothing. Exact pictures have it, too: not set, 1.
  std::optional<int> sample_spacing = {};

  [[nodiscard]] bool operator==(const Drawing&) const = default;
};

[[nodiscard]] inline KernelKind kernel_of(const Drawing& drawing) {
  return drawing.kernel.value_or(KernelKind::moments);
}
[[nodiscard]] inline SortMode sort_of(const Drawing& drawing) { return drawing.sort.value_or(SortMode::exact); }

/// Return the words of options and scene files.
[[nodiscard]] std::string_view name_of(KernelKind kernel);
[[nodiscard]] std::string_view name_of(SortMode sort);

/// Return what a word means. None: it is no such word.
[[nodiscard]] std::optional<KernelKind> kernel_named(std::string_view name);
[[nodiscard]] std::optional<SortMode> sort_named(std::string_view name);

/// Returns what `first` sets, and of the rest what `second` sets.
[[nodiscard]] Quality joined(const Quality& first, const Quality& second);
[[nodiscard]] Drawing joined(const Drawing& first, const Drawing& second);

}  // namespace splatvol
