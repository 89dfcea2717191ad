// The panel's part "contours".
#pragma once

#include <atomic>
#include <cstddef>
#include <memory>
#include <string>

#include "player/measuring.h"
#include "player/session.h"
#include "viewer/save_section.h"
#include "viewer/state.h"

namespace splatvol {

class ContourSection {
 public:
  ContourSection(ViewerState& viewer, SaveSection& save) : viewer_(viewer), save_(save) {}

  /// Draws the contours of the session's scene with their values, colours, opacities and sizes, and changes them.
  void draw();

  /// Tells of a contour that is being exported, and of its end.
  void draw_progress();

  [[nodiscard]] bool is_exporting() const { return exported_.is_begun(); }
  void stop_exporting() { exported_.interrupt(); }

  /// Forgets that the section was drawn: it measures only where it is open.
  void begin_frame() { is_drawn_ = false; }

  /// Whether sizes are on their way that the section shows.
  [[nodiscard]] bool is_measuring() const { return is_drawn_ && measures_.is_busy(); }

  /// Sets the name of the exported file, without its ending. Forgets the sizes.
  void begin(const std::string& stem);

  /// Ends what measures.
  void end() { measures_.reset(); }

 private:
  void draw_contour(SceneContour& contour);
  void draw_values(SceneContour& contour);
  void draw_size(double value);
  void export_contour(double value);
  void measure();

  ViewerState& viewer_;
  SaveSection& save_;
  TextField name_;
  ContourMeasures measures_;
  bool is_drawn_ = false;

  // The contour that is being exported.
  std::string path_;
  std::shared_ptr<std::atomic<double>> share_;
  Task<Result<std::uint64_t>> exported_;
};

}  // namespace splatvol
