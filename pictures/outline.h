// The edges of a box over a picture, and the colours of lines.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "base/math.h"
#include "pictures/image.h"
#include "scene/scene.h"

namespace splatvol {

/// Returns the colour of words and lines on a background: black or white.
[[nodiscard]] dvec3 ink_on(const dvec3& background);

/// Returns the colour of an outline that is seen on black and on white: the grey between them.
[[nodiscard]] dvec3 ink_on_any();

/// A segment as it is seen: pixels from the upper left corner.
struct ProjectedSegment {
  dvec2 from, to;
};

/// Projects a segment, cut off at the eye. None if it lies behind the eye.
[[nodiscard]] std::optional<ProjectedSegment> project(const View& view, const dvec3& from, const dvec3& to);

/// What a line of an outline covers of a pixel.
struct OutlineStroke {
  std::size_t pixel;  // its number in the image
  float opacity;
  bool in_front;  // of the volume; else under it
};

/// Returns the strokes of the edges of a box, in the order of pixels.
[[nodiscard]] std::vector<OutlineStroke> outline_strokes(const View& view, const Box& box);

/// Returns a pixel, linear and premultiplied, with a stroke.
[[nodiscard]] vec4 with_stroke(const vec4& pixel, const OutlineStroke& stroke, const dvec3& ink);

/// Draws the edges of a box: those behind the volume under it, the others over it. `view`: of the image.
void draw_outline(Image& image, const View& view, const Box& box, const dvec3& ink);

}  // namespace splatvol
