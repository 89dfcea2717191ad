// When a viewer's frames are drawn: for events, for pictures that come, and else not.
#pragma once

#include <functional>

#include "base/error.h"
#include "player/events.h"
#include "viewer/viewer.h"

namespace splatvol {

/// A window, or its stand-in, for a loop of frames.
struct FrameStage {
  std::function<FrameInput(double seconds)> take_input;  // waits for events up to a time; all since the last call
  std::function<Status(const FrameInput&)> begin;        // before a frame: binds its framebuffer
  std::function<void()> show;                            // shows a frame that was drawn
};

/// Draws a viewer's frames on a stage. While a thread draws a picture, the loop leaves the processor to it: events
/// come together in a frame each 1/60 s. The frame that takes over the picture knows all events up to then.
class FrameLoop {
 public:
  /// The viewer outlives the loop.
  FrameLoop(Viewer& viewer, FrameStage stage) : viewer_(viewer), stage_(std::move(stage)) {}

  /// Waits until something happens, but a second at most, and draws a frame if one is needed. Returns whether a frame
  /// was shown.
  [[nodiscard]] Result<bool> step();

 private:
  [[nodiscard]] bool needs_frame() const;

  Viewer& viewer_;
  FrameStage stage_;
  FrameInput input_;  // since the last frame
};

}  // namespace splatvol
