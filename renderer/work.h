// What pictures cost: counted work times nanoseconds that do not change.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace splatvol {

/// Nanoseconds of one splat, fragment and so on, on two cores of one machine. `tile_bench --fit` measures them, and a
/// person writes them here. Every machine chooses by these numbers, so that all draw the same picture. Estimates of
/// single pictures are a factor of 1.2 off in the geometric mean, and at most about 2.
namespace nanoseconds {
inline constexpr double of_picture = 110000;  // of splats, besides
inline constexpr double of_splat = 68;
inline constexpr double of_fragment = 0.95;
inline constexpr double of_interpolated_pixel = 1;  // where samples are wider than pixels
inline constexpr double of_tetrahedron = 1.2;
inline constexpr double of_unread_tetrahedron = 230;  // to read it from a disk, and to decode it
inline constexpr double of_row = 26;                  // of samples in a tetrahedron
inline constexpr double of_segment = 2.2;
}  // namespace nanoseconds

/// Of n splats of a view, about cbrt(n) times as many lie one behind the other as of a single one. Returns how many
/// layers that would have. `fragments`: of so many splats. `samples`: of the picture.
[[nodiscard]] inline double layers_of_one_splat(double fragments, double splats, double samples) {
  return fragments / samples / std::cbrt(splats);
}

/// Returns the fragments of so many splats, from that.
[[nodiscard]] inline double fragments_of_splats(double layers_of_one, double splats, double samples) {
  return layers_of_one * std::cbrt(splats) * samples;
}

/// Returns the estimated work of a picture of splats that are chosen, in nanoseconds. `fragments`: as FrameTimes counts
/// them. `pixels`: of the picture.
[[nodiscard]] inline double work_of_splats(double splats, double fragments, double pixels, int sample_spacing) {
  const double interpolated = sample_spacing > 1 ? pixels : 0;
  return nanoseconds::of_picture + nanoseconds::of_splat * splats + nanoseconds::of_fragment * fragments +
         nanoseconds::of_interpolated_pixel * interpolated;
}

/// The cells of a view.
struct CellCounts {
  double tetrahedra = 0;
  double segments = 0;      // of a picture with a sample in each pixel
  double segment_work = 1;  // as the function of this name
  double unread = 0;        // tetrahedra that are not in memory
};

/// Returns the segments of a picture with fewer samples.
[[nodiscard]] inline double sampled_segments(const CellCounts& cells, int sample_spacing) {
  return cells.segments / (sample_spacing * sample_spacing);
}

/// Returns how many segments of a function of few pieces are as much work as one of a function of so many.
[[nodiscard]] inline double segment_work(std::size_t pieces) {
  constexpr double few = 16, of_piece = 0.0017;
  return 1 + of_piece * std::max(static_cast<double>(pieces) - few, 0.0);
}

/// Returns the estimated work of an exact picture of cells, in nanoseconds.
[[nodiscard]] inline double work_of_cells(const CellCounts& cells, double pixels, int sample_spacing) {
  const double interpolated = sample_spacing > 1 ? pixels : 0;
  const double sampled = sampled_segments(cells, sample_spacing);
  const double rows = std::sqrt(cells.tetrahedra * sampled);  // n samples of a tetrahedron lie in about sqrt(n) rows
  return nanoseconds::of_unread_tetrahedron * cells.unread + nanoseconds::of_tetrahedron * cells.tetrahedra +
         nanoseconds::of_row * rows + nanoseconds::of_segment * cells.segment_work * sampled +
         nanoseconds::of_interpolated_pixel * interpolated;
}

}  // namespace splatvol
