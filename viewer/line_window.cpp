// The line over the picture, and the windows of its plots.
#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "pictures/outline.h"
#include "pictures/ticks.h"
#include "viewer/line_section.h"
#include "viewer/plot.h"
#include "viewer/window/gui_units.h"

namespace splatvol {
namespace {

constexpr double seen_light = 0.5;  // of a place that is drawn as seen

std::string text_of(const PlotRange& range) {
  if (range.is_empty()) return "no values";
  const int digits = digits_of_range(range.low, range.high);
  return fmt::format("{:.{}g} to {:.{}g}", range.low, digits, range.high, digits);
}

void draw_curves(const Plot& drawn, const CurvePlot& plot) {
  for (std::size_t number = 0; number < plot.curves.size(); ++number)
    drawn.draw_curve(plot.curves[number].values, axis_of_curve(plot, number), gui_color(color_of_curve(number)));
}

// The ends of the axis of places, in a line below the plot.
void draw_places(const CurvePlot& plot) {
  ImGui::Text("%s %.6g to %.6g", plot.place_name.c_str(), plot.places.front(), plot.places.back());
}

// A window at the lower left corner of the picture. Returns whether it stays.
bool begin_window(const char* name, const PictureArea& area, float scale) {
  ImGui::SetNextWindowPos({static_cast<float>(area.left) + 8 * scale, static_cast<float>(area.height) - 8 * scale},
                          ImGuiCond_Appearing, {0, 1});
  bool stays = true;
  ImGui::Begin(name, &stays,
               ImGuiWindowFlags_AlwaysAutoResize | ImGuiWindowFlags_NoCollapse |
                   ImGuiWindowFlags_NoFocusOnAppearing);  // it may come while an end is typed
  const ImVec2 at = ImGui::GetWindowPos();
  const float lowest = static_cast<float>(area.height) - 8 * scale - ImGui::GetWindowHeight();
  if (at.y > lowest) ImGui::SetWindowPos({at.x, std::max(lowest, 0.0F)});  // it has become higher
  return stays;
}

}  // namespace

void LineSection::draw_line(bool is_at_rest, bool over_picture) {
  if (viewer_.session->shown_number() == 0) return;
  if (is_shown_ && is_at_rest && !viewer_.session->is_reading()) {
    ask_rows();
    ask_lights();
  }
  if (!is_at_rest && lighting_.is_begun()) lighting_.interrupt();
  cursor_ = is_shown_ && over_picture ? cursor_in_picture() : std::nullopt;
  if (is_shown_) draw_window();
  if (is_shown_) draw_in_picture();
  draw_steps_window();
}

// Where the pointer is on the line, if it is near.
std::optional<double> LineSection::cursor_in_picture() const {
  const auto from = viewer_.window_position(ends_[0]), to = viewer_.window_position(ends_[1]);
  if (!from || !to || !has_rows() || answered_ != request()) return {};
  const dvec2 along = *to - *from, pointer = viewer_.steering.pointer();
  const double length = glm::length(along);
  if (!(length > 0)) return {};
  const double share = std::clamp(glm::dot(pointer - *from, along) / (length * length), 0.0, 1.0);
  if (glm::length(pointer - (*from + share * along)) > 6 * static_cast<double>(viewer_.scale())) return {};
  // In perspective, halves of the picture of a line are none of the line.
  const View& view = viewer_.session->view();
  const double near = view.to_view(ends_[0]).z, far = view.to_view(ends_[1]).z;
  const double way = view.orthographic ? share : share * near / (share * near + (1 - share) * far);
  return way * rows_->arc_lengths.back();
}

void LineSection::draw_in_picture() const {
  const PictureArea area = viewer_.picture_area();
  const View& view = viewer_.session->view();
  const float scale = viewer_.scale();
  ImDrawList& list = *ImGui::GetBackgroundDrawList();
  list.PushClipRect({static_cast<float>(area.left), 0}, {static_cast<float>(area.left + area.width), 1e6F});
  const std::vector<dvec3> places = this->places();
  const bool is_known = seen_.lights.size() == places.size() && seen_.line == request() && seen_.view == view;
  const dvec2 units = viewer_.window_units();
  const auto window_of = [&](const dvec2& pixel) {
    return ImVec2(static_cast<float>(area.left + units.x * pixel.x), static_cast<float>(units.y * pixel.y));
  };
  for (std::size_t i = 1; i < places.size(); ++i) {
    const auto segment = project(view, places[i - 1], places[i]);
    if (!segment) continue;
    const bool is_hidden = is_known && std::max(seen_.lights[i - 1], seen_.lights[i]) < seen_light;
    const ImVec2 from = window_of(segment->from), to = window_of(segment->to);
    if (!is_hidden) list.AddLine(from, to, IM_COL32(0, 0, 0, 255), 4 * scale);
    list.AddLine(from, to, IM_COL32(255, 255, 255, is_hidden ? 70 : 255), (is_hidden ? 1.0F : 2.0F) * scale);
  }
  draw_cursor();
  list.PopClipRect();
}

void LineSection::draw_cursor() const {
  if (!cursor_ || !has_rows()) return;
  const double share = *cursor_ / rows_->arc_lengths.back();
  const auto at = viewer_.window_position(ends_[0] + share * (ends_[1] - ends_[0]));
  if (!at) return;
  ImDrawList& list = *ImGui::GetBackgroundDrawList();
  const ImVec2 center(static_cast<float>(at->x), static_cast<float>(at->y));
  list.AddCircleFilled(center, 5 * viewer_.scale(), IM_COL32(0, 0, 0, 255));
  list.AddCircleFilled(center, 3.5F * viewer_.scale(), IM_COL32(255, 210, 80, 255));
}

void LineSection::draw_window() {
  const float unit = gui_unit();
  is_shown_ = begin_window("line", viewer_.picture_area(), viewer_.scale());
  ImGui::Text("length %.6g", request().length());
  if (!trouble_.empty()) {
    ImGui::PushTextWrapPos(300 * unit);
    ImGui::TextUnformatted(trouble_.c_str());
    ImGui::PopTextWrapPos();
  }
  if (has_rows()) {
    plot_.has_common_axis = has_common_axis_;
    const Plot drawn(plot_.places, {300 * unit, 110 * unit});
    draw_curves(drawn, plot_);
    if (cursor_) drawn.draw_cursor(*cursor_);
    if (const auto place = drawn.end()) cursor_ = place;
    for (std::size_t number = 0; number < plot_.curves.size(); ++number)
      ImGui::TextColored(ImGui::ColorConvertU32ToFloat4(gui_color(color_of_curve(number))), "%s %s",
                         plot_.curves[number].name.c_str(), text_of(axis_of_curve(plot_, number)).c_str());
    draw_places(plot_);
    if (cursor_) draw_values_at(*cursor_);
  } else if (trouble_.empty()) {
    ImGui::TextUnformatted("it is being read");
  }
  ImGui::End();
}

void LineSection::draw_values_at(double arc_length) const {
  std::string text = fmt::format("distance {:.6g}", arc_length);
  for (std::size_t a = 0; a < plot_.curves.size(); ++a) {
    const double value = value_on_line(*rows_, a, arc_length);
    text += fmt::format("\n{} {}", plot_.curves[a].name, std::isnan(value) ? "none" : fmt::format("{:.6g}", value));
  }
  ImGui::SetTooltip("%s", text.c_str());
}

// A click on the plot shows the step there.
void LineSection::draw_steps_window() {
  if (over_steps_.curves.empty()) return;
  Session& session = *viewer_.session;
  const float unit = gui_unit();
  const bool stays = begin_window("over all steps", viewer_.picture_area(), viewer_.scale());
  ImGui::Text("at %.5g, %.5g, %.5g", place_of_steps_.x, place_of_steps_.y, place_of_steps_.z);
  const Plot drawn(over_steps_.places, {300 * unit, 110 * unit});
  draw_curves(drawn, over_steps_);
  drawn.draw_cursor(over_steps_.places[session.step()]);
  if (const auto time = drawn.end()) {
    const std::size_t step = session.steps().nearest(*time);
    ImGui::SetTooltip("step %zu, time %.6g\n%s %.6g", step, over_steps_.places[step],
                      over_steps_.curves[0].name.c_str(), over_steps_.curves[0].values[step]);
    if (ImGui::IsMouseClicked(0)) session.choose_step(step);
  }
  ImGui::TextUnformatted((over_steps_.curves[0].name + " " + text_of(range_of(over_steps_.curves[0].values))).c_str());
  draw_places(over_steps_);
  ImGui::End();
  if (!stays) end_steps();
}

}  // namespace splatvol
