// Words over the picture: numbers, and the list of keys. Drawn with Dear ImGui.
#pragma once

#include "viewer/state.h"

namespace splatvol {

/// Draws the numbers of the session's picture, where there is room. Returns where they end; 0: there was no room.
/// `frame_seconds`: from one frame to the next.
float draw_hud(ViewerState& viewer, double frame_seconds);

/// Draws the list of keys. The user may close it.
void draw_keys(ViewerState& viewer);

}  // namespace splatvol
