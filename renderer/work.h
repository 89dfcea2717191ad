// What pictures cost: counted work times nanoseconds that do not change.
#pragma once

#include <cmath>

namespace splatvol {

/// Nanoseconds of one splat, fragment and so on, on two cores of one machine. `tile_bench --fit` measures them, and a
/// person writes them here. Every machine chooses by these numbers, so that all draw the same picture.
namespace nanoseconds {
inline constexpr double of_splat = 45;
inline constexpr double of_fragment = 0.8;
inline constexpr double of_interpolated_pixel = 3.2;  // where samples are wider than pixels
inline constexpr double of_tetrahedron = 35;
inline constexpr double of_segment = 7.5;
}  // namespace nanoseconds

/// Returns the estimated work of a picture of splats, in nanoseconds. `fragments`: as FrameTimes counts them. `pixels`:
/// of the picture.
[[nodiscard]] inline double work_of_splats(double splats, double fragments, double pixels, int sample_spacing) {
  const double interpolated = sample_spacing > 1 ? pixels : 0;
  return nanoseconds::of_splat * splats + nanoseconds::of_fragment * fragments +
         nanoseconds::of_interpolated_pixel * interpolated;
}

/// Returns the same of an exact picture. `segments`: with a sample in each pixel. The fewer samples, the more each one
/// takes.
[[nodiscard]] inline double work_of_cells(double tetrahedra, double segments, double pixels, int sample_spacing) {
  constexpr double samples_by_spacing = 1.6;  // a power
  const double interpolated = sample_spacing > 1 ? pixels : 0;
  return nanoseconds::of_tetrahedron * tetrahedra +
         nanoseconds::of_segment * segments / std::pow(sample_spacing, samples_by_spacing) +
         nanoseconds::of_interpolated_pixel * interpolated;
}

}  // namespace splatvol
