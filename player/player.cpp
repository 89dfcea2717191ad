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
#include "scene/scene_change.h"
#include "scene/shells.h"
#include "streamer/cells/file_cells.h"
#include "streamer/splats/domain.h"

namespace splatvol {
namespace {

// With surfaces or slices, a picture in a time has at least so many splats. Fewer are no faster: each is larger, and
// surfaces are compared with each of its pixels.
constexpr std::uint64_t least_among_surfaces = std::uint64_t{1} << 15;

// Expected of splats where shells stand for contours.
constexpr double error_of_shells = 0.05;

// Splats have no contours: shells stand for them. All data are about as large as their cube, which is known.
Scene scene_of_splats(const Scene& scene, const Streamer& streamer) {
  return with_shells(scene, std::sqrt(3.0) * streamer.info().cube.edge);
}

Status set_function(Rasterizer& rasterizer, const Scene& scene, const Streamer& streamer) {
  const Status set = rasterizer.set_transfer_function(transfer_of(scene), streamer.units());
  return set ? set : Status(fail_in(streamer.volume().name(), set.error()));
}

tl::unexpected<Error> fail_two_surfaces() {
  return fail(ErrorCode::invalid_argument,
              "depths of surfaces, and a scene that shows surfaces or slices: give one of them");
}

// Whether memory is to have room for cells of streamlines.
bool has_streamlines(const Scene& scene, const PlayerOptions& options, const format::Volume& volume) {
  if (!format::CellReader::has_cells(volume)) return false;
  return !scene.streamlines.empty() || (options.takes_tubes && !vectors_of(volume.info()).empty());
}

// Rays that measure an error meet about as many cells as a picture does. Two cores need a tenth of a second for 2^21.
constexpr std::uint64_t most_tetrahedra_for_rays = std::uint64_t{1} << 21;

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
  explicit Call(Player& player) : player_(player), interruptible_(player.calls_.begin()) {}
  Call(const Call&) = delete;
  Call& operator=(const Call&) = delete;
  ~Call() { --player_.calls_.count; }

  [[nodiscard]] Status check() const {
    if (!is_interrupted()) return {};
    return fail(ErrorCode::cancelled, "{}: cancelled", player_.steps_.name());
  }

 private:
  Player& player_;
  Interruptible interruptible_;
};

std::stop_token Player::Calls::begin() {
  const std::scoped_lock lock(mutex);
  if (count++ == 0) stop = std::stop_source();
  return stop.get_token();
}

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
  auto memory = held.memory ? held.memory
                            : std::make_shared<PlayerMemory>(options.memory, *volume, !steps.times().empty(),
                                                             options.draws, has_streamlines(used, options, *volume));
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
  PlayerFile file{std::move(steps),   step, std::move(used), options, std::move(memory), std::move(streamer),
                  std::move(surfaces)};
  if (!options.takes_tubes)
    SPLATVOL_TRY_SET(file.tubes, read_scene_streamlines(
                                     file.scene.streamlines,
                                     {file.streamer->shared_volume(), file.memory, file.streamer->room()}, held.tubes));
  return file;
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
  const SceneChange change = change_between(scene_, scene);
  const bool lacks_room = !scene.streamlines.empty() && memory_->streamlines.capacity() == 0 && has_cells();
  const bool other_parts = step != step_ || options.memory != options_.memory ||
                           kernel_of(options.drawing) != kernel_of(options_.drawing) || change.data || lacks_room ||
                           (scene.lighting && !scene_.lighting && kernel_of(options.drawing) == KernelKind::octant);
  if (other_parts) {
    Held held{step == step_ ? surfaces_.all : surfaces_of_all_steps(), surfaces_.tubes};
    if (options.memory == options_.memory && !lacks_room) held.memory = memory_;
    if (step == step_ && !is_lost_) held.volume = streamer_->shared_volume();
    if (held.memory && (held.volume || !steps_.are_files())) held.room = streamer_->room();
    return [=, steps = steps_, held = std::move(held)] { return read(steps, step, scene, options, held); };
  }
  const bool has_other_tubes = change.streamlines && !options.takes_tubes;
  if (!change.surfaces && !has_other_tubes) return {};
  return [=, steps = steps_, memory = memory_, before = surfaces_.all, tubes = surfaces_.tubes,
          room = streamer_->room()]() -> Result<PlayerFile> {
    SPLATVOL_TRY_ASSIGN(volume, steps.volume(step));
    PlayerFile file{steps, step, scene, options, memory, nullptr, before, tubes};
    if (change.surfaces)
      SPLATVOL_TRY_SET(file.surfaces, read_scene_surfaces(scene.surfaces, *volume, options.read_surface,
                                                          memory->patches.capacity(), before));
    if (has_other_tubes)
      SPLATVOL_TRY_SET(file.tubes, read_scene_streamlines(scene.streamlines, {volume, memory, room}, tubes));
    return file;
  };
}

// Depths of another program, and surfaces or slices of the scene: only one of them.
Status Player::check_surfaces(const Scene& scene, const View& view) const {
  if (!surfaces_.depths) return {};
  if (!view.slices.empty() || std::ranges::any_of(scene.surfaces, &SceneSurface::shown) ||
      std::ranges::any_of(scene.streamlines, &SceneStreamlines::shown))
    return fail_two_surfaces();
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
  if (!options_.takes_tubes) set_tubes(std::move(file.tubes));
  return {};
}

void Player::set_tubes(std::vector<SceneTubes> tubes) {
  surfaces_.tubes = std::move(tubes);
  surfaces_.view.reset();
  join_surfaces();
}

void Player::join_surfaces() {
  surfaces_.drawn = surfaces_.all;
  for (const SceneTubes& tubes : surfaces_.tubes) surfaces_.drawn.push_back(tubes.surface);
}

// Patches have their share while there are some.
void Player::take_surfaces(std::vector<Surface> surfaces) {
  const auto is_same = [](const Surface& a, const Surface& b) {
    return a.style == b.style && a.mesh == b.mesh && a.values == b.values;
  };
  if (!std::ranges::equal(surfaces_.all, surfaces, is_same)) surfaces_.view.reset();
  surfaces_.all = std::move(surfaces);
  join_surfaces();
  const auto is_patch = [](const Surface& surface) { return surface.mesh && !surface.style.boundary.empty(); };
  surfaces_.patches_room = {};
  if (std::ranges::none_of(surfaces_.all, is_patch)) return;
  if (auto room = memory_->patches.reserve(memory_->patches.capacity())) surfaces_.patches_room = std::move(*room);
}

// Takes over a scene, options and a streamer that fits both, in its memory; null: the streamer stays. Surfaces stay.
Status Player::take_over(const Scene& scene, const PlayerOptions& options, std::unique_ptr<Streamer> streamer,
                         const std::shared_ptr<PlayerMemory>& memory, const View& view) {
  std::unique_ptr<Rasterizer> other;
  if (!rasterizer_ || kernel_of(options.drawing) != kernel_of(options_.drawing)) {
    SPLATVOL_TRY_SET(other, make_rasterizer(options.device, {.kernel = kernel_of(options.drawing),
                                                             .gpu_bytes = options.gpu_memory,
                                                             .in_current_context = options.in_current_context}));
    SPLATVOL_TRY(other->set_surface_depths(surfaces_.depths));
  }
  Rasterizer& rasterizer = other ? *other : *rasterizer_;
  const SceneChange change = change_between(scene_, scene);
  if (streamer || change.functions || change.contours) {
    const Streamer& used = streamer ? *streamer : *streamer_;
    Scene of_splats = scene_of_splats(scene, used);
    SPLATVOL_TRY(set_function(rasterizer, of_splats, used));
    function_of_splats_ = std::move(of_splats.transfer_function);
  }
  rasterizer.set_lighting(scene.lighting);
  const bool streamer_is_new = streamer != nullptr;
  if (streamer) {
    frame_ = nullptr;
    is_lost_ = false;
    surfaces_.patches_room = {};
    cells_.use(*streamer, memory);
    streamer_ = std::move(streamer);
    memory_ = memory;
  }
  if (other) {
    rasterizer_ = std::move(other);
    room_ = std::numeric_limits<std::uint64_t>::max();
  }
  if (streamer_is_new || change.is_of_picture()) ++revision_;
  scene_ = scene;
  options_ = options;
  view_ = view;
  asked_.is_nudged = false;
  return {};
}

// Opens a step as if none were open.
Status Player::open_again(std::size_t step) {
  SPLATVOL_TRY_ASSIGN(file, read(steps_, step, scene_, options_, {surfaces_of_all_steps(), surfaces_.tubes, memory_}));
  return replace(std::move(file));
}

std::optional<Error> Player::left_out() const { return left_out_error(surfaces_.all, steps_.name()); }

bool Player::shows_surfaces() const {
  return !view_.slices.empty() || std::ranges::any_of(surfaces_.drawn, &Surface::is_visible);
}

Status Player::set_surface_depths(std::shared_ptr<const SurfaceDepths> depths) {
  if (depths && shows_surfaces()) return fail_two_surfaces();
  SPLATVOL_TRY(rasterizer_->set_surface_depths(depths));
  surfaces_.depths = std::move(depths);
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
  const Scene of_splats = scene_of_splats(scene_, *streamer_);
  function_of_splats_ = of_splats.transfer_function;
  return set_function(*rasterizer_, of_splats, *streamer_);
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
  SPLATVOL_TRY(read_values_of(step, volume));
  SPLATVOL_TRY(read_tubes_of(step, volume));
  is_lost_ = true;
  cells_.drop();
  SPLATVOL_TRY(volume ? streamer_->set_step(std::move(volume)) : streamer_->set_step(step));
  is_lost_ = false;
  cells_.take_ahead(step);
  ++revision_;
  return {};
}

// The files of a series have boundaries of their own.
std::vector<Surface> Player::surfaces_of_all_steps() const {
  if (!steps_.are_files()) return surfaces_.all;
  std::vector<Surface> of_files;
  std::ranges::copy_if(surfaces_.all, std::back_inserter(of_files),
                       [](const Surface& surface) { return surface.style.boundary.empty(); });
  return of_files;
}

Status Player::read_boundary_of(const format::Volume& volume) {
  const std::vector<Surface> kept = surfaces_of_all_steps();
  if (kept.size() == surfaces_.all.size()) return {};
  SPLATVOL_TRY_ASSIGN(
      read, read_scene_surfaces(scene_.surfaces, volume, options_.read_surface, memory_->patches.capacity(), kept));
  take_surfaces(std::move(read));
  return {};
}

// The values that colour surfaces at a step. `volume`: of its file; null: the step is one of the open file.
Status Player::read_values_of(std::size_t step, std::shared_ptr<const format::Volume> volume) {
  const auto is_colored = [](const Surface& surface) { return surface.is_visible() && surface.style.color_by; };
  if (std::ranges::none_of(surfaces_.all, is_colored)) return {};
  if (!volume) SPLATVOL_TRY_SET(volume, steps_.volume(step));
  std::vector<Surface> surfaces = surfaces_.all;
  SPLATVOL_TRY(add_values(surfaces, *volume, surfaces_.all));
  take_surfaces(std::move(surfaces));
  return {};
}

// The streamlines at a step, likewise.
Status Player::read_tubes_of(std::size_t step, std::shared_ptr<const format::Volume> volume) {
  if (options_.takes_tubes || scene_.streamlines.empty()) return {};
  if (!volume) SPLATVOL_TRY_SET(volume, steps_.volume(step));
  SPLATVOL_TRY_ASSIGN(tubes, read_scene_streamlines(scene_.streamlines, {volume, memory_, streamer_->room()}, {}));
  set_tubes(std::move(tubes));
  return {};
}

void Player::read_ahead(std::size_t step, bool with_cells) {
  if (step >= steps_.times().size() || step == step_ || !streamer_->volume().waits()) return;
  if (with_cells && has_cells()) cells_.read_ahead(steps_, step, scene_);
  if (!steps_.are_files()) return streamer_->prefetch_step(step);
  if (ahead_ && ahead_->step() == step) return;
  // Only its preamble: another mesh has other parts in view.
  ahead_ = std::make_unique<VolumeAhead>(step, [steps = steps_, step] { return steps.volume(step); });
}

bool Player::is_reading_ahead() const {
  return (ahead_ && !ahead_->is_done()) || cells_.is_reading_ahead() || streamer_->is_prefetching();
}

std::uint64_t Player::device_splats() const {
  return std::min(rasterizer_->plan_picture(scene_.width, scene_.height), room_);
}

View Player::view_now() const {
  View view = view_;
  const double distance = glm::length(scene_.camera.focal_point - scene_.camera.position);
  if (asked_.is_nudged) view.eye += 1e-9 * distance * view.right;
  return view;
}

tl::unexpected<Error> Player::fail_lost() const {
  return fail(ErrorCode::io, "{}: could not be opened again", steps_.name());
}

Status Player::choose(const Detail& asked, std::optional<double> wait_seconds) {
  const Call call(*this);
  const auto start = Clock::now();
  frame_ = nullptr;
  if (is_lost_) return fail_lost();
  asked_.detail = asked;
  asked_.seconds = wait_seconds;
  Detail detail = asked;
  detail.device_splats = std::min(detail.device_splats, device_splats());
  if (detail.device_splats == 0)
    return fail(ErrorCode::out_of_budget, "{} bytes of GPU memory are too few for a picture of {} x {} pixels",
                options_.gpu_memory, scene_.width, scene_.height);
  const Transfer transfer(function_of_splats_, scene_.opacity ? &scene_.opacity->function : nullptr);
  auto chosen = wait_seconds ? streamer_->advance(view_now(), transfer, detail, *wait_seconds)
                             : streamer_->request(view_now(), transfer, detail);
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
    SPLATVOL_TRY(choose(Detail(asked_.detail), asked_.seconds));
  }
}

Status Player::draw_chosen(int sample_spacing) {
  if (!frame_) return fail(ErrorCode::invalid_argument, "{}: no splats are chosen to be drawn", steps_.name());
  asked_.sample_spacing = sample_spacing;
  const auto start = Clock::now();
  const double chosen_in = times_.frame;
  exact_.reset();
  SPLATVOL_TRY(set_draw_list());
  const double set_seconds = seconds_since(start);
  const View view = view_now();
  sort_ = sort_of(options_.drawing);
  sample_spacing_ = sample_spacing > 0
                        ? sample_spacing
                        : options_.drawing.sample_spacing.value_or(automatic_sample_spacing(view, frame_->detail));
  SPLATVOL_TRY_ASSIGN(times, shows_surfaces() ? draw_with_surfaces(view) : draw_volume(view));
  times.upload += set_seconds;
  times_.draw = times;
  times_.frame = chosen_in + seconds_since(start);
  return {};
}

Result<FrameTimes> Player::draw_volume(const View& view) {
  picture_.reset();
  if (surfaces_.depths) sample_spacing_ = 1;
  return rasterizer_->draw(view, sort_, sample_spacing_);
}

// Finds the layers of surfaces, and of slices unless cells have their values.
void Player::lay_surfaces(const View& view, bool has_slices) {
  if (has_slices && !view.slices.empty()) {
    surfaces_.layers = draw_surfaces(surfaces_.drawn, draw_slices(view), view);
    surfaces_.view.reset();
  } else if (surfaces_.view != view) {
    surfaces_.layers = draw_surfaces(surfaces_.drawn, {}, view);
    surfaces_.view = view;
  }
}

// Draws the volume in front of each layer of surfaces, and joins all.
Result<FrameTimes> Player::draw_with_surfaces(const View& view) {
  const auto start = Clock::now();
  double volume_seconds = 0;
  lay_surfaces(view, true);
  times_.surfaces = seconds_since(start);
  if (surfaces_.layers.layers.empty()) return draw_volume(view);
  picture_.reset();
  FrameTimes sum;
  SurfaceComposite composite;
  const Status drawn = [&]() -> Status {
    for (const SurfaceLayer& layer : surfaces_.layers.layers) {
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

Status Player::hold_cells() {
  const Call call(*this);
  if (is_lost_) return fail_lost();
  SPLATVOL_TRY_ASSIGN(kept, cells_.kept(scene_));
  return kept->hold_all();
}

std::function<Status()> Player::cells_reader() {
  return has_cells() ? cells_.reader(scene_) : std::function<Status()>();
}

std::optional<SharedCells> Player::cells_for_picks() {
  return has_cells() ? cells_.shared(scene_) : std::optional<SharedCells>();
}

bool Player::holds_cells() const { return cells_.are_held(scene_); }

// The cells in the view.
Result<std::shared_ptr<const FileCells>> Player::open_cells() {
  if (is_lost_) return fail_lost();
  return cells_.in_view(scene_, view_, revision_);
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

Status Player::draw_cells(int sample_spacing, const DrawProgress& progress) {
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
  auto drawn = cells_.draw(*cells, {.view = view_,
                                    .transfer = transfer_of(scene_),
                                    .lighting = scene_.lighting,
                                    .contours = contours_of(scene_),
                                    .layers = std::move(layers),
                                    .sample_spacing = sample_spacing_,
                                    .refined_difference = refined_difference(),
                                    .progress = progress});
  SPLATVOL_TRY(call.check());
  if (!drawn && drawn.error().code == ErrorCode::out_of_budget)
    return fail_in(streamer_->volume().name(), drawn.error());
  SPLATVOL_TRY_ASSIGN(picture, std::move(drawn));
  if (picture_) cells_.reuse(std::move(*picture_));
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

Outcome Player::outcome() const {
  if (exact_) return {.recipe = Recipe::of_cells(sample_spacing_), .segments = static_cast<double>(exact_->segments)};
  const FrameSplats& frame = *frame_;
  Outcome outcome{.recipe = {frame.detail, sample_spacing_},
                  .splats = frame.splats,
                  .finest = frame.finest,
                  .fragments = times_.draw.fragments};
  outcome.recipe.splats->device_splats = Detail().device_splats;
  if (frame.progress.complete) outcome.expected_error = frame.goal_error;
  // Of a complete frame counts what was allowed: the next finer cut may have many times as many splats.
  if (!frame.progress.settled)
    outcome.recipe = Recipe::of_splats(std::max<std::uint64_t>(frame.splats, 1), sample_spacing_);
  return outcome;
}

Result<Outcome> Player::draw(const Recipe& recipe, std::optional<double> wait_seconds, const DrawProgress& progress) {
  const Call call(*this);
  if (recipe.is_exact()) {
    SPLATVOL_TRY(draw_cells(recipe.sample_spacing, progress));
  } else {
    SPLATVOL_TRY(choose(*recipe.splats, wait_seconds));
    SPLATVOL_TRY(draw_chosen(recipe.sample_spacing));
  }
  return outcome();
}

// Draws splats of parts that are there or come in time.
Result<Outcome> Player::draw_in(const Recipe& recipe, double seconds) {
  const auto start = Clock::now();
  double draw_seconds = 0;
  if (recipe.is_exact()) {
    SPLATVOL_TRY(draw_cells(recipe.sample_spacing, {}));
    draw_seconds = times_.frame - times_.surfaces;
  } else {
    SPLATVOL_TRY(choose(*recipe.splats, 0));
    if (!frame_->progress.settled) {
      const double share =
          std::min(1.0, static_cast<double>(frame_->splats) / static_cast<double>(recipe.most_splats()));
      const double wait_seconds = seconds - seconds_since(start) - share * drawing_share * seconds;
      if (wait_seconds > 0) SPLATVOL_TRY(choose(*recipe.splats, wait_seconds));
    }
    const auto draw_start = Clock::now();
    SPLATVOL_TRY(draw_chosen(recipe.sample_spacing));
    draw_seconds = seconds_since(draw_start) - times_.surfaces;
  }
  Outcome drawn = outcome();
  drawn.seconds = draw_seconds;
  return drawn;
}

// Draws a picture again, from a place too near to be seen apart: a frame of a moving camera, to be timed. The last one
// is of the view itself.
Result<Outcome> Player::draw_steadily(const Recipe& recipe) {
  asked_.is_nudged = !recipe.is_exact();
  SPLATVOL_TRY(draw(recipe));
  SPLATVOL_TRY(draw_again());
  Outcome drawn = outcome();
  drawn.seconds = times_.frame - times_.surfaces;
  return drawn;
}

Result<bool> Player::draw_next(Chooser& chooser) {
  const Call call(*this);
  Chooser::Needs needs = chooser.needs();
  if (!may_draw_cells()) needs.cells = Chooser::Cells::none;
  SPLATVOL_TRY_ASSIGN(choices, this->choices(needs));
  const bool will_hold = choices.cells && cells_.may_be_held(scene_) &&
                         (needs.cells == Chooser::Cells::all || !streamer_->volume().is_far());
  if (will_hold) choices.cells->unread = 0;
  const std::optional<Recipe> recipe = chooser.next(choices);
  if (!recipe) return false;
  if (recipe->is_exact() && will_hold) SPLATVOL_TRY(hold_cells());
  SPLATVOL_TRY_ASSIGN(drawn, needs.steady_time ? draw_steadily(*recipe)
                             : needs.seconds   ? draw_in(*recipe, *needs.seconds)
                                               : draw(*recipe));
  Image copy;
  if (needs.picture) SPLATVOL_TRY_SET(drawn.picture, image_or_copy(copy));
  chooser.add(drawn, choices);
  return true;
}

Status Player::draw_all(Chooser& chooser) {
  const Call call(*this);
  for (bool goes_on = true; goes_on;) SPLATVOL_TRY_SET(goes_on, draw_next(chooser));
  return {};
}

Result<ChosenQuality> Player::default_quality() {
  const ChosenQuality splats{default_splats(info().point_count())};
  if (!may_draw_cells()) return splats;
  SPLATVOL_TRY_ASSIGN(choices, this->choices({.cells = Chooser::Cells::all}));
  if (!choices.cells) return splats;
  if (spacing_of_cells(choices) > 0) return ChosenQuality{{.exact = true}};
  const double segments = choices.cells->segment_work * choices.cells->segments;
  return ChosenQuality{splats.quality, static_cast<std::uint64_t>(segments)};
}

Result<DrawnPicture> Player::draw_picture(const Quality& quality, const DrawProgress& progress) {
  SPLATVOL_TRY(check_quality(quality));
  const Call call(*this);
  const bool is_default = quality == Quality();
  DrawnPicture drawn{{quality}};
  if (is_default) SPLATVOL_TRY_SET(drawn.chosen, default_quality());
  const Quality& chosen = drawn.chosen.quality;
  const bool is_of_motion = chosen.milliseconds && chosen.max_error;
  if (!is_of_motion) motion_.rest();
  if (chosen.exact) {
    SPLATVOL_TRY(draw(Recipe::of_cells(), {}, progress));
  } else if (is_of_motion) {
    motion_.set_limits({*chosen.max_error, 1e-3 * *chosen.milliseconds});
    SPLATVOL_TRY(draw_next(motion_));
  } else if (chosen.milliseconds) {
    pacer_.set_seconds(drawing_share * 1e-3 * *chosen.milliseconds);
    SPLATVOL_TRY(draw_next(pacer_));
  } else if (chosen.max_error) {
    SPLATVOL_TRY_SET(drawn.search, draw_to_error(*chosen.max_error, is_default));
  } else if (is_default && options_.drawing == Drawing()) {
    SPLATVOL_TRY_SET(drawn.search, draw_all_points());
  } else {
    SPLATVOL_TRY(draw({expected_detail(chosen)}));
  }
  return drawn;
}

// Draws all points, and finds out what error they have.
Result<std::optional<ErrorSearch>> Player::draw_all_points() {
  SPLATVOL_TRY_ASSIGN(drawn, draw_rays());
  AllPoints all(info().resolutions(), drawn ? std::optional(std::move(drawn->rays)) : std::nullopt);
  SPLATVOL_TRY(draw_all(all));
  if (!all.estimate()) return std::nullopt;
  return ErrorSearch{.estimate = *all.estimate(), .tried = {}, .pictures = all.pictures()};
}

bool Player::may_draw_cells() const {
  const bool wants_splats = options_.in_current_context || options_.device == Device::gl || options_.drawing.kernel ||
                            sort_of(options_.drawing) != SortMode::exact;
  return !wants_splats && has_cells();
}

Result<Choices> Player::choices(const Chooser::Needs& needs) {
  const int finest_spacing = options_.drawing.sample_spacing.value_or(1);
  Choices choices{.points = std::clamp<std::uint64_t>(info().point_count(), 1, device_splats()),
                  .least_splats = has_layers() ? least_among_surfaces : 1,
                  .finest_spacing = has_layers() ? 1 : finest_spacing,
                  .widest_spacing = has_layers() ? 1 : std::max(finest_spacing, needs.widest_spacing),
                  .pixels = static_cast<double>(scene_.width) * scene_.height,
                  .surfaces_seconds = has_layers() ? times_.surfaces : 0,
                  .direction = view_.forward};
  const bool has_contours = shows_contours();
  if (has_contours)
    choices.added_error = error_of_shells;
  else
    choices.most_segments = most_exact_segments;
  const bool may_read = needs.cells == Chooser::Cells::all || !streamer_->volume().is_far() || holds_cells();
  if (needs.cells == Chooser::Cells::none || (!may_read && !has_contours)) return choices;
  SPLATVOL_TRY_ASSIGN(cells, open_cells());
  const auto unread = static_cast<double>(cells->unread_tetrahedra());
  SPLATVOL_TRY_ASSIGN(estimate, estimate_exact());
  if (estimate.unknown_cells > 0 && !has_contours) return choices;
  choices.cells = estimate.counts();
  choices.cells->unread = unread;
  choices.has_splats = !has_contours;  // where cells can be drawn, contours are no shells
  return choices;
}

Result<std::optional<Outcome>> Player::try_splats(const Recipe& recipe) {
  constexpr double wait_seconds = 0.1;
  const Call call(*this);
  if (!exact_ || !picture_) return fail(ErrorCode::invalid_argument, "{}: no exact picture is there", steps_.name());
  // Drawing replaces what is known of the last picture.
  Image exact = *std::exchange(picture_, std::nullopt);
  const auto before = std::tuple(exact_, sample_spacing_, times_);
  const auto drawn = [&]() -> Result<std::optional<Outcome>> {
    SPLATVOL_TRY(choose(*recipe.splats, wait_seconds));
    if (!frame_->progress.settled) return std::nullopt;
    const auto start = Clock::now();
    SPLATVOL_TRY(draw_chosen(recipe.sample_spacing));
    Outcome outcome = this->outcome();
    outcome.seconds = seconds_since(start);
    SPLATVOL_TRY_ASSIGN(picture, image());
    SPLATVOL_TRY_ASSIGN(difference, compare_images(picture, exact));
    outcome.error = difference.rmse;
    return outcome;
  }();
  picture_ = std::move(exact);
  std::tie(exact_, sample_spacing_, times_) = before;
  return drawn;
}

// What other programs and the scene's surfaces hide of the volume, and how. Slices are among the cells.
Result<std::vector<CellLayer>> Player::lay_cells() {
  lay_surfaces(view_, false);
  std::vector<CellLayer> layers;
  for (const SurfaceLayer& layer : surfaces_.layers.layers) layers.push_back({&layer.depths, &layer.light});
  if (layers.empty() && surfaces_.depths) {
    SPLATVOL_TRY(check_size(*surfaces_.depths, view_));
    layers.push_back({surfaces_.depths.get()});
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
  auto drawn = cells_.draw(
      *cells,
      {.view = view, .transfer = transfer_of(scene_), .lighting = scene_.lighting, .layers = std::move(layers)});
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
  const int widest_spacing = options_.drawing.sample_spacing.value_or(widest_samples_of_an_error);
  SPLATVOL_TRY_ASSIGN(choices, this->choices({.widest_spacing = widest_spacing}));
  ErrorControl::Search search{.most_splats = device_splats(),
                              .grows = grows,
                              .finest_spacing = choices.finest_spacing,
                              .widest_spacing = choices.widest_spacing,
                              .pixels = choices.pixels,
                              .resolutions = info().resolutions()};
  SPLATVOL_TRY_ASSIGN(rays, draw_rays());
  if (rays) {
    search.rays = std::move(rays->rays);
    if (may_draw_cells()) search.cells = rays->cells;
  }
  ErrorControl control(max_error, std::move(search));
  SPLATVOL_TRY(draw_all(control));
  return ErrorSearch{control.estimate(), control.tried(), control.pictures(), control.learned()};
}

Status Player::draw_again() {
  if (exact_) return draw_cells(sample_spacing_, {});
  asked_.is_nudged = !asked_.is_nudged;
  SPLATVOL_TRY(choose(Detail(asked_.detail), asked_.seconds));
  return draw_chosen(asked_.sample_spacing);
}

Result<Box> Player::find_domain() {
  const Call call(*this);
  frame_ = nullptr;
  auto domain = splatvol::find_domain(*streamer_);
  SPLATVOL_TRY(call.check());
  return domain;
}

void Player::cancel() {
  const std::scoped_lock lock(calls_.mutex);
  calls_.stop.request_stop();
}

}  // namespace splatvol
