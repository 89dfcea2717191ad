#include "viewer/viewer.h"

#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>

#include "base/file.h"

namespace splatvol {
namespace {

constexpr double zoom_per_step = 0.87;
constexpr double least_distance = 1e-7;  // of the data's extent
constexpr double fly_speed = 0.35;       // extents a second
constexpr double turn_speed = 1.2;       // radians a second
constexpr double panel_width = 336;      // at scale 1

void put(std::array<char, 512>& field, const std::string& text) {
  const std::size_t length = std::min(text.size(), field.size() - 1);
  std::memcpy(field.data(), text.data(), length);
  field[length] = 0;
}

double extent_of(const Session& session) {
  return std::max(glm::length(session.bounds().high - session.bounds().low), 1e-300);
}

std::string bytes_text(double bytes) {
  const char* units[] = {"B", "KiB", "MiB", "GiB", "TiB"};
  int unit = 0;
  for (; bytes >= 1024 && unit < 4; ++unit) bytes /= 1024;
  return fmt::format("{:.3g} {}", bytes, units[unit]);
}

}  // namespace

Viewer::Viewer(std::unique_ptr<Gui> gui, Screen screen, const ViewerOptions& options)
    : gui_(std::move(gui)), screen_(std::move(screen)), settings_(options.settings) {}

Result<std::unique_ptr<Viewer>> Viewer::create(const ViewerOptions& options) {
  SPLATVOL_TRY_ASSIGN(gui, Gui::create());
  SPLATVOL_TRY_ASSIGN(screen, Screen::create());
  std::unique_ptr<Viewer> viewer(new Viewer(std::move(gui), std::move(screen), options));
  if (!options.volume.empty()) {
    SPLATVOL_TRY_ASSIGN(session, Session::open(options.volume, options.scene, options.settings));
    viewer->show(std::move(session));
  }
  return viewer;
}

void Viewer::show(std::unique_ptr<Session> session) {
  session_ = std::move(session);
  fitting_ = session_->first_scene().transfer_function;
  const std::string stem = std::filesystem::path(session_->path()).stem().string();
  put(scene_name_, stem + ".json");
  put(picture_name_, stem + ".png");
  put(path_name_, stem + "-path.json");
  path_ = {};
  playing_.reset();
}

// A scene goes with the volume that is open; anything else is taken for a volume.
void Viewer::open(const std::string& path) {
  message_.clear();
  if (session_ && path.ends_with(".json")) {
    auto scene = load_scene(path);
    if (scene && session_->info().find_attribute(scene->attribute) < 0)
      message_ = fmt::format("{}: this file has no attribute '{}'", path, scene->attribute);
    else if (scene)
      session_->scene = std::move(*scene);
    else
      message_ = scene.error().message;
    return;
  }
  auto session = Session::open(path, "", session_ ? session_->settings : settings_);
  if (session)
    show(std::move(*session));
  else
    message_ = session.error().message;
}

// Right of the panel; of at least one pixel.
PicturePlace Viewer::place() const {
  PicturePlace place;
  const double left = panel_ ? panel_width * window_.content_scale : 0;
  place.unit_x = static_cast<double>(window_.width) / std::max(1, window_.pixel_width);
  place.unit_y = static_cast<double>(window_.height) / std::max(1, window_.pixel_height);
  place.left = std::max(0.0, std::min(left, window_.width - place.unit_x));
  place.width = std::max(place.unit_x, window_.width - place.left);
  place.height = std::max(place.unit_y, static_cast<double>(window_.height));
  return place;
}

std::string Viewer::title() const { return session_ ? session_->path() + " - svview" : "svview"; }

bool Viewer::is_settled() const {
  const bool flies = flying_ && std::ranges::any_of(keys_, [](bool down) { return down; });
  return pending_frames_ == 0 && !playing_ && !flies && (!session_ || session_->is_settled());
}

void Viewer::handle(const Event& event) {
  if (const auto* resized = std::get_if<WindowResized>(&event)) window_ = *resized;
  if (const auto* dropped = std::get_if<FilesDropped>(&event))
    for (const std::string& path : dropped->paths) open(path);
  if (const auto* changed = std::get_if<KeyChanged>(&event)) {
    const bool pressed = changed->down && !keys_[static_cast<std::size_t>(changed->code)];
    keys_[static_cast<std::size_t>(changed->code)] = changed->down;
    if (pressed && !gui_->has_keyboard()) handle_key(changed->code);
  }
  if (const auto* button = std::get_if<ButtonChanged>(&event); button && button->button >= 0 && button->button < 3) {
    buttons_[static_cast<std::size_t>(button->button)] = button->down;
    if (button->down && !drag_ && !gui_->has_pointer()) drag_ = button->button;
    if (!button->down && drag_ == button->button) drag_.reset();
  }
  const auto* moved = std::get_if<PointerMoved>(&event);
  const auto* scrolled = std::get_if<Scrolled>(&event);
  if (moved) {
    const dvec2 place(moved->x, moved->y), drag = place - pointer_;
    pointer_ = place;
    if (!session_ || !drag_) return;
    Camera& camera = session_->scene.camera;
    const bool shift = keys_[key::left_shift], control = keys_[key::left_control];
    if (flying_ && *drag_ == 0) {
      const double unit = 2.0 / std::min(viewport().width, viewport().height);
      fly(camera, dvec3(0), unit * drag.x, -unit * drag.y);
    } else if (*drag_ == 1 || *drag_ == 2 || shift) {
      pan(camera, viewport(), drag);
    } else if (control) {
      roll(camera, 4 * drag.x / viewport().width);
    } else {
      orbit(camera, viewport(), drag);
    }
    playing_.reset();
  }
  if (scrolled && session_ && !gui_->has_pointer()) {
    zoom(session_->scene.camera, viewport(), pointer_in_picture(), std::pow(zoom_per_step, scrolled->y),
         least_distance * extent_of(*session_));
    playing_.reset();
  }
}

void Viewer::handle_key(int code) {
  const auto toggle = [](bool& shown) { shown = !shown; };
  if (code == key::f1) toggle(help_);
  if (code == key::escape) help_ = false;
  if (code == 'Q' && keys_[key::left_control]) closing_ = true;
  if (code == key::tab) toggle(panel_);
  if (!session_ || keys_[key::left_control]) return;
  Camera& camera = session_->scene.camera;
  const double sign = keys_[key::left_shift] ? 1 : -1;
  switch (code) {
    case 'F':
      toggle(flying_);
      break;
    case 'H':
      toggle(hud_);
      break;
    case 'C':
      toggle(cut_);
      break;
    case 'B':
      toggle(box_);
      break;
    case 'R':
      camera = session_->first_scene().camera;
      break;
    case 'P':
      set_projection(camera, camera.projection == Camera::Projection::perspective ? Camera::Projection::orthographic
                                                                                  : Camera::Projection::perspective);
      break;
    case 'L':
      if (session_->scene.lighting)
        session_->scene.lighting.reset();
      else
        session_->scene.lighting = Lighting();
      break;
    case '1':
      look_along(camera, {sign, 0, 0}, {0, 1, 0});
      break;
    case '2':
      look_along(camera, {0, sign, 0}, {0, 0, -sign});
      break;
    case '3':
      look_along(camera, {0, 0, sign}, {0, 1, 0});
      break;
    default:
      break;
  }
}

// Keys that are held in fly mode.
void Viewer::move_camera(const FrameInput& input) {
  if (!session_ || !flying_ || gui_->has_keyboard()) return;
  const auto axis = [&](int positive, int negative) {
    return (keys_[static_cast<std::size_t>(positive)] ? 1.0 : 0.0) -
           (keys_[static_cast<std::size_t>(negative)] ? 1.0 : 0.0);
  };
  const double seconds = std::min(input.seconds, 0.1);
  const dvec3 direction(axis('D', 'A'), axis('E', 'Q'), axis('W', 'S'));
  const double yaw = axis(key::right, key::left), pitch = axis(key::up, key::down);
  if (direction == dvec3(0) && yaw == 0 && pitch == 0) return;
  const double faster = keys_[key::left_shift] ? 4 : 1;
  fly(session_->scene.camera, faster * fly_speed * seconds * extent_of(*session_) * direction,
      turn_speed * seconds * yaw, turn_speed * seconds * pitch);
}

void Viewer::play(double seconds) {
  if (!playing_ || !session_ || path_.cameras.size() < 2) return playing_.reset();
  *playing_ += seconds;
  session_->scene.camera = camera_at(path_, *playing_ / path_.seconds);
  if (*playing_ >= path_.seconds) playing_.reset();
}

Status Viewer::frame(const FrameInput& input) {
  if (!input.events.empty()) pending_frames_ = 3;
  pending_frames_ = std::max(0, pending_frames_ - 1);
  frame_seconds_ = 0.9 * frame_seconds_ + 0.1 * input.seconds;
  for (const Event& event : input.events) handle(event);
  if (window_.pixel_width <= 0 || window_.pixel_height <= 0) return {};  // minimised
  move_camera(input);
  play(input.seconds);
  SPLATVOL_TRY(gui_->begin(input, window_));
  if (panel_) draw_panel();
  if (help_) draw_help();
  SPLATVOL_TRY(draw_picture(input.seconds));
  if (session_ && !session_->is_settled()) pending_frames_ = 2;
  draw_overlays();
  return gui_->draw();
}

Status Viewer::draw_picture(double seconds) {
  GLint target = 0;
  glGetIntegerv(GL_DRAW_FRAMEBUFFER_BINDING, &target);
  const int left = static_cast<int>(place().left / place().unit_x);
  const int width = std::max(1, window_.pixel_width - left);
  GLuint picture = 0;
  dvec3 background(0.02);
  if (session_) {
    if (const Status drawn = session_->draw(width, window_.pixel_height, seconds)) {
      picture = session_->texture();
      background = session_->scene.background;
    } else {
      message_ = drawn.error().message;
    }
  }
  glBindFramebuffer(GL_FRAMEBUFFER, static_cast<GLuint>(target));
  glClearColor(0.1f, 0.1f, 0.11f, 1);
  glClear(GL_COLOR_BUFFER_BIT);
  return screen_.show(picture, background, left, width, window_.pixel_height);
}

void Viewer::draw_panel() {
  const float scale = static_cast<float>(window_.content_scale);
  ImGui::SetNextWindowPos({0, 0});
  ImGui::SetNextWindowSize({static_cast<float>(panel_width) * scale, static_cast<float>(window_.height)});
  ImGui::Begin("panel", nullptr, ImGuiWindowFlags_NoDecoration & ~ImGuiWindowFlags_NoScrollbar);
  ImGui::PushItemWidth(220 * scale);
  if (session_) {
    Scene& scene = session_->scene;
    if (ImGui::BeginCombo("attribute", scene.attribute.c_str())) {
      for (const auto& attribute : session_->info().attributes)
        if (ImGui::Selectable(attribute.name.c_str(), attribute.name == scene.attribute) &&
            attribute.name != scene.attribute) {
          if (Status status = session_->show_attribute(attribute.name))
            fitting_ = scene.transfer_function;
          else
            message_ = status.error().message;
        }
      ImGui::EndCombo();
    }
    if (ImGui::CollapsingHeader("transfer function", ImGuiTreeNodeFlags_DefaultOpen))
      editor_.draw(scene.transfer_function, fitting_, session_->attribute(), session_->histogram());
    if (ImGui::CollapsingHeader("view", ImGuiTreeNodeFlags_DefaultOpen)) draw_view_section();
    if (ImGui::CollapsingHeader("camera path")) draw_path_section();
    if (ImGui::CollapsingHeader("save")) draw_file_section();
  } else {
    ImGui::TextWrapped("Drop a .svol file on this window.");
  }
  if (ImGui::SmallButton("keys (F1)")) help_ = !help_;
  if (!message_.empty()) ImGui::TextWrapped("%s", message_.c_str());
  ImGui::PopItemWidth();
  ImGui::End();
}

void Viewer::draw_view_section() {
  Scene& scene = session_->scene;
  ViewSettings& settings = session_->settings;
  const double finest = 0.1, coarsest = 20;
  ImGui::SliderScalar("tolerance", ImGuiDataType_Double, &settings.tolerance, &finest, &coarsest, "%.2g %%",
                      ImGuiSliderFlags_Logarithmic);
  // Memory is taken anew when the slider is let go.
  static constexpr std::uint64_t least = 16, most = 65536;
  std::uint64_t mebibytes = memory_shown_ ? *memory_shown_ : settings.memory >> 20;
  if (ImGui::SliderScalar("memory", ImGuiDataType_U64, &mebibytes, &least, &most, "%llu MiB",
                          ImGuiSliderFlags_Logarithmic))
    memory_shown_ = mebibytes;
  if (memory_shown_ && !ImGui::IsItemActive()) {
    settings.memory = *memory_shown_ << 20;
    memory_shown_.reset();
  }
  int kernel = settings.kernel == KernelKind::moments ? 0 : 1;
  if (ImGui::Combo("kernel", &kernel, "moments\0octant\0"))
    settings.kernel = kernel == 0 ? KernelKind::moments : KernelKind::octant;
  bool lit = scene.lighting.has_value();
  if (ImGui::Checkbox("lighting", &lit)) scene.lighting = lit ? std::optional(Lighting()) : std::nullopt;
  if (scene.lighting) {
    const double none = 0, full = 1;
    ImGui::SliderScalar("ambient", ImGuiDataType_Double, &scene.lighting->ambient, &none, &full, "%.2f");
    ImGui::SliderScalar("diffuse", ImGuiDataType_Double, &scene.lighting->diffuse, &none, &full, "%.2f");
  }
  bool orthographic = scene.camera.projection == Camera::Projection::orthographic;
  if (ImGui::Checkbox("orthographic", &orthographic))
    set_projection(scene.camera, orthographic ? Camera::Projection::orthographic : Camera::Projection::perspective);
  ImGui::SameLine();
  ImGui::Checkbox("fly", &flying_);
  ImGui::SameLine();
  if (ImGui::SmallButton("reset")) scene.camera = session_->first_scene().camera;
  for (int axis = 0; axis < 3; ++axis)
    for (const double sign : {1.0, -1.0}) {
      const std::string name = fmt::format("{}{}", sign > 0 ? '+' : '-', "xyz"[axis]);
      dvec3 direction(0);
      direction[axis] = -sign;  // seen from there
      if (ImGui::SmallButton(name.c_str()))
        look_along(scene.camera, direction, axis == 1 ? dvec3(0, 0, -sign) : dvec3(0, 1, 0));
      ImGui::SameLine();
    }
  ImGui::NewLine();
  bool clipped = scene.clip_box.has_value();
  if (ImGui::Checkbox("clip box", &clipped))
    scene.clip_box = clipped ? std::optional(session_->bounds()) : std::nullopt;
  for (int axis = 0; scene.clip_box && axis < 3; ++axis) {
    const Box& bounds = session_->bounds();
    double range[2] = {scene.clip_box->low[axis], scene.clip_box->high[axis]};
    const double span = bounds.high[axis] - bounds.low[axis];
    const std::string name(1, "xyz"[axis]);
    if (ImGui::DragScalarN(name.c_str(), ImGuiDataType_Double, range, 2, static_cast<float>(span / 200), nullptr,
                           nullptr, "%.4g") &&
        range[0] < range[1])
      scene.clip_box->low[axis] = range[0], scene.clip_box->high[axis] = range[1];
  }
  ImGui::Checkbox("axes", &axes_);
  ImGui::SameLine();
  ImGui::Checkbox("box", &box_);
  ImGui::SameLine();
  ImGui::Checkbox("scalar bar", &scalar_bar_);
  ImGui::Checkbox("HUD", &hud_);
  ImGui::SameLine();
  ImGui::Checkbox("octree cut", &cut_);
  ImGui::SameLine();
  ImGui::Checkbox("probe", &probe_);
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
  ImGui::Text("%zu views", path_.cameras.size());
  ImGui::InputText("file##path", path_name_.data(), path_name_.size());
  if (ImGui::SmallButton("save path") && !path_.cameras.empty())
    save(path_name_.data(), write_text_file(path_name_.data(), path_to_json(path_)));
  ImGui::SameLine();
  if (ImGui::SmallButton("load path")) {
    auto path = load_camera_path(path_name_.data());
    if (path)
      path_ = std::move(*path);
    else
      message_ = path.error().message;
  }
}

void Viewer::draw_file_section() {
  ImGui::InputText("scene", scene_name_.data(), scene_name_.size());
  if (ImGui::SmallButton("save scene"))
    save(scene_name_.data(), write_text_file(scene_name_.data(), scene_to_json(session_->scene)));
  ImGui::SameLine();
  if (ImGui::SmallButton("load scene")) open(scene_name_.data());
  ImGui::InputText("picture", picture_name_.data(), picture_name_.size());
  if (ImGui::SmallButton("save picture (.png, .exr)")) {
    const auto image = session_->image();
    Status status = image ? Status() : tl::unexpected(image.error());
    if (status && !is_image_path(picture_name_.data()))
      status = fail(ErrorCode::invalid_argument, "{}: neither .png nor .exr", picture_name_.data());
    if (status)
      status =
          write_image(picture_name_.data(), *image, session_->scene.background,
                      {{"software", "svview"}, {"file", session_->path()}, {"attribute", session_->scene.attribute}});
    save(picture_name_.data(), status);
  }
}

void Viewer::save(const std::string& what, const Status& status) {
  message_ = status ? "saved " + what : status.error().message;
}

void Viewer::draw_hud() {
  const FrameSplats* frame = session_->frame();
  if (!frame) return;
  const StreamerStatistics statistics = session_->statistics();
  std::string resolutions;
  for (std::size_t r = 0; r < frame->splats_by_resolution.size(); ++r)
    if (frame->splats_by_resolution[r] > 0)
      resolutions += fmt::format("  resolution {}: {} splats in {} nodes\n", r, frame->splats_by_resolution[r],
                                 frame->nodes_by_resolution[r]);
  const auto bytes = [](std::uint64_t count) { return bytes_text(static_cast<double>(count)); };
  const double asked = session_->tolerance_shown(), drawn = frame->detail.tolerance_percent;
  std::string detail = "coarse while it moves";
  if (!frame->detail.goal) detail = fmt::format("tolerance {:.3g} %", asked);
  if (!frame->detail.goal && drawn > asked) detail += fmt::format(" (memory allows {:.3g} %)", drawn);
  const FrameProgress& progress = frame->progress;
  std::string text = fmt::format("{:.0f} frames/s, picture {:.1f} ms\n", frame_seconds_ > 0 ? 1 / frame_seconds_ : 0,
                                 1000 * session_->draw_seconds());
  text += fmt::format("{} points as {} splats\n{}", session_->info().point_count(), frame->splats, resolutions);
  text += fmt::format("{}, an error of about {:.1g}\n", detail, frame->expected_error);
  text += fmt::format("{} of {} in use, {} on the GPU\n", bytes(statistics.bytes_resident),
                      bytes(session_->settings.memory), bytes(session_->gpu_bytes()));
  text += fmt::format("{} of {} read\n", bytes(statistics.bytes_read), bytes(session_->file_bytes()));
  text += fmt::format("{} parts pending ({})", progress.missing_chunks + progress.missing_pages,
                      bytes(progress.missing_bytes));
  const float scale = static_cast<float>(window_.content_scale);
  ImGui::SetNextWindowPos({static_cast<float>(window_.width) - 8 * scale, 8 * scale}, ImGuiCond_Always, {1, 0});
  ImGui::SetNextWindowBgAlpha(0.5f);
  ImGui::Begin("HUD", nullptr,
               ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_NoInputs | ImGuiWindowFlags_AlwaysAutoResize |
                   ImGuiWindowFlags_NoFocusOnAppearing | ImGuiWindowFlags_NoNav);
  ImGui::TextUnformatted(text.c_str());
  for (const std::string& trouble : session_->troubles()) ImGui::TextColored({1, 0.5f, 0.4f, 1}, "%s", trouble.c_str());
  ImGui::End();
}

void Viewer::draw_help() {
  ImGui::SetNextWindowPos({static_cast<float>(window_.width) / 2, static_cast<float>(window_.height) / 2},
                          ImGuiCond_Always, {0.5f, 0.5f});
  ImGui::Begin("keys", &help_, ImGuiWindowFlags_NoCollapse | ImGuiWindowFlags_AlwaysAutoResize);
  ImGui::TextUnformatted(
      "left drag          turn\n"
      "right drag, shift  move\n"
      "control drag       roll\n"
      "wheel              zoom to the pointer\n"
      "R                  see all again\n"
      "1 2 3              along -x, -y, -z; with shift from the other side\n"
      "P                  perspective or orthographic\n"
      "F                  fly: W A S D E Q, arrows and left drag to look, shift for speed\n"
      "L                  lighting\n"
      "B C H              bounding box, octree cut, numbers\n"
      "Tab                panel\n"
      "F1                 this list\n"
      "control Q          quit\n"
      "\n"
      "Drop a .svol file to open it, a scene (.json) to apply it.");
  ImGui::End();
}

void Viewer::draw_overlays() {
  if (!session_) return draw_message("Drop a .svol file here, or: svview FILE.svol", place());
  const View& view = session_->view();
  if (cut_ && session_->frame()) draw_cut(view, session_->drawn_nodes(), session_->info().resolutions(), place());
  if (box_) draw_box(view, session_->bounds(), {230, 230, 230}, place());
  if (session_->scene.clip_box) draw_box(view, *session_->scene.clip_box, {255, 210, 80}, place());
  if (axes_) draw_axes(view, place());
  if (scalar_bar_) draw_scalar_bar(session_->scene.transfer_function, session_->attribute(), place());
  if (const std::string reason = session_->explain(); !reason.empty()) draw_message(reason, place());
  if (hud_) draw_hud();
  if (probe_ && !drag_ && !gui_->has_pointer()) draw_probe();
}

// Beside the pointer. Follows the splats of the last frame.
void Viewer::draw_probe() {
  const FrameSplats* frame = session_->frame();
  if (!frame || pointer_in_picture().x < 0) return;
  const auto found =
      probe(frame->data, frame->batches, session_->scene.transfer_function, session_->value_offset(), session_->view(),
            pointer_in_picture().x / place().unit_x, pointer_in_picture().y / place().unit_y);
  if (!found) return;
  const std::string& unit = session_->attribute().unit;
  ImGui::SetTooltip("%s %.5g %s\nat %.5g, %.5g, %.5g\nopacity %.0f %%", session_->scene.attribute.c_str(), found->value,
                    unit.c_str(), found->position.x, found->position.y, found->position.z, 100 * found->opacity);
}

}  // namespace splatvol
