// Curves over a distance or a time, in the window that is being drawn.
#pragma once

#include <imgui.h>

#include <optional>
#include <span>

#include "pictures/plot.h"

namespace splatvol {

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
