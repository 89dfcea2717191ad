#include "player/player.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <tuple>
#include <utility>

#include "base/addresses.h"
#include "base/clock.h"
#include "base/interruption.h"
#include "player/choice.h"
#include "player/sampling.h"
#include "player/scene_surfaces.h"
#include "renderer/depth_pyramid.h"
#include "renderer/slice_values.h"
#include "streamer/cells/file_cells.h"
#include "streamer/splats/domain.h"

namespace splatvol {
namespace {

Status check_time(double seconds) {
  if (seconds > 0 && std::isfinite(seconds)) return {};
  return fail(ErrorCode::invalid_argument, "{} seconds are no time to draw in", seconds);
}

// The part of draw_within's time that the drawing of splats may take. The rest is for choosing them.
constexpr double drawing_share = 0.7;

// With surfaces or slices, a picture in a time has at least so many splats. Fewer are no faster: each is larger, and
// surfaces are compared with each of its pixels.
constexpr std::uint64_t least_among_surfaces = std::uint64_t{1} << 15;

// Expected of splats where the scene shows contours: they have none.
constexpr double error_without_contours = 0.05;

Status set_function(Rasterizer& rasterizer, const Scene& scene, const Streamer& streamer) {
  const Status set = rasterizer.set_transfer_function(transfer_of(scene), streamer.units());
  return set ? set : Status(fail_in(streamer.volume().name(), set.error()));
}

tl::unexpected<Error> fail_two_surfaces() {
  return fail(ErrorCode::invalid_argument,
              "depths of surfaces, and a scene that shows surfaces or slices: give one of them");
}

// Rays that measure an error meet about as many cells as a picture does. Two cores need a tenth of a second for 2^21.
constexpr std::uint64_t most_tetrahedra_for_rays = std::uint64_t{1} << 21;

Detail detail_of(const Rung& rung) { return {.goal = ErrorGoal{0, rung.splats}}; }

Detail detail_of(const ErrorControl::Request& request, std::uint32_t resolutions) {
  Detail detail;
  if (request.coarser > 0)
    detail.resolution = std::max<std::size_t>(resolutions, request.coarser + 1) - 1 - request.coarser;
  else
    detail.goal = request.goal;
  return detail;
}

// What cannot be read is left out: whoever shows the step meets the error.
StepCells read_cells(const format::Steps& steps, std::size_t step, const Scene& scene, const PartRoom& room) {
  const auto volume = steps.volume(step);
  if (!volume || (*volume)->is_far()) return {};
  const auto kept = KeptCells::open(**volume, scene, room);
  if (!kept) return {};
  static_cast<void>((*kept)->hold_all());
  return {*volume, *kept};
}

// The layers of a picture at the pixels of its rays, whose view this is.
std::vector<SurfaceLayer> layers_at_rays(const std::vector<CellLayer>& layers, const View& view,
                                         const std::vector<std::size_t>& pixels) {
  std::vector<SurfaceLayer> all;
  for (const CellLayer& layer : layers) {
    SurfaceLayer& of_rays =
        all.emplace_back(SurfaceLayer{{view.width, view.height, {}}, {view.width, view.height, {}}});
    for (const std::size_t pixel : pixels) {
      of_rays.depths.depths.push_back(layer.depths->depths[pixel]);
      if (layer.light) of_rays.light.pixels.push_back(layer.light->pixels[pixel]);
    }
  }
  return all;
}

}  // namespace

// A public call: what it reads can be cancelled. Calls within it are parts of it.
class Player::Call {
 public:
  explicit Call(Player& player) : player_(player), interruptible_(begin(player)) {}
  Call(const Call&) = delete;
  Call& operator=(const Call&) = delete;
  ~Call() { --player_.calls_; }

  [[nodiscard]] Status check() const {
    if (!is_interrupted()) return {};
    return fail(ErrorCode::cancelled, "{}: cancelled", player_.steps_.name());
  }

 private:
  static std::stop_token begin(Player& player) {
    const std::scoped_lock lock(player.stop_mutex_);
    if (player.calls_++ == 0) player.stop_ = std::stop_source();
    return player.stop_.get_token();
  }

  Player& player_;
  Interruptible interruptible_;
};

Player::Player(format::Steps steps, std::size_t step) : steps_(std::move(steps)), step_(step) {}

Player::~Player() = default;

Result<std::unique_ptr<Player>> Player::open(const std::string& path, const std::optional<Scene>& scene,
                                             const PlayerOptions& options) {
  SPLATVOL_TRY_ASSIGN(steps, format::Steps::open(path, open_file_or_url));
  const std::size_t last = steps.last();
  return open(std::move(steps), last, scene, options);
}

Result<std::unique_ptr<Player>> Player::open(format::Steps steps, std::size_t step, const std::optional<Scene>& scene,
                                             const PlayerOptions& options) {
  SPLATVOL_TRY_ASSIGN(file, read(std::move(steps), step, scene, options, {}));
  return open(std::move(file));
}

Result<std::unique_ptr<Player>> Player::open(PlayerFile file) {
  std::unique_ptr<Player> player(new Player(file.steps, file.step));
  SPLATVOL_TRY(player->replace(std::move(file)));
  return player;
}

Result<PlayerFile> Player::read(format::Steps steps, std::size_t step, const std::optional<Scene>& scene,
                                const PlayerOptions& options, const Held& held) {
  if (scene) SPLATVOL_TRY(make_view(*scene));
  SPLATVOL_TRY_ASSIGN(volume,
                      held.volume ? Result<std::shared_ptr<const format::Volume>>(held.volume) : steps.volume(step));
  SPLATVOL_TRY_ASSIGN(used, scene ? Result<Scene>(*scene) : default_scene(*volume, "", options.first_picture));
  auto memory = held.memory
                    ? held.memory
                    : std::make_shared<PlayerMemory>(options.memory, *volume, !steps.times().empty(), options.draws);
  SPLATVOL_TRY_ASSIGN(surfaces, read_scene_surfaces(used.surfaces, *volume, options.read_surface,
                                                    memory->patches.capacity(), held.surfaces));
  SPLATVOL_TRY_ASSIGN(
      streamer,
      Streamer::open(std::move(volume), {.attribute = used.attribute,
                                         .kernel = kernel_of(options.drawing),
                                         .gradients = used.lighting.has_value(),
                                         .on_data = options.on_data,
                                         .opacity_attribute = opacity_attribute_of(used),
                                         .room = held.room ? *held.room : room_in(memory->table, memory->splats)}));
  return PlayerFile{std::move(steps),   step, std::move(used), options, std::move(memory), std::move(streamer),
                    std::move(surfaces)};
}

Result<Scene> Player::fitting_scene(const std::string& attribute, const FirstPicture& picture) const {
  return default_scene(streamer_->volume(), attribute, picture);
}

Status Player::set_scene(const Scene& scene) { return use(scene, options_); }

Status Player::set_drawing(const Drawing& drawing) {
  if (drawing == options_.drawing) return {};
  PlayerOptions options = options_;
  options.drawing = drawing;
  return use(scene_, options);
}

Player::Reader Player::reader(const Scene& scene, const PlayerOptions& options,
                              std::optional<std::size_t> asked_step) const {
  const std::size_t step = asked_step.value_or(step_);
  const bool other_parts =
      step != step_ || options.memory != options_.memory || kernel_of(options.drawing) != kernel_of(options_.drawing) ||
      scene.attribute != scene_.attribute || opacity_attribute_of(scene) != opacity_attribute_of(scene_) ||
      (scene.lighting && !scene_.lighting && kernel_of(options.drawing) == KernelKind::octant);
  if (other_parts) {
    Held held{step == step_ ? surfaces_ : surfaces_of_all_steps()};
    if (options.memory == options_.memory) held.memory = memory_;
    if (step == step_ && !is_lost_) held.volume = streamer_->shared_volume();
    if (held.memory && (held.volume || !steps_.are_files())) held.room = streamer_->room();
    return [=, steps = steps_, held = std::move(held)] { return read(steps, step, scene, options, held); };
  }
  if (scene.surfaces == scene_.surfaces) return {};
  return [=, steps = steps_, memory = memory_, before = surfaces_]() -> Result<PlayerFile> {
    SPLATVOL_TRY_ASSIGN(volume, steps.volume(step));
    SPLATVOL_TRY_ASSIGN(surfaces, read_scene_surfaces(scene.surfaces, *volume, options.read_surface,
                                                      memory->patches.capacity(), before));
    return PlayerFile{steps, step, scene, options, memory, nullptr, std::move(surfaces)};
  };
}

// Depths of another program, and surfaces or slices of the scene: only one of them.
Status Player::check_surfaces(const Scene& scene, const View& view) const {
  if (!surface_depths_) return {};
  if (!view.slices.empty() || std::ranges::any_of(scene.surfaces, &SceneSurface::shown)) return fail_two_surfaces();
  return {};
}

Status Player::use(const Scene& scene, const PlayerOptions& options) {
  SPLATVOL_TRY_ASSIGN(view, make_view(scene));
  SPLATVOL_TRY(check_surfaces(scene, view));
  const Reader reader = this->reader(scene, options);
  if (!reader) return take_over(scene, options, nullptr, memory_, view);
  SPLATVOL_TRY_ASSIGN(file, reader());
  return replace(std::move(file));
}

Status Player::replace(PlayerFile file) {
  SPLATVOL_TRY_ASSIGN(view, make_view(file.scene));
  SPLATVOL_TRY(check_surfaces(file.scene, view));
  const bool is_read = file.streamer != nullptr;
  SPLATVOL_TRY(take_over(file.scene, file.options, std::move(file.streamer), file.memory, view));
  if (is_read) step_ = file.step;
  take_surfaces(std::move(file.surfaces));
  return {};
}

// Patches have their share while there are some.
void Player::take_surfaces(std::vector<Surface> surfaces) {
  const auto is_same = [](const Surface& a, const Surface& b) { return a.style == b.style && a.mesh == b.mesh; };
  if (!std::ranges::equal(surfaces_, surfaces, is_same)) surfaces_view_.reset();
  surfaces_ = std::move(surfaces);
  const auto is_patch = [](const Surface& surface) { return surface.mesh && !surface.style.boundary.empty(); };
  patches_room_ = {};
  if (std::ranges::none_of(surfaces_, is_patch)) return;
  if (auto room = memory_->patches.reserve(memory_->patches.capacity())) patches_room_ = std::move(*room);
}

// Takes over a scene, options and a streamer that fits both, in its memory; null: the streamer stays. Surfaces stay.
Status Player::take_over(const Scene& scene, const PlayerOptions& options, std::unique_ptr<Streamer> streamer,
                         const std::shared_ptr<PlayerMemory>& memory, const View& view) {
  std::unique_ptr<Rasterizer> other;
  if (!rasterizer_ || kernel_of(options.drawing) != kernel_of(options_.drawing)) {
    SPLATVOL_TRY_SET(other, make_rasterizer(options.device, {.kernel = kernel_of(options.drawing),
                                                             .gpu_bytes = options.gpu_memory,
                                                             .in_current_context = options.in_current_context}));
    SPLATVOL_TRY(other->set_surface_depths(surface_depths_));
  }
  Rasterizer& rasterizer = other ? *other : *rasterizer_;
  if (streamer || scene.transfer_function != scene_.transfer_function || scene.opacity != scene_.opacity)
    SPLATVOL_TRY(set_function(rasterizer, scene, streamer ? *streamer : *streamer_));
  rasterizer.set_lighting(scene.lighting);
  if (streamer) {
    frame_ = nullptr;
    is_lost_ = false;
    drop_cells();
    cells_ahead_.reset();
    sweep_room_ = {};
    patches_room_ = {};
    streamer_ = std::move(streamer);
    memory_ = memory;
  }
  if (other) {
    rasterizer_ = std::move(other);
    room_ = std::numeric_limits<std::uint64_t>::max();
  }
  scene_ = scene;
  options_ = options;
  view_ = view;
  is_nudged_ = false;
  return {};
}

// Opens a step as if none were open.
Status Player::open_again(std::size_t step) {
  SPLATVOL_TRY_ASSIGN(file, read(steps_, step, scene_, options_, {surfaces_of_all_steps(), memory_}));
  return replace(std::move(file));
}

std::optional<Error> Player::left_out() const { return left_out_error(surfaces_, steps_.name()); }

bool Player::shows_surfaces() const {
  return !view_.slices.empty() || std::ranges::any_of(surfaces_, &Surface::is_visible);
}

Status Player::set_surface_depths(std::shared_ptr<const SurfaceDepths> depths) {
  if (depths && shows_surfaces()) return fail_two_surfaces();
  SPLATVOL_TRY(rasterizer_->set_surface_depths(depths));
  surface_depths_ = std::move(depths);
  return {};
}

Status Player::show_step(std::size_t step) {
  if (steps_.times().empty() || step >= steps_.times().size())
    return fail(ErrorCode::invalid_argument, "{}: no step {}", steps_.name(), step);
  frame_ = nullptr;
  if (is_lost_) return open_again(step);
  Status changed = change_step(step);
  if (!changed) {
    if (is_lost_) static_cast<void>(open_again(step_));
    return changed;
  }
  step_ = step;
  return set_function(*rasterizer_, scene_, *streamer_);
}

// If a file cannot be opened, all stays as it was. If the streamer cannot change, the step is lost.
Status Player::change_step(std::size_t step) {
  const Call call(*this);
  std::shared_ptr<const format::Volume> volume;
  if (steps_.are_files()) {
    const bool is_ahead = ahead_ && ahead_->step() == step;
    auto opened = is_ahead ? ahead_->take() : steps_.volume(step);
    ahead_.reset();
    SPLATVOL_TRY_SET(volume, std::move(opened));
    SPLATVOL_TRY(read_boundary_of(*volume));
  }
  is_lost_ = true;
  drop_cells();
  SPLATVOL_TRY(volume ? streamer_->set_step(std::move(volume)) : streamer_->set_step(step));
  is_lost_ = false;
  if (const auto ahead = std::move(cells_ahead_); ahead && ahead->step() == step) {
    ahead->stop();
    auto [of, kept] = ahead->take();
    kept_volume_ = std::move(of), kept_cells_ = std::move(kept);
  }
  return {};
}

void Player::drop_cells() {
  cells_.reset();
  kept_cells_.reset();
  kept_volume_.reset();
}

// The files of a series have boundaries of their own.
std::vector<Surface> Player::surfaces_of_all_steps() const {
  if (!steps_.are_files()) return surfaces_;
  std::vector<Surface> of_files;
  std::ranges::copy_if(surfaces_, std::back_inserter(of_files),
                       [](const Surface& surface) { return surface.style.boundary.empty(); });
  return of_files;
}

Status Player::read_boundary_of(const format::Volume& volume) {
  const std::vector<Surface> kept = surfaces_of_all_steps();
  if (kept.size() == surfaces_.size()) return {};
  SPLATVOL_TRY_ASSIGN(
      read, read_scene_surfaces(scene_.surfaces, volume, options_.read_surface, memory_->patches.capacity(), kept));
  take_surfaces(std::move(read));
  return {};
}

void Player::read_ahead(std::size_t step, bool with_cells) {
  if (step >= steps_.times().size() || step == step_) return;
  const bool are_ahead = cells_ahead_ && cells_ahead_->step() == step;
  if (with_cells && !are_ahead && has_cells() && !streamer_->volume().is_far()) {
    cells_ahead_.reset();
    const bool is_other = kept_cells_ && &kept_cells_->share() == &memory_->next_cells;
    MemoryShare& share = is_other ? memory_->cells : memory_->next_cells;
    const PartRoom room = steps_.are_files() ? room_in(memory_->table, share) : streamer_->room().in(share);
    cells_ahead_share_ = &share;
    cells_ahead_ = std::make_unique<StepAhead<StepCells>>(
        step, [steps = steps_, step, scene = scene_, room] { return read_cells(steps, step, scene, room); });
  }
  if (!steps_.are_files()) return streamer_->prefetch_step(step);
  if (ahead_ && ahead_->step() == step) return;
  // Only its preamble: another mesh has other parts in view.
  ahead_ = std::make_unique<VolumeAhead>(step, [steps = steps_, step] { return steps.volume(step); });
}

bool Player::is_reading_ahead() const {
  return (ahead_ && !ahead_->is_done()) || (cells_ahead_ && !cells_ahead_->is_done()) || streamer_->is_prefetching();
}

std::uint64_t Player::device_splats() const {
  return std::min(rasterizer_->plan_picture(scene_.width, scene_.height), room_);
}

View Player::view_now() const {
  View view = view_;
  const double distance = glm::length(scene_.camera.focal_point - scene_.camera.position);
  if (is_nudged_) view.eye += 1e-9 * distance * view.right;
  return view;
}

Status Player::choose(const FrameRequest& request) {
  const Call call(*this);
  const auto start = Clock::now();
  frame_ = nullptr;
  if (is_lost_) return fail(ErrorCode::io, "{}: could not be opened again", steps_.name());
  request_ = request;
  Detail detail = request.detail;
  detail.device_splats = std::min(detail.device_splats, device_splats());
  if (detail.device_splats == 0)
    return fail(ErrorCode::out_of_budget, "{} bytes of GPU memory are too few for a picture of {} x {} pixels",
                options_.gpu_memory, scene_.width, scene_.height);
  auto chosen = request.wait_seconds
                    ? streamer_->advance(view_now(), transfer_of(scene_), detail, *request.wait_seconds)
                    : streamer_->request(view_now(), transfer_of(scene_), detail);
  SPLATVOL_TRY(call.check());
  if (!chosen) return tl::unexpected(chosen.error());
  frame_ = *chosen;
  const StreamerStatistics statistics = streamer_->statistics();
  times_ = {statistics.cut_seconds, statistics.fetch_seconds, {}, seconds_since(start)};
  return {};
}

// Gives the chosen splats to the device. While it has no room for them, chooses fewer.
Status Player::set_draw_list() {
  for (std::uint64_t before = std::numeric_limits<std::uint64_t>::max();;) {
    Status set = rasterizer_->set_draw_list(frame_->list);
    if (set) return {};
    if (set.error().code != ErrorCode::out_of_budget || frame_->splats >= before) return set;
    before = frame_->splats;
    room_ = std::max<std::uint64_t>(std::min(device_splats(), frame_->splats) / 8 * 7, 1);
    SPLATVOL_TRY(choose(request_));
  }
}

Status Player::draw(const DrawOptions& options) {
  if (!frame_) return fail(ErrorCode::invalid_argument, "{}: no splats are chosen to be drawn", steps_.name());
  draw_options_ = options;
  if (shows_contours()) return fail_without_contours();
  const auto start = Clock::now();
  const double chosen_in = times_.frame;
  exact_.reset();
  SPLATVOL_TRY(set_draw_list());
  const double set_seconds = seconds_since(start);
  const View view = view_now();
  sort_ = sort_of(options_.drawing);
  sample_spacing_ = options.sample_spacing > 0
                        ? options.sample_spacing
                        : options_.drawing.sample_spacing.value_or(automatic_sample_spacing(view, frame_->detail));
  SPLATVOL_TRY_ASSIGN(times, shows_surfaces() ? draw_with_surfaces(view) : draw_volume(view));
  times.upload += set_seconds;
  times_.draw = times;
  times_.frame = chosen_in + seconds_since(start);
  return {};
}

// Nothing that the scene shows is missing in silence.
Status Player::fail_without_contours() const {
  if (has_cells())
    return fail(ErrorCode::invalid_argument,
                "{}: splats have no contours: draw it exactly, with no option for splats, OpenGL or frames on the way",
                steps_.name());
  return fail(ErrorCode::invalid_argument,
              "{}: it keeps no cells, and only these have contours: build it from a mesh, or from points by "
              "--connectivity delaunay, without --drop-cells, or show an isovalue",
              steps_.name());
}

Result<FrameTimes> Player::draw_volume(const View& view) {
  picture_.reset();
  if (surface_depths_) sample_spacing_ = 1;
  return rasterizer_->draw(view, sort_, sample_spacing_);
}

// Finds the layers of surfaces, and of slices unless cells have their values.
void Player::lay_surfaces(const View& view, bool has_slices) {
  if (has_slices && !view.slices.empty()) {
    surface_layers_ = draw_surfaces(surfaces_, draw_slices(view), view);
    surfaces_view_.reset();
  } else if (surfaces_view_ != view) {
    surface_layers_ = draw_surfaces(surfaces_, {}, view);
    surfaces_view_ = view;
  }
}

// Draws the volume in front of each layer of surfaces, and joins all.
Result<FrameTimes> Player::draw_with_surfaces(const View& view) {
  const auto start = Clock::now();
  double volume_seconds = 0;
  lay_surfaces(view, true);
  times_.surfaces = seconds_since(start);
  if (surface_layers_.layers.empty()) return draw_volume(view);
  picture_.reset();
  FrameTimes sum;
  SurfaceComposite composite;
  const Status drawn = [&]() -> Status {
    for (const SurfaceLayer& layer : surface_layers_.layers) {
      // The layer outlives the drawing: it need not be shared.
      SPLATVOL_TRY(rasterizer_->set_surface_depths({std::shared_ptr<void>(), &layer.depths}));
      sample_spacing_ = 1;
      const auto volume_start = Clock::now();
      SPLATVOL_TRY_ASSIGN(times, rasterizer_->draw(view, sort_, sample_spacing_));
      volume_seconds += seconds_since(volume_start);
      SPLATVOL_TRY_ASSIGN(volume, rasterizer_->read_image());
      composite.add(volume, layer);
      sum.sort += times.sort, sum.upload += times.upload, sum.draw += times.draw;
      sum.fragments += times.fragments;
    }
    return {};
  }();
  SPLATVOL_TRY(rasterizer_->set_surface_depths(nullptr));
  if (!drawn) return tl::unexpected(drawn.error());
  picture_ = composite.finish();
  times_.surfaces = seconds_since(start) - volume_seconds;
  return sum;
}

// The values on the slices, as the chosen splats have them.
std::vector<SlicePicture> Player::draw_slices(const View& view) const {
  std::vector<SlicePicture> pictures;
  for (const Slice& slice : view.slices) {
    std::vector<double> depths = slice_depths(view, slice.plane);
    if (std::ranges::none_of(depths, [](double depth) { return std::isfinite(depth); })) continue;
    const auto values = slice_values(frame_->sliced, streamer_->units(), view, slice.plane, depths);
    pictures.push_back(color_slice(view, slice, std::move(depths), values, scene_.transfer_function));
  }
  return pictures;
}

bool Player::has_cells() const { return !is_lost_ && format::CellReader::has_cells(streamer_->volume()); }

Result<std::shared_ptr<const KeptCells>> Player::kept_cells() {
  if (is_lost_) return fail(ErrorCode::io, "{}: could not be opened again", steps_.name());
  if (kept_cells_ && kept_cells_->color_attribute() != contours_of(scene_).attribute) drop_cells();
  if (!kept_cells_) {
    kept_volume_ = streamer_->shared_volume();
    const bool is_taken = cells_ahead_ && cells_ahead_share_ == &memory_->cells;
    MemoryShare& share = is_taken ? memory_->next_cells : memory_->cells;
    SPLATVOL_TRY_SET(kept_cells_, KeptCells::open(*kept_volume_, scene_, streamer_->room().in(share)));
  }
  return kept_cells_;
}

Status Player::hold_cells() {
  const Call call(*this);
  SPLATVOL_TRY_ASSIGN(kept, kept_cells());
  return kept->hold_all();
}

std::function<Status()> Player::cells_reader() {
  if (!has_cells() || streamer_->volume().is_far() || holds_cells()) return {};
  const auto kept = kept_cells();
  if (!kept || !(*kept)->may_hold_all()) return {};
  return [memory = memory_, volume = kept_volume_, cells = *kept] { return cells->hold_all(); };
}

bool Player::holds_cells() const {
  return kept_cells_ && kept_cells_->are_held() && kept_cells_->color_attribute() == contours_of(scene_).attribute;
}

// The cells in the view.
Result<std::shared_ptr<const FileCells>> Player::open_cells() {
  SPLATVOL_TRY(kept_cells());
  // An estimate and the pictures of a view at rest read the entries of chunks once.
  if (!cells_ || !cells_->are_of(kept_cells_, scene_, view_))
    SPLATVOL_TRY_SET(cells_, FileCells::open(kept_cells_, scene_, view_));
  return cells_;
}

Result<ExactPicture> Player::estimate_exact() {
  const Call call(*this);
  SPLATVOL_TRY_ASSIGN(cells, open_cells());
  SPLATVOL_TRY_ASSIGN(segments, cells->estimate_segments());
  return ExactPicture{static_cast<std::uint64_t>(segments), cells->chunks().size(), cells->tetrahedra(),
                      cells->unknown_cells(), segment_work(count_pieces(scene_.transfer_function))};
}

// Contours and slices have sharp edges, where wide samples show steps.
float Player::refined_difference() const {
  constexpr float visible = 0.1F;
  return shows_contours() || !view_.slices.empty() ? visible : 0;
}

// What waits while cells are drawn has its share from the first time on: the memory stays between pictures.
std::uint64_t Player::sweep_memory() {
  if (sweep_room_.bytes() == 0)
    if (auto room = memory_->sweep.reserve(memory_->sweep.capacity())) sweep_room_ = std::move(*room);
  return sweep_room_.bytes();
}

Status Player::draw_exact(const std::function<void(double)>& progress, int sample_spacing) {
  const Call call(*this);
  exact_.reset();
  const auto start = Clock::now();
  SPLATVOL_TRY_ASSIGN(cells, open_cells());
  times_ = {seconds_since(start), 0, {}, 0, 0};

  const auto surfaces_start = Clock::now();
  SPLATVOL_TRY_ASSIGN(layers, lay_cells());
  times_.surfaces = seconds_since(surfaces_start);

  const auto draw_start = Clock::now();
  const int spacing = sample_spacing > 0 ? sample_spacing : options_.drawing.sample_spacing.value_or(1);
  sample_spacing_ = layers.empty() ? spacing : 1;
  auto drawn = cell_rasterizer_.draw(*cells,
                                     {.view = view_,
                                      .transfer = transfer_of(scene_),
                                      .lighting = scene_.lighting,
                                      .contours = contours_of(scene_),
                                      .layers = std::move(layers),
                                      .sample_spacing = sample_spacing_,
                                      .refined_difference = refined_difference(),
                                      .memory = sweep_memory(),
                                      .progress = progress},
                                     std::exchange(spare_picture_, {}));
  SPLATVOL_TRY(call.check());
  if (!drawn && drawn.error().code == ErrorCode::out_of_budget)
    return fail_in(streamer_->volume().name(), drawn.error());
  SPLATVOL_TRY_ASSIGN(picture, std::move(drawn));
  if (picture_) spare_picture_ = std::move(*picture_);
  picture_ = std::move(picture.image);
  exact_ = ExactPicture{picture.segments, cells->chunks().size(), cells->tetrahedra(), cells->unknown_cells()};
  times_.draw.draw = seconds_since(draw_start);
  times_.frame = seconds_since(start);
  return {};
}

Result<Image> Player::image() const {
  if (picture_) return *picture_;
  return rasterizer_->read_image();
}

Result<const Image*> Player::image_or_copy(Image& copy) const {
  const DevicePicture drawn = picture();
  if (const auto* held = std::get_if<const Image*>(&drawn)) return *held;
  SPLATVOL_TRY_SET(copy, image());
  return &copy;
}

Status Player::draw_frame(const FrameRequest& request, const DrawOptions& options) {
  const Call call(*this);
  SPLATVOL_TRY(choose(request));
  return draw(options);
}

Result<ChosenQuality> Player::default_quality() {
  const ChosenQuality splats{default_splats(info().point_count())};
  if (!may_draw_cells()) return splats;
  if (shows_contours()) return ChosenQuality{{.exact = true}};
  SPLATVOL_TRY_ASSIGN(estimate, estimate_exact());
  if (const double segments = estimate.counted_segments(); segments > most_exact_segments)
    return ChosenQuality{splats.quality, static_cast<std::uint64_t>(segments)};
  if (estimate.unknown_cells > 0) return splats;
  return ChosenQuality{{.exact = true}};
}

Result<DrawnPicture> Player::draw_picture(const Quality& quality, const std::function<void(double)>& progress) {
  SPLATVOL_TRY(check_quality(quality));
  const Call call(*this);
  const bool is_default = quality == Quality();
  DrawnPicture drawn{{quality}};
  if (is_default) SPLATVOL_TRY_SET(drawn.chosen, default_quality());
  if (drawn.chosen.quality.exact) {
    motion_.rest();
    SPLATVOL_TRY(draw_exact(progress));
    return drawn;
  }
  const Quality& splats = drawn.chosen.quality;
  const bool is_of_motion = splats.milliseconds && splats.max_error;
  if (!is_of_motion) motion_.rest();
  if (is_of_motion)
    SPLATVOL_TRY(draw_moving({*splats.max_error, 1e-3 * *splats.milliseconds}));
  else if (splats.milliseconds)
    SPLATVOL_TRY(draw_within(1e-3 * *splats.milliseconds));
  else if (splats.max_error)
    SPLATVOL_TRY_SET(drawn.search, draw_to_error(*splats.max_error, is_default));
  else if (is_default && options_.drawing == Drawing())
    SPLATVOL_TRY_SET(drawn.search, draw_all_points());
  else
    SPLATVOL_TRY(draw_frame({.detail = expected_detail(splats)}));
  return drawn;
}

// Draws all points, and finds out what error they have.
Result<std::optional<ErrorSearch>> Player::draw_all_points() {
  SPLATVOL_TRY_ASSIGN(rays, draw_rays());
  std::vector<Image> coarser;
  for (std::size_t before = 2; before > 0 && !rays && info().resolutions() > 2; --before) {
    SPLATVOL_TRY(draw_frame({.detail = {.resolution = info().resolutions() - 1 - before}}));
    SPLATVOL_TRY_ASSIGN(picture, image());
    coarser.push_back(std::move(picture));
  }
  SPLATVOL_TRY(draw_frame({.detail = {.tolerance_percent = 0}}));
  Image copy;
  SPLATVOL_TRY_ASSIGN(picture, image_or_copy(copy));
  ErrorSearch search;
  search.pictures = static_cast<int>(coarser.size()) + 1;
  if (rays)
    search.estimate = {.error = error_at(rays->rays, *picture), .reached = true, .measured = true};
  else if (!coarser.empty())
    search.estimate = {.error = error_of_all_points(*picture, coarser[1], coarser[0]), .reached = true};
  else
    return std::nullopt;
  search.estimate.file_error = search.estimate.error;
  return search;
}

bool Player::may_draw_cells() const {
  const bool wants_splats = options_.in_current_context || options_.device == Device::gl || options_.drawing.kernel ||
                            sort_of(options_.drawing) != SortMode::exact;
  return !wants_splats && has_cells();
}

Result<Choices> Player::choices(bool with_cells, int widest_spacing) {
  Choices choices{.points = std::clamp<std::uint64_t>(info().point_count(), 1, device_splats()),
                  .pixels = static_cast<double>(scene_.width) * scene_.height};
  choices.has_splats = !shows_contours();
  if (has_layers()) {
    choices.least_splats = least_among_surfaces;
    choices.widest_spacing = 1;
    if (choices.has_splats) return choices;
    widest_spacing = 1;
  }
  choices.finest_spacing = options_.drawing.sample_spacing.value_or(1);
  choices.widest_spacing = std::max(choices.finest_spacing, widest_spacing);
  if (!with_cells) return choices;
  SPLATVOL_TRY_ASSIGN(estimate, estimate_exact());
  if (estimate.unknown_cells == 0 || !choices.has_splats) choices.cells = estimate.counts();
  return choices;
}

Result<Choices> Player::moving_choices(bool with_cells) {
  Choices choices{.points = std::clamp<std::uint64_t>(info().point_count(), 1, device_splats()),
                  .least_splats = has_layers() ? least_among_surfaces : 1,
                  .finest_spacing = options_.drawing.sample_spacing.value_or(1),
                  .pixels = static_cast<double>(scene_.width) * scene_.height,
                  .direction = view_.forward};
  choices.widest_spacing = std::max(choices.finest_spacing, widest_moving_samples);
  if (shows_contours()) choices.added_error = error_without_contours;
  if (!with_cells || !holds_cells()) return choices;
  SPLATVOL_TRY_ASSIGN(estimate, estimate_exact());
  if (estimate.unknown_cells == 0) choices.cells = estimate.counts();
  return choices;
}

Result<std::optional<MotionControl::Outcome>> Player::try_splats(const Rung& rung) {
  constexpr double wait_seconds = 0.1;
  const Call call(*this);
  if (!exact_ || !picture_) return fail(ErrorCode::invalid_argument, "{}: no exact picture is there", steps_.name());
  // Drawing replaces what is known of the last picture.
  Image exact = *std::exchange(picture_, std::nullopt);
  const auto before = std::tuple(exact_, sample_spacing_, times_);
  const auto drawn = [&]() -> Result<std::optional<MotionControl::Outcome>> {
    SPLATVOL_TRY(choose({.detail = detail_of(rung), .wait_seconds = wait_seconds}));
    if (!frame_->progress.settled) return std::nullopt;
    const auto start = Clock::now();
    SPLATVOL_TRY(draw({.sample_spacing = rung.sample_spacing}));
    MotionControl::Outcome outcome{counted(rung), times_.draw.fragments, seconds_since(start), frame_->goal_error};
    SPLATVOL_TRY_ASSIGN(picture, image());
    SPLATVOL_TRY_ASSIGN(difference, compare_images(picture, exact));
    outcome.error = difference.rmse;
    return outcome;
  }();
  picture_ = std::move(exact);
  std::tie(exact_, sample_spacing_, times_) = before;
  return drawn;
}

Rung Player::counted(const Rung& rung) const {
  if (frame_->progress.settled) return rung;
  return {std::max<std::uint64_t>(frame_->splats, 1), rung.sample_spacing};
}

Status Player::draw_within(double seconds) {
  if (pacer_.seconds() != drawing_share * seconds) pacer_.leap();
  pacer_.set_seconds(drawing_share * seconds);
  const int widest_spacing = options_.drawing.sample_spacing.value_or(widest_samples_in_a_time);
  if (shows_contours()) SPLATVOL_TRY(hold_contours());
  SPLATVOL_TRY_ASSIGN(choices, this->choices(may_draw_cells() && (holds_cells() || shows_contours()), widest_spacing));
  const Rung rung = pacer_.next(choices);
  SPLATVOL_TRY_ASSIGN(drawn, draw_rung(rung, seconds));
  pacer_.add(drawn.rung, choices, drawn.fragments, drawn.seconds);
  return {};
}

// The first picture waits for cells, so that those after it need not read.
Status Player::draw_moving(const MotionLimits& limits) {
  motion_.set_limits(limits);
  if (may_draw_cells())
    if (const auto read = cells_reader()) SPLATVOL_TRY(read());
  if (shows_contours()) SPLATVOL_TRY(hold_contours());
  SPLATVOL_TRY_ASSIGN(choices, moving_choices(may_draw_cells()));
  if (has_layers()) choices.widest_spacing = choices.finest_spacing = 1;
  if (shows_contours()) {
    SPLATVOL_TRY_ASSIGN(estimate, estimate_exact());
    choices.cells = estimate.counts();
    choices.has_splats = false;
  } else {
    choices.most_segments = most_exact_segments;
  }
  SPLATVOL_TRY_ASSIGN(drawn, draw_rung(motion_.next(choices), limits.seconds));
  motion_.add(drawn, choices);
  return {};
}

// Only cells have contours, whatever the time: they are read before it counts, if memory has room for them.
Status Player::hold_contours() {
  if (!may_draw_cells()) return fail_without_contours();
  if (const auto read = cells_reader()) SPLATVOL_TRY(read());
  return {};
}

// Draws a rung. Splats are of parts that are there or come in time.
Result<MotionControl::Outcome> Player::draw_rung(const Rung& rung, double seconds) {
  const auto start = Clock::now();
  if (rung.is_exact()) {
    SPLATVOL_TRY(draw_exact({}, rung.sample_spacing));
    return MotionControl::Outcome{.rung = rung, .seconds = times_.frame};
  }
  FrameRequest request{.detail = detail_of(rung), .wait_seconds = 0};
  SPLATVOL_TRY(choose(request));
  if (!frame_->progress.settled) {
    const double share = std::min(1.0, static_cast<double>(frame_->splats) / static_cast<double>(rung.splats));
    request.wait_seconds = seconds - seconds_since(start) - share * drawing_share * seconds;
    if (*request.wait_seconds > 0) SPLATVOL_TRY(choose(request));
  }
  const auto draw_start = Clock::now();
  SPLATVOL_TRY(draw({.sample_spacing = rung.sample_spacing}));
  const auto model = frame_->progress.complete ? std::optional(frame_->goal_error) : std::nullopt;
  return MotionControl::Outcome{counted(rung), times_.draw.fragments, seconds_since(draw_start), model};
}

// What other programs and the scene's surfaces hide of the volume, and how. Slices are among the cells.
Result<std::vector<CellLayer>> Player::lay_cells() {
  lay_surfaces(view_, false);
  std::vector<CellLayer> layers;
  for (const SurfaceLayer& layer : surface_layers_.layers) layers.push_back({&layer.depths, &layer.light});
  if (layers.empty() && surface_depths_) {
    SPLATVOL_TRY(check_size(*surface_depths_, view_));
    layers.push_back({surface_depths_.get()});
  }
  return layers;
}

// Draws exact rays through some pixels: what errors of pictures are measured by. None, if that may be much work, or
// much reading.
Result<std::optional<Player::DrawnRays>> Player::draw_rays() {
  if (!has_cells()) return std::nullopt;
  SPLATVOL_TRY_ASSIGN(cells, open_cells());
  const bool is_near = !streamer_->volume().is_far() && cells->tetrahedra() <= most_tetrahedra_for_rays;
  if (cells->unknown_cells() > 0 || !(is_near || holds_cells())) return std::nullopt;
  const int spacing = spacing_of_rays(view_.width, view_.height);
  const View view = view_of_rays(view_, spacing);
  SPLATVOL_TRY_ASSIGN(layers, lay_cells());
  const std::vector<SurfaceLayer> at_rays =
      layers_at_rays(layers, view, pixels_of_rays(view_.width, view_.height, spacing));
  for (std::size_t i = 0; i < layers.size(); ++i)
    layers[i] = {&at_rays[i].depths, layers[i].light ? &at_rays[i].light : nullptr};
  auto drawn = cell_rasterizer_.draw(*cells, {.view = view,
                                              .transfer = transfer_of(scene_),
                                              .lighting = scene_.lighting,
                                              .layers = std::move(layers),
                                              .memory = sweep_memory()});
  // A ray has too many cells: finer pictures tell the error.
  if (!drawn && drawn.error().code == ErrorCode::out_of_budget) return std::nullopt;
  SPLATVOL_TRY_ASSIGN(picture, std::move(drawn));
  const double of_rays =
      static_cast<double>(view_.width) * view_.height / (static_cast<double>(view.width) * view.height);
  return DrawnRays{{std::move(picture.image), spacing},
                   {static_cast<double>(cells->tetrahedra()), static_cast<double>(picture.segments) * of_rays,
                    segment_work(count_pieces(scene_.transfer_function))}};
}

// Draws picture after picture, until one has the error.
Result<ErrorSearch> Player::draw_to_error(double max_error, bool grows) {
  const int finest_spacing = has_layers() ? 1 : options_.drawing.sample_spacing.value_or(1);
  const bool may_widen = !has_layers() && !options_.drawing.sample_spacing;
  ErrorControl::Search search{.most_splats = device_splats(),
                              .grows = grows,
                              .finest_spacing = finest_spacing,
                              .widest_spacing = may_widen ? widest_samples_of_an_error : finest_spacing,
                              .pixels = static_cast<double>(scene_.width) * scene_.height};
  SPLATVOL_TRY_ASSIGN(rays, draw_rays());
  if (rays) {
    search.rays = std::move(rays->rays);
    if (may_draw_cells()) search.cells = rays->cells;
  }
  ErrorControl control(max_error, std::move(search));
  Image copy;
  while (const auto& next = control.next()) {
    if (next->exact) {
      SPLATVOL_TRY(draw_exact({}, next->sample_spacing));
      control.add({.image = *picture_});
      continue;
    }
    SPLATVOL_TRY(
        draw_frame({.detail = detail_of(*next, info().resolutions())}, {.sample_spacing = next->sample_spacing}));
    SPLATVOL_TRY_ASSIGN(picture, image_or_copy(copy));
    const std::uint64_t allowed = frame_->detail.goal.value_or(ErrorGoal{}).max_splats;
    control.add({*picture, frame_->splats, frame_->goal_error, frame_->finest, allowed, times_.draw.fragments});
  }
  return ErrorSearch{control.estimate(), control.tried(), control.pictures(), control.learned()};
}

Result<std::vector<Rung>> Player::draw_at_pace(double seconds) {
  SPLATVOL_TRY(check_time(seconds));
  constexpr std::size_t most_pictures = 12, most_leaps = 3;
  const Call call(*this);
  const int widest_spacing = options_.drawing.sample_spacing.value_or(widest_samples_in_a_time);
  Pacer pacer(seconds);
  std::vector<Rung> drawn;
  while (drawn.size() < most_pictures) {
    // The first picture tells how fast the machine is.
    if (shows_contours()) SPLATVOL_TRY(hold_contours());
    const bool may_be_cells = may_draw_cells() && (shows_contours() || !drawn.empty());
    SPLATVOL_TRY_ASSIGN(choices, this->choices(may_be_cells, widest_spacing));
    if (choices.cells && pacer.fits({0, choices.widest_spacing}, choices)) SPLATVOL_TRY(hold_cells());
    if (!holds_cells() && choices.has_splats) choices.cells.reset();
    if (drawn.size() < most_leaps) pacer.leap();
    const Rung rung = pacer.next(choices);
    if (!drawn.empty() && rung == drawn.back()) break;
    double fragments = 0;
    if (rung.is_exact()) {
      SPLATVOL_TRY(draw_exact({}, rung.sample_spacing));
      SPLATVOL_TRY(draw_exact({}, rung.sample_spacing));
    } else {
      is_nudged_ = true;  // so that the second picture is of the view itself
      SPLATVOL_TRY(draw_frame({.detail = detail_of(rung)}, {.sample_spacing = rung.sample_spacing}));
      SPLATVOL_TRY(draw_again());
      fragments = times_.draw.fragments;
    }
    drawn.push_back(rung);
    pacer.add(rung, choices, fragments, times_.frame);
  }
  return drawn;
}

Status Player::draw_again() {
  if (exact_) return draw_exact({}, sample_spacing_);
  is_nudged_ = !is_nudged_;
  return draw_frame(FrameRequest(request_), draw_options_);
}

Result<Box> Player::find_domain() {
  const Call call(*this);
  frame_ = nullptr;
  auto domain = splatvol::find_domain(*streamer_);
  SPLATVOL_TRY(call.check());
  return domain;
}

void Player::cancel() {
  const std::scoped_lock lock(stop_mutex_);
  stop_.request_stop();
}

}  // namespace splatvol
