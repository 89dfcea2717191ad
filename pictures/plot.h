// Curves over a distance or a time, and their picture.
#pragma once

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "pictures/image.h"

namespace splatvol {

/// The least and the largest of some values; `low` > `high`: there is none.
struct PlotRange {
  double low, high;

  [[nodiscard]] bool is_empty() const { return !(low <= high); }
  /// Returns the range of both.
  [[nodiscard]] PlotRange with(const PlotRange& other) const;
};
[[nodiscard]] PlotRange range_of(std::span<const double> values);

/// Returns the numbers of rows that look like all of them in a plot of so many columns: in each column the first and
/// the last, those of the least and the largest value, and one without a value. `places`: ascending.
[[nodiscard]] std::vector<std::size_t> rows_of_plot(std::span<const double> places, std::span<const double> values,
                                                    std::size_t columns);

/// A curve through rows, linear in between. NaN: a gap.
struct PlotCurve {
  std::string name;            // with its unit
  std::vector<double> values;  // [row]
};

/// Curves over common places. Two rows may have one place, where values jump.
struct CurvePlot {
  std::vector<double> places = {};  // [row]: ascending
  std::vector<PlotCurve> curves = {};
  std::string place_name = {};  // what a place is
  bool has_common_axis = true;  // else each curve fills the height, and its words tell its range
};

/// Returns the colour of a curve by its number, linear: seen on black and on white.
[[nodiscard]] dvec3 color_of_curve(std::size_t number);

/// Returns the range of a curve's axis.
[[nodiscard]] PlotRange axis_of_curve(const CurvePlot& plot, std::size_t number);

/// Draws a plot in black on white, with the colours of its curves. Fails if words leave less than half of the width or
/// the height to it. Requires a row and a curve.
[[nodiscard]] Result<Image> draw_plot(const CurvePlot& plot, int width, int height);

}  // namespace splatvol
