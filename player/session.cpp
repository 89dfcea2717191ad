#include "player/session.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <limits>
#include <utility>

#include "base/interruption.h"
#include "format/mesh_box.h"
#include "pictures/contrast.h"
#include "player/camera_control.h"
#include "player/choice.h"
#include "renderer/cpu/srgb_bytes.h"
#include "scene/scene_change.h"
#include "streamer/first/explain.h"
#include "streamer/splats/domain.h"

namespace splatvol {
namespace {

PlayerOptions player_options(const ViewSettings& settings) {
  return {.memory = settings.memory,
          .gpu_memory = settings.gpu_memory,
          .device = settings.device,
          .in_current_context = settings.in_current_context,
          .drawing = settings.drawing,
          .first_picture = settings.first_picture,
          .read_surface = settings.read_surface};
}

using Histogram = std::array<std::uint64_t, 64>;

// Reads the histograms of a scene's attributes. Without an opacity, its histogram stays.
Status read_histograms(const format::Volume& volume, const Scene& scene, Histogram& values, Histogram& opacity) {
  SPLATVOL_TRY_ASSIGN(histograms, volume.read_histograms());
  const auto histogram_of = [&](const std::string& attribute) {
    const auto index = static_cast<std::size_t>(volume.info().find_attribute(attribute));
    return histograms.empty() ? Histogram{} : histograms[index];
  };
  values = histogram_of(scene.attribute);
  if (scene.opacity) opacity = histogram_of(scene.opacity->attribute);
  return {};
}

// Adds what a session shows besides splats. Reads the coarsest splats, too. Unless it `must_fit`, the scene takes the
// place of one that fits a file which is damaged.
Result<SessionFile> with_data(SessionFile read, bool must_fit, bool fits_opacity = false) {
  Streamer& streamer = *read.file.streamer;
  const Scene& scene = read.file.scene;
  SPLATVOL_TRY(read_histograms(streamer.volume(), scene, read.histogram, read.opacity_histogram));
  if (fits_opacity)
    SPLATVOL_TRY_SET(read.fitting_opacity, splatvol::fitting_opacity(streamer.volume(), scene.opacity->attribute,
                                                                     {512, 512, scene.background}));
  SPLATVOL_TRY_SET(read.bounds, find_domain(streamer));
  SPLATVOL_TRY_ASSIGN(of_cells, format::box_of_cells(streamer.volume()));
  read.mesh_box = of_cells.value_or(read.bounds);
  read.fitting = scene;
  if (read.fits) return read;
  auto fitting = default_scene(streamer.volume(), scene.attribute, {512, 512, scene.background});
  if (fitting)
    read.fitting = std::move(*fitting);
  else if (must_fit)
    return tl::unexpected(fitting.error());
  return read;
}

// Returns what `first` tells, and of the rest what `second` tells.
SceneUse joined(const SceneUse& first, const SceneUse& second) {
  SceneUse use = first;
  if (use.file.empty()) use.file = second.file, use.pieces = second.pieces;
  if (!use.step) use.step = second.step;
  use.quality = joined(first.quality, second.quality);
  use.drawing = joined(first.drawing, second.drawing);
  return use;
}

ViewSettings with_use(ViewSettings settings, const SceneUse& use) {
  settings.quality = joined(use.quality, settings.quality);
  settings.drawing = joined(use.drawing, settings.drawing);
  return settings;
}

tl::unexpected<Error> fail_no_step(const format::Steps& steps, std::size_t step) {
  return fail(ErrorCode::invalid_argument, "{}: no step {}; {}", steps.name(), step,
              steps.times().empty() ? "the file is no time series" : fmt::format("the last one is {}", steps.last()));
}

// Converts a mesh, or one that is in several pieces; none for another file.
Result<std::optional<ConvertedFile>> convert_mesh(const SceneUse& use, const Conversion& conversion) {
  ConversionRequest request{{use.file}, conversion.all_steps || use.step, conversion.preview};
  request.inputs.insert(request.inputs.end(), use.pieces.begin(), use.pieces.end());
  if (!needs_conversion(request.inputs)) return std::optional<ConvertedFile>();
  return convert(request, conversion.tell);
}

// Whether two changes need the same parts of the file.
bool need_the_same(const Scene& a, const ViewSettings& a_settings, const Scene& b, const ViewSettings& b_settings) {
  return a_settings.memory == b_settings.memory && kernel_of(a_settings.drawing) == kernel_of(b_settings.drawing) &&
         a.attribute == b.attribute && opacity_attribute_of(a) == opacity_attribute_of(b) && a.surfaces == b.surfaces &&
         a.lighting.has_value() == b.lighting.has_value();
}

// Lists of splats are large, and hold rows.
FrameSplats without_list(const FrameSplats& frame) {
  return {{},
          {},
          frame.serial,
          frame.nodes,
          frame.splats,
          frame.nodes_by_resolution,
          frame.splats_by_resolution,
          frame.detail,
          frame.expected_error,
          frame.goal_error,
          frame.finest,
          frame.progress};
}

}  // namespace

Result<std::unique_ptr<Session>> Session::open(const std::string& path, const std::string& scene_path,
                                               const ViewSettings& settings, SessionHost& host) {
  SPLATVOL_TRY_ASSIGN(file, read(SceneUse{.file = path}, scene_path, settings));
  return open(std::move(file), host);
}

Result<SessionFile> Session::read(const SceneUse& asked, const std::string& scene_path, const ViewSettings& settings,
                                  const format::OpenFile& open_file, const Conversion& conversion) {
  std::optional<Scene> scene;
  SceneUse use = asked;
  if (!scene_path.empty()) {
    SPLATVOL_TRY_ASSIGN(loaded, load_used_scene(scene_path));
    scene = std::move(loaded.scene);
    use = joined(asked, loaded.use);
    if (use.file.empty())
      return fail(ErrorCode::invalid_argument, "{}: names no file: open a .svol file or a mesh, and then this scene",
                  scene_path.starts_with('{') ? "the scene" : scene_path);
  }
  SPLATVOL_TRY_ASSIGN(converted, convert_mesh(use, conversion));
  SPLATVOL_TRY_ASSIGN(steps, converted ? format::Steps::open(converted->path, open_as(use.file, *converted, open_file))
                                       : format::Steps::open(use.file, open_file));
  const std::size_t step = use.step.value_or(steps.last());
  if (step > steps.last()) return fail_no_step(steps, step);
  const ViewSettings used = with_use(settings, use);
  SPLATVOL_TRY_ASSIGN(file, Player::read(std::move(steps), step, scene, player_options(used), {}));
  return with_data({.path = use.file,
                    .pieces = use.pieces,
                    .converted = std::move(converted),
                    .fits = !scene,
                    .settings = used,
                    .file = std::move(file)},
                   false);
}

Result<std::unique_ptr<Session>> Session::open(SessionFile file, SessionHost& host) {
  std::unique_ptr<Session> session(new Session(host));
  session->path_ = std::move(file.path);
  session->pieces_ = std::move(file.pieces);
  session->converted_ = std::move(file.converted);
  session->fits_ = file.fits;
  session->settings = session->used_settings_ = std::move(file.settings);
  session->scene = session->first_scene_ = session->used_scene_ = file.file.scene;
  session->histogram_ = file.histogram;
  session->opacity_histogram_ = file.opacity_histogram;
  session->bounds_ = file.bounds;
  session->mesh_box_ = file.mesh_box;
  session->fitting_scene_ = std::move(file.fitting);
  SPLATVOL_TRY_SET(session->player_, Player::open(std::move(file.file)));
  return session;
}

Session::~Session() {
  stop_drawing();
  end_holding_cells();
  end_reading();
  end_fitting();
}

// Takes over histogram and domain of the step that is shown.
Status Session::use_step() {
  SPLATVOL_TRY(read_histograms(player_->streamer().volume(), used_scene_, histogram_, opacity_histogram_));
  if (!player_->steps().are_files()) return {};
  SPLATVOL_TRY_ASSIGN(bounds, player_->find_domain());  // a file may have another mesh
  bounds_ = bounds;
  SPLATVOL_TRY_ASSIGN(of_cells, format::box_of_cells(player_->streamer().volume()));
  mesh_box_ = of_cells.value_or(bounds);
  return {};
}

format::Attribute Session::attribute() const {
  format::Attribute shown = info().attributes[static_cast<std::size_t>(info().find_attribute(used_scene_.attribute))];
  if (!scene.scalar_bar.unit.empty()) shown.unit = scene.scalar_bar.unit;
  return shown;
}

format::Attribute Session::bar_attribute() const {
  format::Attribute shown =
      info().attributes[static_cast<std::size_t>(info().find_attribute(bar_colors_of(used_scene_).attribute))];
  if (!scene.scalar_bar.unit.empty()) shown.unit = scene.scalar_bar.unit;
  return shown;
}

std::optional<format::Attribute> Session::opacity_attribute() const {
  if (!used_scene_.opacity) return {};
  return info().attributes[static_cast<std::size_t>(info().find_attribute(used_scene_.opacity->attribute))];
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
  end_fitting();
  const bool is_aside = settings.works_aside && settings.hurries;
  fitting_.emplace(Fitting{scene, {}, {}});
  const auto read = [steps = player_->steps(), step = player_->step(), stop = fitting_->stop.get_token(),
                     fit = std::move(fit)]() -> Result<Scene> {
    const Interruptible interruptible(stop);
    SPLATVOL_TRY_ASSIGN(volume, steps.volume(step));
    return fit(*volume);
  };
  fitting_->fitted = {host_, read};
  if (!is_aside) static_cast<void>(fitting_->fitted.wait(std::numeric_limits<double>::infinity()));
  take_fitted();
}

// Waits for the thread.
void Session::end_fitting() {
  if (fitting_) fitting_->stop.request_stop();
  fitting_.reset();
}

// Takes over what was fitted, if it is there. What was changed meanwhile stays.
void Session::take_fitted() {
  if (!fitting_ || !fitting_->fitted.wait()) return;
  const Result<Scene> fitted = fitting_->fitted.take();
  const Scene before = std::move(fitting_->before);
  fitting_.reset();
  if (!fitted) return troubles_.push_back(fitted.error().message);
  if (scene.camera == before.camera) scene.camera = fitted->camera;
  const bool is_same = scene.attribute == before.attribute && scene.transfer_function == before.transfer_function;
  if (is_same) scene.transfer_function = fitted->transfer_function;
}

TransferFunction Session::fitting_function() const {
  Scene adapted = fitting_scene_;
  if (adapted.background != scene.background) adapt_to_background(adapted, scene.background);
  return adapted.transfer_function;
}

UsedScene Session::used_scene() const {
  UsedScene used{scene, {.file = path_, .pieces = pieces_}};
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
  std::vector<std::string> files = {path_};
  files.insert(files.end(), pieces_.begin(), pieces_.end());
  converted_.reset();
  return splatvol::forget_converted(files);
}

Status Session::use(const SceneUse& use) {
  if (use.step && *use.step > player_->steps().last()) return fail_no_step(player_->steps(), *use.step);
  settings = with_use(settings, use);
  return use.step && *use.step != step() ? show_step(*use.step) : Status{};
}

void Session::show_attribute(const std::string& name) {
  scene.attribute = name;
  fits_function_ = true;
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
  fits_opacity_ = true;
}

Status Session::show_step(std::size_t step) {
  stop_drawing();
  cancel_reading();
  settled_ = moving_is_drawn_ = false;
  refinement_.reset();
  SPLATVOL_TRY(player_->show_step(step));
  await_step();
  return use_step();
}

// Of a series of files, only the file itself is opened ahead: the rest would be read here.
void Session::ask_step(std::size_t step) {
  asked_step_ = step == player_->step() ? std::nullopt : std::optional(step);
  const bool is_there = asked_step_ && !player_->steps().are_files() && read_ahead_ == step && !is_reading_ahead();
  if (!is_there) return;
  if (const Status shown = show_step(step); !shown) troubles_.push_back(shown.error().message);
}

void Session::choose_step(std::size_t step) {
  stop_playing();
  if (step < times().size()) ask_step(step);
}

void Session::toggle_playing() {
  const std::size_t count = times().size();
  if (is_playing() || count < 2) return stop_playing();
  if (step() + 1 == count) choose_step(0);
  step_seconds_ = 0;
  played_step_.reset();
}

Status Session::play(double seconds) {
  if (!is_playing() || !is_step_shown()) return {};
  const auto asked = std::exchange(played_step_, {});
  const bool is_last = step() + 1 == times().size();
  if ((asked && step() != *asked) || (is_last && !playback.loops)) {
    stop_playing();
    return {};
  }
  const std::size_t next = is_last ? 0 : step() + 1;
  read_ahead(next);
  *step_seconds_ += seconds;
  const double period = 1 / playback.steps_per_second;
  if (*step_seconds_ < period || is_reading_ahead()) return {};
  step_seconds_ = std::min(*step_seconds_ - period, period);  // on the average, the rate is kept
  if (steps().are_files()) {
    played_step_ = next;
    ask_step(next);
    return {};
  }
  Status shown = show_step(next);
  if (!shown) stop_playing();
  return shown;
}

void Session::remember() {
  if (!frame()) return;
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
  settled_ = moving_is_drawn_ = false;
  refinement_.reset();
  read_ahead_.reset();
  still_seconds_ = awaited_seconds_ = 0;
  awaits_step_ = true;
  cells_fail_ = false;
  end_holding_cells();
}

// Returns the scene as it can be drawn until what a change needs has been read. Other edits show.
Scene Session::scene_without_change() const {
  if (!reading_) return scene;
  Scene drawn = scene;
  if (drawn.attribute != used_scene_.attribute || opacity_attribute_of(drawn) != opacity_attribute_of(used_scene_)) {
    drawn.attribute = used_scene_.attribute;
    drawn.transfer_function = used_scene_.transfer_function;
    drawn.opacity = used_scene_.opacity;
  }
  if (drawn.lighting.has_value() != used_scene_.lighting.has_value()) drawn.lighting = used_scene_.lighting;
  drawn.surfaces = used_scene_.surfaces;
  return drawn;
}

// Goes back to this scene, which needs no reading.
void Session::take_back(const Scene& without_change) {
  scene = without_change;
  settings.memory = used_settings_.memory;
  settings.drawing.kernel = used_settings_.drawing.kernel;
}

void Session::cancel_reading() {
  end_fitting();
  asked_step_.reset();
  if (!reading_) return;
  take_back(scene_without_change());
  end_reading();
}

// Waits for the thread.
void Session::end_reading() {
  if (reading_) reading_->stop.request_stop();
  reading_.reset();
}

// Sees to it that what the scene and the settings need is read.
Status Session::read_change() {
  if (reading_ &&
      (reading_->step != asked_step_ || !need_the_same(reading_->scene, reading_->settings, scene, settings)))
    end_reading();
  const bool is_aside = settings.works_aside && settings.hurries;
  if (!reading_) {
    const Player::Reader reader = player_->reader(scene, player_options(settings), asked_step_);
    if (!reader) {
      fits_function_ = fits_opacity_ = false;
      return {};
    }
    reading_.emplace(Reading{scene, settings, asked_step_, {}, {}});
    const auto read = [reader, path = path_, fits = fits_function_, fits_opacity = fits_opacity_,
                       stop = reading_->stop.get_token()]() -> Result<SessionFile> {
      const Interruptible interruptible(stop);
      SPLATVOL_TRY_ASSIGN(file, reader());
      SessionFile change{.path = path, .file = std::move(file)};
      if (change.file.streamer) return with_data(std::move(change), fits, fits_opacity);
      return change;
    };
    reading_->file = {host_, read};
  }
  if (is_aside && !reading_->file.wait()) return {};
  const Scene without_change = scene_without_change();
  Result<SessionFile> change = reading_->file.take();
  reading_.reset();
  return take_change(std::move(change), without_change);
}

// What cannot be read, or does not fit, stays as it was.
Status Session::take_change(Result<SessionFile> change, const Scene& without_change) {
  Status taken;
  const bool has_step = asked_step_.has_value();
  asked_step_.reset();
  if (change) {
    PlayerFile& file = change->file;
    const bool is_whole = file.streamer != nullptr;
    if (fits_function_ && is_whole) {
      TransferFunction function = change->fitting.transfer_function;
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
      end_holding_cells();
      picture_is_whole_ = false;  // another rasterizer may have none
      histogram_ = change->histogram;
      opacity_histogram_ = change->opacity_histogram;
      fitting_scene_ = std::move(change->fitting);
    }
    if (taken && has_step) {
      bounds_ = change->bounds;
      mesh_box_ = change->mesh_box;
      await_step();
    }
  } else {
    taken = tl::unexpected(change.error());
  }
  fits_function_ = fits_opacity_ = false;
  if (taken) return {};
  troubles_.push_back(taken.error().message);
  take_back(without_change);
  return {};
}

// Passes changes on to the player. A change of the picture starts again from a coarse one.
Status Session::apply() {
  SPLATVOL_TRY(read_change());
  Scene drawn = scene_without_change();
  if (const Status set = player_->set_scene(drawn); !set) {
    troubles_.push_back(set.error().message);
    drawn = scene = used_scene_;
    SPLATVOL_TRY(player_->set_scene(scene));
  }
  Drawing drawing = settings.drawing;
  drawing.kernel = player_->options().drawing.kernel;  // until what another one needs is read
  SPLATVOL_TRY(player_->set_drawing(drawing));
  const SceneChange change = change_between(used_scene_, drawn);
  const bool same = player_->options().memory == used_settings_.memory && drawing == used_settings_.drawing &&
                    settings.quality == used_settings_.quality &&
                    settings.most_exact_segments == used_settings_.most_exact_segments && !change.is_of_picture();
  view_ = player_->view();
  used_scene_ = std::move(drawn);
  used_settings_ = settings;
  used_settings_.memory = player_->options().memory;
  used_settings_.drawing = drawing;
  if (same) return {};
  if (change.data)
    motion_.forget_errors();
  else if (change.is_beyond_camera())
    motion_.doubt_errors();
  still_seconds_ = 0;
  settled_ = moving_is_drawn_ = false;
  refinement_.reset();
  return {};
}

// Fits the first scene's camera to the first picture, if its size was not known when the file was opened.
Status Session::fit_camera() {
  if (!fits_) return {};
  fits_ = false;
  const bool fits_size = scene.width == first_scene_.width && scene.height == first_scene_.height;
  if (fits_size || scene.camera != first_scene_.camera) return {};
  SPLATVOL_TRY_ASSIGN(fitted, player_->fitting_scene(scene.attribute, {scene.width, scene.height}));
  scene.camera = first_scene_.camera = fitted.camera;
  return {};
}

Status Session::draw(int width, int height, double seconds, bool is_busy) {
  failure_ = draw_next(width, height, seconds, is_busy);
  if (!failure_) settled_ = true;  // only a change helps, and it begins anew
  return failure_;
}

Status Session::draw_next(int width, int height, double seconds, bool is_busy) {
  scene.width = width;
  scene.height = height;
  SPLATVOL_TRY(fit_camera());
  take_fitted();
  if (holding_cells_.is_begun() && holding_cells_.wait()) cells_fail_ = !holding_cells_.take() || cells_fail_;
  SPLATVOL_TRY(make_view(scene));
  if (!awaits_step_) still_seconds_ += seconds;
  if (is_drawing()) {
    const bool is_old = asked_step_ || change_between(used_scene_, scene_without_change()).is_of_picture();
    if (is_old && work_ != Work::moving) interrupt_drawing();
    SPLATVOL_TRY(end_drawing(is_busy));
    if (is_drawing()) return {};     // the picture stays
    SPLATVOL_TRY(encode_picture());  // the next one may begin before this one is shown
  }
  SPLATVOL_TRY(apply());
  if (settled_) return failure_;

  if (is_busy && refinement_ && !awaits_step_) return {};  // the picture stays

  const bool plays_on = is_playing() && playback.steps_per_second > 2;
  const bool moves = settings.hurries && (is_busy || plays_on || still_seconds_ < pause_seconds);
  if (moves) return moving_is_drawn_ && !awaits_step_ ? Status{} : begin_picture(true, seconds);
  if (asked_step_) return {};  // the picture stays
  if (!refinement_) begin_rest();
  return refinement_->is_done() ? begin_making_ready() : begin_picture(false, seconds);
}

// Keeps a trouble that comes back with each frame.
void Session::tell_once(const std::string& trouble) {
  if (told_once_.insert(trouble).second) troubles_.push_back(trouble);
}

// Keeps the errors of parts of the frame that was chosen.
void Session::note_frame() {
  for (const Error& error : player_->frame()->progress.errors) tell_once(error.message);
}

void Session::note_drawn(const ShownRecipe& recipe) {
  encoded_is_old_ = picture_is_whole_ = true;
  draw_seconds_ = took_seconds_;
  const double made_in = std::max(std::exchange(job_seconds_, 0), took_seconds_);
  device_bytes_ = player_->rasterizer().device_bytes();
  ++shown_number_;
  shown_view_ = view_;
  shown_recipe_ = recipe;
  if (!encoded_aside_.bytes.empty()) {
    std::swap(encoded_, encoded_aside_);
    encoded_aside_.bytes.clear();
    encoded_background_ = used_scene_.background;
    encoded_outline_ = used_scene_.outline;
    encoded_is_old_ = encoded_is_shown_ = false;
  }
  if (!settings.on_picture) return;
  const DevicePicture picture = player_->picture();
  if (const auto* image = std::get_if<const Image*>(&picture))
    settings.on_picture({shown_number_, **image, used_scene_, player_->step(), recipe, made_in});
}

Status Session::draw_aside(Work work, std::function<Status()> draw) {
  before_ = {{},
             player_->exact(),
             player_->streamer().drawn_nodes(),
             player_->streamer().statistics(),
             player_->is_reading_ahead(),
             player_->left_out()};
  if (const FrameSplats* frame = player_->frame()) before_.frame = without_list(*frame);
  work_ = work;
  stop_ = std::stop_source();
  const auto draw_interruptibly = [this, draw = std::move(draw), start = host_.now(),
                                   stop = stop_.get_token()]() -> Status {
    const Interruptible interruptible(stop);
    Status drawn = draw();
    job_seconds_ = host_.now() - start;
    return drawn;
  };
  const auto priority = work == Work::moving ? SessionHost::Priority::usual : SessionHost::Priority::low;
  drawing_ = {host_, draw_interruptibly, priority};
  return end_drawing(work == Work::moving);
}

// Takes over the picture if it is there, or comes soon.
Status Session::end_drawing(bool is_busy) {
  constexpr double patience = 0.008;  // seconds: half of a frame at 60 frames a second
  if (!drawing_.wait(is_busy ? 0 : patience)) return {};
  return finish(drawing_.take());
}

Status Session::finish(const Status& done) {
  return work_ == Work::making_ready ? finish_making_ready(done) : finish_picture(done);
}

// Ends a picture that nobody will see.
void Session::stop_drawing() {
  if (!is_drawing()) return;
  interrupt_drawing();
  static_cast<void>(drawing_.take());
  encoded_aside_.bytes.clear();
}

void Session::interrupt_drawing() {
  picture_is_whole_ = false;
  stop_.request_stop();
  player_->cancel();  // of choosing the splats
}

Result<ShownPicture> Session::shown_picture() {
  if (!is_drawing()) {
    const DevicePicture picture = player_->picture();
    if (const auto* texture = std::get_if<TexturePicture>(&picture)) return ShownPicture{.texture = *texture};
    SPLATVOL_TRY(encode_picture());
  }
  return ShownPicture{.encoded = &encoded_, .is_new = !std::exchange(encoded_is_shown_, true)};
}

// Lays the processor's picture over the background where nobody waits for it.
Status Session::encode_aside() {
  const DevicePicture picture = player_->picture();
  const auto* image = std::get_if<const Image*>(&picture);
  if (!image) return {};
  encode(**image, view_, used_scene_, encoded_aside_);
  return {};
}

// Lays a picture over the background of `shown`, with its outline.
void Session::encode(const Image& picture, const View& view, const Scene& shown, EncodedPicture& encoded) const {
  encode_srgb(picture, shown.background, encoded.bytes);
  encoded.width = picture.width, encoded.height = picture.height;
  if (!shown.outline || view.width != picture.width || view.height != picture.height) return;
  const dvec3 ink = ink_on(shown.background);
  std::vector<std::size_t> places;
  Image changed;
  for (const OutlineStroke& stroke : outline_strokes(view, bounds_)) {
    if (places.empty() || places.back() != stroke.pixel) {
      places.push_back(stroke.pixel);
      changed.pixels.push_back(picture.pixels[stroke.pixel]);
    }
    changed.pixels.back() = with_stroke(changed.pixels.back(), stroke, ink);
  }
  changed.width = static_cast<int>(places.size()), changed.height = 1;
  std::vector<std::uint8_t> bytes;
  encode_srgb(changed, shown.background, bytes);
  for (std::size_t i = 0; i < places.size(); ++i) std::copy_n(&bytes[4 * i], 4, &encoded.bytes[4 * places[i]]);
}

// Lays the processor's picture over the background, unless that is done. Needs no context.
Status Session::encode_picture() {
  const bool is_encoded =
      !encoded_is_old_ && encoded_background_ == scene.background && encoded_outline_ == scene.outline;
  if (is_encoded || !picture_is_whole_) return {};
  Image copy;
  SPLATVOL_TRY_ASSIGN(picture, player_->image_or_copy(copy));
  encode(*picture, shown_view_, scene, encoded_);
  encoded_background_ = scene.background;
  encoded_outline_ = scene.outline;
  encoded_is_old_ = encoded_is_shown_ = false;
  return {};
}

std::optional<DevicePicture> Session::volume_picture() const {
  if (player_->has_drawn_surfaces() || !frame()) return {};
  return player_->picture();
}

Result<Image> Session::page(const Page& page, const PageText& text, bool transparent) const {
  SPLATVOL_TRY_ASSIGN(image, player_->image());
  const dvec3 ink = ink_on(used_scene_.background);
  if (used_scene_.outline) draw_outline(image, view(), bounds_, transparent ? ink_on_any() : ink);
  return compose_page(page, std::move(image), text, bar_colors_of(used_scene_).function, ink, transparent);
}

// Contours may show where the volume does not.
std::string Session::explain() const {
  if (!frame() || !contours_of(used_scene_).surfaces.empty()) return {};
  const auto sentence = [](const EmptyReason& why, const std::string& remedy) {
    std::string text = fmt::format("{}: {}.", why.reason, remedy);
    text[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(text[0])));
    return text;
  };
  const ShownAttributes shown = player_->streamer().shown_attributes();
  if (const EmptyReason why = why_empty(view(), transfer_of(used_scene_), shown, bounds_)) {
    const bool outside = std::string_view(why.reason).ends_with("outside of the view");
    return sentence(why, outside ? "press R to see all of it" : why.remedy);
  }
  if (frame()->splats > 0 || !frame()->progress.settled) return {};
  const EmptyReason why = why_empty_in_view(false);
  return sentence(why, why.remedy);
}

}  // namespace splatvol
