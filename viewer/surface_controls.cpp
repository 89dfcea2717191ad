// The panel's list of surfaces: those of the scene, and the patches of the file's boundary.
#include <imgui.h>

#include <algorithm>
#include <filesystem>

#include "viewer/viewer.h"

namespace splatvol {
namespace {

constexpr std::size_t most_rows = 8;  // beyond, the list scrolls

std::string name_of(const SceneSurface& surface) {
  if (!surface.boundary.empty()) return surface.boundary;
  return std::filesystem::path(surface.file).filename().string();
}

// Returns whether the box was clicked. A name may hold any characters, also ImGui's marks.
bool draw_row(std::size_t number, const std::string& name, bool& shown) {
  ImGui::PushID(static_cast<int>(number));
  const bool clicked = ImGui::Checkbox("##shown", &shown);
  ImGui::SameLine();
  ImGui::TextUnformatted(name.c_str());
  ImGui::PopID();
  return clicked;
}

// The patches of the file that no surface of the scene is.
std::vector<std::string> other_patches(const format::VolumeInfo& info, const std::vector<SceneSurface>& surfaces) {
  std::vector<std::string> names;
  if (!info.boundary) return names;
  for (const format::PatchInfo& patch : info.boundary->patches)
    if (patch.triangles > 0 && std::ranges::find(surfaces, patch.name, &SceneSurface::boundary) == surfaces.end())
      names.push_back(patch.name);
  return names;
}

}  // namespace

void Viewer::draw_surface_controls() {
  std::vector<SceneSurface>& surfaces = session_->scene.surfaces;
  const std::vector<std::string> patches = other_patches(session_->info(), surfaces);
  const std::size_t rows = surfaces.size() + patches.size();
  if (rows == 0) return;
  ImGui::TextUnformatted("surfaces");
  const float row_height = ImGui::GetFrameHeightWithSpacing();
  const bool scrolls = rows > most_rows;
  if (scrolls) ImGui::BeginChild("surfaces", {0, row_height * most_rows}, true);
  std::size_t number = 0;
  for (SceneSurface& surface : surfaces) draw_row(number++, name_of(surface), surface.shown);
  for (const std::string& patch : patches) {
    bool shown = false;
    if (draw_row(number++, patch, shown)) surfaces.push_back({.boundary = patch});
  }
  if (scrolls) ImGui::EndChild();
  if (const auto left_out = session_->left_out())
    ImGui::TextWrapped("%s: svview --memory grants more", left_out->message.c_str());
}

}  // namespace splatvol
