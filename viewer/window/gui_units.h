// Colours, lengths and hints as Dear ImGui takes them.
#pragma once

#include <imgui.h>

#include <array>
#include <cstddef>

#include "base/math.h"
#include "scene/srgb.h"

namespace splatvol {

/// Returns an opaque colour from linear RGB.
[[nodiscard]] inline ImU32 gui_color(const dvec3& rgb) {
  const auto encode = [](double c) { return static_cast<float>(srgb_of(c)); };
  return ImGui::ColorConvertFloat4ToU32(ImVec4(encode(rgb.r), encode(rgb.g), encode(rgb.b), 1));
}

/// From one line of text to the next, at scale 1.
inline constexpr float font_height = 15;

/// Returns the window units that a unit of the interface's design takes: 1 on a plain screen.
[[nodiscard]] inline float gui_unit() { return ImGui::GetFontSize() / font_height; }

/// Draws a field for a colour, linear RGB. Returns whether it was changed.
inline bool edit_color(const char* label, dvec3& rgb) {
  std::array<float, 3> encoded{};
  for (int i = 0; i < 3; ++i) encoded[static_cast<std::size_t>(i)] = static_cast<float>(srgb_of(rgb[i]));
  if (!ImGui::ColorEdit3(label, encoded.data())) return false;
  for (int i = 0; i < 3; ++i) rgb[i] = linear_of(static_cast<double>(encoded[static_cast<std::size_t>(i)]));
  return true;
}

/// Tells about the control before, where the pointer rests on it; also about one that is off.
inline void hint(const char* text) {
  if (ImGui::IsItemHovered(ImGuiHoveredFlags_AllowWhenDisabled)) ImGui::SetTooltip("%s", text);
}

}  // namespace splatvol
