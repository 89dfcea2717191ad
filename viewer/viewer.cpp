#include "viewer/viewer.h"

#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <functional>

#include "base/byte_text.h"
#include "base/file.h"
#include "pictures/contrast.h"
#include "scene/color_map_file.h"

namespace splatvol {
namespace {

constexpr double zoom_per_notch = 0.87;  // of the wheel
constexpr double pan_per_notch = 40;     // window units at scale 1
constexpr double least_distance = 1e-7;  // of the data's extent
constexpr double fly_speed = 0.35;       // extents a second
constexpr double turn_speed = 1.2;       // radians a second

// Turns of the wheel, and moves by keys, are one step of the history if they follow each other so soon.
constexpr double burst_seconds = 0.3;

// The first frame waits so long for a file, so that most windows appear with their picture.
constexpr std::chrono::milliseconds longest_first_wait{150};

void put(std::array<char, 512>& field, const std::string& text) {
  const std::size_t length = std::min(text.size(), field.size() - 1);
  std::memcpy(field.data(), text.data(), length);
  field[length] = 0;
}

// For the columns beside the picture. A processor would take 2 ms to clear all.
void clear_columns(int begin, int end, int height) {
  if (begin >= end) return;
  glEnable(GL_SCISSOR_TEST);
  glScissor(begin, 0, end - begin, height);
  glClearColor(0.1f, 0.1f, 0.11f, 1);
  glClear(GL_COLOR_BUFFER_BIT);
  glDisable(GL_SCISSOR_TEST);
}

double extent_of(const Session& session) {
  return std::max(glm::length(session.bounds().high - session.bounds().low), 1e-300);
}

}  // namespace

Viewer::Viewer(const ViewerOptions& options)
    : settings_(options.settings), recent_files_(options.recent_files), window_(options.window) {}

// The file is read while the interface is prepared.
Result<std::unique_ptr<Viewer>> Viewer::create(const ViewerOptions& options) {
  std::unique_ptr<Viewer> viewer(new Viewer(options));
  if (!options.volume.empty() || !options.scene.empty()) {
    SceneUse use = options.use;
    use.file = options.volume;
    viewer->begin_opening(use, options.scene);
  }
  SPLATVOL_TRY_ASSIGN(gui, Gui::create(options.window.content_scale, options.clipboard));
  SPLATVOL_TRY_ASSIGN(screen, Screen::create());
  viewer->gui_ = std::move(gui);
  viewer->screen_ = std::move(screen);
  SPLATVOL_TRY(viewer->take_opened(longest_first_wait));
  return viewer;
}

void Viewer::begin_opening(const SceneUse& use, const std::string& scene_path) {
  ViewSettings settings = session_ ? session_->settings : settings_;
  const auto [width, height] = picture_size();
  if (!is_minimised()) settings.first_picture = {.width = width, .height = height};
  opening_seconds_ = 0;
  opening_ = std::make_unique<Opening>(use, scene_path, settings);
}

// Shows the file that is being opened if it is there in time.
Status Viewer::take_opened(std::chrono::milliseconds wait) {
  if (!opening_ || (settings_.reads_aside && !opening_->wait(wait))) return {};
  const std::unique_ptr<Opening> opening = std::move(opening_);
  SPLATVOL_TRY_ASSIGN(file, opening->take());
  SPLATVOL_TRY_ASSIGN(session, Session::open(std::move(file)));
  recent_files_.add(session->path());
  show(std::move(session));
  return {};
}

void Viewer::close() {
  end_session();
  opening_.reset();
  message_.clear();
}

// Lets go of the file, and of all that belongs to it.
void Viewer::end_session() {
  end_film();
  session_.reset();
  pin_.reset();
  prober_.forget();
  history_.reset();
  question_.reset();
  saving_.reset();
  stop_playing();
}

void Viewer::stop_playing() {
  playing_.reset();
  step_seconds_.reset();
}

void Viewer::show(std::unique_ptr<Session> session) {
  end_session();
  session_ = std::move(session);
  up_ = session_->info().up >= 0 ? session_->info().up : 1;
  const std::string stem = std::filesystem::path(session_->path()).stem().string();
  put(scene_name_, stem + ".json");
  put(picture_name_, stem + ".png");
  put(path_name_, stem + "-path.json");
  put(movie_name_, stem + ".mp4");
  path_ = {};
  planes_.reset();
}

// A .json file is a scene for the volume that is open, or colours for it. Any other file is a volume.
void Viewer::open(const std::string& path) {
  message_.clear();
  if (session_ && path.ends_with(".json")) {
    const auto text = read_text_file(path);
    const bool is_map = text && is_color_map_text(*text);
    if (const Status opened = is_map ? open_color_maps(path) : open_scene(path); !opened)
      message_ = opened.error().message;
    return;
  }
  const bool is_scene = path.ends_with(".json");
  begin_opening({.file = is_scene ? "" : path}, is_scene ? path : "");
}

Status Viewer::open_scene(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(used, load_used_scene(path));
  if (!used.use.file.empty() && used.use.file != session_->used_scene().use.file) {
    begin_opening({}, path);
    return {};
  }
  if (session_->info().find_attribute(used.scene.attribute) < 0)
    return fail(ErrorCode::invalid_argument, "{}: this file has no attribute '{}'", path, used.scene.attribute);
  session_->cancel_reading();
  session_->scene = std::move(used.scene);
  return session_->use(used.use);
}

// The first of the maps colours the volume. All of them stand among the presets.
Status Viewer::open_color_maps(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(maps, load_color_maps(path));
  session_->scene.transfer_function.colors = maps.front().colors;
  editor_.add_presets(std::move(maps));
  return {};
}

// Beside the panel, and at least one pixel wide.
PictureArea Viewer::picture_area() const {
  PictureArea area;
  const double panel = panel_ && !is_narrow() ? panel_width * window_.content_scale : 0;
  area.unit_x = static_cast<double>(window_.width) / std::max(1, window_.pixel_width);
  area.unit_y = static_cast<double>(window_.height) / std::max(1, window_.pixel_height);
  area.width = std::max(area.unit_x, window_.width - panel);
  area.left = panel_right_ ? 0 : std::max(0.0, window_.width - area.width);
  area.height = std::max(area.unit_y, static_cast<double>(window_.height));
  return area;
}

// Returns the size of the window's picture, in pixels.
std::array<int, 2> Viewer::picture_size() const {
  return {std::max(1, static_cast<int>(picture_area().width / picture_area().unit_x)), window_.pixel_height};
}

std::string Viewer::title() const { return session_ ? session_->path() + " - svview" : "svview"; }

bool Viewer::is_settled() const {
  const bool flies = flying_ && std::ranges::any_of(keys_, [](bool down) { return down; });
  if (is_minimised()) return true;
  if (moved_seconds_ < burst_seconds || saving_ || filming_) return false;
  if (opening_ || prober_.is_busy()) return false;
  return events_.is_empty() && !is_busy() && pending_frames_ == 0 && !playing_ && !step_seconds_ && !flies &&
         (!session_ || session_->is_settled());
}

bool Viewer::awaits_picture() const {
  return session_ && session_->awaits_picture() && events_.is_empty() && pending_frames_ == 0 && !is_busy() &&
         !opening_ && !prober_.is_busy() && !session_->is_reading() && moved_seconds_ >= burst_seconds;
}

void Viewer::handle(const Event& event) {
  if (const auto* dropped = std::get_if<FilesDropped>(&event))
    for (const std::string& path : dropped->paths) open(path);
  if (const auto* changed = std::get_if<KeyChanged>(&event)) {
    const bool pressed = changed->down && !keys_[static_cast<std::size_t>(changed->code)];
    if (pressed && !is_held()) remember();
    keys_[static_cast<std::size_t>(changed->code)] = changed->down;
    if (pressed && !gui_->has_keyboard()) handle_key(changed->code);
  }
  if (const auto* button = std::get_if<ButtonChanged>(&event); button && button->button >= 0 && button->button < 3) {
    if (button->down && !is_held()) remember();
    buttons_[static_cast<std::size_t>(button->button)] = button->down;
    if (button->down && !drag_ && !gui_->has_pointer() && !grab_plane(button->button)) {
      drag_ = button->button;
      pressed_at_ = pointer_;
    }
    if (!button->down && drag_ == button->button) {
      drag_.reset();
      if (button->button == 0 && glm::length(pointer_ - pressed_at_) < 3 * window_.content_scale) pin(pointer_);
    }
    if (!button->down && button->button == 0) planes_.release();
  }
  if (const auto* moved = std::get_if<PointerMoved>(&event)) {
    const dvec2 position(moved->x, moved->y), drag = position - pointer_;
    pointer_ = position;
    if (session_ && planes_.is_held())
      planes_.drag(session_->scene, session_->view(), picture_area(), drag);
    else if (session_ && drag_)
      drag_camera(drag);
  }
  const auto* scrolled = std::get_if<Scrolled>(&event);
  if (scrolled && session_ && !gui_->has_pointer()) scroll(dvec2(scrolled->x, scrolled->y));
}

// The wheel, or two fingers: up and down zooms, sideways moves, and with shift both move.
void Viewer::scroll(const dvec2& notches) {
  Camera& camera = session_->scene.camera;
  const bool moves = has_shift() && !has_control();
  const dvec2 move(notches.x, moves ? notches.y : 0);
  if (move != dvec2(0)) pan(camera, viewport(), pan_per_notch * window_.content_scale * move);
  if (!moves)
    zoom(camera, viewport(), pointer_in_picture(), std::pow(zoom_per_notch, notches.y),
         least_distance * extent_of(*session_));
  playing_.reset();
  moved_seconds_ = 0;
}

// Takes a handle of a slice or a clip plane, where the pointer is over one.
bool Viewer::grab_plane(int button) {
  return button == 0 && session_ && session_->frame() &&
         planes_.grab(session_->scene, session_->view(), picture_area(), pointer_);
}

void Viewer::drag_camera(const dvec2& drag) {
  Camera& camera = session_->scene.camera;
  if (flying_ && *drag_ == 0) {
    const double unit = 2.0 / std::min(viewport().width, viewport().height);
    fly(camera, dvec3(0), unit * drag.x, -unit * drag.y);
  } else if (*drag_ == 1 || *drag_ == 2 || has_shift()) {
    pan(camera, viewport(), drag);
  } else if (has_control()) {
    roll(camera, 4 * drag.x / viewport().width);
  } else {
    orbit(camera, viewport(), drag);
  }
  playing_.reset();
}

void Viewer::handle_key(int code) {
  const auto toggle = [](bool& shown) { shown = !shown; };
  if (code == key::f1) toggle(help_);
  if (code == key::escape) help_ = false;
  if (code == key::escape && opening_) opening_.reset();
  if (code == key::escape && session_) session_->cancel_reading();
  if (code == key::escape) {
    pin_.reset();
    if (filming_ && !filming_->joined.valid()) end_film();
  }
  if (code == 'Q' && has_control()) closing_ = true;
  if (code == 'O' && has_control()) dialog_.open(session_ ? session_->path() : "");
  if (code == 'W' && has_control()) close();
  if (code == key::tab) toggle(panel());
  if (!session_) return;
  if (has_control()) {
    if (code == 'Y' || (code == 'Z' && has_shift()))
      redo();
    else if (code == 'Z')
      undo();
    else if (code == 'C')
      copy_command();
    return;
  }
  if (code == 'F') toggle(flying_);
  if (code == key::space) toggle_steps();
  if (!flying_ && code == key::right) show_step(session_->step() + 1);
  if (!flying_ && code == key::left && session_->step() > 0) show_step(session_->step() - 1);
  if (code == 'H') toggle(hud_);
  if (code == 'C') toggle(cut_);
  if (code == 'B') toggle(session_->scene.outline);
  handle_scene_key(code);
}

void Viewer::handle_scene_key(int code) {
  using Projection = Camera::Projection;
  Scene& scene = session_->scene;
  Camera& camera = scene.camera;
  const double sign = has_shift() ? 1 : -1;
  switch (code) {
    case 'R':
      session_->show_all();
      break;
    case 'P':
      set_projection(camera,
                     camera.projection == Projection::perspective ? Projection::orthographic : Projection::perspective);
      break;
    case 'L':
      scene.lighting = scene.lighting ? std::nullopt : std::optional(Lighting());
      break;
    case 'X':
      planes_.add_slice(scene, session_->view(), session_->bounds());
      break;
    case '1':
      look_from({-sign, 0, 0});
      break;
    case '2':
      look_from({0, -sign, 0});
      break;
    case '3':
      look_from({0, 0, -sign});
      break;
    default:
      break;
  }
}

// Looks at the focal point from an axis's side. From the axis that is up, the picture is a plan: x or y goes right.
void Viewer::look_from(const dvec3& direction) {
  static constexpr std::array<dvec3, 3> plan_up = {dvec3(0, 0, 1), dvec3(0, 0, -1), dvec3(0, 1, 0)};
  dvec3 up(0);
  up[up_] = 1;
  if (direction[up_] != 0) up = direction[up_] * plan_up[static_cast<std::size_t>(up_)];
  look_along(session_->scene.camera, -direction, up);
}

// Turns the camera about its line of sight, unless it looks along the axis.
void Viewer::set_up_axis(int axis) {
  up_ = axis;
  dvec3 up(0);
  up[axis] = 1;
  Camera& camera = session_->scene.camera;
  if (std::abs(glm::dot(axes_of(camera).forward, up)) < 0.999) camera.up = up;
}

// Flies with the keys that are held.
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
  moved_seconds_ = 0;
  const double faster = has_shift() ? 4 : 1;
  fly(session_->scene.camera, faster * fly_speed * seconds * extent_of(*session_) * direction,
      turn_speed * seconds * yaw, turn_speed * seconds * pitch);
}

// Whether the scene is in the middle of a change.
bool Viewer::is_held() const {
  return std::ranges::any_of(buttons_, std::identity()) || gui_->has_active_control() || playing_ || filming_ ||
         (session_ && session_->is_reading());
}

// Adds the scene to the history, if it has changed.
void Viewer::remember() {
  if (!session_ || !session_->frame()) return;
  Scene scene = session_->scene;
  scene.width = scene.height = 0;
  if (!history_)
    history_.emplace(std::move(scene));
  else
    history_->add(scene);
}

void Viewer::undo() {
  if (is_held() || !history_) return;
  remember();
  restore(history_->undo());
}

void Viewer::redo() {
  if (is_held() || !history_) return;
  remember();
  restore(history_->redo());
}

void Viewer::restore(const Scene& scene) {
  const int width = session_->scene.width, height = session_->scene.height;
  session_->scene = scene;
  session_->scene.width = width;
  session_->scene.height = height;
  moved_seconds_ = burst_seconds;
}

void Viewer::play(double seconds) {
  if (!playing_ || !session_ || path_.cameras.size() < 2) return playing_.reset();
  *playing_ += seconds;
  session_->scene.camera = camera_at(path_, *playing_ / path_.seconds);
  if (*playing_ >= path_.seconds) playing_.reset();
}

// Shows a step by the user's hand: stops playing.
void Viewer::show_step(std::size_t step) {
  step_seconds_.reset();
  if (step < session_->times().size()) session_->ask_step(step);
}

// At the last step, playing begins with the first one.
void Viewer::toggle_steps() {
  const std::size_t count = session_->times().size();
  if (step_seconds_ || count < 2) return step_seconds_.reset();
  if (session_->step() + 1 == count) show_step(0);
  step_seconds_ = 0;
  played_step_.reset();
}

// Shows the next step once the picture of this one has been there for its time and the next one has been read. A file
// is read aside: if that fails or is taken back, it is the end.
void Viewer::play_steps(double seconds) {
  if (!step_seconds_ || !session_ || !session_->is_step_shown()) return;
  if (const auto asked = std::exchange(played_step_, {}); asked && session_->step() != *asked)
    return step_seconds_.reset();
  const std::size_t count = session_->times().size();
  const bool is_last = session_->step() + 1 == count;
  if (is_last && !loops_) return step_seconds_.reset();
  const std::size_t next = is_last ? 0 : session_->step() + 1;
  session_->read_ahead(next);
  *step_seconds_ += seconds;
  const double period = 1 / steps_per_second_;
  if (*step_seconds_ < period || session_->is_reading_ahead()) return;
  step_seconds_ = std::min(*step_seconds_ - period, period);  // on the average, the rate is kept
  if (session_->steps_are_files()) {
    played_step_ = next;
    return session_->ask_step(next);
  }
  if (const Status shown = session_->show_step(next); !shown) {
    message_ = shown.error().message;
    step_seconds_.reset();
  }
}

Status Viewer::frame(const FrameInput& given) {
  const auto start = std::chrono::steady_clock::now();
  picture_seconds_ = 0;
  SPLATVOL_TRY(draw_frame(given));
  note_window_seconds(std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count());
  return {};
}

// Where the processor draws the window too, it is not drawn before somebody waits for it. The first frames compile
// shaders and upload fonts: the shortest of them counts, and then a moving average.
void Viewer::note_window_seconds(double seconds) {
  if (!session_ || !session_->is_drawn_by_processor()) return;
  constexpr int first_frames = 8;
  const double measured = seconds - picture_seconds_;
  if (window_frames_ < first_frames) {
    window_seconds_ = window_frames_ == 0 ? measured : std::min(window_seconds_, measured);
    ++window_frames_;
  } else {
    constexpr double most = 2;  // times the average: what is longer was something else
    window_seconds_ = 0.9 * window_seconds_ + 0.1 * std::min(measured, most * window_seconds_);
  }
  session_->set_window_seconds(window_seconds_);
}

Status Viewer::draw_frame(const FrameInput& given) {
  for (const Event& event : given.events)
    if (const auto* resized = std::get_if<WindowResized>(&event)) window_ = *resized;
  events_.add(given.events);
  if (is_minimised()) return {};
  const FrameInput input{given.seconds, events_.take_frame()};
  moved_seconds_ += input.seconds;
  idle_seconds_ = input.events.empty() ? idle_seconds_ + input.seconds : 0;
  if (!input.events.empty()) pending_frames_ = 3;
  pending_frames_ = std::max(0, pending_frames_ - 1);
  frame_seconds_ = 0.9 * frame_seconds_ + 0.1 * input.seconds;
  for (const Event& event : input.events) handle(event);
  if (prober_.take_answer()) pending_frames_ = 3;  // a new tooltip appears a frame later
  opening_seconds_ += input.seconds;
  const bool reads = session_ && (session_->is_reading() || session_->is_fitting());
  reading_seconds_ = reads ? reading_seconds_ + input.seconds : 0;
  if (const Status opened = take_opened(std::chrono::milliseconds(0)); !opened) message_ = opened.error().message;
  move_camera(input);
  play(input.seconds);
  play_steps(input.seconds);
  SPLATVOL_TRY(gui_->begin(input, window_, light_));
  if (panel())
    draw_panel();
  else if (is_narrow())
    draw_panel_button();
  if (help_) draw_help();
  draw_question();
  draw_opening();
  if (const auto chosen = dialog_.draw(window_, recent_files_.paths())) open(*chosen);
  const bool was_settled = session_ && session_->is_settled();
  SPLATVOL_TRY(draw_picture(input.seconds));
  save_drawn_picture();
  film();
  // What the HUD tells of a picture that has come fits into it a frame later.
  const bool is_settled = session_ && session_->is_settled();
  if (session_ && !session_->is_drawing() && !(was_settled && is_settled)) pending_frames_ = 2;
  if (!is_held() && moved_seconds_ >= burst_seconds) remember();
  draw_overlays();
  SPLATVOL_TRY(gui_->draw());
  if (session_ && session_->is_drawn_by_processor()) glFinish();
  return {};
}

Status Viewer::draw_picture(double seconds) {
  GLint target = 0;
  glGetIntegerv(GL_DRAW_FRAMEBUFFER_BINDING, &target);
  const int left = static_cast<int>(picture_area().left / picture_area().unit_x);
  const auto [width, height] = picture_size();
  ShownPicture picture;
  dvec3 background(0.02);
  if (session_) {
    const auto start = std::chrono::steady_clock::now();
    // A picture that is saved in another size fills the window until it is there.
    if (saving_)
      drawn_ = session_->draw(saving_->width, saving_->height, seconds);
    else if (filming_)
      drawn_ = session_->draw(filming_->width, filming_->height, pause_seconds);
    else
      drawn_ = session_->draw(width, height, seconds, is_busy());
    picture_seconds_ = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    if (drawn_) {
      SPLATVOL_TRY_ASSIGN(shown, session_->shown_picture());
      picture = shown;
      background = session_->scene.background;
    } else {
      message_ = drawn_.error().message;
    }
  }
  glBindFramebuffer(GL_FRAMEBUFFER, static_cast<GLuint>(target));
  clear_columns(0, left, window_.pixel_height);
  clear_columns(left + width, window_.pixel_width, window_.pixel_height);
  return screen_.show(picture, background, left, width, height);
}

void Viewer::draw_overlays() {
  if (!session_)
    return opening_ ? void() : draw_message("Drop a .svol file here, or open one (control O)", picture_area());
  if (saving_ || filming_) return draw_work();
  const View& view = session_->view();
  if (cut_ && session_->frame())
    draw_cut(view, session_->drawn_nodes(), session_->info().resolutions(), picture_area());
  if (session_->scene.outline) draw_box(view, session_->bounds(), {150, 150, 150}, picture_area());
  if (session_->scene.clip_box) draw_box(view, *session_->scene.clip_box, {255, 210, 80}, picture_area());
  planes_.draw_handles(session_->scene, view, session_->bounds(), picture_area(), pointer_);
  if (axes_) draw_axes(view, picture_area());
  if (scalar_bar_)
    draw_scalar_bar(session_->drawn_scene().transfer_function, session_->attribute(), session_->scene.scalar_bar.ticks,
                    ink_on(session_->scene.background), picture_area());
  if (const std::string reason = session_->explain(); !reason.empty()) draw_message(reason, picture_area());
  if (hud_) draw_hud();
  if (probe_) draw_probes();
}

// Tells of what is being read, and lets the user cancel it.
void Viewer::draw_opening() {
  constexpr double patience = 0.3;  // seconds: what is there sooner needs no words
  const bool reads = reading_seconds_ > patience;
  if (!opening_ && !reads) return;
  if (opening_ && opening_seconds_ < patience && session_) return;
  const PictureArea area = picture_area();
  const float scale = static_cast<float>(window_.content_scale);
  ImGui::SetNextWindowPos({static_cast<float>(area.left + area.width / 2), static_cast<float>(area.height / 2)},
                          ImGuiCond_Always, {0.5f, 0.5f});
  ImGui::SetNextWindowSizeConstraints({0, 0},
                                      {std::max(160 * scale, static_cast<float>(area.width) - 16 * scale), 1e6f});
  ImGui::Begin("opening", nullptr, ImGuiWindowFlags_NoDecoration | ImGuiWindowFlags_AlwaysAutoResize);
  if (opening_) {
    ImGui::TextUnformatted(fmt::format("opening {}", opening_->path()).c_str());
    ImGui::TextUnformatted(
        fmt::format("{} read in {:.0f} s", byte_text(static_cast<double>(opening_->bytes_read())), opening_seconds_)
            .c_str());
  } else {
    ImGui::TextUnformatted("reading what the change needs");
  }
  if (ImGui::SmallButton("cancel (Esc)")) {
    if (opening_)
      opening_.reset();
    else
      session_->cancel_reading();
  }
  ImGui::End();
}

}  // namespace splatvol
