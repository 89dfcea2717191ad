// Lines and words over the picture. Drawn with Dear ImGui, behind its windows.
#pragma once

#include <array>
#include <span>
#include <string>

#include "pictures/page.h"
#include "scene/scene.h"
#include "streamer/splats/streamer.h"

namespace splatvol {

/// The picture's area in the window, in window units, and the window units that a pixel of the picture takes.
struct PictureArea {
  double left = 0;
  double width = 1, height = 1;
  double unit_x = 1, unit_y = 1;
};

/// Draws the box's twelve edges.
void draw_box(const View& view, const Box& box, const std::array<unsigned char, 3>& color, const PictureArea& area);

/// Draws the nodes of the cut, coloured by resolution.
void draw_cut(const View& view, std::span<const DrawnNode> nodes, std::size_t resolutions, const PictureArea& area);

/// Draws the world's axes as the camera sees them, in the picture's lower left corner.
void draw_axes(const View& view, const PictureArea& area);

/// Draws scalar bars beside each other at the right edge, as many as half of the picture has room for; words in `ink`.
void draw_scalar_bars(std::span<const PageBar> bars, int ticks, const dvec3& ink, const PictureArea& area);

/// Draws a text in the middle of the picture.
void draw_message(const std::string& text, const PictureArea& area);

}  // namespace splatvol
