// Curves over a distance or a time, in the window that is being drawn.
#pragma once

#include <imgui.h>

#include <cstddef>
#include <optional>
#include <span>
#include <vector>

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

/// A plot at the place of the next control. Each row has a place; two may have the same, where values jump.
class Plot {
 public:
  /// Draws the ground. `places`: ascending, at least one; they must outlive the plot. `size`: window units.
  Plot(std::span<const double> places, const ImVec2& size);

  /// Fills the area below shares of the height, from 0 to 1.
  void draw_area(std::span<const double> shares) const;

  /// Draws values that are linear between rows. NaN: a gap.
  void draw_curve(std::span<const double> values, const PlotRange& range, ImU32 color) const;

  /// Draws a line across all curves.
  void draw_cursor(double place) const;

  /// Ends the plot. Returns the place under the pointer, if it is over the plot.
  [[nodiscard]] std::optional<double> end() const;

 private:
  [[nodiscard]] float x_of(double place) const;
  [[nodiscard]] float y_of(double share) const { return corner_.y + size_.y * (1 - static_cast<float>(share)); }

  std::span<const double> places_;
  ImVec2 corner_, size_;
};

}  // namespace splatvol
