#include "viewer/slice_controls.h"

#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "pictures/ticks.h"
#include "viewer/projection.h"
#include "viewer/window/gui_units.h"

namespace splatvol {
namespace {

constexpr float handle_radius = 7, grip = 11, arrow_length = 70;  // window units, at scale 1
constexpr std::size_t most_planes = 64;                           // of each kind, as in a scene file

// The end of the arrow along a plane's normal.
dvec3 tip_of(const Plane& plane, const Projection& projection) {
  return plane.point + arrow_length * gui_unit() * projection.world_per_unit(plane.point) * plane.normal;
}

// A plane cuts a box in a polygon. Returns its corners, in order round its middle.
std::vector<dvec3> section_of(const Plane& plane, const Box& box) {
  const auto corner = [&](int c) {
    return dvec3(c & 1 ? box.high.x : box.low.x, c & 2 ? box.high.y : box.low.y, c & 4 ? box.high.z : box.low.z);
  };
  std::vector<dvec3> corners;
  for (int c = 0; c < 8; ++c)
    for (const int axis : {1, 2, 4}) {
      if (c & axis) continue;
      const dvec3 from = corner(c), to = corner(c | axis);
      const double a = plane.distance(from), b = plane.distance(to);
      if (a != b && (a <= 0) != (b <= 0)) corners.push_back(from + a / (a - b) * (to - from));
    }
  if (corners.empty()) return corners;
  dvec3 middle(0);
  for (const dvec3& p : corners) middle += p / static_cast<double>(corners.size());
  const dvec3 x = corners.front() - middle, y = glm::cross(plane.normal, x);
  std::ranges::sort(corners, {},
                    [&](const dvec3& p) { return std::atan2(glm::dot(p - middle, y), glm::dot(p - middle, x)); });
  return corners;
}

dvec3 middle_of(const Box& bounds) { return 0.5 * (bounds.low + bounds.high); }

// The point that the camera turns about, if it is in the data.
dvec3 point_in_sight(const Scene& scene, const Box& bounds) {
  const dvec3& point = scene.camera.focal_point;
  return ClipRegion{bounds, {}}.contains(point) ? point : middle_of(bounds);
}

// The axis that is nearest to the line of sight, towards the eye.
dvec3 towards_eye(const View& view) {
  dvec3 direction(0);
  const int axis = longest_axis(glm::abs(view.forward));
  direction[axis] = view.forward[axis] > 0 ? -1 : 1;
  return direction;
}

// A slider along the normal. The point moves within the plane, next to the middle of the data.
void draw_offset(dvec3& point, const dvec3& normal, const Box& bounds) {
  const Plane plane = make_plane(point, normal);
  const dvec3 middle = middle_of(bounds);
  const double half = std::max(0.5 * glm::dot(glm::abs(plane.normal), bounds.extent()), 1e-300);
  double offset = 0.0 - plane.distance(middle);  // never -0
  const double least = -half, most = half;
  if (ImGui::SliderScalar("position", ImGuiDataType_Double, &offset, &least, &most, "%.4g"))
    point = middle + offset * plane.normal;
  hint(
      "From the middle of the data, along the normal, in the units of the file's coordinates.\n"
      "Control click: type a number.");
}

}  // namespace

std::optional<SliceControls::Selected> SliceControls::selected(Scene& scene) const {
  if (!selected_) return {};
  const auto [is_slice, i] = *selected_;
  if (is_slice && i < scene.slices.size()) return Selected{&scene.slices[i].point, &scene.slices[i].normal};
  if (!is_slice && i < scene.clip_planes.size())
    return Selected{&scene.clip_planes[i].point, &scene.clip_planes[i].normal};
  return {};
}

// The selected plane, if it is shown.
std::optional<Plane> SliceControls::plane(const Scene& scene) const {
  if (!selected_) return {};
  const auto [is_slice, i] = *selected_;
  if (is_slice && i < scene.slices.size() && scene.slices[i].shown)
    return make_plane(scene.slices[i].point, scene.slices[i].normal);
  if (!is_slice && i < scene.clip_planes.size() && scene.clip_planes[i].active)
    return make_plane(scene.clip_planes[i].point, scene.clip_planes[i].normal);
  return {};
}

// Draws the row of one plane. Returns whether it is to be removed.
bool SliceControls::draw_row(const Selection& which, bool& shown) {
  ImGui::PushID(static_cast<int>(which.is_slice ? which.index : 1000 + which.index));
  ImGui::Checkbox("##shown", &shown);
  hint(which.is_slice ? "Shows the slice." : "Cuts the data.");
  ImGui::SameLine();
  const bool is_selected = selected_ == which;
  const std::string name = fmt::format("{} {}", which.is_slice ? "slice" : "clip plane", which.index + 1);
  if (ImGui::RadioButton(name.c_str(), is_selected)) selected_ = is_selected ? std::nullopt : std::optional(which);
  hint("Shows its handles: drag the ball in its middle to move it, the one at the arrow's tip to turn it.");
  ImGui::SameLine();
  const bool removed = ImGui::SmallButton("remove");
  ImGui::PopID();
  return removed;
}

// Draws the controls of the selected plane.
void SliceControls::draw_selected(Scene& scene, const View& view, const Box& bounds) {
  const auto plane = selected(scene);
  if (!plane) return;
  const bool is_slice = selected_->is_slice;
  dvec3& normal = *plane->normal;
  draw_offset(*plane->point, normal, bounds);
  for (int axis = 0; axis < 3; ++axis) {
    dvec3 along(0);
    along[axis] = 1;
    if (ImGui::SmallButton(std::string(1, "xyz"[axis]).c_str())) normal = along;
    hint("Turns the normal to this axis.");
    ImGui::SameLine();
  }
  if (ImGui::SmallButton("flip")) normal = -normal;
  hint(is_slice ? "Turns the normal round." : "Cuts off the other side.");
  ImGui::SameLine();
  if (ImGui::SmallButton("face me")) normal = -view.forward;
  hint("Turns the normal to the eye.");
  std::array<double, 3> numbers{normal.x, normal.y, normal.z};
  if (ImGui::DragScalarN("normal", ImGuiDataType_Double, numbers.data(), 3, 0.01F, nullptr, nullptr, "%.3f")) {
    const dvec3 changed(numbers[0], numbers[1], numbers[2]);
    const double length = glm::length(changed);
    if (std::isfinite(length) && length > 1e-6) normal = changed;
  }
  hint("Of any length.\nDrag, or control click: type a number.");
  if (!is_slice) return;
  double& opacity = scene.slices[selected_->index].opacity;
  const double clear = 0, opaque = 1;
  ImGui::SliderScalar("opacity##slice", ImGuiDataType_Double, &opacity, &clear, &opaque, "%.2f");
  opacity = std::clamp(opacity, clear, opaque);
}

void SliceControls::draw_add_buttons(Scene& scene, const View& view, const Box& bounds) {
  ImGui::BeginDisabled(scene.slices.size() >= most_planes);
  if (ImGui::SmallButton("add slice")) add_slice(scene, view, bounds);
  ImGui::EndDisabled();
  hint("A plane that shows the values on it. Key X.");
  ImGui::SameLine();
  ImGui::BeginDisabled(scene.clip_planes.size() >= most_planes);
  if (ImGui::SmallButton("add clip plane")) {
    selected_ = {false, scene.clip_planes.size()};
    scene.clip_planes.push_back({.point = point_in_sight(scene, bounds), .normal = -towards_eye(view)});
  }
  ImGui::EndDisabled();
  hint("Hides all on one side of a plane.");
}

// A click changes rows below it only.
void SliceControls::draw_panel(Scene& scene, const View& view, const Box& bounds) {
  draw_add_buttons(scene, view, bounds);
  for (std::size_t i = 0; i < scene.slices.size(); ++i) {
    if (!draw_row({true, i}, scene.slices[i].shown)) continue;
    scene.slices.erase(scene.slices.begin() + static_cast<std::ptrdiff_t>(i--));
    reset();
  }
  for (std::size_t i = 0; i < scene.clip_planes.size(); ++i) {
    if (!draw_row({false, i}, scene.clip_planes[i].active)) continue;
    scene.clip_planes.erase(scene.clip_planes.begin() + static_cast<std::ptrdiff_t>(i--));
    reset();
  }
  draw_selected(scene, view, bounds);
}

void SliceControls::add_slice(Scene& scene, const View& view, const Box& bounds) {
  if (scene.slices.size() >= most_planes) return;
  selected_ = {true, scene.slices.size()};
  scene.slices.push_back({.point = point_in_sight(scene, bounds), .normal = towards_eye(view)});
}

void SliceControls::draw_handles(const Scene& scene, const View& view, const Box& bounds, const PictureArea& area,
                                 const dvec2& pointer) const {
  const auto shown = plane(scene);
  if (!shown) return;
  const Projection projection(view, area);
  ImDrawList& canvas = *ImGui::GetBackgroundDrawList();
  const ImU32 color = IM_COL32(255, 210, 80, 255), dark = IM_COL32(0, 0, 0, 160);
  const float unit = gui_unit();
  const std::vector<dvec3> section = section_of(*shown, bounds);
  for (std::size_t i = 0; i < section.size(); ++i) {
    const auto from = projection.at(section[i]), to = projection.at(section[(i + 1) % section.size()]);
    if (from && to) canvas.AddLine(*from, *to, IM_COL32(255, 210, 80, 180), unit);
  }
  const auto point = projection.at(shown->point), tip = projection.at(tip_of(*shown, projection));
  if (!point || !tip) return;
  canvas.AddLine(*point, *tip, dark, 4 * unit);
  canvas.AddLine(*point, *tip, color, 2 * unit);
  const auto under = held_ ? held_ : handle_at(scene, view, area, pointer);
  for (const auto& [at, handle] : {std::pair{*point, Handle::point}, std::pair{*tip, Handle::tip}}) {
    const float radius = handle_radius * unit * (under == handle ? 1.3F : 1.0F);
    canvas.AddCircleFilled(at, radius + unit, dark);
    canvas.AddCircleFilled(at, radius, handle == Handle::point ? color : IM_COL32(255, 255, 255, 255));
  }
}

// The tip comes first: it lies over the point if the normal faces the eye.
std::optional<SliceControls::Handle> SliceControls::handle_at(const Scene& scene, const View& view,
                                                              const PictureArea& area, const dvec2& pointer) const {
  const auto shown = plane(scene);
  if (!shown) return {};
  const Projection projection(view, area);
  const auto is_near = [&](const std::optional<ImVec2>& at) {
    return at && std::hypot(at->x - pointer.x, at->y - pointer.y) <= static_cast<double>(grip * gui_unit());
  };
  if (is_near(projection.at(tip_of(*shown, projection)))) return Handle::tip;
  if (is_near(projection.at(shown->point))) return Handle::point;
  return {};
}

bool SliceControls::grab(const Scene& scene, const View& view, const PictureArea& area, const dvec2& pointer) {
  held_ = handle_at(scene, view, area, pointer);
  return held_.has_value();
}

void SliceControls::drag(Scene& scene, const View& view, const PictureArea& area, const dvec2& moved) {
  const auto held = selected(scene);
  if (!held || !held_) return release();
  const Plane plane = make_plane(*held->point, *held->normal);
  const Projection projection(view, area);
  const double world = projection.world_per_unit(plane.point);
  const dvec3 in_view(glm::dot(plane.normal, view.right), glm::dot(plane.normal, view.up),
                      glm::dot(plane.normal, view.forward));
  const dvec2 seen(in_view.x, -in_view.y);  // of the normal, in the window
  if (*held_ == Handle::point) {
    // A normal that faces the eye has no direction in the window: up is along it.
    constexpr double least = 0.2;
    const double square = glm::dot(seen, seen);
    const double along = square > least * least ? glm::dot(moved, seen) / square : -moved.y;
    *held->point = plane.point + along * world * plane.normal;
    return;
  }
  // The tip is on a ball round the point.
  const double radius = static_cast<double>(arrow_length * gui_unit());
  const dvec2 at = radius * seen + moved;
  const double square = glm::dot(at, at);
  const double depth = std::sqrt(std::max(radius * radius - square, 0.0)) * (in_view.z > 0 ? 1 : -1);
  *held->normal = glm::normalize(at.x * view.right - at.y * view.up + depth * view.forward);
}

}  // namespace splatvol
