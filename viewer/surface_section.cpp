#include "viewer/surface_section.h"

#include <imgui.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "viewer/coloring.h"
#include "viewer/window/gui_units.h"

namespace splatvol {

// A row of the list.
struct SurfaceSection::Row {
  std::string name;
  std::optional<std::size_t> surface = {};  // of the scene; none: a patch that the scene does not have
};

namespace {

constexpr std::size_t most_rows = 8;  // beyond, the list scrolls

std::string name_of(const SceneSurface& surface) {
  if (!surface.boundary.empty()) return surface.boundary;
  return std::filesystem::path(surface.file).filename().string();
}

// The patches of the file's boundary.
std::vector<std::string> patches_of(const format::VolumeInfo& info) {
  std::vector<std::string> names;
  if (!info.boundary) return names;
  for (const format::PatchInfo& patch : info.boundary->patches)
    if (patch.triangles > 0) names.push_back(patch.name);
  return names;
}

// Patches have the file's order, so that no row moves when its patch becomes a surface.
template <class Row>
std::vector<Row> rows_of(const std::vector<SceneSurface>& surfaces, const std::vector<std::string>& patches) {
  std::vector<Row> rows;
  for (std::size_t i = 0; i < surfaces.size(); ++i)
    if (std::ranges::find(patches, surfaces[i].boundary) == patches.end()) rows.push_back({name_of(surfaces[i]), i});
  for (const std::string& patch : patches) {
    const std::size_t before = rows.size();
    for (std::size_t i = 0; i < surfaces.size(); ++i)
      if (surfaces[i].boundary == patch) rows.push_back({patch, i});
    if (rows.size() == before) rows.push_back({patch});
  }
  return rows;
}

// Whether the name was clicked. It may hold any characters, also ImGui's marks.
bool draw_name(const std::string& name, bool is_selected) {
  ImGui::AlignTextToFramePadding();
  const ImVec2 place = ImGui::GetCursorScreenPos();
  const bool clicked = ImGui::Selectable("##name", is_selected);
  ImGui::GetWindowDrawList()->AddText({place.x, place.y + ImGui::GetStyle().FramePadding.y},
                                      ImGui::GetColorU32(ImGuiCol_Text), name.c_str(), name.c_str() + name.size());
  return clicked;
}

// The surfaces that a control changes; the first one is shown in it.
using Chosen = std::vector<SceneSurface*>;

void draw_coloring(const Session& session, const Chosen& chosen) {
  const std::optional<SceneColoring> first = chosen.front()->color_by;
  const auto color = [&](const std::optional<SceneColoring>& coloring) {
    for (SceneSurface* surface : chosen) surface->color_by = coloring;
  };
  ImGui::BeginDisabled(!session.info().cells);
  if (ImGui::BeginCombo("colour", first ? ("by " + first->attribute).c_str() : "one colour")) {
    if (ImGui::Selectable("one colour", !first)) color(std::nullopt);
    for (const format::Attribute& attribute : session.info().attributes)
      if (ImGui::Selectable(("by " + attribute.name).c_str(), first && first->attribute == attribute.name))
        color(coloring_by(session.scene, attribute));
    ImGui::EndCombo();
  }
  ImGui::EndDisabled();
  hint(session.info().cells ? "One, or by the values of the cells at the surface"
                            : "This file keeps no cells, and only these have values at surfaces.");
  if (first) return;
  dvec3 rgb = chosen.front()->color;
  if (!edit_color("##rgb", rgb)) return;
  for (SceneSurface* surface : chosen) surface->color = rgb;
}

void draw_opacity(const Chosen& chosen) {
  double opacity = chosen.front()->opacity;
  const double clear = 0, opaque = 1;
  if (!ImGui::SliderScalar("opacity", ImGuiDataType_Double, &opacity, &clear, &opaque, "%.2f")) return;
  for (SceneSurface* surface : chosen) surface->opacity = std::clamp(opacity, clear, opaque);
}

void draw_near_side(const Chosen& chosen) {
  const auto patch = std::ranges::find_if(chosen, [](const SceneSurface* one) { return !one->boundary.empty(); });
  ImGui::BeginDisabled(patch == chosen.end());
  int side = patch == chosen.end() ? 0 : static_cast<int>((*patch)->near_side);
  if (ImGui::Combo("near side", &side, "shown\0translucent\0hidden\0"))
    for (SceneSurface* surface : chosen)
      if (!surface->boundary.empty()) surface->near_side = static_cast<NearSide>(side);
  ImGui::EndDisabled();
  hint(patch == chosen.end()
           ? "A file of a surface does not tell where cells are."
           : "Parts between the eye and the cells behind them: the front of the outer walls, and nothing "
             "of a body in the flow");
}

}  // namespace

// A patch becomes a surface when it is clicked: where it would hide the cells from the eye, it is open.
void SurfaceSection::draw_row(Session& session, const Row& row) {
  std::vector<SceneSurface>& surfaces = session.scene.surfaces;
  const bool is_selected = row.surface && selected_ == row.surface;
  bool shown = row.surface && surfaces[*row.surface].shown;
  const bool checked = ImGui::Checkbox("##shown", &shown);
  ImGui::SameLine();
  const bool clicked = draw_name(row.name, is_selected);
  hint("Its look is set below the list.\nAnother click: the look of all surfaces that are shown.");
  if (!checked && !clicked) return;
  const std::size_t number = row.surface.value_or(surfaces.size());
  if (!row.surface) surfaces.push_back({.boundary = row.name, .near_side = NearSide::hidden});
  if (checked) surfaces[number].shown = shown;
  if (clicked) selected_ = is_selected ? std::nullopt : std::optional(number);
}

// It comes below the list, so that its rows stay.
void SurfaceSection::draw_style(Session& session) {
  Chosen chosen;
  if (selected_) chosen.push_back(&session.scene.surfaces[*selected_]);
  for (SceneSurface& surface : session.scene.surfaces)
    if (!selected_ && surface.shown) chosen.push_back(&surface);
  if (chosen.empty()) return;
  const std::string name = selected_ ? name_of(*chosen.front()) : "all surfaces that are shown";
  ImGui::TextUnformatted(name.c_str());
  draw_coloring(session, chosen);
  draw_opacity(chosen);
  draw_near_side(chosen);
}

void SurfaceSection::draw(Session& session) {
  const std::vector<Row> rows = rows_of<Row>(session.scene.surfaces, patches_of(session.info()));
  if (selected_ && *selected_ >= session.scene.surfaces.size()) selected_.reset();
  if (rows.empty()) return;
  ImGui::PushID("surfaces");
  ImGui::TextUnformatted("surfaces");
  const bool scrolls = rows.size() > most_rows;
  if (scrolls) ImGui::BeginChild("list", {0, ImGui::GetFrameHeightWithSpacing() * most_rows}, true);
  for (std::size_t number = 0; number < rows.size(); ++number) {
    ImGui::PushID(static_cast<int>(number));
    draw_row(session, rows[number]);
    ImGui::PopID();
  }
  if (scrolls) ImGui::EndChild();
  draw_style(session);
  if (const auto left_out = session.left_out())
    ImGui::TextWrapped("%s: svview --memory grants more", left_out->message.c_str());
  ImGui::PopID();
}

}  // namespace splatvol
