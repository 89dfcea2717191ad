#include "viewer/transfer_editor.h"

#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>
#include <cmath>

#include "pictures/ticks.h"
#include "scene/color_maps.h"
#include "scene/transfer_edits.h"
#include "viewer/window/gui_units.h"

namespace splatvol {
namespace {

float srgb(double linear) { return static_cast<float>(srgb_of(linear)); }

double linear(float srgb) { return linear_of(static_cast<double>(srgb)); }

void range_hint(const format::Attribute& attribute, const char* how) {
  if (ImGui::IsItemHovered())
    ImGui::SetTooltip("The values%s%s at the ends of the curve.\n%s", attribute.unit.empty() ? "" : ", in ",
                      attribute.unit.c_str(), how);
}

constexpr double decades = 4;  // of a logarithmic opacity
constexpr float grip = 7;      // farthest distance from the pointer to the control point that it takes, at scale 1

}  // namespace

// A part of the panel that shows control points: where t and densities lie in it, and the pointer over it.
struct TransferEditor::Area {
  ImVec2 low, high;  // upper left and lower right corner
  float height;
  ImVec2 pointer;
  bool hovered, active;
  double top = 1;  // density
  bool logarithmic = false;

  // Takes the space for an area of this height at the interface's present position.
  static Area make(const char* name, float height_wanted) {
    const ImVec2 corner = ImGui::GetCursorScreenPos();
    const ImVec2 size(ImGui::GetContentRegionAvail().x, height_wanted);
    ImGui::InvisibleButton(name, size, ImGuiButtonFlags_MouseButtonLeft | ImGuiButtonFlags_MouseButtonRight);
    return {corner,
            {corner.x + size.x, corner.y + size.y},
            size.y,
            ImGui::GetIO().MousePos,
            ImGui::IsItemHovered(),
            ImGui::IsItemActive()};
  }

  float x(double t) const { return low.x + static_cast<float>(t) * (high.x - low.x); }
  float y(double density) const {
    const double part = logarithmic ? 1 + std::log10(std::max(density / top, 1e-30)) / decades : density / top;
    return high.y - static_cast<float>(std::clamp(part, 0.0, 1.0)) * (high.y - low.y);
  }
  double pointer_t() const { return std::clamp(static_cast<double>((pointer.x - low.x) / (high.x - low.x)), 0.0, 1.0); }
  double pointer_density() const {
    const double part = std::clamp(static_cast<double>((high.y - pointer.y) / (high.y - low.y)), 0.0, 1.0);
    if (!logarithmic) return part * top;
    return part > 0 ? top * std::pow(10, decades * (part - 1)) : 0;
  }

  bool is_clicked(ImGuiMouseButton button) const { return hovered && ImGui::IsMouseClicked(button); }

  // A right click removes the point under the pointer. A left click holds it, or adds and holds `added`.
  template <class Point>
  void click(std::vector<Point>& points, std::optional<std::size_t> nearest, const Point& added,
             std::optional<std::size_t>& held) const {
    if (is_clicked(ImGuiMouseButton_Right) && nearest) remove_point(points, *nearest);
    if (is_clicked(ImGuiMouseButton_Left)) held = nearest ? *nearest : add_point(points, added);
  }
};

void TransferEditor::add_presets(std::vector<NamedColorMap> maps) {
  for (NamedColorMap& map : maps) {
    std::erase_if(presets_, [&](const NamedColorMap& preset) { return preset.name == map.name; });
    presets_.push_back(std::move(map));
  }
}

// Shows each map's colours beside its name.
void TransferEditor::choose_preset(TransferFunction& function) const {
  if (!ImGui::BeginCombo("colours", "presets", ImGuiComboFlags_HeightLargest)) return;
  const auto offer = [&](const std::string& name, const std::vector<TransferFunction::Color>& colors) {
    ImGui::PushID(name.c_str());
    const ImVec2 corner = ImGui::GetCursorScreenPos();
    const float height = ImGui::GetTextLineHeight(), width = 5 * height;
    if (ImGui::Selectable("##map")) function.colors = colors;
    TransferFunction map;
    map.colors = colors;
    constexpr int stripes = 32;
    for (int i = 0; i < stripes; ++i)
      ImGui::GetWindowDrawList()->AddRectFilled({corner.x + width * float(i) / stripes, corner.y},
                                                {corner.x + width * float(i + 1) / stripes, corner.y + height},
                                                gui_color(map.color_at((i + 0.5) / stripes)));
    ImGui::SameLine(width + 2 * ImGui::GetStyle().ItemSpacing.x);
    ImGui::TextUnformatted(name.c_str());
    ImGui::PopID();
  };
  for (const ColorMap& map : color_maps()) offer(std::string(map.name), map.colors);
  for (const NamedColorMap& map : presets_) offer(map.name, map.colors);
  ImGui::EndCombo();
}

bool TransferEditor::draw(TransferFunction& function, const TransferFunction& fitting,
                          const format::Attribute& attribute, const std::array<std::uint64_t, 64>& histogram,
                          const format::StepRange& all, std::vector<SceneContour>& contours) {
  choose_preset(function);
  // A dragged point must not move the axis that it is dragged along.
  if (!density_) top_ = std::max(1.25 * largest_extinction(function), 1e-30);
  edit_densities(function, attribute, histogram, "extinction", " per unit of length", contours);
  edit_colors(function);

  edit_range(function, attribute);
  if (ImGui::SmallButton("fit")) function = fitting;
  hint("Colours and opacity that fit the data");
  ImGui::SameLine();
  const bool wants_visible = ImGui::SmallButton("visible");
  hint(
      "Spreads the colours over the values that are seen in this picture:\nthe 2nd to the 98th percentile of its "
      "light");
  ImGui::SameLine();
  if (ImGui::SmallButton("all values") && all.max > all.min)
    function = with_domain(function, function.axis, all.min, all.max);
  ImGui::SameLine();
  if (ImGui::SmallButton("reverse colours")) function.colors = reversed(function.colors);
  ImGui::Checkbox("log counts", &log_counts_);
  ImGui::SameLine();
  ImGui::Checkbox("log opacity", &log_opacity_);

  const double least = 1e-3, most = 1e3;
  double factor = function.density_factor;
  if (ImGui::SliderScalar("opacity", ImGuiDataType_Double, &factor, &least, &most, "%.3g",
                          ImGuiSliderFlags_Logarithmic) &&
      factor > 0)
    function.density_factor = factor;
  hint("A factor on the whole curve.\nControl click: type a number.");
  return wants_visible;
}

void TransferEditor::draw_factors(TransferFunction& factors, const format::Attribute& attribute,
                                  const std::array<std::uint64_t, 64>& histogram) {
  ImGui::PushID("factors");
  top_ = 1;
  edit_densities(factors, attribute, histogram, "factor", "");
  edit_range(factors, attribute);
  ImGui::PopID();
}

// The axis, and the range that t = 0 to 1 stands for.
void TransferEditor::edit_range(TransferFunction& function, const format::Attribute& attribute) {
  int axis = static_cast<int>(function.axis);
  if (ImGui::Combo("axis", &axis, "linear\0log\0asinh\0"))
    function = with_domain(function, static_cast<ValueAxis>(axis), function.lo, function.hi);

  const double span = std::max(attribute.max - attribute.min, 1e-30);
  const double narrowest = 1e-6 * span;
  double range[2] = {function.lo, function.hi};
  const std::string number = fmt::format("%.{}g", digits_of_range(function.lo, function.hi));
  if (function.axis == ValueAxis::linear) {
    const float speed = static_cast<float>(span / 400);
    if (ImGui::DragScalarN("range", ImGuiDataType_Double, range, 2, speed, nullptr, nullptr, number.c_str()) &&
        range[1] - range[0] > narrowest)
      function.lo = range[0], function.hi = range[1];
    range_hint(attribute, "Drag, or control click: type a number.");
    return;
  }
  // Steps of a drag would be too long for the small values.
  const bool changed = ImGui::InputScalarN("range", ImGuiDataType_Double, range, 2, nullptr, nullptr, number.c_str(),
                                           ImGuiInputTextFlags_EnterReturnsTrue);
  range_hint(attribute, "Type a number, and Enter.");
  if (changed && range[0] < range[1]) function = with_domain(function, function.axis, range[0], range[1]);
  double width = function.linear_width;
  if (function.axis == ValueAxis::asinh &&
      ImGui::InputDouble("linear to", &width, 0, 0, "%.3g", ImGuiInputTextFlags_EnterReturnsTrue) && width > 1e-100)
    function.linear_width = width;
}

void TransferEditor::draw_histogram(const Area& area, const TransferFunction& function,
                                    const format::Attribute& attribute,
                                    const std::array<std::uint64_t, 64>& histogram) const {
  const auto tallest = static_cast<double>(*std::ranges::max_element(histogram));
  const auto x_of_bin = [&](std::size_t bin) {
    const double value = attribute.min + (attribute.max - attribute.min) * static_cast<double>(bin) / 64;
    return area.x(std::clamp(function.t_of(value), -1.0, 2.0));
  };
  for (std::size_t bin = 0; tallest > 0 && bin < histogram.size(); ++bin) {
    const auto count = static_cast<double>(histogram[bin]);
    const double part = log_counts_ ? std::log1p(count) / std::log1p(tallest) : count / tallest;
    const float bar = static_cast<float>(part) * area.height;
    ImGui::GetWindowDrawList()->AddRectFilled({x_of_bin(bin), area.high.y - bar}, {x_of_bin(bin + 1), area.high.y},
                                              IM_COL32(90, 95, 110, 255));
  }
}

void TransferEditor::edit_densities(TransferFunction& function, const format::Attribute& attribute,
                                    const std::array<std::uint64_t, 64>& histogram, const char* name, const char* unit,
                                    std::span<SceneContour> contours) {
  Area area = Area::make("##densities", 110 * gui_unit());
  area.top = top_;
  area.logarithmic = log_opacity_;
  auto& points = function.densities;

  ImDrawList& list = *ImGui::GetWindowDrawList();
  list.AddRectFilled(area.low, area.high, IM_COL32(20, 20, 24, 255));
  list.PushClipRect(area.low, area.high, true);
  draw_histogram(area, function, attribute, histogram);
  std::vector<ImVec2> line = {{area.low.x, area.y(points.front().extinction)}};
  for (const auto& point : points) line.emplace_back(area.x(point.t), area.y(point.extinction));
  line.emplace_back(area.high.x, area.y(points.back().extinction));
  list.AddPolyline(line.data(), static_cast<int>(line.size()), IM_COL32(255, 255, 255, 255), 0, 1.5f * gui_unit());
  list.PopClipRect();

  std::optional<std::size_t> nearest;
  float least = grip * gui_unit();
  for (std::size_t i = 0; i < points.size(); ++i) {
    const ImVec2 at(area.x(points[i].t), area.y(points[i].extinction));
    const float distance = std::hypot(at.x - area.pointer.x, at.y - area.pointer.y);
    list.AddCircleFilled(at, 4 * gui_unit(), IM_COL32(255, 210, 80, 255));
    if (distance < least) nearest = i, least = distance;
  }
  if (!area.active) density_.reset();
  edit_contours(area, function, contours);
  if (contour_) return;
  area.click(points, nearest, {area.pointer_t(), area.pointer_density()}, density_);
  if (density_ && *density_ < points.size()) {
    move_point(points, *density_, area.pointer_t());
    points[*density_].extinction = area.pointer_density();
  }
  if (area.hovered && !area.active)
    ImGui::SetTooltip("%.*g %s\n%s %.3g%s\nclick: add or drag, right click: remove",
                      digits_of_range(function.lo, function.hi), function.value_at(area.pointer_t()),
                      attribute.unit.c_str(), name, function.density_factor * area.pointer_density(), unit);
}

// A line for each value, with a handle at its upper end. No two values become equal.
void TransferEditor::edit_contours(const Area& area, const TransferFunction& function,
                                   std::span<SceneContour> contours) {
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const float half = 5 * gui_unit(), height = 9 * gui_unit();
  if (!area.active) contour_.reset();
  std::optional<ContourValue> under;
  const double pointed = function.value_at(area.pointer_t());
  for (std::size_t i = 0; i < contours.size(); ++i)
    for (std::size_t j = 0; j < contours[i].values.size(); ++j) {
      const double value = contours[i].values[j], t = function.t_of(value);
      if (!contours[i].shown || t < 0 || t > 1) continue;
      const float x = area.x(t), y = area.low.y;
      const ImU32 color = gui_color(contours[i].color.value_or(function.color_at(t)));
      list.AddLine({x, y}, {x, area.high.y}, IM_COL32(0, 0, 0, 255), 3 * gui_unit());
      list.AddLine({x, y}, {x, area.high.y}, color, gui_unit());
      list.AddTriangleFilled({x - half, y}, {x + half, y}, {x, y + height}, color);
      list.AddTriangle({x - half, y}, {x + half, y}, {x, y + height}, IM_COL32_WHITE, gui_unit());
      if (std::abs(x - area.pointer.x) <= half && area.pointer.y <= y + height) under = {i, j};
    }
  if (under && area.is_clicked(ImGuiMouseButton_Left)) contour_ = under;
  if (contour_ && contour_->contour < contours.size() && contour_->value < contours[contour_->contour].values.size()) {
    double& value = contours[contour_->contour].values[contour_->value];
    if (!have_value(contours, pointed) && ImGui::IsMouseDragging(ImGuiMouseButton_Left, 0)) value = pointed;
    ImGui::SetTooltip("contour at %.*g", digits_of_range(function.lo, function.hi), value);
  }
}

void TransferEditor::pick_color(TransferFunction& function) const {
  if (!ImGui::BeginPopup("colour")) return;
  if (picked_color_ < function.colors.size()) {
    dvec3& rgb = function.colors[picked_color_].rgb;
    float shown[3] = {srgb(rgb.r), srgb(rgb.g), srgb(rgb.b)};
    if (ImGui::ColorPicker3("colour", shown)) rgb = {linear(shown[0]), linear(shown[1]), linear(shown[2])};
  }
  ImGui::EndPopup();
}

void TransferEditor::edit_colors(TransferFunction& function) {
  const Area area = Area::make("##colours", 22 * gui_unit());
  const auto color_at = [&](double t) { return function.color_at(t); };
  auto& points = function.colors;
  ImDrawList& list = *ImGui::GetWindowDrawList();
  constexpr int stripes = 64;
  for (int i = 0; i < stripes; ++i)
    list.AddRectFilled({area.x(double(i) / stripes), area.low.y}, {area.x(double(i + 1) / stripes), area.high.y},
                       gui_color(color_at((i + 0.5) / stripes)));

  std::optional<std::size_t> nearest;
  float least = grip * gui_unit();
  for (std::size_t i = 0; i < points.size(); ++i) {
    const ImVec2 at(area.x(points[i].t), area.high.y - 6 * gui_unit());
    list.AddCircleFilled(at, 5 * gui_unit(), IM_COL32(0, 0, 0, 255));
    list.AddCircleFilled(at, 4 * gui_unit(), gui_color(points[i].rgb));
    if (std::abs(at.x - area.pointer.x) < least) nearest = i, least = std::abs(at.x - area.pointer.x);
  }
  area.click(points, nearest, {area.pointer_t(), color_at(area.pointer_t())}, color_);
  if (area.hovered && color_ && ImGui::IsMouseDoubleClicked(ImGuiMouseButton_Left)) {
    picked_color_ = *color_;
    ImGui::OpenPopup("colour");
  }
  if (!area.active) color_.reset();
  if (color_ && *color_ < points.size()) move_point(points, *color_, area.pointer_t());
  pick_color(function);
  if (area.hovered && !area.active) ImGui::SetTooltip("click: add or drag, double click: pick, right click: remove");
}

}  // namespace splatvol
