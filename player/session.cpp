#include "player/session.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <limits>
#include <utility>

#include "pictures/contrast.h"
#include "player/camera_control.h"
#include "player/choice.h"
#include "player/scalar_bars.h"
#include "scene/scene_change.h"
#include "streamer/first/explain.h"

namespace splatvol {

Result<std::unique_ptr<Session>> Session::open(const std::string& path, const std::string& scene_path,
                                               const ViewSettings& settings, SessionHost& host) {
  SPLATVOL_TRY_ASSIGN(file, read(SceneUse{.file = path}, scene_path, settings));
  return open(std::move(file), host);
}

Result<std::unique_ptr<Session>> Session::open(SessionFile file, SessionHost& host) {
  std::unique_ptr<Session> session(new Session(host));
  session->source_ = std::move(file.source);
  session->fits_ = file.fits;
  session->settings = session->used_.settings = std::move(file.settings);
  session->scene = session->first_scene_ = session->used_.scene = file.file.scene;
  session->data_ = std::move(file.data);
  SPLATVOL_TRY_SET(session->player_, Player::open(std::move(file.file)));
  return session;
}

Session::~Session() {
  stop_drawing();
  movement_.holding_cells.end();
  change_.end();
  streamlines_.end();
  fitting_.fitted.end();
}

// Takes over histogram and domain of the step that is shown.
Status Session::use_step() {
  SPLATVOL_TRY(read_histograms(player_->streamer().volume(), used_.scene, data_));
  if (!player_->steps().are_files()) return {};
  SPLATVOL_TRY_SET(data_.bounds, player_->find_domain());  // a file may have another mesh
  SPLATVOL_TRY_SET(data_.mesh_box, mesh_box_of(player_->streamer().volume(), data_.bounds));
  return {};
}

format::Attribute Session::attribute() const {
  format::Attribute shown = info().attributes[static_cast<std::size_t>(info().find_attribute(used_.scene.attribute))];
  if (!scene.scalar_bar.unit.empty()) shown.unit = scene.scalar_bar.unit;
  return shown;
}

std::vector<PageBar> Session::scalar_bars() const {
  Scene shown = used_.scene;
  shown.scalar_bar = scene.scalar_bar;  // its unit waits for no picture
  return scalar_bars_of(shown, info(), player_->streamer().volume().name()).value_or(std::vector<PageBar>());
}

std::optional<format::Attribute> Session::opacity_attribute() const {
  if (!used_.scene.opacity) return {};
  return info().attributes[static_cast<std::size_t>(info().find_attribute(used_.scene.opacity->attribute))];
}

void Session::show_all() {
  const FirstPicture picture{.width = scene.width, .height = scene.height, .up = up};
  begin_fitting([before = scene, picture](const format::Volume& volume) -> Result<Scene> {
    SPLATVOL_TRY_ASSIGN(first, default_scene(volume, before.attribute, picture));
    Scene fitted = before;
    fitted.camera = first.camera;
    set_projection(fitted.camera, before.camera.projection);
    return fitted;
  });
}

void Session::show_visible() {
  begin_fitting([before = scene](const format::Volume& volume) -> Result<Scene> {
    Scene fitted = before;
    SPLATVOL_TRY_SET(fitted.transfer_function, visible_colors(volume, before));
    return fitted;
  });
}

void Session::choose_up(int axis) {
  up = axis;
  dvec3 direction(0);
  direction[axis] = 1;
  if (std::abs(glm::dot(axes_of(scene.camera).forward, direction)) < 0.999) scene.camera.up = direction;
}

void Session::begin_fitting(std::function<Result<Scene>(const format::Volume&)> fit) {
  fitting_.fitted.end();
  const bool is_aside = settings.works_aside && settings.hurries;
  fitting_.before = scene;
  fitting_.fitted = {host_,
                     [steps = player_->steps(), step = player_->step(), fit = std::move(fit)]() -> Result<Scene> {
                       SPLATVOL_TRY_ASSIGN(volume, steps.volume(step));
                       return fit(*volume);
                     }};
  if (!is_aside) static_cast<void>(fitting_.fitted.wait(std::numeric_limits<double>::infinity()));
  take_fitted();
}

// Takes over what was fitted, if it is there. What was changed meanwhile stays.
void Session::take_fitted() {
  if (!is_fitting() || !fitting_.fitted.wait()) return;
  const Result<Scene> fitted = fitting_.fitted.take();
  const Scene& before = fitting_.before;
  if (!fitted) return troubles_.add(fitted.error().message);
  if (scene.camera == before.camera) scene.camera = fitted->camera;
  const bool is_same = scene.attribute == before.attribute && scene.transfer_function == before.transfer_function;
  if (is_same) scene.transfer_function = fitted->transfer_function;
}

TransferFunction Session::fitting_function() const {
  Scene adapted = data_.fitting;
  if (adapted.background != scene.background) adapt_to_background(adapted, scene.background);
  return adapted.transfer_function;
}

UsedScene Session::used_scene() const {
  UsedScene used{scene, {.file = source_.path, .pieces = source_.pieces}};
  const auto make_absolute = [](std::string& path) {
    std::error_code error;
    if (!is_url(path)) path = std::filesystem::absolute(path, error).lexically_normal().string();
  };
  make_absolute(used.use.file);
  std::ranges::for_each(used.use.pieces, make_absolute);
  if (times().size() > 1) used.use.step = step();
  if (asks_for_splats(settings.quality))
    used.use.quality = settings.quality;
  else if (exact())
    used.use.quality.exact = true;
  else
    used.use.quality.max_error = settings.quality.max_error.value_or(default_max_error);
  used.use.drawing = settings.drawing;
  used.use.drawing.kernel = kernel_of(settings.drawing);
  return used;
}

Status Session::forget_converted() {
  std::vector<std::string> files = {source_.path};
  files.insert(files.end(), source_.pieces.begin(), source_.pieces.end());
  source_.converted.reset();
  return splatvol::forget_converted(files);
}

Status Session::use(const SceneUse& use) {
  if (use.step) SPLATVOL_TRY(check_step(player_->steps(), *use.step));
  settings = with_use(settings, use);
  return use.step && *use.step != step() ? show_step(*use.step) : Status{};
}

void Session::show_attribute(const std::string& name) {
  scene.attribute = name;
  change_.fits_function = true;
}

// Until the values are known, the factor is 1.
void Session::show_opacity(const std::string& name) {
  if (name.empty()) {
    scene.opacity.reset();
    TransferFunction& function = scene.transfer_function;
    if (function.densities.size() == 1) function.densities = fitting_function().densities, function.density_factor = 1;
    return;
  }
  scene.opacity = SceneOpacity{name, {.colors = {{0, dvec3(1)}}, .densities = {{0, 1}}}};
  change_.fits_opacity = true;
}

Status Session::show_step(std::size_t step) {
  stop_drawing();
  cancel_reading();
  progress_.settled = movement_.is_drawn = false;
  rest_.refinement.reset();
  SPLATVOL_TRY(player_->show_step(step));
  await_step();
  return use_step();
}

// Of a series of files, only the file itself is opened ahead: the rest would be read here.
bool Session::reads_steps_here() const { return !player_->steps().are_files() && player_->streamer().volume().waits(); }

void Session::ask_step(std::size_t step) {
  change_.step = step == player_->step() ? std::nullopt : std::optional(step);
  const bool is_there = change_.step && reads_steps_here() && awaited_.ahead == step && !is_reading_ahead();
  if (!is_there) return;
  if (const Status shown = show_step(step); !shown) troubles_.add(shown.error().message);
}

void Session::choose_step(std::size_t step) {
  stop_playing();
  if (step < times().size()) ask_step(step);
}

void Session::toggle_playing() {
  const std::size_t count = times().size();
  if (is_playing() || count < 2) return stop_playing();
  if (step() + 1 == count) choose_step(0);
  playback.begin();
}

Status Session::play(double seconds) {
  if (!is_playing()) return {};
  playback.pass(seconds);
  if (!is_step_shown()) return {};
  const std::optional<std::size_t> next = playback.next(step(), times().size());
  if (!next) return {};
  read_ahead(*next);
  if (!playback.is_due(!is_reading_ahead())) return {};
  if (!reads_steps_here()) {
    playback.await(*next);
    ask_step(*next);
    return {};
  }
  Status shown = show_step(*next);
  if (!shown) stop_playing();
  // The one after it is read while its picture is drawn.
  if (const auto after = playback.after(*next, times().size()); shown && after) read_ahead(*after);
  return shown;
}

void Session::remember() {
  if (shown_.number == 0) return;
  Scene present = scene;
  present.width = present.height = 0;
  if (!history_)
    history_.emplace(std::move(present));
  else
    history_->add(present);
}

void Session::undo() {
  if (!history_) return;
  remember();
  restore(history_->undo());
}

void Session::redo() {
  if (!history_) return;
  remember();
  restore(history_->redo());
}

void Session::restore(const Scene& before) {
  const int width = scene.width, height = scene.height;
  scene = before;
  scene.width = width;
  scene.height = height;
}

// Begins with the picture of another step.
void Session::await_step() {
  progress_.settled = movement_.is_drawn = false;
  rest_.refinement.reset();
  awaited_.ahead.reset();
  progress_.still_seconds = awaited_.seconds = 0;
  awaited_.is_awaited = true;
  cells_fail_ = false;
  movement_.holding_cells.end();
}

// Returns the scene as it can be drawn until what a change needs has been read. Other edits show.
Scene Session::scene_without_change() const {
  if (!is_reading()) return scene;
  Scene drawn = scene;
  if (change_between(used_.scene, drawn).data) {
    drawn.attribute = used_.scene.attribute;
    drawn.transfer_function = used_.scene.transfer_function;
    drawn.opacity = used_.scene.opacity;
  }
  if (drawn.lighting.has_value() != used_.scene.lighting.has_value()) drawn.lighting = used_.scene.lighting;
  drawn.surfaces = used_.scene.surfaces;
  return drawn;
}

// Goes back to this scene, which needs no reading.
void Session::take_back(const Scene& without_change) {
  scene = without_change;
  settings.memory = used_.settings.memory;
  settings.drawing.kernel = used_.settings.drawing.kernel;
}

void Session::cancel_reading() {
  fitting_.fitted.end();
  change_.step.reset();
  if (!is_reading()) return;
  take_back(scene_without_change());
  change_.end();
}

// Sees to it that what the scene and the settings need is read.
Status Session::read_change() {
  if (!change_.begin(host_, *player_, source_.path, scene, settings)) return {};
  const bool is_aside = settings.works_aside && settings.hurries;
  if (is_aside && !change_.is_done()) return {};
  const Scene without_change = scene_without_change();
  return take_change(change_.take(), without_change);
}

// What cannot be read, or does not fit, stays as it was.
Status Session::take_change(Result<SessionFile> change, const Scene& without_change) {
  Status taken;
  const bool has_step = change_.step.has_value();
  change_.step.reset();
  if (change) {
    PlayerFile& file = change->file;
    const bool is_whole = file.streamer != nullptr;
    if (change_.fits_function && is_whole) {
      TransferFunction function = change->data.fitting.transfer_function;
      if (scene.opacity) {
        function.densities = scene.transfer_function.densities;
        function.density_factor = scene.transfer_function.density_factor;
      }
      scene.transfer_function = std::move(function);
    }
    if (change->fitting_opacity) splatvol::show_opacity(scene, std::move(*change->fitting_opacity));
    file.scene = scene;
    taken = player_->replace(std::move(file));
    if (taken && is_whole) {
      cells_fail_ = false;
      movement_.holding_cells.end();
      shown_.is_whole = false;  // another rasterizer may have none
      data_.histogram = change->data.histogram;
      data_.opacity_histogram = change->data.opacity_histogram;
      data_.fitting = change->data.fitting;
    }
    if (taken && has_step) {
      data_.bounds = change->data.bounds;
      data_.mesh_box = change->data.mesh_box;
      await_step();
    }
  } else {
    taken = tl::unexpected(change.error());
  }
  change_.fits_function = change_.fits_opacity = false;
  if (taken) return {};
  troubles_.add(taken.error().message);
  take_back(without_change);
  return {};
}

// Passes tubes of streamlines on to the player. Returns whether some have come.
bool Session::take_tubes() {
  std::optional<Error> trouble;
  auto tubes = streamlines_.take(trouble);
  if (trouble && trouble->code != ErrorCode::cancelled) troubles_.add_once(trouble->message);
  if (!tubes) return false;
  streamline_counts_.clear();
  for (const SceneTubes& one : *tubes) streamline_counts_.push_back({one.lines ? one.lines->size() : 0, one.seeds});
  player_->set_tubes(*std::move(tubes));
  return true;
}

// Passes changes on to the player. A change of the picture starts again from a coarse one.
Status Session::apply() {
  SPLATVOL_TRY(read_change());
  Scene drawn = scene_without_change();
  if (const Status set = player_->set_scene(drawn); !set) {
    troubles_.add(set.error().message);
    drawn = scene = used_.scene;
    SPLATVOL_TRY(player_->set_scene(scene));
  }
  Drawing drawing = settings.drawing;
  drawing.kernel = player_->options().drawing.kernel;  // until what another one needs is read
  SPLATVOL_TRY(player_->set_drawing(drawing));
  streamlines_.follow(host_, *player_, drawn.streamlines);
  const bool has_tubes = take_tubes();
  const SceneChange change = change_between(used_.scene, drawn);
  const bool same = !has_tubes && player_->options().memory == used_.settings.memory &&
                    drawing == used_.settings.drawing && settings.quality == used_.settings.quality &&
                    settings.most_exact_segments == used_.settings.most_exact_segments && !change.is_of_picture();
  used_.view = player_->view();
  used_.scene = std::move(drawn);
  used_.settings = settings;
  used_.settings.memory = player_->options().memory;
  used_.settings.drawing = drawing;
  if (same) return {};
  if (change.data)
    movement_.control.forget_errors();
  else if (change.is_beyond_camera())
    movement_.control.doubt_errors();
  progress_.still_seconds = 0;
  progress_.settled = movement_.is_drawn = false;
  rest_.refinement.reset();
  return {};
}

// Fits the first scene's camera to the first picture, if its size was not known when the file was opened.
Status Session::fit_camera() {
  if (!fits_) return {};
  fits_ = false;
  const bool fits_size = scene.width == first_scene_.width && scene.height == first_scene_.height;
  if (fits_size || scene.camera != first_scene_.camera) return {};
  const auto fitted = player_->fitting_scene(scene.attribute, {scene.width, scene.height});
  fits_ = is_pending(fitted);
  if (fits_) return {};  // the camera stays until then
  SPLATVOL_TRY(fitted);
  scene.camera = first_scene_.camera = fitted->camera;
  return {};
}

Status Session::draw(int width, int height, double seconds, bool is_busy) {
  progress_.failure = draw_next(width, height, seconds, is_busy);
  if (!progress_.failure) progress_.settled = true;  // only a change helps, and it begins anew
  return progress_.failure;
}

Status Session::draw_next(int width, int height, double seconds, bool is_busy) {
  scene.width = width;
  scene.height = height;
  SPLATVOL_TRY(fit_camera());
  take_fitted();
  if (movement_.holding_cells.is_begun() && movement_.holding_cells.wait())
    cells_fail_ = !movement_.holding_cells.take() || cells_fail_;
  SPLATVOL_TRY(make_view(scene));
  if (!awaited_.is_awaited) progress_.still_seconds += seconds;
  if (is_drawing()) {
    const bool is_old =
        change_.step || streamlines_.has_news() || change_between(used_.scene, scene_without_change()).is_of_picture();
    if (is_old && job_.work() != Work::moving) interrupt_drawing();
    SPLATVOL_TRY(end_drawing(is_busy));
    if (is_drawing()) return {};     // the picture stays
    SPLATVOL_TRY(encode_picture());  // the next one may begin before this one is shown
  }
  SPLATVOL_TRY(apply());
  if (progress_.settled) return progress_.failure;

  if (is_busy && rest_.refinement && !awaited_.is_awaited) return {};  // the picture stays

  const bool plays_on = is_playing() && playback.steps_per_second > 2;
  const bool moves = settings.hurries && (is_busy || plays_on || progress_.still_seconds < pause_seconds);
  if (moves) {
    movement_.control.set_limits(moving_limits(is_busy));
    return movement_.is_drawn && !awaited_.is_awaited ? Status{} : begin_picture(true, seconds);
  }
  if (change_.step) return {};  // the picture stays
  if (!rest_.refinement) begin_rest();
  return rest_.refinement->is_done() ? begin_making_ready() : begin_picture(false, seconds);
}

// Keeps the errors of parts of the frame that was chosen.
void Session::note_frame() {
  for (const Error& error : player_->frame()->progress.errors) troubles_.add_once(error.message);
}

void Session::note_drawn(const ShownRecipe& recipe) {
  const double made_in = std::max(job_.take_seconds(), picture_.seconds);
  shown_ = {shown_.number + 1, used_.view, recipe, picture_.seconds, player_->rasterizer().device_bytes(), true};
  screen_.take_next(used_.scene);
  if (!settings.on_picture) return;
  const DevicePicture picture = player_->picture();
  if (const auto* image = std::get_if<const Image*>(&picture))
    settings.on_picture({shown_.number, **image, used_.scene, player_->step(), recipe, made_in});
}

Status Session::draw_aside(Work work, std::function<Status()> draw) {
  job_.begin(host_, work, *player_, std::move(draw));
  return end_drawing(work == Work::moving);
}

// Takes over the picture if it is there, or comes soon.
Status Session::end_drawing(bool is_busy) {
  constexpr double patience = 0.008;  // seconds: half of a frame at 60 frames a second
  if (!job_.wait(is_busy ? 0 : patience)) return {};
  const Status done = job_.take();
  return job_.work() == Work::making_ready ? finish_making_ready(done) : finish_picture(done);
}

// Ends a picture that nobody will see.
void Session::stop_drawing() {
  if (!is_drawing()) return;
  interrupt_drawing();
  static_cast<void>(job_.take());
  screen_.drop_next();
}

void Session::interrupt_drawing() {
  shown_.is_whole = false;
  job_.interrupt();
  player_->cancel();  // of choosing the splats
}

Result<ShownPicture> Session::shown_picture() {
  if (!is_drawing()) {
    const DevicePicture picture = player_->picture();
    if (const auto* texture = std::get_if<TexturePicture>(&picture)) return ShownPicture{.texture = *texture};
    SPLATVOL_TRY(encode_picture());
  }
  return ShownPicture{.encoded = &screen_.encoded(), .is_new = screen_.take_news()};
}

// Encodes the processor's picture where nobody waits for it.
void Session::encode_aside() {
  const DevicePicture picture = player_->picture();
  if (const auto* image = std::get_if<const Image*>(&picture))
    screen_.encode_next(**image, used_.view, used_.scene, data_.bounds);
}

// Encodes the picture, unless that is done. Needs no context if it is the processor's.
Status Session::encode_picture() {
  if (screen_.is_of(scene) || !shown_.is_whole) return {};
  Image copy;
  SPLATVOL_TRY_ASSIGN(picture, player_->image_or_copy(copy));
  screen_.encode(*picture, shown_.view, scene, data_.bounds);
  return {};
}

std::optional<DevicePicture> Session::volume_picture() const {
  if (player_->has_drawn_surfaces() || !frame()) return {};
  return player_->picture();
}

// Contours and streamlines may show where the volume does not.
std::string Session::explain() const {
  const bool has_tubes = std::ranges::any_of(used_.scene.streamlines, &SceneStreamlines::shown);
  if ((!frame() && !exact()) || has_tubes || !contours_of(used_.scene).surfaces.empty()) return {};
  const auto sentence = [](const EmptyReason& why, const std::string& remedy) {
    std::string text = fmt::format("{}: {}.", why.reason, remedy);
    text[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(text[0])));
    return text;
  };
  const ShownAttributes shown = player_->streamer().shown_attributes();
  if (const EmptyReason why = why_empty(view(), transfer_of(used_.scene), shown, data_.bounds)) {
    const bool outside = std::string_view(why.reason).ends_with("outside of the view");
    return sentence(why, outside ? "press R to see all of it" : why.remedy);
  }
  const bool is_empty = exact() ? exact()->segments == 0 : frame()->splats == 0 && frame()->progress.settled;
  if (!is_empty) return {};
  const EmptyReason why = why_empty_in_view(false);
  return sentence(why, why.remedy);
}

}  // namespace splatvol
