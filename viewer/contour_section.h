// The panel's part "contours".
#pragma once

#include "player/session.h"

namespace splatvol {

/// Draws the contours of the session's scene with their values, colours and opacities, and changes them.
void draw_contour_section(Session& session);

}  // namespace splatvol
