// Colours, lengths and hints as Dear ImGui takes them.
#pragma once

#include <imgui.h>

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

/// Tells about the control before, where the pointer rests on it.
inline void hint(const char* text) {
  if (ImGui::IsItemHovered()) ImGui::SetTooltip("%s", text);
}

}  // namespace splatvol
