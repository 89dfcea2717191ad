#include "viewer/contour_section.h"

#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string>
#include <vector>

#include "pictures/ticks.h"
#include "scene/scene.h"
#include "viewer/coloring.h"
#include "viewer/window/gui_units.h"

namespace splatvol {
namespace {

// Adds one between the values of the others: in the middle of the widest gap of the colours.
void add_contour(Scene& scene) {
  const TransferFunction& function = scene.transfer_function;
  std::vector<double> places = {0, 1};
  for (const SceneContour& contour : scene.contours)
    for (const double value : contour.values) places.push_back(std::clamp(function.t_of(value), 0.0, 1.0));
  std::ranges::sort(places);
  std::size_t widest = 1;
  for (std::size_t i = 2; i < places.size(); ++i)
    if (places[i] - places[i - 1] > places[widest] - places[widest - 1]) widest = i;
  const double value = function.value_at(0.5 * (places[widest - 1] + places[widest]));
  if (!have_value(scene.contours, value)) scene.contours.push_back({.values = {value}});
}

// Values run along the axis of the colours. No two are equal.
void draw_values(Scene& scene, SceneContour& contour) {
  const TransferFunction& function = scene.transfer_function;
  const std::string number = fmt::format("%.{}g", digits_of_range(function.lo, function.hi));
  const auto flags = function.axis == ValueAxis::log && function.lo > 0 ? ImGuiSliderFlags_Logarithmic : 0;
  for (std::size_t i = 0; i < contour.values.size(); ++i) {
    double value = contour.values[i];
    ImGui::PushID(static_cast<int>(i));
    if (ImGui::SliderScalar("value", ImGuiDataType_Double, &value, &function.lo, &function.hi, number.c_str(), flags) &&
        std::isfinite(value) && !have_value(scene.contours, value))
      contour.values[i] = value;
    ImGui::PopID();
    hint("In the attribute's unit.\nControl click: type a number, also beyond the colours.");
  }
}

// All contours that another attribute colours have the same colours.
void color_by(Scene& scene, SceneContour& contour, const format::Attribute& attribute) {
  const SceneColoring coloring = coloring_by(scene, attribute);
  for (SceneContour& other : scene.contours)
    if (other.color_by) other.color_by = coloring;
  contour.color.reset();
  contour.color_by = coloring;
}

void draw_color(Session& session, SceneContour& contour) {
  Scene& scene = session.scene;
  const dvec3 of_value = scene.transfer_function.color(contour.values.front());
  const std::string shown = contour.color_by ? "by " + contour.color_by->attribute
                            : contour.color  ? "one colour"
                                             : "of its value";
  if (ImGui::BeginCombo("colour", shown.c_str())) {
    if (ImGui::Selectable("of its value", !contour.color && !contour.color_by))
      contour.color.reset(), contour.color_by.reset();
    if (ImGui::Selectable("one colour", contour.color.has_value()) && !contour.color)
      contour.color = of_value, contour.color_by.reset();
    for (const format::Attribute& attribute : session.info().attributes)
      if (ImGui::Selectable(("by " + attribute.name).c_str(),
                            contour.color_by && contour.color_by->attribute == attribute.name))
        color_by(scene, contour, attribute);
    ImGui::EndCombo();
  }
  hint("That of its value among the colours, one, or by the values of another attribute on it");
  if (!contour.color) return;
  dvec3& rgb = *contour.color;
  std::array<float, 3> encoded{};
  for (int i = 0; i < 3; ++i) encoded[static_cast<std::size_t>(i)] = static_cast<float>(srgb_of(rgb[i]));
  if (ImGui::ColorEdit3("##rgb", encoded.data()))
    for (int i = 0; i < 3; ++i) rgb[i] = linear_of(static_cast<double>(encoded[static_cast<std::size_t>(i)]));
}

// Returns whether the contour is to be removed. A click changes rows below it only.
bool draw_contour(Session& session, SceneContour& contour, std::size_t number) {
  ImGui::Checkbox(fmt::format("contour {}", number + 1).c_str(), &contour.shown);
  ImGui::SameLine();
  const bool is_removed = ImGui::SmallButton("remove");
  draw_values(session.scene, contour);
  const double clear = 0, opaque = 1;
  ImGui::SliderScalar("opacity", ImGuiDataType_Double, &contour.opacity, &clear, &opaque, "%.2f");
  contour.opacity = std::clamp(contour.opacity, clear, opaque);
  draw_color(session, contour);
  return is_removed;
}

}  // namespace

void draw_contour_section(Session& session) {
  std::vector<SceneContour>& contours = session.scene.contours;
  ImGui::PushID("contours");
  ImGui::BeginDisabled(contours.size() >= most_contour_values);
  if (ImGui::SmallButton("add contour")) add_contour(session.scene);
  ImGui::EndDisabled();
  hint(
      "A surface on which the attribute has one value, cut from the cells.\nFor contours alone, set the opacity to 0.");
  if (!session.info().cells) ImGui::TextWrapped("This file keeps no cells: shells of the volume stand for contours.");
  std::optional<std::size_t> removed;
  for (std::size_t i = 0; i < contours.size(); ++i) {
    ImGui::PushID(static_cast<int>(i));
    if (draw_contour(session, contours[i], i)) removed = i;
    ImGui::PopID();
  }
  if (removed) contours.erase(contours.begin() + static_cast<std::ptrdiff_t>(*removed));
  ImGui::PopID();
}

}  // namespace splatvol
