#include "viewer/path_section.h"

#include <imgui.h>

#include "viewer/window/gui_units.h"

namespace splatvol {

void PathSection::begin(const std::string& stem) {
  path_ = {};
  name_.set(stem + "-path.json");
}

void PathSection::play(double seconds) {
  if (!playing_ || !viewer_.session || path_.cameras.size() < 2) return playing_.reset();
  *playing_ += seconds;
  viewer_.session->scene.camera = camera_at(path_, *playing_ / path_.seconds);
  if (*playing_ >= path_.seconds) playing_.reset();
}

void PathSection::draw() {
  if (ImGui::SmallButton("add this view")) {
    if (!path_.cameras.empty() && path_.cameras.front().projection != viewer_.session->scene.camera.projection)
      viewer_.messages.error("A path has one projection: change it (P), or begin another path");
    else
      path_.cameras.push_back(viewer_.session->scene.camera);
  }
  ImGui::SameLine();
  if (ImGui::SmallButton("remove last") && !path_.cameras.empty()) path_.cameras.pop_back();
  ImGui::SameLine();
  if (ImGui::SmallButton(playing_ ? "stop" : "play")) playing_ = playing_ ? std::nullopt : std::optional(0.0);
  const double shortest = 0.1, longest = 600;
  ImGui::SliderScalar("seconds", ImGuiDataType_Double, &path_.seconds, &shortest, &longest, "%.3g",
                      ImGuiSliderFlags_Logarithmic);
  hint("Of the whole path, or of a turn in a movie.\nControl click: type a number.");
  ImGui::Text("%zu views", path_.cameras.size());
  name_.draw("file##path");
  if (ImGui::SmallButton("save path") && !path_.cameras.empty()) save_.save_json(name_.text(), path_to_json(path_));
  ImGui::SameLine();
  if (ImGui::SmallButton("load path")) {
    auto path = load_camera_path(name_.text());
    if (path)
      path_ = std::move(*path);
    else
      viewer_.messages.error(path.error().message);
  }
}

}  // namespace splatvol
