#include "viewer/session.h"

#include <algorithm>
#include <bit>
#include <cctype>
#include <chrono>
#include <cmath>
#include <system_error>

#include "base/interruption.h"
#include "renderer/cpu/tile_rasterizer.h"
#include "renderer/gl/gl_rasterizer.h"
#include "streamer/explain.h"

namespace splatvol {
namespace {

// Duration of a change of resolution.
constexpr double fade_seconds = 0.2;

// The first picture at rest for an error has at least so many splats: it costs little.
constexpr std::uint64_t least_first_splats = std::uint64_t{1} << 13;

// With surfaces or slices, a moving picture has at least so many splats. Fewer are no faster: each is larger, and
// surfaces are compared with each of its pixels.
constexpr std::uint64_t least_among_surfaces = std::uint64_t{1} << 15;

// Longest time that the picture of the step before stays. Then the new one is drawn as coarse as it is.
constexpr double longest_wait_seconds = 2;

// Longest wait of one frame for the first picture of a step.
constexpr double step_wait_seconds = 0.02;

// Returns the sample spacing while something moves, for a picture of this many splats. It is three times as wide as one
// that loses nothing: in the same time, many small splats make a better picture than a few sharp ones.
int moving_sample_spacing(const View& view, std::uint64_t splats) {
  const double covered =
      std::min(view.width, view.height) / std::cbrt(static_cast<double>(std::max<std::uint64_t>(splats, 1)));
  return std::clamp(static_cast<int>(covered / 4), 1, 6);
}

}  // namespace

Result<std::unique_ptr<Session>> Session::open(const std::string& path, const std::string& scene_path,
                                               const ViewSettings& settings) {
  std::unique_ptr<Session> session(new Session);
  session->path_ = path;
  session->settings = session->used_settings_ = settings;
  std::optional<Scene> scene;
  if (scene_path.empty()) {
    session->fits_ = true;
  } else {
    SPLATVOL_TRY_ASSIGN(loaded, load_scene(scene_path));
    scene = std::move(loaded);
  }
  SPLATVOL_TRY_ASSIGN(player, Player::open(path, scene,
                                           {.memory = settings.memory,
                                            .gpu_memory = settings.gpu_memory,
                                            .device = settings.device,
                                            .in_current_context = settings.in_current_context,
                                            .kernel = settings.kernel,
                                            .read_surface = settings.read_surface}));
  session->player_ = std::move(player);
  session->scene = session->first_scene_ = session->used_scene_ = session->player_->scene();
  SPLATVOL_TRY(session->read_histogram());
  SPLATVOL_TRY(session->find_bounds());
  return session;
}

Status Session::read_histogram() {
  SPLATVOL_TRY_ASSIGN(histograms, player_->streamer().volume().read_histograms());
  const auto index = static_cast<std::size_t>(info().find_attribute(player_->scene().attribute));
  histogram_ = histograms.empty() ? decltype(histogram_){} : histograms[index];
  return {};
}

Status Session::find_bounds() {
  SPLATVOL_TRY_ASSIGN(bounds, player_->find_domain());
  bounds_ = bounds;
  return {};
}

const format::Attribute& Session::attribute() const {
  return info().attributes[static_cast<std::size_t>(info().find_attribute(used_scene_.attribute))];
}

Result<Camera> Session::fitting_camera() const {
  SPLATVOL_TRY_ASSIGN(fitting, player_->fitting_scene(scene.attribute, {scene.width, scene.height}));
  return fitting.camera;
}

Status Session::show_attribute(const std::string& name) {
  SPLATVOL_TRY_ASSIGN(fitting, fitting_scene(name));
  scene.attribute = name;
  scene.transfer_function = fitting.transfer_function;
  return {};
}

Status Session::show_step(std::size_t step) {
  stop_drawing();
  settled_ = false;
  sharpening_.reset();
  SPLATVOL_TRY(player_->show_step(step));
  still_seconds_ = awaited_seconds_ = 0;
  awaits_step_ = true;
  SPLATVOL_TRY(read_histogram());
  return player_->steps().are_files() ? find_bounds() : Status{};  // a file may have another mesh
}

// Passes changes on to the player; what it refuses stays as it was. A change of the picture starts again from a coarse
// one.
Status Session::apply() {
  Status applied;
  if (settings.memory != used_settings_.memory) applied = player_->set_memory(settings.memory);
  if (applied && settings.kernel != used_settings_.kernel) applied = player_->set_kernel(settings.kernel);
  if (applied) applied = player_->set_scene(scene);
  if (!applied) {
    troubles_.push_back(applied.error().message);
    settings = used_settings_;
    settings.kernel = player_->options().kernel;
    settings.memory = player_->options().memory;
    scene = used_scene_;
    SPLATVOL_TRY(player_->set_scene(scene));
  }
  if (scene.attribute != used_scene_.attribute) SPLATVOL_TRY(read_histogram());
  const bool same = settings.memory == used_settings_.memory && settings.kernel == used_settings_.kernel &&
                    settings.tolerance == used_settings_.tolerance && settings.max_error == used_settings_.max_error &&
                    settings.mixes == used_settings_.mixes && scene.attribute == used_scene_.attribute &&
                    scene.camera == used_scene_.camera && scene.transfer_function == used_scene_.transfer_function &&
                    scene.lighting == used_scene_.lighting && scene.clip_box == used_scene_.clip_box &&
                    scene.surfaces == used_scene_.surfaces && scene.slices == used_scene_.slices &&
                    scene.clip_planes == used_scene_.clip_planes && scene.width == used_scene_.width &&
                    scene.height == used_scene_.height;
  used_scene_ = scene;
  used_settings_ = settings;
  if (same) return {};
  still_seconds_ = 0;
  settled_ = false;
  sharpening_.reset();
  return {};
}

// Fits the first scene's camera to the first picture, whose size was not known when the file was opened.
Status Session::fit_camera() {
  if (!fits_) return {};
  fits_ = false;
  if (scene.camera != first_scene_.camera) return {};
  SPLATVOL_TRY_ASSIGN(fitted, fitting_camera());
  scene.camera = first_scene_.camera = fitted;
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
  SPLATVOL_TRY(make_view(scene));
  still_seconds_ += seconds;
  undrawn_seconds_ += seconds;
  if (is_drawing()) {
    if (scene != used_scene_) stop_.request_stop();
    SPLATVOL_TRY(end_drawing(is_busy));
    if (is_drawing()) return {};  // the picture stays
  }
  SPLATVOL_TRY(apply());
  if (settled_) return failure_;

  if (is_busy && sharpening_ && !awaits_step_) return {};  // the picture stays

  const bool moves = settings.hurries && (is_busy || still_seconds_ < pause_seconds);
  if (!moves && !sharpening_) begin_rest();
  FrameRequest request{.wait_seconds = awaits_step_ ? step_wait_seconds : 0,
                       .change = moves ? 1 : std::min(1.0, std::max(undrawn_seconds_, 0.01) / fade_seconds)};
  if (moves)
    request.detail.goal = ErrorGoal{0, std::min(moving_splats(), player_->device_splats())};
  else
    request.detail = sharpening_->detail();
  SPLATVOL_TRY(player_->choose(request));
  const FrameSplats& chosen = *player_->frame();
  for (const Error& error : chosen.progress.errors) troubles_.push_back(error.message);
  awaited_seconds_ += seconds;
  awaits_step_ = awaits_step_ && !chosen.progress.settled && awaited_seconds_ < longest_wait_seconds;
  if (awaits_step_) return {};  // the picture stays

  // Slabs take several times as long: a hand that turns the data gets more splats instead.
  const bool mixes = settings.mixes && !moves;
  const DrawOptions options{.sort = settings.sort,
                            .raster = mixes ? Raster::automatic : Raster::splats,
                            .sample_spacing = moves ? moving_sample_spacing(view(), chosen.splats) : 0};
  undrawn_seconds_ = 0;
  if (!moves && can_draw_aside()) return draw_aside(options);
  SPLATVOL_TRY(player_->draw(options));
  note_drawn();
  // Counts the splats that were allowed, not those drawn: the next finer cut may have many times as many.
  const PlayerTimes& times = player_->times();
  if (moves) pacer_.add(request.detail.goal->max_splats, times.frame - times.surfaces);
  return moves || !frame()->progress.settled ? Status{} : finish_picture();
}

std::uint64_t Session::moving_splats() const {
  return player_->has_drawn_surfaces() ? std::max(pacer_.splats(), least_among_surfaces) : pacer_.splats();
}

void Session::note_drawn() {
  texture_is_old_ = true;
  draw_seconds_ = player_->times().frame;
  device_bytes_ = player_->rasterizer().device_bytes();
}

// A context of OpenGL belongs to this thread.
bool Session::can_draw_aside() const {
  return settings.hurries && dynamic_cast<const TileRasterizer*>(&player_->rasterizer());
}

Status Session::draw_aside(const DrawOptions& options) {
  stop_ = std::stop_source();
  const auto draw = [this, options, stop = stop_.get_token()] {
    const Interruptible interruptible(stop);
    return player_->draw(options);
  };
  try {
    drawing_ = std::async(std::launch::async, draw);
  } catch (const std::system_error&) {
    drawing_ = std::async(std::launch::deferred, draw);  // no thread starts: it is drawn here
    drawing_.wait();
  }
  return end_drawing(false);
}

// Takes over the picture if it is there, or comes soon.
Status Session::end_drawing(bool is_busy) {
  constexpr std::chrono::milliseconds patience{8};  // half of a frame at 60 frames a second
  if (drawing_.wait_for(is_busy ? std::chrono::milliseconds{0} : patience) == std::future_status::timeout) return {};
  const Status drawn = drawing_.get();
  if (!drawn && drawn.error().code == ErrorCode::cancelled) return {};
  SPLATVOL_TRY(drawn);
  note_drawn();
  return frame()->progress.settled ? finish_picture() : Status{};
}

// Ends a picture that nobody will see.
void Session::stop_drawing() {
  if (!is_drawing()) return;
  stop_.request_stop();
  static_cast<void>(drawing_.get());
}

// Begins with a picture like the last one of the movement. Rounds its splats, which depend on the machine's load.
void Session::begin_rest() {
  Sharpening::Options options{.max_error = settings.max_error, .tolerance = settings.tolerance};
  if (!settings.tolerance && info().point_count() <= points_drawn_at_once) options.tolerance = 0;
  if (settings.hurries && frame()) options.first_splats = std::bit_floor(std::max(frame()->splats, least_first_splats));
  sharpening_.emplace(options);
}

// Goes on to a finer picture, unless this one is the last.
Status Session::finish_picture() {
  SPLATVOL_TRY(sharpening_->add(*frame(), [this] { return player_->image(); }));
  settled_ = sharpening_->is_done();
  if (settled_) read_ahead(step() + 1);
  return {};
}

Result<ShownPicture> Session::shown_picture() {
  if (player_->has_drawn_surfaces()) {
    if (texture_is_old_) {
      SPLATVOL_TRY_ASSIGN(picture, player_->image());
      SPLATVOL_TRY(texture_.upload(picture));
      texture_is_old_ = false;
    }
    return ShownPicture{texture_.name(), true};
  }
  if (const auto* gl = dynamic_cast<const GlRasterizer*>(&player_->rasterizer()))
    return ShownPicture{gl->texture(), false};
  if (const auto* tiles = dynamic_cast<const TileRasterizer*>(&player_->rasterizer()); tiles && texture_is_old_) {
    SPLATVOL_TRY(texture_.upload(tiles->image()));
    texture_is_old_ = false;
  }
  return ShownPicture{texture_.name(), true};
}

Result<Image> Session::page(const PageText& text, bool transparent) const {
  SPLATVOL_TRY_ASSIGN(image, player_->image());
  const dvec3 ink = ink_on(used_scene_.background);
  if (used_scene_.outline) draw_outline(image, view(), bounds_, transparent ? ink_on_any() : ink);
  SPLATVOL_TRY_ASSIGN(page, lay_out_round(image.width, image.height, text, used_scene_.transfer_function));
  return compose_page(page, std::move(image), text, used_scene_.transfer_function, ink, transparent);
}

std::string Session::explain() const {
  if (!frame()) return {};
  const auto sentence = [](const EmptyReason& why, const std::string& remedy) {
    std::string text = fmt::format("{}: {}.", why.reason, remedy);
    text[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(text[0])));
    return text;
  };
  if (const EmptyReason why = why_empty(view(), used_scene_.transfer_function, attribute(), bounds_)) {
    const bool outside = std::string_view(why.reason).ends_with("outside of the view");
    return sentence(why, outside ? "press R to see all of it" : why.remedy);
  }
  if (frame()->splats > 0 || !frame()->progress.settled) return {};
  const EmptyReason why = why_empty_in_view(false);
  return sentence(why, why.remedy);
}

}  // namespace splatvol
