#include "pictures/outline.h"

#include <algorithm>

#include "pictures/contrast.h"
#include "pictures/line.h"

namespace splatvol {
namespace {

// Returns whether the eye sees a side of the box from outside.
bool faces_eye(const View& view, const Box& box, int axis, bool high) {
  if (view.orthographic) return high ? view.forward[axis] < 0 : view.forward[axis] > 0;
  return high ? view.eye[axis] > box.high[axis] : view.eye[axis] < box.low[axis];
}

}  // namespace

dvec3 ink_on(const dvec3& background) { return dvec3(is_light(background) ? 0 : 1); }

dvec3 ink_on_any() { return dvec3(0.184); }

std::optional<ProjectedSegment> project(const View& view, const dvec3& from, const dvec3& to) {
  dvec3 a = view.to_view(from), b = view.to_view(to);
  if (!view.orthographic) {
    const double nearest = 1e-6 * std::max(glm::length(a), glm::length(b));
    if (a.z <= nearest && b.z <= nearest) return {};
    if (a.z < nearest) a += (nearest - a.z) / (b.z - a.z) * (b - a);
    if (b.z < nearest) b += (nearest - b.z) / (a.z - b.z) * (a - b);
  }
  const auto pixel = [&](const dvec3& p) {
    const double f = view.focal / (view.orthographic ? 1 : p.z);
    return dvec2(0.5 * view.width + f * p.x, 0.5 * view.height - f * p.y);
  };
  return ProjectedSegment{pixel(a), pixel(b)};
}

std::vector<OutlineStroke> outline_strokes(const View& view, const Box& box) {
  constexpr double opacity = 0.5;
  const double width = std::max(1.0, std::min(view.width, view.height) / 700.0);
  std::vector<OutlineStroke> strokes;
  const auto corner = [&](unsigned c) {
    return dvec3(c & 1 ? box.high.x : box.low.x, c & 2 ? box.high.y : box.low.y, c & 4 ? box.high.z : box.low.z);
  };
  for (unsigned c = 0; c < 8; ++c)
    for (int axis = 0; axis < 3; ++axis) {
      const unsigned bit = 1u << axis;
      const auto line = c & bit ? std::nullopt : project(view, corner(c), corner(c | bit));
      if (!line) continue;
      const int u = (axis + 1) % 3, v = (axis + 2) % 3;
      const bool front = faces_eye(view, box, u, c & 1u << u) || faces_eye(view, box, v, c & 1u << v);
      visit_line(*line, width, view.width, view.height, [&](int x, int y, double share) {
        const auto pixel =
            static_cast<std::size_t>(y) * static_cast<std::size_t>(view.width) + static_cast<std::size_t>(x);
        strokes.push_back({pixel, static_cast<float>(opacity * share), front});
      });
    }
  std::ranges::stable_sort(strokes, {}, &OutlineStroke::pixel);
  return strokes;
}

vec4 with_stroke(const vec4& pixel, const OutlineStroke& stroke, const dvec3& ink) {
  const vec4 light = vec4(vec3(ink), 1) * stroke.opacity;
  return stroke.in_front ? light + (1 - light.a) * pixel : pixel + (1 - pixel.a) * light;
}

void draw_outline(Image& image, const View& view, const Box& box, const dvec3& ink) {
  for (const OutlineStroke& stroke : outline_strokes(view, box))
    image.pixels[stroke.pixel] = with_stroke(image.pixels[stroke.pixel], stroke, ink);
}

}  // namespace splatvol
