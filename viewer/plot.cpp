#include "viewer/plot.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "viewer/window/gui_units.h"

namespace splatvol {

Plot::Plot(std::span<const double> places, const ImVec2& size)
    : places_(places), corner_(ImGui::GetCursorScreenPos()), size_(size) {
  ImGui::GetWindowDrawList()->AddRectFilled(corner_, {corner_.x + size.x, corner_.y + size.y},
                                            ImGui::GetColorU32(ImGuiCol_FrameBg));
}

float Plot::x_of(double place) const {
  const double width = places_.back() - places_.front();
  return corner_.x + size_.x * (width > 0 ? static_cast<float>((place - places_.front()) / width) : 0.5F);
}

// Soft edges would overlap where parts of the area meet.
void Plot::draw_area(std::span<const double> shares) const {
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const ImDrawListFlags flags = std::exchange(list.Flags, list.Flags & ~ImDrawListFlags_AntiAliasedFill);
  const auto rows = rows_of_plot(places_, shares, static_cast<std::size_t>(size_.x));
  for (std::size_t k = 1; k < rows.size(); ++k) {
    const std::size_t from = rows[k - 1], to = rows[k];
    const float left = x_of(places_[from]), right = x_of(places_[to]);
    const std::array<ImVec2, 4> area = {
        {{left, y_of(0)}, {left, y_of(shares[from])}, {right, y_of(shares[to])}, {right, y_of(0)}}};
    list.AddConvexPolyFilled(area.data(), 4, ImGui::GetColorU32(ImGuiCol_PlotHistogram, 0.25F));
  }
  list.Flags = flags;
}

void Plot::draw_curve(std::span<const double> values, const PlotRange& range, ImU32 color) const {
  ImDrawList& list = *ImGui::GetWindowDrawList();
  const double span = range.high > range.low ? range.high - range.low : 1;
  const float width = 1.5F * gui_unit();
  const auto rows = rows_of_plot(places_, values, static_cast<std::size_t>(size_.x));
  const auto point_of = [&](std::size_t row) {
    return ImVec2(x_of(places_[row]), y_of((values[row] - range.low) / span));
  };
  for (std::size_t k = 0; k < rows.size(); ++k) {
    if (std::isnan(values[rows[k]])) continue;
    const bool follows = k > 0 && !std::isnan(values[rows[k - 1]]);
    const bool goes_on = k + 1 < rows.size() && !std::isnan(values[rows[k + 1]]);
    if (follows) list.AddLine(point_of(rows[k - 1]), point_of(rows[k]), color, width);
    if (!follows && !goes_on) list.AddCircleFilled(point_of(rows[k]), 1.5F * width, color);
  }
}

void Plot::draw_cursor(double place) const {
  if (place < places_.front() || place > places_.back()) return;
  ImGui::GetWindowDrawList()->AddLine({x_of(place), y_of(1)}, {x_of(place), y_of(0)},
                                      ImGui::GetColorU32(ImGuiCol_TextDisabled));
}

std::optional<double> Plot::end() const {
  ImGui::Dummy(size_);
  if (!ImGui::IsItemHovered()) return {};
  const double share = static_cast<double>((ImGui::GetMousePos().x - corner_.x) / size_.x);
  return places_.front() + std::clamp(share, 0.0, 1.0) * (places_.back() - places_.front());
}

}  // namespace splatvol
