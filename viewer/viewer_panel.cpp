// The viewer's panel, its numbers and its list of keys.
#include <fmt/format.h>
#include <imgui.h>

#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>

#include "base/byte_text.h"
#include "base/file.h"
#include "base/program.h"
#include "base/replaceable.h"
#include "pictures/contrast.h"
#include "viewer/gui_units.h"
#include "viewer/viewer.h"

namespace splatvol {
namespace {

constexpr double usual_tolerance = 1;  // per cent
constexpr int largest_picture = 16384;

Status write_json(const std::string& path, const std::string& text) {
  if (!has_extension(path, ".json")) return fail(ErrorCode::invalid_argument, "{}: does not end in .json", path);
  return write_text_file(path, text);
}

// Returns a word for a shell.
std::string quoted(const std::string& text) {
  std::string word = "'";
  for (const char c : text) word += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return word + "'";
}

// The file of a scene is named from the scene's folder on, if it lies there: both can be moved.
std::string scene_text(const std::string& path, const Session& session) {
  UsedScene used = session.used_scene();
  std::error_code error;
  const auto folder = std::filesystem::absolute(path, error).parent_path().lexically_normal();
  const auto relative = std::filesystem::path(used.use.file).lexically_relative(folder);
  if (!is_url(used.use.file) && !relative.empty() && *relative.begin() != "..") used.use.file = relative.string();
  return to_json(used);
}

// Puts a .png into the desktop's clipboard. GLFW holds text only, so a program has to.
Status copy_png(const std::string& path) {
  const bool is_wayland = std::getenv("WAYLAND_DISPLAY") != nullptr;
  const int code = is_wayland ? run_program({"wl-copy", "--type", "image/png"}, {.input = path})
                              : run_program({"xclip", "-selection", "clipboard", "-t", "image/png", "-i", path});
  const char* program = is_wayland ? "wl-copy (package wl-clipboard)" : "xclip";
  if (code == no_program) return fail(ErrorCode::io, "no {} in PATH: install it, or save the picture", program);
  return code == 0 ? Status{} : fail(ErrorCode::io, "{} failed: save the picture", program);
}

// Tells what is in the picture.
std::string drawn_text(const Session& session) {
  if (const auto& exact = session.exact())
    return fmt::format("{} segments of rays, in {} chunks of cells\n", exact->segments, exact->chunks);
  const FrameSplats& frame = *session.frame();
  std::string text = fmt::format("{} points as {} splats\n", session.info().point_count(), frame.splats);
  for (std::size_t r = 0; r < frame.splats_by_resolution.size(); ++r)
    if (frame.splats_by_resolution[r] > 0)
      text += fmt::format("  resolution {}: {} splats in {} nodes\n", r, frame.splats_by_resolution[r],
                          frame.nodes_by_resolution[r]);
  return text;
}

// Tells how fine the picture is, and why it is not finer.
std::string detail_text(const Session& session) {
  if (session.exact()) return session.is_settled() ? "exact" : "exact, with fewer samples than pixels: it sharpens";
  const FrameSplats& frame = *session.frame();
  const auto& sharpening = session.sharpening();
  if (!sharpening) return fmt::format("coarse while it moves, an error of about {:.1g}", frame.expected_error);
  const Detail& asked = sharpening->detail();
  if (asked.resolution) return fmt::format("resolution {}", frame.detail.resolution.value_or(*asked.resolution));
  if (!asked.goal) {
    const double drawn = frame.detail.tolerance_percent;
    const bool lacks = !frame.detail.goal && drawn > asked.tolerance_percent;
    return (asked.tolerance_percent > 0 ? fmt::format("tolerance {:.3g} %", asked.tolerance_percent) : "all points") +
           (lacks ? fmt::format(" (memory allows a tolerance of {:.3g} %)", drawn) : "");
  }
  if (!sharpening->seeks_error()) return fmt::format("an error of about {:.1g} expected", frame.expected_error);
  const std::string error = sharpening->error() ? fmt::format("an error of about {:.2g}", *sharpening->error()) : "";
  if (!sharpening->is_done()) return (error.empty() ? "" : error + ", ") + "it sharpens";
  if (frame.finest) return "no more points would show";
  return error + (sharpening->has_reached() ? "" : ": memory allows no less");
}

}  // namespace

// Ends within a line.
void Viewer::draw_history_buttons() {
  const auto button = [](const char* name, bool enabled) {
    ImGui::BeginDisabled(!enabled);
    const bool pressed = ImGui::SmallButton(name);
    ImGui::EndDisabled();
    return pressed;
  };
  const bool undoes = button("undo", history_ && history_->can_undo());
  ImGui::SameLine();
  if (button("redo", history_ && history_->can_redo())) redo();
  if (undoes) undo();
  ImGui::SameLine();
}

void Viewer::draw_attribute_menu() {
  Scene& scene = session_->scene;
  if (!ImGui::BeginCombo("attribute", scene.attribute.c_str())) return;
  for (const auto& attribute : session_->info().attributes)
    if (ImGui::Selectable(attribute.name.c_str(), attribute.name == scene.attribute) &&
        attribute.name != scene.attribute)
      session_->show_attribute(attribute.name);
  ImGui::EndCombo();
}

// The opacity attribute, and its factors.
void Viewer::draw_opacity_controls() {
  std::optional<SceneOpacity>& opacity = session_->scene.opacity;
  if (ImGui::BeginCombo("opacity by", opacity ? opacity->attribute.c_str() : "the same attribute")) {
    if (ImGui::Selectable("the same attribute", !opacity) && opacity) session_->show_opacity("");
    for (const auto& attribute : session_->info().attributes) {
      const bool is_shown = opacity && opacity->attribute == attribute.name;
      if (ImGui::Selectable(attribute.name.c_str(), is_shown) && !is_shown) session_->show_opacity(attribute.name);
    }
    ImGui::EndCombo();
  }
  hint("The attribute that is shown gives the colours.\nAnother one may give the opacity.");
  const std::optional<format::Attribute> drawn = session_->opacity_attribute();
  if (opacity && drawn && drawn->name == opacity->attribute && !session_->is_reading())
    opacity_editor_.draw_factors(opacity->function, *drawn, session_->opacity_histogram());
}

// The step of a time series, and how fast steps play.
void Viewer::draw_step_controls() {
  const std::vector<double>& times = session_->times();
  if (times.size() < 2) return;
  int step = static_cast<int>(session_->step());
  const int last = static_cast<int>(times.size()) - 1;
  const std::string label = fmt::format("%d: time {:.6g}", times[session_->step()]);
  if (ImGui::SliderInt("step", &step, 0, last, label.c_str()))
    show_step(static_cast<std::size_t>(std::clamp(step, 0, last)));
  if (ImGui::SmallButton(step_seconds_ ? "stop steps" : "play steps")) toggle_steps();
  ImGui::SameLine();
  ImGui::Checkbox("loop", &loops_);
  const double slowest = 0.1, fastest = 60;
  ImGui::SliderScalar("steps a second", ImGuiDataType_Double, &steps_per_second_, &slowest, &fastest, "%.3g",
                      ImGuiSliderFlags_Logarithmic | ImGuiSliderFlags_AlwaysClamp);
  hint("Steps come later if the file is slow.\nControl click: type a number.");
}

void Viewer::draw_panel() {
  const float scale = static_cast<float>(window_.content_scale);
  const float width = std::min(static_cast<float>(panel_width) * scale, static_cast<float>(window_.width));
  ImGui::SetNextWindowPos({panel_right_ ? static_cast<float>(window_.width) - width : 0, 0});
  ImGui::SetNextWindowSize({width, static_cast<float>(window_.height)});
  ImGui::Begin("panel", nullptr,
               (ImGuiWindowFlags_NoDecoration & ~ImGuiWindowFlags_NoScrollbar) | ImGuiWindowFlags_HorizontalScrollbar);
  ImGui::PushItemWidth(220 * scale);
  if (ImGui::SmallButton("open")) dialog_.open(session_ ? session_->path() : "");
  hint("A file, an address, or one of the recent files (control O)");
  ImGui::SameLine();
  if (session_) draw_history_buttons();
  if (ImGui::SmallButton("keys (F1)")) help_ = !help_;
  ImGui::SameLine();
  if (ImGui::SmallButton("hide (Tab)")) panel() = false;
  if (session_) {
    draw_attribute_menu();
    draw_step_controls();
    if (ImGui::CollapsingHeader("transfer function", ImGuiTreeNodeFlags_DefaultOpen)) {
      // The attribute's values are not known while they are read.
      ImGui::BeginDisabled(session_->is_reading());
      TransferFunction drawn = session_->drawn_scene().transfer_function;
      editor_.draw(session_->is_reading() ? drawn : session_->scene.transfer_function, session_->fitting_function(),
                   session_->attribute(), session_->histogram(), session_->range_of_all_steps());
      ImGui::EndDisabled();
      draw_opacity_controls();
    }
    if (ImGui::CollapsingHeader("view", ImGuiTreeNodeFlags_DefaultOpen)) draw_view_section();
    if (ImGui::CollapsingHeader("camera path")) draw_path_section();
    if (ImGui::CollapsingHeader("save")) draw_file_section();
    if (ImGui::CollapsingHeader("slices, clip planes, isovalue")) {
      planes_.draw_panel(session_->scene, session_->view(), session_->bounds());
      planes_.draw_isovalue(session_->scene, session_->fitting_function(), session_->bounds());
    }
  } else {
    ImGui::TextWrapped("Drop a .svol file on this window, or open one.");
  }
  if (!message_.empty()) ImGui::TextWrapped("%s", message_.c_str());
  if (session_ && !session_->troubles().empty()) {
    const auto& troubles = session_->troubles();
    ImGui::TextWrapped("%zu errors, the last: %s", troubles.size(), troubles.back().c_str());
  }
  ImGui::PopItemWidth();
  ImGui::End();
}

void Viewer::draw_panel_button() {
  ImGui::SetNextWindowPos({0, 0});
  ImGui::Begin("panel button", nullptr, ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_AlwaysAutoResize);
  if (ImGui::SmallButton("panel (Tab)")) panel() = true;
  ImGui::End();
}

void Viewer::draw_detail_controls() {
  ViewSettings& settings = session_->settings;
  std::optional<double>& tolerance = settings.quality.tolerance_percent;
  int by = tolerance ? 1 : 0;
  if (ImGui::Combo("detail by", &by, "error\0tolerance\0"))
    settings.quality = by == 0 ? Quality{.max_error = max_error_} : Quality{.tolerance_percent = usual_tolerance};
  const double least_error = 0.0005, most_error = 0.05, finest = 0.1, coarsest = 20;
  if (tolerance) {
    ImGui::SliderScalar("tolerance", ImGuiDataType_Double, &*tolerance, &finest, &coarsest, "%.2g %%",
                        ImGuiSliderFlags_Logarithmic);
  } else {
    max_error_ = settings.quality.max_error.value_or(default_max_error);
    if (ImGui::SliderScalar("error", ImGuiDataType_Double, &max_error_, &least_error, &most_error, "%.2g",
                            ImGuiSliderFlags_Logarithmic))
      settings.quality = {.max_error = max_error_};
  }
  hint(tolerance ? "The largest share of the picture that a splat may cover, at rest.\nControl click: type a number."
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

void Viewer::draw_lighting_controls() {
  Scene& scene = session_->scene;
  bool lit = scene.lighting.has_value();
  if (ImGui::Checkbox("lighting", &lit)) scene.lighting = lit ? std::optional(Lighting()) : std::nullopt;
  if (!scene.lighting) return;
  const double none = 0, full = 1;
  ImGui::SliderScalar("ambient", ImGuiDataType_Double, &scene.lighting->ambient, &none, &full, "%.2f");
  ImGui::SliderScalar("diffuse", ImGuiDataType_Double, &scene.lighting->diffuse, &none, &full, "%.2f");
}

void Viewer::draw_camera_controls() {
  Camera& camera = session_->scene.camera;
  bool orthographic = camera.projection == Camera::Projection::orthographic;
  if (ImGui::Checkbox("orthographic", &orthographic))
    set_projection(camera, orthographic ? Camera::Projection::orthographic : Camera::Projection::perspective);
  ImGui::SameLine();
  ImGui::Checkbox("fly", &flying_);
  ImGui::SameLine();
  if (ImGui::SmallButton("see all")) session_->show_all();
  for (int axis = 0; axis < 3; ++axis)
    for (const double sign : {1.0, -1.0}) {
      const std::string name = fmt::format("{}{}", sign > 0 ? '+' : '-', "xyz"[axis]);
      dvec3 direction(0);
      direction[axis] = sign;
      if (ImGui::SmallButton(name.c_str())) look_from(direction);
      ImGui::SameLine();
    }
  ImGui::SetNextItemWidth(45 * static_cast<float>(window_.content_scale));
  int up = up_;
  if (ImGui::Combo("up", &up, "x\0y\0z\0")) set_up_axis(up);
}

void Viewer::draw_clip_box_controls() {
  std::optional<Box>& clip_box = session_->scene.clip_box;
  const Box& bounds = session_->bounds();
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

void Viewer::draw_view_section() {
  draw_detail_controls();
  draw_lighting_controls();
  draw_camera_controls();
  draw_clip_box_controls();
  draw_surface_controls();
  ImGui::Checkbox("axes", &axes_);
  ImGui::SameLine();
  ImGui::Checkbox("box", &session_->scene.outline);
  ImGui::SameLine();
  ImGui::Checkbox("scalar bar", &scalar_bar_);
  ImGui::Checkbox("HUD", &hud_);
  ImGui::SameLine();
  ImGui::Checkbox("octree cut", &cut_);
  ImGui::SameLine();
  ImGui::Checkbox("probe", &probe_);
  ImGui::Checkbox("light theme", &light_);
  ImGui::SameLine();
  ImGui::Checkbox("panel at the right", &panel_right_);
}

void Viewer::draw_path_section() {
  if (ImGui::SmallButton("add this view")) {
    if (!path_.cameras.empty() && path_.cameras.front().projection != session_->scene.camera.projection)
      message_ = "A path has one projection.";
    else
      path_.cameras.push_back(session_->scene.camera);
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
  ImGui::InputText("file##path", path_name_.data(), path_name_.size());
  if (ImGui::SmallButton("save path") && !path_.cameras.empty()) save_text(path_name_.data(), path_to_json(path_));
  ImGui::SameLine();
  if (ImGui::SmallButton("load path")) {
    auto path = load_camera_path(path_name_.data());
    if (path)
      path_ = std::move(*path);
    else
      message_ = path.error().message;
  }
  draw_movie_controls();
}

void Viewer::draw_file_section() {
  ImGui::InputText("scene", scene_name_.data(), scene_name_.size());
  if (ImGui::SmallButton("save scene")) save_text(scene_name_.data(), scene_text(scene_name_.data(), *session_));
  ImGui::SameLine();
  if (ImGui::SmallButton("load scene or colours")) open(scene_name_.data());
  if (ImGui::SmallButton("copy command")) copy_command();
  hint("Copies a command that shows the same: file, scene, step, detail and kernel (control C)");
  draw_picture_controls();
}

void Viewer::copy_command() {
  UsedScene used = session_->used_scene();
  const std::string file = std::exchange(used.use.file, "");
  ImGui::SetClipboardText(fmt::format("svview {} --scene {}", quoted(file), quoted(to_json(used, -1))).c_str());
  message_ = "copied";
}

// The same page as svrender's.
void Viewer::draw_picture_controls() {
  Scene& scene = session_->scene;
  int light = is_light(scene.background) ? 1 : 0;
  if (ImGui::Combo("background", &light, "dark\0white\0")) adapt_to_background(scene, dvec3(light));
  ImGui::InputText("title", title_.data(), title_.size());
  ImGui::Checkbox("scalar bar in the file", &saves_bar_);
  ImGui::SameLine();
  ImGui::Checkbox("transparent", &saves_transparent_);
  draw_scalar_bar_controls();
  ImGui::InputText("picture", picture_name_.data(), picture_name_.size());
  ImGui::Checkbox("size as shown", &saves_as_shown_);
  if (!saves_as_shown_) ImGui::InputInt2("size", saved_size_.data());
  if (ImGui::SmallButton("save picture (.png, .exr)")) save_picture();
  ImGui::SameLine();
  if (ImGui::SmallButton("copy picture")) copy_picture();
  hint("To the clipboard, by xclip or wl-copy");
}

// In one line: the unit, and the number of ticks.
void Viewer::draw_scalar_bar_controls() {
  ScalarBar& bar = session_->scene.scalar_bar;
  const float scale = static_cast<float>(window_.content_scale);
  std::array<char, 64> unit{};
  bar.unit.copy(unit.data(), unit.size() - 1);
  ImGui::SetNextItemWidth(90 * scale);
  if (ImGui::InputText("unit", unit.data(), unit.size())) bar.unit = unit.data();
  hint("In place of the attribute's");
  ImGui::SameLine();
  ImGui::SetNextItemWidth(86 * scale);
  ImGui::SliderInt("ticks", &bar.ticks, 2, 20, "%d", ImGuiSliderFlags_AlwaysClamp);
}

// Asks before it replaces a file.
void Viewer::save(const std::string& path, std::function<void()> write) {
  std::error_code error;
  if (std::filesystem::exists(path, error))
    question_ = Question{path, std::move(write)};
  else
    write();
}

void Viewer::save_text(const std::string& path, const std::string& text) {
  save(path, [=, this] { report(path, write_json(path, text)); });
}

void Viewer::save_picture() {
  const std::string path = picture_name_.data();
  if (!is_image_path(path)) {
    message_ = path + ": neither .png nor .exr";
  } else if (const auto size = saved_size()) {
    save(path, [=, this] {
      stop_playing();
      saving_ = Saving{path, (*size)[0], (*size)[1]};
    });
  }
}

// Returns the size of pictures and movies. None if it is impossible, which the message tells.
std::optional<std::array<int, 2>> Viewer::saved_size() {
  const Scene& scene = session_->scene;
  const std::array<int, 2> size = saves_as_shown_ ? std::array{scene.width, scene.height} : saved_size_;
  if (std::ranges::min(size) >= 1 && std::ranges::max(size) <= largest_picture) return size;
  message_ = fmt::format("{} x {}: sides of pictures have 1 to {} pixels", size[0], size[1], largest_picture);
  return {};
}

// Writes the picture once it is as fine as it gets.
void Viewer::save_drawn_picture() {
  if (!saving_ || (drawn_ && !session_->is_settled())) return;
  const Status written = drawn_ ? write_picture(saving_->path) : drawn_;
  if (saving_->is_copied) {
    const Status copied = written ? copy_png(saving_->path) : written;
    message_ = copied ? "copied" : copied.error().message;
    pending_frames_ = 3;
    std::error_code error;
    std::filesystem::remove(saving_->path, error);
  } else {
    report(saving_->path, written);
  }
  saving_.reset();
}

void Viewer::copy_picture() {
  const auto size = saved_size();
  if (!size) return;
  std::error_code error;
  const std::string folder = std::filesystem::temp_directory_path(error).string();
  const std::string path = fmt::format("{}/svview-{}.png", error ? "/tmp" : folder, ::getpid());
  stop_playing();
  saving_ = Saving{path, (*size)[0], (*size)[1], true};
}

void Viewer::draw_question() {
  if (!question_) return;
  constexpr const char* name = "replace?";
  ImGui::OpenPopup(name);
  ImGui::SetNextWindowPos({static_cast<float>(window_.width) / 2, static_cast<float>(window_.height) / 2},
                          ImGuiCond_Always, {0.5f, 0.5f});
  if (!ImGui::BeginPopupModal(name, nullptr, ImGuiWindowFlags_AlwaysAutoResize)) return;
  ImGui::Text("%s is there.", question_->path.c_str());
  const bool replaces = ImGui::Button("replace it");
  ImGui::SameLine();
  if (replaces || ImGui::Button("keep it") || keys_[key::escape]) {
    ImGui::CloseCurrentPopup();
    if (replaces) question_->write();
    question_.reset();
  }
  ImGui::EndPopup();
}

Status Viewer::write_picture(const std::string& path) const {
  const Scene& scene = session_->scene;
  PageText text;
  text.title = title_.data();
  if (saves_bar_) text.bar = label_of(session_->attribute());
  text.ticks = scene.scalar_bar.ticks;
  const bool data = path.ends_with(".exr");
  SPLATVOL_TRY_ASSIGN(image, data ? session_->image() : session_->page(text, saves_transparent_));
  return write_image(path, image, scene.background,
                     {{"software", "svview"}, {"file", session_->path()}, {"attribute", scene.attribute}},
                     saves_transparent_);
}

void Viewer::report(const std::string& path, const Status& saved) {
  pending_frames_ = 3;  // the panel, which shows it, has been drawn
  message_ = saved ? "saved " + path : saved.error().message;
}

void Viewer::draw_hud() {
  const FrameSplats* frame = session_->frame();
  if (!frame) return;
  const StreamerStatistics statistics = session_->statistics();
  const auto bytes = [](std::uint64_t count) { return byte_text(static_cast<double>(count)); };
  const FrameProgress& progress = frame->progress;
  std::string text = fmt::format("{:.0f} frames/s, picture {:.1f} ms\n", frame_seconds_ > 0 ? 1 / frame_seconds_ : 0,
                                 1000 * session_->draw_seconds());
  text += drawn_text(*session_);
  text += detail_text(*session_) + "\n";
  text += fmt::format("{} of {} in use, and {} to draw\n", bytes(statistics.bytes_resident),
                      bytes(session_->settings.memory), bytes(session_->device_bytes()));
  const std::string device = session_->device_text(), name = device.substr(0, device.find(','));
  const bool is_open = name.find('(') != std::string::npos && name.find(')') == std::string::npos;
  text += session_->exact() ? "drawn by the processor\n" : fmt::format("drawn by {}{}\n", name, is_open ? ")" : "");
  text += fmt::format("{} of {} read\n", bytes(statistics.bytes_read), bytes(session_->file_bytes()));
  text += fmt::format("{} parts pending ({})", progress.missing_rows + progress.missing_pages,
                      bytes(progress.missing_bytes));
  const std::vector<double>& times = session_->times();
  if (times.size() > 1)
    text +=
        fmt::format("\nstep {} (0 to {}), time {:.6g}", session_->step(), times.size() - 1, times[session_->step()]);
  const float scale = static_cast<float>(window_.content_scale);
  if (const auto& troubles = session_->troubles(); !troubles.empty())
    text += fmt::format("\nerrors: {}", troubles.size());
  // Where it would hide most of the picture, or the button of the panel, there are no numbers.
  const ImVec2 size = ImGui::CalcTextSize(text.c_str());
  const float room = static_cast<float>(picture_area().width) - (is_narrow() ? 120 : 32) * scale;
  if (panel() && is_narrow()) return;
  if (size.x > room || size.y > static_cast<float>(picture_area().height) / 2) return;
  const float right = static_cast<float>(picture_area().left + picture_area().width);
  ImGui::SetNextWindowPos({right - 8 * scale, 8 * scale}, ImGuiCond_Always, {1, 0});
  ImGui::SetNextWindowBgAlpha(0.75f);
  ImGui::Begin("HUD", nullptr,
               ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoInputs | ImGuiWindowFlags_AlwaysAutoResize |
                   ImGuiWindowFlags_NoFocusOnAppearing | ImGuiWindowFlags_NoNav);
  ImGui::TextUnformatted(text.c_str());
  ImGui::End();
}

void Viewer::draw_help() {
  const PictureArea area = picture_area();
  ImGui::SetNextWindowPos({static_cast<float>(area.left + area.width / 2), static_cast<float>(window_.height) / 2},
                          ImGuiCond_Always, {0.5f, 0.5f});
  ImGui::Begin("keys", &help_, ImGuiWindowFlags_NoCollapse | ImGuiWindowFlags_AlwaysAutoResize);
  constexpr std::pair<const char*, const char*> lines[] = {
      {"left drag", "turn"},
      {"right drag, shift", "move"},
      {"control drag", "roll"},
      {"wheel", "zoom to the pointer; with shift, or sideways: move"},
      {"click", "pin the value and its plot along the line of sight"},
      {"R", "see all again"},
      {"1 2 3", "from +x, +y, +z; with shift from the other side"},
      {"P", "perspective or orthographic"},
      {"F", "fly: W A S D E Q, arrows and left drag to look, shift for speed"},
      {"L", "lighting"},
      {"X", "add a slice; drag its balls to move and turn it"},
      {"space", "play the steps of a time series, or stop"},
      {"left, right", "step before, next step"},
      {"B C H", "bounding box, octree cut, numbers"},
      {"Tab", "panel"},
      {"control Z", "undo; with shift, or control Y: redo"},
      {"control O, W", "open a file, close it"},
      {"control C", "copy a command that shows the same"},
      {"Esc", "cancel what is being read"},
      {"F1", "this list"},
      {"control Q", "quit"},
  };
  if (ImGui::BeginTable("keys", 2, ImGuiTableFlags_SizingFixedFit)) {
    for (const auto& [keys, what] : lines) {
      ImGui::TableNextColumn();
      ImGui::TextUnformatted(keys);
      ImGui::TableNextColumn();
      ImGui::TextUnformatted(what);
    }
    ImGui::EndTable();
  }
  ImGui::TextUnformatted("Drop a .svol file to open it, a scene or ParaView's colour maps (.json) to apply them.");
  ImGui::End();
}

}  // namespace splatvol
