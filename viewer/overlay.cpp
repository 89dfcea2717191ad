#include "viewer/overlay.h"

#include <imgui.h>

#include <algorithm>

#include "pictures/outline.h"
#include "pictures/page.h"
#include "pictures/ticks.h"
#include "viewer/window/gui_units.h"

namespace splatvol {
namespace {

constexpr float bar_room = 90;  // that a scalar bar takes with its words, in units of the interface

ImDrawList& canvas() { return *ImGui::GetBackgroundDrawList(); }

// Returns a place in the window, within single precision however far outside it lies. `pixel`: of the picture.
ImVec2 in_window(const dvec2& pixel, const PictureArea& area) {
  constexpr double limit = 1e5;
  return {static_cast<float>(area.left + area.unit_x * std::clamp(pixel.x, -limit, limit)),
          static_cast<float>(area.unit_y * std::clamp(pixel.y, -limit, limit))};
}

void draw_edges(const View& view, const Box& box, ImU32 color, const PictureArea& area) {
  const auto corner = [&](int c) {
    return dvec3(c & 1 ? box.high.x : box.low.x, c & 2 ? box.high.y : box.low.y, c & 4 ? box.high.z : box.low.z);
  };
  for (int c = 0; c < 8; ++c)
    for (const int axis : {1, 2, 4})
      if (!(c & axis))
        if (const auto line = project(view, corner(c), corner(c | axis)))
          canvas().AddLine(in_window(line->from, area), in_window(line->to, area), color, gui_unit());
}

// `right`: the end of its words.
void draw_scalar_bar(const PageBar& bar, int ticks_wanted, const dvec3& ink, float right, const PictureArea& area) {
  const TransferFunction& function = bar.function;
  const float u = gui_unit();
  const float above = 30 * u, below = 26 * u, width = 14 * u;
  const float height = std::min(180 * u, static_cast<float>(area.height) - above - below);
  if (height < 40 * u) return;
  const ImVec2 low(right - bar_room * u, static_cast<float>(area.height) - height - below);
  constexpr int stripes = 64;
  const auto y = [&](double t) { return low.y + static_cast<float>(1 - t) * height; };
  for (int i = 0; i < stripes; ++i)
    canvas().AddRectFilled({low.x, y((i + 1.0) / stripes)}, {low.x + width, y(double(i) / stripes)},
                           gui_color(function.color_at((i + 0.5) / stripes)));
  const ImU32 color = gui_color(ink), halo = gui_color(dvec3(1) - ink) & ~IM_COL32(0, 0, 0, 128);
  canvas().AddRect(low, {low.x + width, low.y + height}, color);
  const auto write = [&](const ImVec2& at, const std::string& text) {
    for (const ImVec2& shift : {ImVec2(1, 0), ImVec2(-1, 0), ImVec2(0, 1), ImVec2(0, -1)})
      canvas().AddText({at.x + shift.x, at.y + shift.y}, halo, text.c_str());
    canvas().AddText(at, color, text.c_str());
  };
  const Ticks ticks = ticks_of(function, height < 100 * u ? std::min(ticks_wanted, 3) : ticks_wanted);
  const float half_line = ImGui::GetFontSize() / 2;
  for (const Tick& tick : ticks.list) {
    const double t = function.t_of(tick.value);
    canvas().AddLine({low.x + width, y(t)}, {low.x + width + 4 * u, y(t)}, color, u);
    write({low.x + width + 7 * u, y(t) - half_line}, tick.label);
  }
  const auto write_within = [&](float at_y, const std::string& text) {
    write({std::min(low.x, right - ImGui::CalcTextSize(text.c_str()).x - 8 * u), at_y}, text);
  };
  if (!ticks.factor.empty()) write_within(low.y + height + 3 * u, ticks.factor);
  write_within(low.y - 22 * u, bar.label);
}

}  // namespace

void draw_box(const View& view, const Box& box, const std::array<unsigned char, 3>& color, const PictureArea& area) {
  draw_edges(view, box, IM_COL32(color[0], color[1], color[2], 160), area);
}

void draw_cut(const View& view, std::span<const DrawnNode> nodes, std::size_t resolutions, const PictureArea& area) {
  for (const DrawnNode& node : nodes) {
    float r, g, b;
    const auto part =
        static_cast<float>(node.resolution) / static_cast<float>(std::max<std::size_t>(resolutions - 1, 1));
    ImGui::ColorConvertHSVtoRGB(0.66f * (1 - part), 0.8f, 1, r, g, b);
    draw_edges(view, {node.cube.origin, node.cube.origin + node.cube.edge},
               ImGui::ColorConvertFloat4ToU32(ImVec4(r, g, b, 0.45f)), area);
  }
}

void draw_axes(const View& view, const PictureArea& area) {
  const float length = 38 * gui_unit();
  const ImVec2 center(static_cast<float>(area.left) + 1.5f * length, static_cast<float>(area.height) - 1.5f * length);
  struct Axis {
    dvec3 seen;
    ImU32 color;
    const char* name;
  };
  std::array<Axis, 3> axes = {{{{}, IM_COL32(240, 90, 80, 255), "x"},
                               {{}, IM_COL32(110, 220, 90, 255), "y"},
                               {{}, IM_COL32(90, 150, 255, 255), "z"}}};
  for (int k = 0; k < 3; ++k) {
    dvec3 axis(0);
    axis[k] = 1;
    axes[static_cast<std::size_t>(k)].seen = {glm::dot(axis, view.right), glm::dot(axis, view.up),
                                              glm::dot(axis, view.forward)};
  }
  std::ranges::sort(axes, std::greater<>(), [](const Axis& axis) { return axis.seen.z; });  // the farthest first
  for (const Axis& axis : axes) {
    const ImVec2 tip(center.x + length * static_cast<float>(axis.seen.x),
                     center.y - length * static_cast<float>(axis.seen.y));
    canvas().AddLine(center, tip, axis.color, 2 * gui_unit());
    canvas().AddText({tip.x + 3 * gui_unit(), tip.y - 7 * gui_unit()}, axis.color, axis.name);
  }
}

void draw_scalar_bars(std::span<const PageBar> bars, int ticks, const dvec3& ink, const PictureArea& area) {
  const auto half = static_cast<float>(area.left + area.width / 2);
  auto right = static_cast<float>(area.left + area.width);
  for (const PageBar& bar : bars) {
    const float left =
        right - std::max(bar_room, ImGui::CalcTextSize(bar.label.c_str()).x / gui_unit() + 16) * gui_unit();
    if (&bar != bars.data() && left < half) return;
    draw_scalar_bar(bar, ticks, ink, right, area);
    right = left;
  }
}

void draw_message(const std::string& text, const PictureArea& area) {
  const ImVec2 size = ImGui::CalcTextSize(text.c_str());
  const ImVec2 at(static_cast<float>(area.left + area.width / 2) - size.x / 2,
                  static_cast<float>(area.height / 2) - size.y / 2);
  const float border = 10 * gui_unit();
  canvas().AddRectFilled({at.x - border, at.y - border}, {at.x + size.x + border, at.y + size.y + border},
                         IM_COL32(0, 0, 0, 200), 4 * gui_unit());
  canvas().AddText(at, IM_COL32(255, 230, 150, 255), text.c_str());
}

}  // namespace splatvol
