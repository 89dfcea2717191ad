#include "viewer/view_section.h"

#include <fmt/format.h>
#include <imgui.h>

#include <string>
#include <tuple>

#include "player/choice.h"
#include "viewer/window/gui_units.h"

namespace splatvol {
namespace {

constexpr double usual_tolerance = 1;  // per cent

}  // namespace

void DetailControls::draw(Session& session) {
  ViewSettings& settings = session.settings;
  std::optional<double>& tolerance = settings.quality.tolerance_percent;
  const bool is_of_scene = asks_for_splats(settings.quality) && !tolerance;  // a number of splats, or a resolution
  int by = is_of_scene ? 2 : tolerance ? 1 : 0;
  if (ImGui::Combo("detail by", &by, is_of_scene ? "error\0tolerance\0scene\0" : "error\0tolerance\0") && by < 2)
    settings.quality = by == 0 ? Quality{.max_error = max_error_} : Quality{.tolerance_percent = usual_tolerance};
  const double least_error = 0.0005, most_error = 0.05, finest = 0.1, coarsest = 20;
  if (tolerance) {
    ImGui::SliderScalar("tolerance", ImGuiDataType_Double, &*tolerance, &finest, &coarsest, "%.2g %%",
                        ImGuiSliderFlags_Logarithmic);
  } else if (by < 2) {
    max_error_ = settings.quality.max_error.value_or(default_max_error);
    if (ImGui::SliderScalar("error", ImGuiDataType_Double, &max_error_, &least_error, &most_error, "%.2g",
                            ImGuiSliderFlags_Logarithmic))
      settings.quality = {.max_error = max_error_};
  }
  hint(by == 2     ? "At rest, the splats or the resolution that the scene tells."
       : tolerance ? "The largest share of the picture that a splat may cover, at rest.\nControl click: type a number."
                   : "Of the picture at rest: root mean square of linear RGB.\nControl click: type a number.");
  // The streamer is opened again for another memory: only when the slider is let go.
  static constexpr std::uint64_t least = 16, most = 65536;
  std::uint64_t mebibytes = memory_shown_ ? *memory_shown_ : settings.memory >> 20;
  if (ImGui::SliderScalar("memory", ImGuiDataType_U64, &mebibytes, &least, &most, "%llu MiB",
                          ImGuiSliderFlags_Logarithmic))
    memory_shown_ = mebibytes;
  hint("For the parts of the file that are read.\nControl click: type a number.");
  if (memory_shown_ && !ImGui::IsItemActive()) {
    settings.memory = *memory_shown_ << 20;
    memory_shown_.reset();
  }
  int kernel = kernel_of(settings.drawing) == KernelKind::moments ? 0 : 1;
  if (ImGui::Combo("kernel", &kernel, "moments\0octant\0"))
    settings.drawing.kernel = kernel == 0 ? KernelKind::moments : KernelKind::octant;
}

// One row, lit or not: lighting is also switched from below, and by a key.
void draw_lighting_controls(Scene& scene) {
  bool lit = scene.lighting.has_value();
  if (ImGui::Checkbox("lighting", &lit)) scene.lighting = lit ? std::optional(Lighting()) : std::nullopt;
  Lighting shown = scene.lighting.value_or(Lighting());
  const double none = 0, full = 1;
  ImGui::BeginDisabled(!scene.lighting);
  for (const auto& [id, format, value] : {std::tuple("##ambient", "ambient %.2f", &shown.ambient),
                                          std::tuple("##diffuse", "diffuse %.2f", &shown.diffuse)}) {
    ImGui::SameLine();
    ImGui::SetNextItemWidth(104 * gui_unit());
    ImGui::SliderScalar(id, ImGuiDataType_Double, value, &none, &full, format);
  }
  ImGui::EndDisabled();
  if (scene.lighting) scene.lighting = shown;
}

void draw_camera_controls(ViewerState& viewer) {
  Session& session = *viewer.session;
  Steering& steering = viewer.steering;
  Camera& camera = session.scene.camera;
  bool orthographic = camera.projection == Camera::Projection::orthographic;
  if (ImGui::Checkbox("orthographic", &orthographic))
    set_projection(camera, orthographic ? Camera::Projection::orthographic : Camera::Projection::perspective);
  ImGui::SameLine();
  ImGui::Checkbox("fly", &steering.is_flying);
  ImGui::SameLine();
  if (ImGui::SmallButton("see all")) session.show_all();
  for (int axis = 0; axis < 3; ++axis)
    for (const double sign : {1.0, -1.0}) {
      const std::string name = fmt::format("{}{}", sign > 0 ? '+' : '-', "xyz"[axis]);
      dvec3 direction(0);
      direction[axis] = sign;
      if (ImGui::SmallButton(name.c_str())) Steering::look_from(session, direction);
      ImGui::SameLine();
    }
  ImGui::SetNextItemWidth(45 * viewer.scale());
  int up = session.up_axis();
  if (ImGui::Combo("up", &up, "x\0y\0z\0")) session.choose_up(up);
}

void draw_clip_box_controls(Scene& scene, const Box& bounds) {
  std::optional<Box>& clip_box = scene.clip_box;
  bool clipped = clip_box.has_value();
  if (ImGui::Checkbox("clip box", &clipped)) clip_box = clipped ? std::optional(bounds) : std::nullopt;
  for (int axis = 0; clip_box && axis < 3; ++axis) {
    double range[2] = {clip_box->low[axis], clip_box->high[axis]};
    const double span = bounds.high[axis] - bounds.low[axis];
    const std::string name(1, "xyz"[axis]);
    if (ImGui::DragScalarN(name.c_str(), ImGuiDataType_Double, range, 2, static_cast<float>(span / 200), nullptr,
                           nullptr, "%.4g") &&
        range[0] < range[1])
      clip_box->low[axis] = range[0], clip_box->high[axis] = range[1];
    hint("In the units of the file's coordinates.\nDrag, or control click: type a number.");
  }
}

void draw_shown_controls(Scene& scene, Shown& shown) {
  ImGui::Checkbox("axes", &shown.axes);
  ImGui::SameLine();
  ImGui::Checkbox("box", &scene.outline);
  ImGui::SameLine();
  ImGui::Checkbox("scalar bar", &shown.scalar_bar);
  ImGui::Checkbox("HUD", &shown.hud);
  ImGui::SameLine();
  ImGui::Checkbox("octree cut", &shown.cut);
  ImGui::SameLine();
  ImGui::Checkbox("values", &shown.values);
  ImGui::Checkbox("light theme", &shown.light);
  ImGui::SameLine();
  ImGui::Checkbox("panel at the right", &shown.panel_right);
}

}  // namespace splatvol
