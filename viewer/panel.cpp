#include "viewer/panel.h"

#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>
#include <filesystem>

#include "viewer/window/gui_units.h"

namespace splatvol {
namespace {

void draw_attribute_menu(Session& session) {
  Scene& scene = session.scene;
  if (!ImGui::BeginCombo("attribute", scene.attribute.c_str())) return;
  for (const auto& attribute : session.info().attributes)
    if (ImGui::Selectable(attribute.name.c_str(), attribute.name == scene.attribute) &&
        attribute.name != scene.attribute)
      session.show_attribute(attribute.name);
  ImGui::EndCombo();
}

// The step of a time series, and how fast steps play.
void draw_step_controls(Session& session) {
  const std::vector<double>& times = session.times();
  if (times.size() < 2) return;
  int step = static_cast<int>(session.step());
  const int last = static_cast<int>(times.size()) - 1;
  const std::string label = fmt::format("%d: time {:.6g}", times[session.step()]);
  if (ImGui::SliderInt("step", &step, 0, last, label.c_str()))
    session.choose_step(static_cast<std::size_t>(std::clamp(step, 0, last)));
  if (ImGui::SmallButton(session.is_playing() ? "stop steps" : "play steps")) session.toggle_playing();
  ImGui::SameLine();
  ImGui::Checkbox("loop", &session.playback.loops);
  const double slowest = 0.1, fastest = 60;
  ImGui::SliderScalar("steps/s", ImGuiDataType_Double, &session.playback.steps_per_second, &slowest, &fastest, "%.3g",
                      ImGuiSliderFlags_Logarithmic | ImGuiSliderFlags_AlwaysClamp);
  hint("Steps come later if the file is slow.\nControl click: type a number.");
}

void draw_panel_button(ViewerState& viewer) {
  ImGui::SetNextWindowPos({0, 0});
  ImGui::Begin("panel button", nullptr, ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_AlwaysAutoResize);
  if (ImGui::SmallButton("panel (Tab)")) viewer.panel() = true;
  ImGui::End();
}

}  // namespace

void Panel::begin() {
  const std::filesystem::path file = viewer_.session->path();
  const std::string stem = (file.has_filename() ? file : file.parent_path()).stem().string();  // of a folder, too
  save.begin(stem);
  path.begin(stem);
  movie.begin(stem);
  mesh.begin(stem);
  line.begin(stem);
  contours.begin(stem);
  measure.begin();
  planes.reset();
  surfaces_ = {};
  streamlines.reset();
}

void Panel::end() {
  movie.end(true);
  save.end();
  path.stop();
  line.end();
  contours.end();
  measure.end();
}

bool Panel::holds_scene() const { return ImGui::IsAnyItemActive() || path.is_playing() || movie.filming(); }

// Ends within a line.
void Panel::draw_history_buttons() {
  const auto button = [](const char* name, bool enabled) {
    ImGui::BeginDisabled(!enabled);
    const bool pressed = ImGui::SmallButton(name);
    ImGui::EndDisabled();
    return pressed;
  };
  const bool undoes = button("undo", viewer_.session->can_undo());
  ImGui::SameLine();
  const bool redoes = button("redo", viewer_.session->can_redo());
  const Steering::Taken taken{.scene = holds_scene()};
  if (redoes) viewer_.steering.redo(*viewer_.session, taken);
  if (undoes) viewer_.steering.undo(*viewer_.session, taken);
  ImGui::SameLine();
}

// The opacity attribute, and its factors: their rows stay while values are read.
void Panel::draw_opacity_controls() {
  Session& session = *viewer_.session;
  std::optional<SceneOpacity>& opacity = session.scene.opacity;
  if (ImGui::BeginCombo("opacity by", opacity ? opacity->attribute.c_str() : "the same attribute")) {
    if (ImGui::Selectable("the same attribute", !opacity) && opacity) session.show_opacity("");
    for (const auto& attribute : session.info().attributes) {
      const bool is_shown = opacity && opacity->attribute == attribute.name;
      if (ImGui::Selectable(attribute.name.c_str(), is_shown) && !is_shown) session.show_opacity(attribute.name);
    }
    ImGui::EndCombo();
  }
  hint("The attribute that is shown gives the colours.\nAnother one may give the opacity.");
  const auto number = opacity ? session.info().find_attribute(opacity->attribute) : -1;
  if (number < 0) return;
  const std::optional<format::Attribute> drawn = session.opacity_attribute();
  const bool is_known = drawn && drawn->name == opacity->attribute && !session.is_reading();
  ImGui::BeginDisabled(!is_known);
  if (is_known)
    opacity_editor_.draw_factors(opacity->function, *drawn, session.opacity_histogram());
  else
    opacity_editor_.draw_factors(opacity->function, session.info().attributes[static_cast<std::size_t>(number)], {});
  ImGui::EndDisabled();
}

void Panel::draw_transfer_section() {
  // The attribute's values are not known while they are read.
  Session& session = *viewer_.session;
  ImGui::BeginDisabled(session.is_reading());
  TransferFunction drawn = session.drawn_scene().transfer_function;
  if (editor_.draw(session.is_reading() ? drawn : session.scene.transfer_function, session.fitting_function(),
                   session.attribute(), session.histogram(), session.range_of_all_steps(), session.scene.contours))
    session.show_visible();
  ImGui::EndDisabled();
  draw_opacity_controls();
}

std::optional<std::string> Panel::draw_sections() {
  Session& session = *viewer_.session;
  std::optional<std::string> file;
  draw_attribute_menu(session);
  draw_step_controls(session);
  if (ImGui::CollapsingHeader("transfer function", ImGuiTreeNodeFlags_DefaultOpen)) draw_transfer_section();
  if (ImGui::CollapsingHeader("view", ImGuiTreeNodeFlags_DefaultOpen)) {
    detail_.draw(session);
    draw_lighting_controls(session.scene);
    draw_camera_controls(viewer_);
    draw_clip_box_controls(session.scene, session.mesh_box());
    surfaces_.draw(session);
    draw_shown_controls(session.scene, viewer_.shown);
  }
  if (ImGui::CollapsingHeader("camera path")) {
    path.draw();
    movie.draw();
  }
  if (ImGui::CollapsingHeader("save")) file = save.draw();
  if (ImGui::CollapsingHeader("slices, clip planes"))
    planes.draw_panel(session.scene, session.view(), session.bounds());
  if (ImGui::CollapsingHeader("contours")) contours.draw();
  if (ImGui::CollapsingHeader("line")) line.draw();
  if (ImGui::CollapsingHeader("measure")) measure.draw();
  if (ImGui::CollapsingHeader("streamlines")) streamlines.draw_panel(session);
  return file;
}

Panel::Wishes Panel::draw() {
  Wishes wishes;
  contours.begin_frame();
  if (!viewer_.panel()) {
    if (viewer_.is_narrow()) draw_panel_button(viewer_);
    return wishes;
  }
  const float scale = viewer_.scale();
  const float width =
      std::min(static_cast<float>(ViewerState::panel_width) * scale, static_cast<float>(viewer_.window.width));
  ImGui::SetNextWindowPos({viewer_.shown.panel_right ? static_cast<float>(viewer_.window.width) - width : 0, 0});
  ImGui::SetNextWindowSize({width, static_cast<float>(viewer_.window.height)});
  // It stays behind toasts and other windows, where they lie over it.
  ImGui::Begin("panel", nullptr,
               (ImGuiWindowFlags_NoDecoration & ~ImGuiWindowFlags_NoScrollbar) | ImGuiWindowFlags_HorizontalScrollbar |
                   ImGuiWindowFlags_NoBringToFrontOnFocus);
  ImGui::PushItemWidth(220 * scale);
  if (ImGui::SmallButton("open")) wishes.opens_dialog = true;
  hint("A file, an address, or one of the recent files (control O)");
  ImGui::SameLine();
  if (viewer_.session) draw_history_buttons();
  if (ImGui::SmallButton("keys (F1)")) viewer_.shown.help = !viewer_.shown.help;
  ImGui::SameLine();
  if (ImGui::SmallButton("hide (Tab)")) viewer_.panel() = false;
  if (viewer_.session) {
    wishes.file = draw_sections();
    if (viewer_.session->converted() && ImGui::CollapsingHeader("mesh")) wishes.all_steps = mesh.draw();
  } else {
    ImGui::TextWrapped("Drop a mesh or a .svol file on this window, or open one.");
  }
  ImGui::PopItemWidth();
  ImGui::End();
  return wishes;
}

}  // namespace splatvol
