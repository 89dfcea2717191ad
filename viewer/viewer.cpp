#include "viewer/viewer.h"

#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>
#include <utility>

#include "base/byte_text.h"
#include "base/file.h"
#include "pictures/contrast.h"
#include "scene/color_map_file.h"
#include "viewer/hud.h"
#include "viewer/overlay.h"
#include "viewer/window/frame_composer.h"

namespace splatvol {
namespace {

// The first frame waits so long for a file, so that most windows appear with their picture.
constexpr double longest_first_wait = 0.15;

}  // namespace

Viewer::Viewer(const ViewerOptions& options)
    : settings_(options.settings), recent_files_(options.recent_files), panel_(state_), probes_(state_) {
  state_.window = options.window;
}

Viewer::~Viewer() = default;

// The file is read while the interface is prepared.
Result<std::unique_ptr<Viewer>> Viewer::create(const ViewerOptions& options) {
  std::unique_ptr<Viewer> viewer(new Viewer(options));
  if (!options.volume.empty() || !options.scene.empty()) {
    SceneUse use = options.use;
    use.file = options.volume;
    viewer->begin_opening(use, options.scene);
  }
  SPLATVOL_TRY_ASSIGN(gui, Gui::create(options.window.content_scale, options.clipboard));
  SPLATVOL_TRY_ASSIGN(presenter, Presenter::create());
  SPLATVOL_TRY_ASSIGN(composer, FrameComposer::create());
  viewer->gui_ = std::move(gui);
  viewer->presenter_ = std::move(presenter);
  viewer->composer_ = std::make_unique<FrameComposer>(std::move(composer));
  SPLATVOL_TRY(viewer->take_opened(longest_first_wait));
  return viewer;
}

void Viewer::begin_opening(const SceneUse& use, const std::string& scene_path) {
  ViewSettings settings = state_.session ? state_.session->settings : settings_;
  const auto [width, height] = state_.picture_size();
  if (!state_.is_minimised()) settings.first_picture = {.width = width, .height = height};
  opening_seconds_ = 0;
  opening_ = std::make_unique<Opening>(state_.host, use, scene_path, settings);
}

// Shows the file that is being opened if it is there in time.
Status Viewer::take_opened(double wait_seconds) {
  if (!opening_ || (settings_.works_aside && !opening_->wait(wait_seconds))) return {};
  const std::unique_ptr<Opening> opening = std::move(opening_);
  SPLATVOL_TRY_ASSIGN(file, opening->take());
  SPLATVOL_TRY_ASSIGN(session, Session::open(std::move(file), state_.host));
  recent_files_.add(session->path());
  if (state_.session) session->playback = state_.session->playback;
  end_session();
  state_.session = std::move(session);
  state_.steering.take_up_axis(*state_.session);
  panel_.begin();
  return {};
}

void Viewer::close() {
  end_session();
  opening_.reset();
  state_.message.clear();
}

// Lets go of the file, and of all that belongs to it.
void Viewer::end_session() {
  panel_.end();
  state_.session.reset();
  probes_.end();
}

void Viewer::stop_playing() {
  panel_.path.stop();
  if (state_.session) state_.session->stop_playing();
}

void Viewer::end_loop() {
  if (state_.session) state_.session->playback.loops = false;
}

// A .json file is a scene for the volume that is open, or colours for it. Any other file is a volume.
void Viewer::open(const std::string& path) {
  state_.message.clear();
  if (state_.session && path.ends_with(".json")) {
    const auto text = read_text_file(path);
    const bool is_map = text && is_color_map_text(*text);
    if (const Status opened = is_map ? open_color_maps(path) : open_scene(path); !opened)
      state_.message = opened.error().message;
    return;
  }
  const bool is_scene = path.ends_with(".json");
  begin_opening({.file = is_scene ? "" : path}, is_scene ? path : "");
}

Status Viewer::open_scene(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(used, load_used_scene(path));
  if (!used.use.file.empty() && used.use.file != state_.session->used_scene().use.file) {
    begin_opening({}, path);
    return {};
  }
  if (state_.session->info().find_attribute(used.scene.attribute) < 0)
    return fail(ErrorCode::invalid_argument, "{}: this file has no attribute '{}'", path, used.scene.attribute);
  state_.session->cancel_reading();
  state_.session->scene = std::move(used.scene);
  return state_.session->use(used.use);
}

// The first of the maps colours the volume. All of them stand among the presets.
Status Viewer::open_color_maps(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(maps, load_color_maps(path));
  state_.session->scene.transfer_function.colors = maps.front().colors;
  panel_.add_presets(std::move(maps));
  return {};
}

std::string Viewer::title() const { return state_.session ? state_.session->path() + " - svview" : "svview"; }

bool Viewer::is_settled() const {
  const Session* session = state_.session.get();
  if (state_.is_minimised()) return true;
  if (state_.steering.is_moving() || panel_.is_saving()) return false;
  if (opening_ || probes_.is_busy() || windows_wait_seconds()) return false;
  return events_.is_empty() && !is_busy() && state_.pending_frames == 0 && !panel_.path.is_playing() &&
         !state_.steering.flies_on() && (!session || (session->is_settled() && !session->is_playing()));
}

bool Viewer::awaits_picture(double seconds) const {
  const Session* session = state_.session.get();
  if (!session || !session->awaits_picture()) return false;
  if (!events_.is_empty() || state_.pending_frames > 0) return false;
  if (opening_ || probes_.is_busy() || session->is_reading()) return false;
  const bool ends_pause = is_busy() && idle_seconds_ + seconds >= pause_seconds;
  const std::optional<double> waiting = windows_wait_seconds();
  return !ends_pause && !(waiting && seconds >= *waiting);
}

// None, too, of a picture that a graphics card draws.
std::optional<double> Viewer::windows_wait_seconds() const {
  return picture_.encoded ? composer_->waiting_seconds() : std::nullopt;
}

double Viewer::patience() const {
  constexpr double for_events = 1, for_picture = 0.001, for_change = 0.004;
  if (is_settled()) return for_events;
  if (awaits_picture()) return for_picture;
  const bool goes_on = has_drawn_ || !events_.is_empty() || state_.pending_frames > 0;
  return goes_on ? 0 : for_change;
}

// Controls take what is over them, and then handles of planes. The rest is for the hand at the picture.
void Viewer::handle(const Event& event) {
  if (const auto* dropped = std::get_if<FilesDropped>(&event))
    for (const std::string& path : dropped->paths) open(path);
  Session* session = state_.session.get();
  const PictureArea area = state_.picture_area();
  const SteeredPicture picture{area.left, {area.width, area.height}, state_.window.content_scale};
  SliceControls& planes = panel_.planes;
  bool is_taken = std::holds_alternative<KeyChanged>(event) ? gui_->has_keyboard() : gui_->has_pointer();
  const auto* button = std::get_if<ButtonChanged>(&event);
  if (button && button->button == 0 && button->down && !is_taken && !state_.steering.is_dragging() && session &&
      session->frame())
    is_taken = planes.grab(session->scene, session->view(), area, state_.steering.pointer());
  if (const auto* moved = std::get_if<PointerMoved>(&event)) {
    is_taken = planes.is_held();
    if (session && is_taken)
      planes.drag(session->scene, session->view(), area, dvec2(moved->x, moved->y) - state_.steering.pointer());
  }
  const Steering::Effect effect = state_.steering.handle(event, session, picture, taken(is_taken));
  if (effect.moves_camera) panel_.path.stop();
  if (effect.clicked) probes_.pin(*effect.clicked);
  if (effect.pressed) press_key(*effect.pressed);
  if (button && button->button == 0 && !button->down) planes.release();
}

// The keys that do not steer the picture.
void Viewer::press_key(int code) {
  const auto toggle = [](bool& shown) { shown = !shown; };
  const bool has_control = state_.steering.has_control();
  Session* session = state_.session.get();
  if (code == key::f1) toggle(state_.shown.help);
  if (code == key::escape) {
    state_.shown.help = false;
    opening_.reset();
    if (session) session->cancel_reading();
    probes_.unpin();
    panel_.movie.end(false);
  }
  if (code == 'Q' && has_control) closing_ = true;
  if (code == 'O' && has_control) dialog_.open(session ? session->path() : "");
  if (code == key::tab) toggle(state_.panel());
  if (code == 'W' && has_control) return close();
  if (!session) return;
  if (code == 'C' && has_control) panel_.save.copy_command();
  if (has_control) return;
  if (code == 'H') toggle(state_.shown.hud);
  if (code == 'C') toggle(state_.shown.cut);
  if (code == 'X') panel_.planes.add_slice(session->scene, session->view(), session->bounds());
}

// Moves on what plays.
void Viewer::play(double seconds) {
  panel_.path.play(seconds);
  if (!state_.session) return;
  if (const Status played = state_.session->play(seconds); !played) state_.message = played.error().message;
}

Status Viewer::frame(const FrameInput& given) {
  const double start = state_.host.now();
  picture_seconds_ = 0;
  has_drawn_ = false;
  SPLATVOL_TRY(draw_frame(given));
  window_seconds_ = state_.host.now() - start - picture_seconds_;
  return {};
}

// Takes the events of a frame, and what jobs have brought.
void Viewer::take_events(const FrameInput& input) {
  state_.steering.begin_frame(input.seconds);
  idle_seconds_ = input.events.empty() ? idle_seconds_ + input.seconds : 0;
  if (!input.events.empty()) state_.pending_frames = 3;
  state_.pending_frames = std::max(0, state_.pending_frames - 1);
  for (const Event& event : input.events) handle(event);
  if (probes_.take_answer()) state_.pending_frames = 3;  // a new tooltip appears a frame later
  opening_seconds_ += input.seconds;
  const bool reads = state_.session && (state_.session->is_reading() || state_.session->is_fitting());
  reading_seconds_ = reads ? reading_seconds_ + input.seconds : 0;
  if (const Status opened = take_opened(0); !opened) state_.message = opened.error().message;
}

void Viewer::draw_controls() {
  const Panel::Wishes wishes = panel_.draw();
  if (wishes.opens_dialog) dialog_.open(state_.session ? state_.session->path() : "");
  if (wishes.file) open(*wishes.file);
  if (state_.shown.help) draw_keys(state_);
  panel_.save.draw_question();
  draw_opening();
  if (const auto chosen = dialog_.draw(state_.window, recent_files_.paths())) open(*chosen);
  if (panel_.is_saving()) stop_playing();
}

Status Viewer::draw_frame(const FrameInput& given) {
  for (const Event& event : given.events)
    if (const auto* resized = std::get_if<WindowResized>(&event)) state_.window = *resized, is_frame_lost_ = true;
  events_.add(given.events);
  if (state_.is_minimised()) return {};
  const FrameInput input{given.seconds, events_.take_frame()};
  take_events(input);
  state_.steering.move(input.seconds, state_.session.get(), taken(gui_->has_keyboard()));
  play(input.seconds);
  SPLATVOL_TRY(gui_->begin(input, state_.window, state_.shown.light));
  draw_controls();
  const bool was_settled = state_.session && state_.session->is_settled();
  SPLATVOL_TRY(draw_picture(input.seconds));
  panel_.save.save_drawn_picture();
  panel_.movie.film();
  if (Session* session = state_.session.get()) {
    // What the HUD tells of a picture that has come fits into it a frame later.
    if (!session->is_drawing() && !(was_settled && session->is_settled())) state_.pending_frames = 2;
    state_.steering.remember(*session, taken(false));
  }
  note_picture(input.seconds);
  draw_overlays();
  return present(input.seconds);
}

Status Viewer::draw_picture(double seconds) {
  presenter_.begin();
  picture_ = {};
  Session* session = state_.session.get();
  if (!session) return {};
  const double start = state_.host.now();
  const auto [width, height] = state_.picture_size();
  const auto& saving = panel_.save.saving();
  const auto& filming = panel_.movie.filming();
  // A picture that is saved in another size fills the window until it is there.
  if (saving)
    state_.drawn = session->draw(saving->width, saving->height, seconds);
  else if (filming)
    state_.drawn = session->draw(filming->width, filming->height, pause_seconds);
  else
    state_.drawn = session->draw(width, height, seconds, is_busy());
  picture_seconds_ = state_.host.now() - start;
  if (state_.drawn)
    SPLATVOL_TRY_SET(picture_, session->shown_picture());
  else
    state_.message = state_.drawn.error().message;
  return {};
}

// The mean time between pictures that follow each other.
void Viewer::note_picture(double seconds) {
  constexpr double longest = 1;  // seconds: then nothing has moved
  unchanged_seconds_ += seconds;
  if (!picture_.is_new) return;
  if (const double since = std::exchange(unchanged_seconds_, 0); since <= longest)
    frame_seconds_ = 0.9 * frame_seconds_ + 0.1 * since;
}

// A picture of a graphics card is drawn in each frame.
Status Viewer::present(double seconds) {
  gui_->end();
  const PictureArea area = state_.picture_area();
  const int left = static_cast<int>(area.left / area.unit_x), width = state_.picture_size()[0];
  if (!picture_.encoded) {
    has_drawn_ = is_frame_lost_ = true;
    const dvec3 background = state_.session ? state_.session->scene.background : dvec3(0.02);
    SPLATVOL_TRY(presenter_.show(picture_.texture, background, left, width, state_.window));
    return gui_->draw();
  }
  const FrameParts parts{.picture = picture_.encoded,
                         .is_new = picture_.is_new,
                         .left = left,
                         .width = width,
                         .pixel_width = state_.window.pixel_width,
                         .pixel_height = state_.window.pixel_height,
                         .is_lost = is_frame_lost_,
                         .seconds = seconds};
  SPLATVOL_TRY_SET(has_drawn_, composer_->compose(parts, *gui_, presenter_.framebuffer()));
  is_frame_lost_ = false;
  if (has_drawn_) Presenter::finish();
  return {};
}

void Viewer::draw_overlays() {
  const PictureArea area = state_.picture_area();
  const Session* session = state_.session.get();
  const Shown& shown = state_.shown;
  if (!session) return opening_ ? void() : draw_message("Drop a .svol file here, or open one (control O)", area);
  if (const auto& saving = panel_.save.saving()) return draw_message(saving->path + " is being drawn", area);
  if (panel_.movie.filming()) return panel_.movie.draw_progress();
  const View& view = session->view();
  ImDrawList& canvas = *ImGui::GetBackgroundDrawList();
  canvas.PushClipRect({static_cast<float>(area.left), 0},
                      {static_cast<float>(area.left + area.width), static_cast<float>(area.height)});
  if (shown.cut && session->frame()) draw_cut(view, session->drawn_nodes(), session->info().resolutions(), area);
  if (session->scene.outline) draw_box(view, session->bounds(), {150, 150, 150}, area);
  if (session->scene.clip_box) draw_box(view, *session->scene.clip_box, {255, 210, 80}, area);
  panel_.planes.draw_handles(session->scene, view, session->bounds(), area, state_.steering.pointer());
  if (shown.axes) draw_axes(view, area);
  if (shown.scalar_bar)
    draw_scalar_bar(bar_colors_of(session->drawn_scene()).function, session->bar_attribute(),
                    session->scene.scalar_bar.ticks, ink_on(session->scene.background), area);
  if (const std::string reason = session->explain(); !reason.empty()) draw_message(reason, area);
  canvas.PopClipRect();
  if (shown.hud) draw_hud(state_, frame_seconds_);
  const bool is_at_rest = !state_.steering.is_dragging() && !panel_.planes.is_held() && !is_busy();
  if (shown.probe) probes_.draw(is_at_rest, !gui_->has_pointer());
}

// Tells of what is being read, and lets the user cancel it.
void Viewer::draw_opening() {
  constexpr double patience = 0.3;  // seconds: what is there sooner needs no words
  const bool reads = reading_seconds_ > patience;
  if (!opening_ && !reads) return;
  if (opening_ && opening_seconds_ < patience && state_.session) return;
  const PictureArea area = state_.picture_area();
  const float scale = state_.scale();
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
      state_.session->cancel_reading();
  }
  ImGui::End();
}

}  // namespace splatvol
