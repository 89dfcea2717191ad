#include "viewer/viewer.h"

#include <fmt/format.h>
#include <imgui.h>

#include <algorithm>
#include <filesystem>
#include <system_error>
#include <utility>

#include "base/byte_text.h"
#include "base/file.h"
#include "base/input_formats.h"
#include "pictures/contrast.h"
#include "pictures/outline.h"
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
    : settings_(options.settings), recent_files_(options.recent_files), panel_(state_), pins_(state_) {
  state_.window = options.window;
}

Viewer::~Viewer() {
  panel_.contours.stop_exporting();
  close();
}

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

void Viewer::begin_opening(const SceneUse& use, const std::string& scene_path, bool all_steps) {
  ViewSettings settings = state_.session ? state_.session->settings : settings_;
  const auto [width, height] = state_.picture_size();
  if (!state_.is_minimised()) settings.first_picture = {.width = width, .height = height};
  opening_seconds_ = 0;
  began_[Ending::opening] = 0;
  opening_ = std::make_unique<Opening>(state_.host, use, scene_path, settings, all_steps);
}

// The scene stays, at the step that was the only one.
void Viewer::open_all_steps() {
  const UsedScene used = state_.session->used_scene();
  begin_opening({.file = state_.session->path(), .pieces = used.use.pieces}, to_json(used), true);
}

// Shows the file that is being opened if it is there in time, and before that some of its points.
Status Viewer::take_opened(double wait_seconds) {
  if (!opening_) return {};
  if (settings_.works_aside && !opening_->wait(wait_seconds)) return take_preview();
  preview_.reset();
  const std::unique_ptr<Opening> opening = std::move(opening_);
  SPLATVOL_TRY_ASSIGN(file, opening->take());
  const bool has_no_scene = file.fits;
  SPLATVOL_TRY_ASSIGN(session, Session::open(std::move(file), state_.host));
  if (previewed_) take_over_preview(*session);
  if (opening->asked().pieces.empty()) recent_files_.add(session->path());
  show(std::move(session));
  if (has_no_scene && state_.session->converted()) ask_up();
  if (const auto& converted = state_.session->converted())
    for (const std::string& note : converted->notes) state_.messages.note(note);
  return {};
}

// Without the preview, the whole file comes nevertheless.
Status Viewer::take_preview() {
  if (!preview_) preview_ = opening_->open_preview(state_.host);
  if (!preview_ || !preview_->wait(0)) return {};
  auto file = preview_->take();
  preview_.reset();
  opening_->end_preview();
  if (!file) return {};
  file->source.path = opening_->path();
  file->source.pieces = opening_->asked().pieces;
  SPLATVOL_TRY_ASSIGN(session, Session::open(std::move(*file), state_.host));
  const Scene first = session->scene;
  show(std::move(session));
  ask_up();
  previewed_ = first;
  return {};
}

// The camera of a preview stays, and so does all that was changed meanwhile.
void Viewer::take_over_preview(Session& whole) const {
  const Session& preview = *state_.session;
  Scene unchanged = *previewed_;
  unchanged.camera = preview.scene.camera;
  unchanged.width = preview.scene.width;
  unchanged.height = preview.scene.height;
  if (preview.scene == unchanged)
    whole.scene.camera = preview.scene.camera;
  else
    whole.scene = preview.scene;
  whole.settings = preview.settings;
  whole.up = preview.up;
}

void Viewer::show(std::unique_ptr<Session> session) {
  if (state_.session) session->playback = state_.session->playback;
  end_session();
  state_.session = std::move(session);
  panel_.begin();
}

void Viewer::close() {
  end_session();
  end_opening();
}

void Viewer::end_opening() {
  preview_.reset();
  opening_.reset();
  if (previewed_)
    state_.messages.note(
        fmt::format("{}: what you see is some of its points: open it again for all", state_.session->path()));
}

// Lets go of the file, and of all that belongs to it.
void Viewer::end_session() {
  panel_.end();
  pins_.end();
  state_.session.reset();
  previewed_.reset();
  told_troubles_ = 0;
  state_.messages.end_question();
}

void Viewer::stop_playing() {
  panel_.path.stop();
  if (state_.session) state_.session->stop_playing();
}

void Viewer::end_recording() {
  if (state_.session) state_.session->playback.loops = false;
  state_.messages.hold();
}

// Several meshes that are dropped at once are pieces of one.
void Viewer::drop(const std::vector<std::string>& paths) {
  SceneUse mesh;
  for (const std::string& path : paths) {
    const bool is_piece = paths.size() > 1 && !is_surface_file(path) && is_convertible(path);
    if (!is_piece)
      open(path);
    else if (mesh.file.empty())
      mesh.file = path;
    else
      mesh.pieces.push_back(path);
  }
  if (!mesh.file.empty()) begin_opening(mesh, "");
}

// A surface file is drawn with the volume that is open.
void Viewer::add_surface(const std::string& path) {
  if (!state_.session)
    return state_.messages.error(fmt::format("{}: is a surface: open the volume first that it belongs to", path));
  std::error_code error;
  const std::string file = std::filesystem::absolute(path, error).lexically_normal().string();
  state_.session->scene.surfaces.push_back({.file = file});
}

// A .json file is a scene for the volume that is open, or colours for it. Any other file is a volume or a surface.
void Viewer::open(const std::string& path) {
  if (is_surface_file(path)) return add_surface(path);
  if (state_.session && path.ends_with(".json")) {
    const auto text = read_text_file(path);
    const bool is_map = text && is_color_map_text(*text);
    if (const Status opened = is_map ? open_color_maps(path) : open_scene(path); !opened)
      state_.messages.error(opened.error().message);
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

bool Viewer::is_note_over(double seconds) const {
  const std::optional<double> left = state_.messages.seconds_to_change();
  return left && seconds >= *left;
}

bool Viewer::is_settled(double seconds) const { return state_.is_minimised() || (!opening_ && rests(seconds)); }

bool Viewer::rests(double seconds) const { return is_still(seconds) && !panel_.has_jobs(); }

bool Viewer::is_still(double seconds) const {
  const Session* session = state_.session.get();
  if (is_note_over(seconds)) return false;
  if (state_.steering.is_moving() || panel_.is_saving()) return false;
  if (pins_.is_busy() || panel_.line.is_busy() || windows_wait_seconds()) return false;
  return events_.is_empty() && !is_busy() && state_.pending_frames == 0 && !panel_.path.is_playing() &&
         !state_.steering.flies_on() && (!session || (session->is_settled() && !session->is_playing()));
}

bool Viewer::awaits_picture(double seconds) const {
  const Session* session = state_.session.get();
  if (!session || !session->awaits_picture()) return false;
  if (!events_.is_empty() || state_.pending_frames > 0) return false;
  if (opening_ || pins_.is_busy() || panel_.line.is_busy() || session->is_reading()) return false;
  const bool ends_pause = is_busy() && idle_seconds_ + seconds >= pause_seconds;
  const std::optional<double> waiting = windows_wait_seconds();
  return !ends_pause && !is_note_over(seconds) && !(waiting && seconds >= *waiting);
}

// None, too, of a picture that a graphics card draws.
std::optional<double> Viewer::windows_wait_seconds() const {
  return picture_.encoded ? composer_->waiting_seconds() : std::nullopt;
}

double Viewer::patience(double seconds) const {
  constexpr double for_events = 1, for_picture = 0.001, for_change = 0.004, for_progress = 0.05;
  if (state_.is_minimised()) return for_events;
  if (is_settled()) {
    const std::optional<double> note = state_.messages.seconds_to_change();
    return note ? std::clamp(*note - seconds, 0.0, for_events) : for_events;
  }
  if (awaits_picture()) return for_picture;
  const bool has_progress = (opening_ && opening_->conversion()) || panel_.has_jobs();
  if (has_progress && is_still(seconds)) return for_progress;
  const bool goes_on = has_drawn_ || !events_.is_empty() || state_.pending_frames > 0;
  return goes_on ? 0 : for_change;
}

// Controls take what is over them, and then handles of planes. The rest is for the hand at the picture.
void Viewer::handle(const Event& event) {
  if (const auto* dropped = std::get_if<FilesDropped>(&event)) drop(dropped->paths);
  Session* session = state_.session.get();
  const PictureArea area = state_.picture_area();
  const SteeredPicture picture{area.left, {area.width, area.height}, state_.window.content_scale};
  SliceControls& planes = panel_.planes;
  StreamlineControls& seeds = panel_.streamlines;
  const auto* key_event = std::get_if<KeyChanged>(&event);
  const bool closes_dialog = key_event && key_event->code == key::escape && dialog_.is_open();  // while it takes text
  bool is_taken = key_event ? gui_->has_keyboard() && !closes_dialog : gui_->has_pointer();
  const auto* button = std::get_if<ButtonChanged>(&event);
  if (button && button->button == 0 && button->down && !is_taken && !state_.steering.is_dragging() && session &&
      session->shown_number() > 0)
    is_taken = seeds.grab(session->scene, session->view(), area, state_.steering.pointer()) ||
               planes.grab(session->scene, session->view(), area, state_.steering.pointer());
  if (const auto* moved = std::get_if<PointerMoved>(&event)) {
    is_taken = planes.is_held() || seeds.is_held();
    const dvec2 way = dvec2(moved->x, moved->y) - state_.steering.pointer();
    if (session && planes.is_held()) planes.drag(session->scene, session->view(), area, way);
    if (session && seeds.is_held()) seeds.drag(session->scene, session->view(), area, way);
  }
  const Steering::Effect effect = state_.steering.handle(event, session, picture, taken(is_taken));
  if (effect.moves_camera) panel_.path.stop();
  if (effect.clicked) click(*effect.clicked);
  if (effect.pressed) press_key(*effect.pressed);
  if (button && button->button == 0 && !button->down) planes.release(), seeds.release();
  note_beginnings();
}

// Pins the place, or ends a line there.
void Viewer::click(const dvec2& position) {
  if (state_.steering.has_shift()) return pins_.pin_end(position);
  pins_.pin(position);
  panel_.line.hide();
  began_[Ending::pin] = 0;
}

// Gives numbers to what has begun since the last call.
void Viewer::note_beginnings() {
  const Session* session = state_.session.get();
  std::array<bool, Ending::count> there{};
  there[Ending::help] = state_.shown.help;
  there[Ending::list] = state_.messages.is_list_open();
  there[Ending::opening] = opening_ != nullptr;
  there[Ending::reading] = session && (session->is_reading() || session->is_fitting());
  there[Ending::pin] = pins_.has_pin();
  there[Ending::line] = panel_.line.is_shown();
  there[Ending::steps] = panel_.line.has_steps();
  there[Ending::movie] = panel_.movie.can_end();
  for (std::size_t i = 0; i < Ending::count; ++i)
    if (!there[i] || began_[i] == 0) began_[i] = there[i] ? state_.messages.take_number() : 0;
}

void Viewer::end(std::size_t thing) {
  if (thing == Ending::help) state_.shown.help = false;
  if (thing == Ending::list) state_.messages.toggle_list();
  if (thing == Ending::opening) end_opening();
  if (thing == Ending::reading) state_.session->cancel_reading();
  if (thing == Ending::pin) pins_.unpin();
  if (thing == Ending::line) panel_.line.hide();
  if (thing == Ending::steps) panel_.line.end_steps();
  if (thing == Ending::movie) panel_.movie.end(false);
}

// Ends one thing: a dialog, which lies over all else, or what began last.
void Viewer::press_escape() {
  if (dialog_.is_open()) return dialog_.close();
  if (panel_.save.is_asking()) return panel_.save.keep_file();
  note_beginnings();
  const auto newest = std::ranges::max_element(began_);
  const std::uint64_t error = state_.messages.newest_error();
  if (error > *newest)
    state_.messages.close(error);
  else if (*newest > 0)
    end(static_cast<std::size_t>(newest - began_.begin()));
}

// The keys that do not steer the picture.
void Viewer::press_key(int code) {
  const auto toggle = [](bool& shown) { shown = !shown; };
  const bool has_control = state_.steering.has_control();
  Session* session = state_.session.get();
  if (code == key::f1) toggle(state_.shown.help);
  if (code == key::escape) press_escape();
  if (code == 'Q' && has_control) closing_ = true;
  if (code == 'O' && has_control) dialog_.open(session ? session->path() : "");
  if (code == key::tab) toggle(state_.panel());
  if (code == 'M' && !has_control) state_.messages.toggle_list();
  if (code == 'W' && has_control) return close();
  if (!session) return;
  if (code == 'C' && has_control) panel_.save.copy_command();
  if (has_control) return;
  if (code == 'H') toggle(state_.shown.hud);
  if (code == 'C') toggle(state_.shown.cut);
  if (code == 'X') panel_.planes.add_slice(session->scene, session->view(), session->bounds());
  if (code == 'N') look_along_plane(*session);
}

// Looks at the selected plane from the side that is nearer to the eye.
void Viewer::look_along_plane(Session& session) {
  const auto plane = panel_.planes.plane(session.scene);
  if (!plane)
    return state_.messages.note("Select a slice or a clip plane in the panel, and then look along its normal");
  const double towards = glm::dot(plane->normal, session.view().forward);
  Steering::look_from(session, towards > 0 ? -plane->normal : plane->normal);
}

// Moves on what plays.
void Viewer::play(double seconds) {
  panel_.path.play(seconds);
  if (!state_.session) return;
  if (const Status played = state_.session->play(seconds); !played) state_.messages.error(played.error().message);
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
  state_.messages.advance(input.seconds);
  idle_seconds_ = input.events.empty() ? idle_seconds_ + input.seconds : 0;
  if (!input.events.empty()) state_.pending_frames = 3;
  state_.pending_frames = std::max(0, state_.pending_frames - 1);
  for (const Event& event : input.events) handle(event);
  const bool has_line_news = panel_.line.take_answers();
  if (pins_.take_answer() || has_line_news) state_.pending_frames = 3;  // a new tooltip appears a frame later
  opening_seconds_ += input.seconds;
  const bool reads = state_.session && (state_.session->is_reading() || state_.session->is_fitting());
  reading_seconds_ = reads ? reading_seconds_ + input.seconds : 0;
  if (const Status opened = take_opened(0); !opened) state_.messages.error(opened.error().message);
}

void Viewer::draw_controls() {
  const Panel::Wishes wishes = panel_.draw();
  if (wishes.opens_dialog) dialog_.open(state_.session ? state_.session->path() : "");
  if (wishes.file) open(*wishes.file);
  if (wishes.all_steps) open_all_steps();
  if (state_.shown.help) draw_keys(state_);
  panel_.save.draw_question();
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
  tell_troubles();
  note_beginnings();
  if (state_.messages.take_change()) state_.pending_frames = 3;
  draw_overlays();
  draw_toasts();
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
  const std::string told = state_.drawn ? "" : state_.drawn.error().message;
  // A picture that is saved in another size fills the window until it is there.
  if (saving)
    state_.drawn = session->draw(saving->layout.page.picture_width, saving->layout.page.picture_height, seconds);
  else if (filming)
    state_.drawn =
        session->draw(filming->layout.page.picture_width, filming->layout.page.picture_height, pause_seconds);
  else
    state_.drawn = session->draw(width, height, seconds, is_busy());
  picture_seconds_ = state_.host.now() - start;
  if (state_.drawn)
    SPLATVOL_TRY_SET(picture_, session->shown_picture());
  else if (state_.drawn.error().message != told)
    state_.messages.error(state_.drawn.error().message);
  return {};
}

// Tells what the session could not do since the last call.
void Viewer::tell_troubles() {
  if (!state_.session) return;
  const std::vector<std::string>& troubles = state_.session->troubles();
  for (; told_troubles_ < troubles.size(); ++told_troubles_) state_.messages.error(troubles[told_troubles_]);
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
  hud_bottom_ = 0;
  if (!session)
    return opening_ ? void() : draw_message("Drop a mesh or a .svol file here, or open one (control O)", area);
  if (const auto& saving = panel_.save.saving()) return draw_message(saving->path + " is being drawn", area);
  if (panel_.movie.filming()) return;
  const View& view = session->view();
  ImDrawList& canvas = *ImGui::GetBackgroundDrawList();
  canvas.PushClipRect({static_cast<float>(area.left), 0},
                      {static_cast<float>(area.left + area.width), static_cast<float>(area.height)});
  if (shown.cut && session->frame()) draw_cut(view, session->drawn_nodes(), session->info().resolutions(), area);
  if (session->scene.outline && !picture_.encoded) draw_box(view, session->bounds(), {150, 150, 150}, area);
  if (session->scene.clip_box) draw_box(view, *session->scene.clip_box, {255, 210, 80}, area);
  panel_.planes.draw_handles(session->scene, view, session->bounds(), area, state_.steering.pointer());
  panel_.streamlines.draw_handles(session->scene, view, area);
  if (shown.axes) draw_axes(view, area);
  if (shown.scalar_bar)
    draw_scalar_bars(session->scalar_bars(), session->scene.scalar_bar.ticks, ink_on(session->scene.background), area);
  if (const std::string reason = session->explain(); !reason.empty()) draw_message(reason, area);
  canvas.PopClipRect();
  if (shown.hud) hud_bottom_ = draw_hud(state_, frame_seconds_);
  const bool is_at_rest =
      !state_.steering.is_dragging() && !panel_.planes.is_held() && !panel_.streamlines.is_held() && !is_busy();
  if (const auto ends = pins_.take_ends()) panel_.line.show(*ends);
  if (shown.values) pins_.draw(is_at_rest, !gui_->has_pointer(), !panel_.line.is_shown());
  panel_.line.draw_line(is_at_rest, !gui_->has_pointer());
}

void Viewer::draw_toasts() {
  state_.messages.begin(state_.picture_area(), state_.session && state_.shown.axes, hud_bottom_);
  draw_opening();
  panel_.movie.draw_progress();
  panel_.mesh.draw_progress();
  panel_.contours.draw_progress();
  panel_.measure.draw_progress();
  if (const auto axis = state_.messages.draw()) {
    state_.session->choose_up(static_cast<int>(*axis));
    state_.session->show_all();
    ask_up();
  }
}

// Most meshes do not tell which axis is upwards.
void Viewer::ask_up() {
  state_.messages.ask(fmt::format("{} is up", "xyz"[state_.session->up_axis()]), {"x", "y", "z"});
}

// Tells of what is being read, and lets the user cancel it.
void Viewer::draw_opening() {
  constexpr double patience = 0.3;  // seconds: what is there sooner needs no words
  Messages::Work work{.name = "opening", .text = "reading what the change needs", .buttons = {"cancel (Esc)"}};
  if (opening_)
    work.text = fmt::format("opening {}\n{} read in {:.0f} s", opening_->path(),
                            byte_text(static_cast<double>(opening_->bytes_read())), opening_seconds_);
  const auto conversion = opening_ ? opening_->conversion() : std::nullopt;
  if (conversion) {
    work.text = fmt::format("converting {}: {}{}", opening_->path(), conversion->stage,
                            previewed_ ? "\nwhat you see is some of its points" : "");
    work.share = conversion->share;
    work.seconds_left = conversion->seconds_left;
  }
  const bool is_slow = opening_ ? opening_seconds_ >= patience || !state_.session : reading_seconds_ > patience;
  if (is_slow && state_.messages.draw(work)) end(opening_ ? Ending::opening : Ending::reading);
}

}  // namespace splatvol
