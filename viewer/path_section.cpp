#include "viewer/path_section.h"

#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>
#include <array>
#include <utility>
#include <vector>

#include "viewer/window/gui_units.h"

namespace splatvol {

void PathSection::begin(const std::string& stem) {
  path_ = {};
  name_.set(stem + "-path.json");
}

void PathSection::play(double seconds) {
  if (!playing_ || !viewer_.session || path_.views.size() < 2) return playing_.reset();
  *playing_ += seconds;
  viewer_.session->scene.camera = camera_at(path_, *playing_ / path_.seconds);
  if (*playing_ >= path_.seconds) playing_.reset();
}

// A click goes to a view. Its name can be typed, and it can change places with the one before.
void PathSection::draw_views() {
  std::vector<PathView>& views = path_.views;
  if (views.empty()) ImGui::TextUnformatted("no views yet");
  std::optional<std::size_t> removed;
  for (std::size_t i = 0; i < views.size(); ++i) {
    ImGui::PushID(static_cast<int>(i));
    if (ImGui::SmallButton(fmt::format("{}", i + 1).c_str())) {
      stop();
      viewer_.session->scene.camera = views[i].camera;
    }
    hint("Goes to this view.");
    ImGui::SameLine();
    std::array<char, 64> name{};
    views[i].name.copy(name.data(), name.size() - 1);
    ImGui::SetNextItemWidth(120 * viewer_.scale());
    if (ImGui::InputTextWithHint("##name", "name", name.data(), name.size())) views[i].name = name.data();
    ImGui::SameLine();
    ImGui::BeginDisabled(i == 0);
    if (ImGui::SmallButton("up")) std::swap(views[i - 1], views[i]);
    ImGui::EndDisabled();
    ImGui::SameLine();
    if (ImGui::SmallButton("remove")) removed = i;
    ImGui::PopID();
  }
  if (removed) views.erase(views.begin() + static_cast<std::ptrdiff_t>(*removed));
}

void PathSection::draw() {
  if (ImGui::SmallButton("add this view")) {
    const Camera& camera = viewer_.session->scene.camera;
    if (!path_.views.empty() && path_.views.front().camera.projection != camera.projection)
      viewer_.messages.error("A path has one projection: change it (P), or begin another path");
    else
      path_.views.push_back({camera});
  }
  ImGui::SameLine();
  if (ImGui::SmallButton(playing_ ? "stop" : "play")) playing_ = playing_ ? std::nullopt : std::optional(0.0);
  const double shortest = 0.1, longest = 600;
  ImGui::SliderScalar("seconds", ImGuiDataType_Double, &path_.seconds, &shortest, &longest, "%.3g",
                      ImGuiSliderFlags_Logarithmic);
  hint("Of the whole path, or of a turn in a movie.\nControl click: type a number.");
  draw_views();
  name_.draw("file##path");
  if (ImGui::SmallButton("save path") && !path_.views.empty()) save_.save_json(name_.text(), path_to_json(path_));
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
