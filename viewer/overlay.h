// Lines and words over the picture. Drawn with Dear ImGui, behind its windows.
#pragma once

#include <array>

#include "format/volume_info.h"
#include "scene/scene.h"
#include "streamer/streamer.h"

namespace splatvol {

/// From pixels of the picture to units of the window.
struct OverlayScale {
  double x = 1, y = 1;
};

/// The box's twelve edges.
void draw_box(const View& view, const Box& box, const std::array<unsigned char, 3>& color, OverlayScale scale);

/// The nodes that a frame draws, coloured by resolution.
void draw_cut(const View& view, const FrameSplats& frame, std::size_t resolutions, OverlayScale scale);

/// The world's axes as the camera sees them, in the lower left corner right of `left`.
void draw_axes(const View& view, double left, double bottom);

/// Colours and values of a transfer function, at the right edge.
void draw_scalar_bar(const TransferFunction& function, const format::Attribute& attribute, double right, double bottom);

/// Words in the middle of the window.
void draw_message(const std::string& text, double width, double height);

}  // namespace splatvol
