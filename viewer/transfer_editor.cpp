#include "viewer/transfer_editor.h"

#include <imgui.h>

#include <algorithm>
#include <cmath>

#include "viewer/color_maps.h"
#include "viewer/srgb.h"

namespace splatvol {
namespace {

float srgb(double linear) { return static_cast<float>(srgb_of(linear)); }

double linear(float srgb) { return linear_of(static_cast<double>(srgb)); }

ImU32 color_of(const dvec3& rgb) {
  return ImGui::ColorConvertFloat4ToU32(ImVec4(srgb(rgb.r), srgb(rgb.g), srgb(rgb.b), 1));
}

double largest_density(const TransferFunction& function) {
  double largest = 0;
  for (const auto& density : function.densities) largest = std::max(largest, density.extinction);
  return largest;
}

constexpr double decades = 4;  // that a logarithmic opacity shows
constexpr float grip = 7;      // how near to a control point the pointer has to be, at scale 1

}  // namespace

// Where values and densities lie on the screen.
struct TransferEditor::Area {
  ImVec2 low, high;  // upper left and lower right corner
  double top;        // density
  bool logarithmic;

  float x(double t) const { return low.x + static_cast<float>(t) * (high.x - low.x); }
  float y(double density) const {
    const double part = logarithmic ? 1 + std::log10(std::max(density / top, 1e-30)) / decades : density / top;
    return high.y - static_cast<float>(std::clamp(part, 0.0, 1.0)) * (high.y - low.y);
  }
  double t(float x) const { return std::clamp(static_cast<double>((x - low.x) / (high.x - low.x)), 0.0, 1.0); }
  double density(float y) const {
    const double part = std::clamp(static_cast<double>((high.y - y) / (high.y - low.y)), 0.0, 1.0);
    if (!logarithmic) return part * top;
    return part > 0 ? top * std::pow(10, decades * (part - 1)) : 0;
  }
};

void TransferEditor::draw(TransferFunction& function, const TransferFunction& fitting,
                          const format::Attribute& attribute, const std::array<std::uint64_t, 64>& histogram) {
  // Colours.
  if (ImGui::BeginCombo("colours", "presets", ImGuiComboFlags_HeightLargest)) {
    for (const ColorMap& map : color_maps())
      if (ImGui::Selectable(std::string(map.name).c_str())) function.colors = map.colors;
    ImGui::EndCombo();
  }
  edit_densities(function, attribute, histogram);
  edit_colors(function);

  // The range that t = 0 to 1 stands for.
  const double span = std::max(attribute.max - attribute.min, 1e-30);
  const double narrowest = 1e-6 * span;
  double range[2] = {function.lo, function.hi};
  const float speed = static_cast<float>(span / 400);
  if (ImGui::DragScalarN("range", ImGuiDataType_Double, range, 2, speed, nullptr, nullptr, "%.5g") &&
      range[1] - range[0] > narrowest)
    function.lo = range[0], function.hi = range[1];
  if (ImGui::SmallButton("fit")) function = fitting;
  ImGui::SameLine();
  if (ImGui::SmallButton("all values") && attribute.max > attribute.min)
    function.lo = attribute.min, function.hi = attribute.max;
  ImGui::SameLine();
  if (ImGui::SmallButton("reverse colours")) function.colors = reversed(function.colors);
  ImGui::Checkbox("log counts", &log_counts_);
  ImGui::SameLine();
  ImGui::Checkbox("log opacity", &log_opacity_);

  const double fitting_top = largest_density(fitting), now = largest_density(function);
  if (fitting_top > 0 && now > 0) {
    double opacity = now / fitting_top;
    const double least = 1e-3, most = 1e3;
    if (ImGui::SliderScalar("opacity", ImGuiDataType_Double, &opacity, &least, &most, "%.3g",
                            ImGuiSliderFlags_Logarithmic)) {
      for (auto& density : function.densities) density.extinction *= opacity * fitting_top / now;
      top_ = 0;
    }
  }
}

void TransferEditor::edit_densities(TransferFunction& function, const format::Attribute& attribute,
                                    const std::array<std::uint64_t, 64>& histogram) {
  const float scale = ImGui::GetFontSize() / 13;
  const ImVec2 corner = ImGui::GetCursorScreenPos();
  const ImVec2 size(ImGui::GetContentRegionAvail().x, 110 * scale);
  ImGui::InvisibleButton("##densities", size, ImGuiButtonFlags_MouseButtonLeft | ImGuiButtonFlags_MouseButtonRight);
  const bool hovered = ImGui::IsItemHovered(), active = ImGui::IsItemActive();
  // A dragged point must not move the axis that it is dragged along.
  if (!density_) top_ = std::max(1.25 * largest_density(function), 1e-30);
  const Area area{corner, {corner.x + size.x, corner.y + size.y}, top_, log_opacity_};

  ImDrawList& list = *ImGui::GetWindowDrawList();
  list.AddRectFilled(area.low, area.high, IM_COL32(20, 20, 24, 255));
  list.PushClipRect(area.low, area.high, true);
  const auto tallest = static_cast<double>(*std::ranges::max_element(histogram));
  for (std::size_t b = 0; tallest > 0 && b < histogram.size(); ++b) {
    const auto value_at = [&](std::size_t edge) {
      return attribute.min + (attribute.max - attribute.min) * static_cast<double>(edge) / 64;
    };
    const auto t_of = [&](double value) { return (value - function.lo) / (function.hi - function.lo); };
    const auto count = static_cast<double>(histogram[b]);
    const double part = log_counts_ ? std::log1p(count) / std::log1p(tallest) : count / tallest;
    const double left = std::clamp(t_of(value_at(b)), -1.0, 2.0), right = std::clamp(t_of(value_at(b + 1)), -1.0, 2.0);
    list.AddRectFilled({area.x(left), area.high.y - static_cast<float>(part) * size.y}, {area.x(right), area.high.y},
                       IM_COL32(90, 95, 110, 255));
  }
  std::vector<ImVec2> line = {{area.low.x, area.y(function.densities.front().extinction)}};
  for (const auto& point : function.densities) line.emplace_back(area.x(point.t), area.y(point.extinction));
  line.emplace_back(area.high.x, area.y(function.densities.back().extinction));
  list.AddPolyline(line.data(), static_cast<int>(line.size()), IM_COL32(255, 255, 255, 255), 0, 1.5f * scale);
  list.PopClipRect();

  const ImVec2 pointer = ImGui::GetIO().MousePos;
  std::optional<std::size_t> nearest;
  float least = grip * scale;
  for (std::size_t i = 0; i < function.densities.size(); ++i) {
    const ImVec2 at(area.x(function.densities[i].t), area.y(function.densities[i].extinction));
    const float distance = std::hypot(at.x - pointer.x, at.y - pointer.y);
    list.AddCircleFilled(at, 4 * scale, IM_COL32(255, 210, 80, 255));
    if (distance < least) nearest = i, least = distance;
  }
  if (hovered && ImGui::IsMouseClicked(ImGuiMouseButton_Right) && nearest && function.densities.size() > 1)
    function.densities.erase(function.densities.begin() + static_cast<std::ptrdiff_t>(*nearest));
  if (hovered && ImGui::IsMouseClicked(ImGuiMouseButton_Left)) {
    density_ = nearest;
    if (!nearest) {
      const TransferFunction::Density point{area.t(pointer.x), area.density(pointer.y)};
      const auto place = std::ranges::upper_bound(function.densities, point.t, {}, &TransferFunction::Density::t);
      density_ = static_cast<std::size_t>(place - function.densities.begin());
      function.densities.insert(place, point);
    }
  }
  if (!active) density_.reset();
  if (density_ && *density_ < function.densities.size()) {
    const std::size_t i = *density_;
    auto& points = function.densities;
    const double from = i > 0 ? points[i - 1].t : 0, to = i + 1 < points.size() ? points[i + 1].t : 1;
    points[i] = {std::clamp(area.t(pointer.x), from, std::max(from, to)), area.density(pointer.y)};
  }
  if (hovered && !active)
    ImGui::SetTooltip("%.5g\nclick: add or drag, right click: remove",
                      function.lo + (function.hi - function.lo) * area.t(pointer.x));
}

void TransferEditor::edit_colors(TransferFunction& function) {
  const float scale = ImGui::GetFontSize() / 13;
  const ImVec2 corner = ImGui::GetCursorScreenPos();
  const ImVec2 size(ImGui::GetContentRegionAvail().x, 22 * scale);
  ImGui::InvisibleButton("##colours", size, ImGuiButtonFlags_MouseButtonLeft | ImGuiButtonFlags_MouseButtonRight);
  const bool hovered = ImGui::IsItemHovered(), active = ImGui::IsItemActive();
  const Area area{corner, {corner.x + size.x, corner.y + size.y}, 1, false};
  ImDrawList& list = *ImGui::GetWindowDrawList();
  constexpr int steps = 64;
  for (int i = 0; i < steps; ++i) {
    const double t = (i + 0.5) / steps;
    list.AddRectFilled({area.x(double(i) / steps), area.low.y}, {area.x(double(i + 1) / steps), area.high.y},
                       color_of(function.color(function.lo + t * (function.hi - function.lo))));
  }
  const ImVec2 pointer = ImGui::GetIO().MousePos;
  std::optional<std::size_t> nearest;
  float least = grip * scale;
  for (std::size_t i = 0; i < function.colors.size(); ++i) {
    const ImVec2 at(area.x(function.colors[i].t), area.high.y - 6 * scale);
    list.AddCircleFilled(at, 5 * scale, IM_COL32(0, 0, 0, 255));
    list.AddCircleFilled(at, 4 * scale, color_of(function.colors[i].rgb));
    if (std::abs(at.x - pointer.x) < least) nearest = i, least = std::abs(at.x - pointer.x);
  }
  if (hovered && ImGui::IsMouseClicked(ImGuiMouseButton_Right) && nearest && function.colors.size() > 1)
    function.colors.erase(function.colors.begin() + static_cast<std::ptrdiff_t>(*nearest));
  if (hovered && ImGui::IsMouseClicked(ImGuiMouseButton_Left)) {
    color_ = nearest;
    if (!nearest) {
      const double t = area.t(pointer.x);
      const auto place = std::ranges::upper_bound(function.colors, t, {}, &TransferFunction::Color::t);
      color_ = static_cast<std::size_t>(place - function.colors.begin());
      function.colors.insert(place, {t, function.color(function.lo + t * (function.hi - function.lo))});
    }
  }
  if (hovered && color_ && ImGui::IsMouseDoubleClicked(ImGuiMouseButton_Left)) {
    picked_color_ = *color_;
    ImGui::OpenPopup("colour");
  }
  if (!active) color_.reset();
  if (color_ && *color_ < function.colors.size()) {
    auto& points = function.colors;
    const std::size_t i = *color_;
    const double from = i > 0 ? points[i - 1].t : 0, to = i + 1 < points.size() ? points[i + 1].t : 1;
    points[i].t = std::clamp(area.t(pointer.x), from, std::max(from, to));
  }
  if (ImGui::BeginPopup("colour")) {
    if (picked_color_ < function.colors.size()) {
      dvec3& rgb = function.colors[picked_color_].rgb;
      float shown[3] = {srgb(rgb.r), srgb(rgb.g), srgb(rgb.b)};
      if (ImGui::ColorPicker3("colour", shown)) rgb = {linear(shown[0]), linear(shown[1]), linear(shown[2])};
    }
    ImGui::EndPopup();
  }
  if (hovered && !active) ImGui::SetTooltip("click: add or drag, double click: pick, right click: remove");
}

}  // namespace splatvol
