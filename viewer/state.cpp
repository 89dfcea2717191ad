#include "viewer/state.h"

#include <algorithm>

namespace splatvol {

PictureArea ViewerState::picture_area() const {
  PictureArea area;
  const double panel = shown.panel && !is_narrow() ? panel_width * window.content_scale : 0;
  area.unit_x = static_cast<double>(window.width) / std::max(1, window.pixel_width);
  area.unit_y = static_cast<double>(window.height) / std::max(1, window.pixel_height);
  area.width = std::max(area.unit_x, window.width - panel);
  area.left = shown.panel_right ? 0 : std::max(0.0, window.width - area.width);
  area.height = std::max(area.unit_y, static_cast<double>(window.height));
  return area;
}

std::array<int, 2> ViewerState::picture_size() const {
  const PictureArea area = picture_area();
  return {std::max(1, static_cast<int>(area.width / area.unit_x)), window.pixel_height};
}

dvec2 ViewerState::window_units() const {
  const PictureArea area = picture_area();
  const auto [width, height] = picture_size();
  const View& view = session->view();
  return dvec2(area.unit_x * width, area.unit_y * height) / dvec2(std::max(view.width, 1), std::max(view.height, 1));
}

std::optional<dvec2> ViewerState::window_position(const dvec3& position) const {
  const View& view = session->view();
  const dvec3 at = view.to_view(position);
  if (!view.orthographic && !(at.z > 0)) return {};
  const double by = view.focal / (view.orthographic ? 1 : at.z);
  const dvec2 pixel(by * at.x + 0.5 * view.width, 0.5 * view.height - by * at.y);
  return dvec2(picture_area().left, 0) + window_units() * pixel;
}

}  // namespace splatvol
