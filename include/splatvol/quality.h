// How fine a picture is to be. Component `render`.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

namespace splatvol {

/// The error of a picture for which nothing is asked.
inline constexpr double default_max_error = 0.002;

/// If nothing is asked, all points of a file with up to so many are drawn.
inline constexpr std::uint64_t most_points_at_once = std::uint64_t{1} << 19;

/// If nothing is asked, a picture is exact if its cells make no more segments, pieces of rays in a tetrahedron: about a
/// second's work of two cores. Work is counted, and no clock decides, so a picture does not depend on the machine.
inline constexpr std::uint64_t most_exact_segments = 60'000'000;

/// How fine a picture is to be: at most one of these, or `max_error` with `milliseconds`.
///
/// None of them: the cells of a file that keeps them, exactly, if they make at most `most_exact_segments`. Else all
/// points of a file of up to `most_points_at_once`. Of a larger file, finer and finer pictures, until one has an error
/// of `default_max_error`.
struct Quality {
  std::optional<double> max_error = {};          // root mean square of linear RGB, against the exact picture; measured
  std::optional<std::uint64_t> max_splats = {};  // put where they reduce the error most
  std::optional<double> tolerance_percent = {};  // the largest share of the shorter side for a splat; 0: all points
  std::optional<std::size_t> resolution = {};    // that of all points; 0: the coarsest

  /// Draws the cells of a file that keeps them exactly, by the processor, and no splats.
  bool exact = false;

  /// The best picture that can be there by then. How fast the device is, is learned from picture to picture.
  ///
  /// With `max_error`: for what moves. If the best picture within 1/60 s is expected to have more error, it is the
  /// quickest that has no more, within `milliseconds`. If there is none, it is the best in that time, or in twice that
  /// time if its error is large. Cells are drawn, too, and are held in memory if there is room.
  std::optional<double> milliseconds = {};

  [[nodiscard]] bool operator==(const Quality&) const = default;
};

}  // namespace splatvol
