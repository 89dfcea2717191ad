// The panel's part "measure": integrals over the cells that are seen, contours and slices.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "player/measuring.h"
#include "viewer/state.h"

namespace splatvol {

class MeasureSection {
 public:
  explicit MeasureSection(ViewerState& viewer) : viewer_(viewer) {}

  /// Draws what is to be measured, a button that begins it, and the numbers.
  void draw();

  /// Takes the numbers once they are there, and tells how far they are.
  void draw_progress();

  [[nodiscard]] bool is_begun() const { return measuring_.is_begun(); }

  /// Forgets all: for another file.
  void begin();

  /// Measures no more.
  void end() { measuring_.end(); }

 private:
  void draw_surface(const std::vector<double>& contours);
  void draw_vector();
  void draw_ranges();
  void draw_begin();
  void draw_result() const;
  [[nodiscard]] MeasureRequest request() const;

  ViewerState& viewer_;
  Measuring measuring_;
  std::optional<double> contour_;     // is measured
  std::optional<std::size_t> slice_;  // or this one of the scene's; else cells
  std::string vector_;
  std::vector<ValueRange> ranges_;

  struct Answer {
    MeasureRequest request;
    Measured numbers;
  };
  std::optional<Answer> answer_;
};

}  // namespace splatvol
