#include "viewer/contour_section.h"

#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <optional>
#include <string>
#include <system_error>
#include <vector>

#include "pictures/ticks.h"
#include "player/contour_export.h"
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
  hint("The colour of its value, one colour, or colours by another attribute on it");
  if (!contour.color) return;
  edit_color("##rgb", *contour.color);
}

// Why cells give no contour; empty: they do.
std::string reason_against(const format::VolumeInfo& info) {
  return info.cells ? "" : "The file keeps no cells: build it without --drop-cells.";
}

}  // namespace

void ContourSection::begin(const std::string& stem) {
  name_.set(stem + ".vtp");
  measures_.reset();
}

// Values run along the axis of the colours. No two are equal.
void ContourSection::draw_values(SceneContour& contour) {
  Scene& scene = viewer_.session->scene;
  const TransferFunction& function = scene.transfer_function;
  const std::string number = fmt::format("%.{}g", digits_of_range(function.lo, function.hi));
  const auto flags = function.axis == ValueAxis::log && function.lo > 0 ? ImGuiSliderFlags_Logarithmic : 0;
  for (std::size_t i = 0; i < contour.values.size(); ++i) {
    double value = contour.values[i];
    ImGui::PushID(static_cast<int>(i));
    if (ImGui::SliderScalar("value", ImGuiDataType_Double, &value, &function.lo, &function.hi, number.c_str(), flags) &&
        std::isfinite(value) && !have_value(scene.contours, value))
      contour.values[i] = value;
    hint("In the attribute's unit.\nControl click: type a number, also beyond the colours.");
    draw_size(contour.values[i]);
    ImGui::PopID();
  }
}

// In the units of the positions. The row stays while the size is not known.
void ContourSection::draw_size(double value) {
  const std::string reason = reason_against(viewer_.session->info());
  ImGui::BeginDisabled(!reason.empty() || is_exporting());
  if (ImGui::SmallButton("export")) export_contour(value);
  ImGui::EndDisabled();
  hint(reason.empty() ? "Writes the whole contour to the file below, as svexport does" : reason.c_str());
  ImGui::SameLine();
  const auto size = measures_.size_of(value);
  const std::string text = !reason.empty() ? ""
                           : !size         ? "area ..."
                           : std::isnan(size->volume)
                               ? fmt::format("area {:.5g}", size->area)
                               : fmt::format("area {:.5g}, volume {:.5g}", size->area, size->volume);
  ImGui::BeginDisabled(!size);
  ImGui::TextUnformatted(text.c_str());
  ImGui::EndDisabled();
  hint("Of the whole contour. A volume is inside one that is closed;\nit is negative round a hole.");
}

void ContourSection::draw_contour(SceneContour& contour) {
  draw_values(contour);
  const double clear = 0, opaque = 1;
  ImGui::SliderScalar("opacity", ImGuiDataType_Double, &contour.opacity, &clear, &opaque, "%.2f");
  contour.opacity = std::clamp(contour.opacity, clear, opaque);
  draw_color(*viewer_.session, contour);
}

// Nothing is measured while a control is held: a value that is dragged changes with each frame.
void ContourSection::measure() {
  Session& session = *viewer_.session;
  if (!reason_against(session.info()).empty() || session.is_reading()) return;
  const Status measured =
      measures_.update(viewer_.host, session.steps(), session.step(), session.scene, session.settings.memory / 8,
                       ImGui::GetIO().DeltaTime, ImGui::IsAnyItemActive());
  if (!measured) viewer_.messages.error(measured.error().message);
}

void ContourSection::draw() {
  Session& session = *viewer_.session;
  std::vector<SceneContour>& contours = session.scene.contours;
  is_drawn_ = true;
  measure();
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
    ImGui::Checkbox(fmt::format("contour {}", i + 1).c_str(), &contours[i].shown);
    ImGui::SameLine();
    if (ImGui::SmallButton("remove")) removed = i;  // a click changes rows below it only
    draw_contour(contours[i]);
    ImGui::PopID();
  }
  if (!contours.empty()) name_.draw("file##contour");
  if (removed) contours.erase(contours.begin() + static_cast<std::ptrdiff_t>(*removed));
  ImGui::PopID();
}

void ContourSection::export_contour(double value) {
  const Session& session = *viewer_.session;
  const std::string path = name_.text();
  ContourExportRequest request{.file = session.converted() ? session.converted()->path : session.path(),
                               .step = {},
                               .attribute = session.scene.attribute,
                               .value = value,
                               .output = path};
  if (!session.times().empty()) request.step = session.step();
  std::error_code error;
  request.replaces = std::filesystem::exists(path, error);
  save_.save(path, [this, request] {
    path_ = request.output;
    share_ = std::make_shared<std::atomic<double>>(0);
    // A converted file stays in the cache until then.
    exported_ = {viewer_.host, [request, share = share_, converted = viewer_.session->converted()] {
                   return export_contour_aside(request, [&](double done) { *share = done; });
                 }};
  });
}

void ContourSection::draw_progress() {
  if (!is_exporting()) return;
  if (!exported_.wait()) {
    const Messages::Work work{
        .name = "export", .text = "exporting " + path_, .buttons = {"stop"}, .share = share_->load()};
    if (viewer_.messages.draw(work)) stop_exporting();
    return;
  }
  const Result<std::uint64_t> triangles = exported_.take();
  if (triangles)
    viewer_.messages.note(fmt::format("saved {}: {} triangles", path_, *triangles));
  else if (triangles.error().code != ErrorCode::cancelled)
    viewer_.messages.error(triangles.error().message);
}

}  // namespace splatvol
