#include "viewer/frame_loop.h"

#include <iterator>
#include <utility>

namespace splatvol {

bool FrameLoop::needs_frame() const {
  constexpr double shortest = 1.0 / 30;  // between frames beside a picture that is drawn
  const Session* session = viewer_.session();
  if (session && session->awaits_picture() && input_.seconds < shortest) return false;
  if (!input_.events.empty()) return true;
  return !viewer_.is_settled(input_.seconds) && !viewer_.awaits_picture(input_.seconds);
}

Result<bool> FrameLoop::step() {
  const Session* session = viewer_.session();
  constexpr double picture_patience = 0.001;
  const bool waits = !input_.events.empty() && session && session->awaits_picture();
  FrameInput taken = stage_.take_input(waits ? picture_patience : viewer_.patience(input_.seconds));
  input_.seconds += taken.seconds;
  std::move(taken.events.begin(), taken.events.end(), std::back_inserter(input_.events));
  if (!needs_frame()) return false;
  const FrameInput input = std::exchange(input_, {});
  SPLATVOL_TRY(stage_.begin(input));
  SPLATVOL_TRY(viewer_.frame(input));
  if (viewer_.has_drawn()) stage_.show();
  return viewer_.has_drawn();
}

}  // namespace splatvol
