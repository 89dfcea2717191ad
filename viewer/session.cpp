#include "viewer/session.h"

#include <algorithm>
#include <bit>
#include <cctype>
#include <chrono>
#include <cmath>
#include <future>
#include <limits>
#include <stop_token>

#include "base/http_source.h"
#include "base/interruption.h"
#include "renderer/cpu/tile_rasterizer.h"
#include "renderer/gl/gl_rasterizer.h"
#include "renderer/sampling.h"
#include "streamer/default_scene.h"
#include "streamer/explain.h"

namespace splatvol {
namespace {

// After this time without a change, the picture becomes finer.
constexpr double pause_seconds = 0.15;

// Duration of a change of resolution.
constexpr double fade_seconds = 0.2;

// The first picture at rest for an error has at least so many splats: it costs little.
constexpr std::uint64_t least_first_splats = std::uint64_t{1} << 13;

// Longest time that the picture of the step before stays. Then the new one is drawn as coarse as it is.
constexpr double longest_wait_seconds = 2;

// Longest wait of one frame for the first picture of a step.
constexpr double step_wait_seconds = 0.02;

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

// Returns the sample spacing while something moves, for a picture of this many splats. It is three times as wide as one
// that loses nothing: in the same time, many small splats make a better picture than a few sharp ones.
int moving_sample_spacing(const View& view, std::uint64_t splats) {
  const double covered =
      std::min(view.width, view.height) / std::cbrt(static_cast<double>(std::max<std::uint64_t>(splats, 1)));
  return std::clamp(static_cast<int>(covered / 4), 1, 6);
}

// Half of the edges of the box round a splat, and its centre, relative to its block.
struct SplatExtent {
  dvec3 center, half;
};

SplatExtent extent_of(const RecordRow& row, std::uint32_t record) {
  if (std::holds_alternative<std::vector<OctantShape>>(row.shapes->records())) {
    const OctantSplat splat = unpack_octant(row, record);
    return {dvec3(splat.position), dvec3(0.5 * static_cast<double>(splat.size))};
  }
  const Material splat = unpack(row, record);
  const dmat3 axes = glm::mat3_cast(splat.orientation);
  SplatExtent extent{splat.center, dvec3(0)};
  for (int k = 0; k < 3; ++k) {
    const dvec3 across(axes[0][k], axes[1][k], axes[2][k]);
    extent.half[k] = std::sqrt(3.0) * glm::length(across * splat.deviations);
  }
  return extent;
}

}  // namespace

// Opens a step's file on a thread of its own. Its destruction does not wait for a server.
class Session::Ahead {
 public:
  Ahead(const format::Steps& steps, std::size_t step)
      : step_(step), volume_(std::async(std::launch::async, [steps, step, stop = stop_.get_token()] {
          const Interruptible interruptible(stop);
          return steps.volume(step);
        })) {}
  Ahead(const Ahead&) = delete;
  Ahead& operator=(const Ahead&) = delete;
  ~Ahead() { stop_.request_stop(); }

  [[nodiscard]] std::size_t step() const { return step_; }
  [[nodiscard]] bool is_done() const {
    return !volume_.valid() || volume_.wait_for(std::chrono::seconds(0)) == std::future_status::ready;
  }

  // Waits for it. Called once.
  [[nodiscard]] Result<std::shared_ptr<const format::Volume>> volume() { return volume_.get(); }

 private:
  std::size_t step_;
  std::stop_source stop_;
  std::future<Result<std::shared_ptr<const format::Volume>>> volume_;
};

Session::Session() = default;
Session::~Session() = default;

Result<std::unique_ptr<Session>> Session::open(const std::string& path, const std::string& scene_path,
                                               const ViewSettings& settings) {
  std::unique_ptr<Session> session(new Session);
  session->path_ = path;
  session->settings = settings;
  SPLATVOL_TRY_ASSIGN(steps, format::Steps::open(path, open_file_or_url));
  session->step_ = steps.last();
  session->steps_ = std::move(steps);
  if (scene_path.empty()) {
    SPLATVOL_TRY_ASSIGN(volume, session->steps_->volume(session->step_));
    SPLATVOL_TRY_ASSIGN(scene, default_scene(*volume, ""));
    session->scene = std::move(scene);
    session->fits_ = true;
  } else {
    SPLATVOL_TRY_ASSIGN(scene, load_scene(scene_path));
    session->scene = std::move(scene);
  }
  session->first_scene_ = session->scene;
  SPLATVOL_TRY(session->open_streamer());
  return session;
}

Status Session::open_streamer() {
  frame_ = nullptr;
  streamer_.reset();  // frees its memory before the next one takes some
  ahead_.reset();
  SPLATVOL_TRY_ASSIGN(volume, steps_->volume(step_));
  SPLATVOL_TRY_ASSIGN(streamer, Streamer::open(std::move(volume), {settings.memory, scene.attribute, settings.kernel,
                                                                   scene.lighting.has_value()}));
  streamer_ = std::move(streamer);
  if (!renderer_ || used_settings_.kernel != settings.kernel) {
    SPLATVOL_TRY_ASSIGN(renderer,
                        make_rasterizer(settings.device, {.kernel = settings.kernel,
                                                          .gpu_bytes = settings.gpu_memory,
                                                          .in_current_context = settings.in_current_context}));
    renderer_ = std::move(renderer);
    can_mix_ = renderer_->set_compositing(Compositing::slabs).has_value();
    most_splats_ = std::numeric_limits<std::uint64_t>::max();
  }
  SPLATVOL_TRY(use_step());
  renderer_->set_lighting(scene.lighting);
  used_settings_ = settings;
  used_scene_ = scene;
  troubles_.clear();
  return bounds_.low.x <= bounds_.high.x ? Status{} : find_bounds();
}

// Takes over what depends on the step: units and histogram.
Status Session::use_step() {
  settled_ = false;
  sharpening_.reset();
  SPLATVOL_TRY_ASSIGN(histograms, streamer_->volume().read_histograms());
  const auto index = static_cast<std::size_t>(info().find_attribute(scene.attribute));
  histogram_ = histograms.empty() ? decltype(histogram_){} : histograms[index];
  return renderer_->set_transfer_function(scene.transfer_function, streamer_->units());
}

// Finds a box round the coarsest splats. sqrt(3) deviations each way are exact for a splat that is a uniform box.
Status Session::find_bounds() {
  Camera camera = scene.camera;
  camera.position = info().cube.origin + 4 * info().cube.edge;
  camera.focal_point = info().cube.origin + 0.5 * info().cube.edge;
  camera.up = {0, 1, 0};
  SPLATVOL_TRY_ASSIGN(view, make_view(camera, 64, 64));
  TransferFunction all;
  all.colors = {{0, dvec3(1)}};
  all.densities = {{0, 1}};
  DetailOptions detail;
  detail.resolution = 0;
  SPLATVOL_TRY_ASSIGN(frame, streamer_->request(view, all, detail));
  const double length = streamer_->units().length;
  for (const DrawRange& range : frame->list.ranges) {
    const dvec3& origin = range.row.shapes->blocks()[range.block].origin;
    for (std::uint32_t i = range.begin; i < range.begin + range.count; ++i) {
      const auto [center, half] = extent_of(range.row, i);
      bounds_.include({origin + length * (center - half), origin + length * (center + half)});
    }
  }
  return {};
}

const format::Attribute& Session::attribute() const {
  return info().attributes[static_cast<std::size_t>(info().find_attribute(used_scene_.attribute))];
}

Status Session::show_attribute(const std::string& name) {
  SPLATVOL_TRY_ASSIGN(fitting, default_scene(streamer_->volume(), name, {512, 512, scene.background}));
  scene.attribute = name;
  scene.transfer_function = fitting.transfer_function;
  return {};
}

Status Session::show_step(std::size_t step) {
  if (times().empty() || step >= times().size())
    return fail(ErrorCode::invalid_argument, "{}: no step {}", path_, step);
  frame_ = nullptr;
  Status changed = change_step(step);
  if (!changed) {
    SPLATVOL_TRY(open_streamer());
    return changed;
  }
  step_ = step;
  still_seconds_ = awaited_seconds_ = 0;
  awaits_step_ = true;
  SPLATVOL_TRY(use_step());
  if (!steps_->are_files()) return {};
  bounds_ = Box();  // another mesh
  return find_bounds();
}

Status Session::change_step(std::size_t step) {
  if (!steps_->are_files()) return streamer_->set_step(step);
  const bool is_ahead = ahead_ && ahead_->step() == step;
  auto volume = is_ahead ? ahead_->volume() : steps_->volume(step);
  ahead_.reset();
  if (!volume) return tl::unexpected(volume.error());
  return streamer_->set_step(std::move(*volume));
}

void Session::read_ahead(std::size_t step) {
  if (step >= times().size() || step == step_) return;
  if (!steps_->are_files()) return streamer_->prefetch_step(step);
  if (ahead_ && ahead_->step() == step) return;
  // Only its preamble: another mesh has other parts in view.
  ahead_ = std::make_unique<Ahead>(*steps_, step);
}

bool Session::is_reading_ahead() const { return (ahead_ && !ahead_->is_done()) || streamer_->is_prefetching(); }

// Passes changes on to streamer and renderer. A change of the picture starts again from a coarse one.
Status Session::apply(const View& view) {
  const bool other_file = settings.memory != used_settings_.memory || settings.kernel != used_settings_.kernel ||
                          scene.attribute != used_scene_.attribute ||
                          (scene.lighting && !used_scene_.lighting && settings.kernel == KernelKind::octant);
  if (other_file) {
    const ViewSettings before = used_settings_;
    const Scene scene_before = used_scene_;
    Status opened = open_streamer();
    if (!opened) {
      // Perhaps memory is too small: go on with the settings of before.
      settings = before;
      scene = scene_before;
      SPLATVOL_TRY(open_streamer());
      troubles_.push_back(opened.error().message);
    }
  }
  const bool other_function = scene.transfer_function != used_scene_.transfer_function;
  if (other_function) SPLATVOL_TRY(renderer_->set_transfer_function(scene.transfer_function, streamer_->units()));
  if (scene.lighting != used_scene_.lighting) renderer_->set_lighting(scene.lighting);
  const bool other_size = view.width != view_.width || view.height != view_.height;
  if (other_file || other_function || other_size || scene.camera != used_scene_.camera ||
      scene.lighting != used_scene_.lighting || scene.clip_box != used_scene_.clip_box ||
      settings.tolerance != used_settings_.tolerance || settings.max_error != used_settings_.max_error ||
      settings.mixes != used_settings_.mixes) {
    still_seconds_ = 0;
    settled_ = false;
    sharpening_.reset();
  }
  used_scene_ = scene;
  used_settings_ = settings;
  view_ = view;
  return {};
}

// Fits the first scene's camera to the first picture, whose size was not known when the file was opened.
Status Session::fit_camera(int width, int height) {
  if (!fits_) return {};
  fits_ = false;
  if (scene.camera != first_scene_.camera) return {};
  SPLATVOL_TRY_ASSIGN(fitted, default_scene(streamer_->volume(), first_scene_.attribute, {width, height}));
  scene.camera = first_scene_.camera = fitted.camera;
  return {};
}

// Gives the frame's splats to the renderer. False if the device has no room for them: the next call asks for fewer.
Result<bool> Session::set_splats(std::uint64_t splats) {
  const Status set = renderer_->set_draw_list(frame_->list);
  if (set) return true;
  if (set.error().code != ErrorCode::out_of_budget || most_splats_ <= 1) return tl::unexpected(set.error());
  most_splats_ = std::max<std::uint64_t>(splats / 8 * 7, 1);
  return false;
}

Status Session::draw(int width, int height, double seconds) {
  Status drawn = draw_next(width, height, seconds);
  if (!drawn) settled_ = true;  // only a change helps, and it begins anew
  return drawn;
}

Status Session::draw_next(int width, int height, double seconds) {
  SPLATVOL_TRY(fit_camera(width, height));
  scene.width = width;
  scene.height = height;
  SPLATVOL_TRY_ASSIGN(view, make_view(scene));
  still_seconds_ += seconds;
  SPLATVOL_TRY(apply(view));
  if (settled_) return {};

  const bool moves = settings.hurries && still_seconds_ < pause_seconds;
  if (!moves && !sharpening_) begin_rest();
  const DetailOptions detail = next_detail(width, height, moves);
  const double change = moves ? 1 : std::min(1.0, std::max(seconds, 0.01) / fade_seconds);
  const auto start = std::chrono::steady_clock::now();
  frame_ = nullptr;  // a call that fails leaves no frame
  SPLATVOL_TRY_ASSIGN(
      frame, streamer_->advance(view, scene.transfer_function, detail, awaits_step_ ? step_wait_seconds : 0, change));
  frame_ = frame;
  for (const Error& error : frame->progress.errors) troubles_.push_back(error.message);
  awaited_seconds_ += seconds;
  awaits_step_ = awaits_step_ && !frame->progress.settled && awaited_seconds_ < longest_wait_seconds;
  if (awaits_step_) return {};  // the picture stays
  SPLATVOL_TRY_ASSIGN(fits, set_splats(frame->splats));
  if (!fits) return {};
  // Slabs take several times as long: a hand that turns the data gets more splats instead.
  const bool mixes =
      !moves && can_mix_ && settings.mixes && settings.sort == SortMode::exact && is_worth_mixing(view, frame->splats);
  const Compositing compositing = mixes ? Compositing::slabs : Compositing::splats;
  SPLATVOL_TRY(renderer_->set_compositing(compositing));
  const int spacing =
      moves ? moving_sample_spacing(view, frame->splats) : automatic_sample_spacing(view, frame->detail, compositing);
  SPLATVOL_TRY(renderer_->draw(view, settings.sort, spacing).map([](auto) {}));
  texture_is_old_ = true;
  draw_seconds_ = seconds_since(start);
  // Counts the splats that were allowed, not those drawn: the next finer cut may have many times as many.
  if (moves) pacer_.add(detail.goal->max_splats, draw_seconds_);
  return moves || !frame->progress.settled ? Status{} : finish_picture();
}

// Begins with a picture like the last one of the movement. Rounds its splats, which depend on the machine's load.
void Session::begin_rest() {
  Sharpening::Options options{.max_error = settings.max_error, .tolerance = settings.tolerance};
  if (!settings.tolerance && info().point_count() <= points_drawn_at_once) options.tolerance = 0;
  if (settings.hurries && frame_) options.first_splats = std::bit_floor(std::max(frame_->splats, least_first_splats));
  sharpening_.emplace(options);
}

// Returns the detail of the next picture.
DetailOptions Session::next_detail(int width, int height, bool moves) {
  DetailOptions detail = moves ? DetailOptions{} : sharpening_->detail();
  detail.device_splats = std::clamp<std::uint64_t>(renderer_->plan_picture(width, height), 1, most_splats_);
  if (moves) detail.goal = ErrorGoal{0, std::min(pacer_.splats(), detail.device_splats)};
  return detail;
}

// Goes on to a finer picture, unless this one is the last.
Status Session::finish_picture() {
  SPLATVOL_TRY(sharpening_->add(*frame_, *renderer_));
  settled_ = sharpening_->is_done();
  if (settled_) read_ahead(step_ + 1);
  return {};
}

Result<ShownPicture> Session::shown_picture() {
  if (const auto* gl = dynamic_cast<const GlRasterizer*>(renderer_.get())) return ShownPicture{gl->texture(), false};
  if (const auto* tiles = dynamic_cast<const TileRasterizer*>(renderer_.get()); tiles && texture_is_old_) {
    SPLATVOL_TRY(texture_.upload(tiles->image()));
    texture_is_old_ = false;
  }
  return ShownPicture{texture_.name(), true};
}

Result<Image> Session::page(const PageText& text, bool transparent) const {
  SPLATVOL_TRY_ASSIGN(image, renderer_->read_image());
  const dvec3 ink = ink_on(used_scene_.background);
  if (used_scene_.outline) draw_outline(image, view_, bounds_, transparent ? ink_on_any() : ink);
  SPLATVOL_TRY_ASSIGN(page, lay_out_round(image.width, image.height, text, used_scene_.transfer_function));
  return compose_page(page, std::move(image), text, used_scene_.transfer_function, ink, transparent);
}

std::string Session::explain() const {
  if (!frame_) return {};
  const auto sentence = [](const EmptyReason& why, const std::string& remedy) {
    std::string text = fmt::format("{}: {}.", why.reason, remedy);
    text[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(text[0])));
    return text;
  };
  if (const EmptyReason why = why_empty(view_, used_scene_.transfer_function, attribute(), bounds_)) {
    const bool outside = std::string_view(why.reason).ends_with("outside of the view");
    return sentence(why, outside ? "press R to see all of it" : why.remedy);
  }
  if (frame_->splats > 0 || !frame_->progress.settled) return {};
  const EmptyReason why = why_empty_in_view(false);
  return sentence(why, why.remedy);
}

}  // namespace splatvol
