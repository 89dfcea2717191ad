// The panel's part "camera path".
#pragma once

#include <optional>

#include "player/camera_path.h"
#include "viewer/save_section.h"
#include "viewer/state.h"

namespace splatvol {

/// Holds a path of cameras, and plays it.
class PathSection {
 public:
  PathSection(ViewerState& viewer, SaveSection& save) : viewer_(viewer), save_(save) {}

  void draw();

  /// Moves the session's camera on, while the path plays.
  void play(double seconds);
  void stop() { playing_.reset(); }
  [[nodiscard]] bool is_playing() const { return playing_.has_value(); }

  [[nodiscard]] const CameraPath& path() const { return path_; }

  /// Begins with an empty path, and a name of its file without the ending.
  void begin(const std::string& stem);

 private:
  void draw_views();

  ViewerState& viewer_;
  SaveSection& save_;
  CameraPath path_;
  std::optional<double> playing_;  // seconds since its beginning
  TextField name_;
};

}  // namespace splatvol
