// The panel's part "view".
#pragma once

#include <cstdint>
#include <optional>

#include "viewer/state.h"

namespace splatvol {

/// How fine pictures are, and what they take.
class DetailControls {
 public:
  void draw(Session& session);

 private:
  std::optional<std::uint64_t> memory_shown_;  // MiB, while the slider is held
  double max_error_ = default_max_error;       // the last one, while the detail is by tolerance
};

void draw_lighting_controls(Scene& scene);
void draw_camera_controls(ViewerState& viewer);

/// `bounds`: of the data, where the box begins.
void draw_clip_box_controls(Scene& scene, const Box& bounds);

/// Draws the switches of what is shown besides the picture.
void draw_shown_controls(Scene& scene, Shown& shown);

}  // namespace splatvol
