#include "tools/svrender_drawing.h"

#include <fmt/format.h>

#include <cmath>
#include <cstdlib>
#include <iterator>
#include <limits>

#include "player/camera_motion.h"
#include "player/movie.h"
#include "player/statistics.h"
#include "tools/reading.h"
#include "tools/tool.h"
#include "tools/version.h"

namespace splatvol {
namespace {

KernelKind kernel_of(const RenderOptions& options) {
  return options.kernel == "octant" ? KernelKind::octant : KernelKind::moments;
}

DrawOptions how_to_draw(const RenderOptions& options) {
  DrawOptions how;
  if (options.sort != "exact") how.sort = options.sort == "none" ? SortMode::none : SortMode::axis;
  if (options.sampling != "auto") how.sample_spacing = std::atoi(options.sampling.c_str());
  return how;
}

// A frame of a moving camera has all of its splats; one of a picture that is being read has those that are there.
FrameRequest request_of(const RenderOptions& options, const Drawing& drawing) {
  FrameRequest request{.detail = drawing.detail, .change = 1.0 / options.fade};
  if (options.moves())
    request.wait_seconds = 1e6;
  else if (!options.plays() && !options.progress_frames.empty())
    request.wait_seconds = 0;
  return request;
}

// `is_alone`: no progress of several frames is shown.
Status draw_exact(Drawing& drawing, bool is_alone) {
  const int spacing = std::max(drawing.how.sample_spacing, 1);
  if (!is_alone) return drawing.player->draw_exact({}, spacing);
  ProgressBar bar("draw");
  return drawing.player->draw_exact([&](double share) { bar.update(share); }, spacing);
}

Status draw_frame(const RenderOptions& options, Drawing& drawing, Timings& timings) {
  // If nobody asked for an exact picture, a step that has no cells is drawn by splats.
  if (options.exact && (!options.chooses_detail || drawing.player->has_cells()))
    SPLATVOL_TRY(draw_exact(drawing, !options.moves() && !options.plays()));
  else
    SPLATVOL_TRY(drawing.player->draw_frame(request_of(options, drawing), drawing.how));
  timings.add(drawing.player->times());
  return {};
}

// Finds the cut of --max-error, in a few pictures of this view. Further views and steps take a cut of the same expected
// error.
Status find_cut(const RenderOptions& options, Drawing& drawing, Timings& timings) {
  SPLATVOL_TRY_ASSIGN(search, drawing.player->draw_to_error(*drawing.max_error, options.grows, drawing.how));
  timings.add(drawing.player->times());
  if (options.moves() || options.plays()) drawing.detail.goal = ErrorGoal{search.learned * *drawing.max_error};
  drawing.search = std::move(search);
  return {};
}

Status write_frame(const RenderOptions& options, const Composition& composition, const Drawing& drawing,
                   const std::string& path, Image image) {
  return write_page(composition, drawing.player->view(), std::move(image), path, provenance_of(options, drawing));
}

// Draws and writes frames until the picture is complete, and prints a line for each. Prints and returns the errors of
// parts that could not be read.
Result<std::vector<Error>> draw_progress(const RenderOptions& options, const Composition& composition, Drawing& drawing,
                                         Timings& timings, double start) {
  SPLATVOL_TRY_ASSIGN(frames, Movie::create("", options.progress_frames, 1));
  std::vector<Error> errors;
  for (int number = 0;; ++number) {
    SPLATVOL_TRY(draw_frame(options, drawing, timings));
    const FrameSplats& frame = *drawing.player->frame();
    const FrameProgress& progress = frame.progress;
    const std::string path = frames.frame_path(number);
    SPLATVOL_TRY_ASSIGN(image, drawing.player->image());
    const StreamerStatistics statistics = drawing.player->streamer().statistics();
    timings.progress.push_back({seconds_now() - start, statistics.cut_seconds + statistics.fetch_seconds, frame.splats,
                                statistics.bytes_read, progress.missing_bytes});
    SPLATVOL_TRY(write_frame(options, composition, drawing, path, std::move(image)));
    fmt::print(stderr, "{}: {} splats, {} bytes read, {} bytes in {} parts of rows and {} pages missing\n", path,
               frame.splats, statistics.bytes_read, progress.missing_bytes, progress.missing_rows,
               progress.missing_pages);
    for (const Error& error : progress.errors) {
      fmt::print(stderr, "svrender: {}: drawn coarser\n", error.message);
      errors.push_back(error);
    }
    if (progress.settled) return errors;
  }
}

CameraMotion motion_of(const RenderOptions& options, const Composition& composition) {
  if (options.turntable > 0) return {.frames = options.turntable, .center = composition.turned_about};
  return {.frames = static_cast<int>(std::ceil(options.path[0])),
          .degrees = options.path[1],
          .factor = options.path[2],
          .center = std::nullopt};
}

// Draws the frames of a moving camera, each with all of its splats, and measures the change from each to the next.
// Returns the errors of parts that could not be read.
Result<std::vector<Error>> draw_path(const RenderOptions& options, const Composition& composition, Drawing& drawing,
                                     Timings& timings) {
  std::optional<Movie> movie;
  if (!options.progress_frames.empty() || !options.movie.empty()) {
    SPLATVOL_TRY(store(Movie::create(options.movie, options.progress_frames, options.frames_per_second), movie));
  }
  const CameraMotion motion = motion_of(options, composition);
  Scene scene = composition.scene;
  Image last;
  std::vector<Error> errors;
  ProgressBar bar("draw");
  for (int number = 0; number < motion.frames; ++number) {
    scene.camera = camera_at(composition.scene.camera, motion, number);
    SPLATVOL_TRY(drawing.player->set_scene(scene));
    SPLATVOL_TRY(draw_frame(options, drawing, timings));
    SPLATVOL_TRY_ASSIGN(image, drawing.player->image());
    double change = 0;
    if (number > 0) {
      SPLATVOL_TRY_ASSIGN(difference, compare_images(last, image));
      change = difference.rmse;
    }
    const FrameSplats& frame = splats_of(*drawing.player);
    std::ranges::copy(frame.progress.errors, std::back_inserter(errors));
    timings.path.push_back({frame.splats, frame.progress.fading, change});
    if (movie) SPLATVOL_TRY(write_frame(options, composition, drawing, movie->frame_path(number), image));
    last = std::move(image);
    bar.update((number + 1.0) / motion.frames);
  }
  if (movie) SPLATVOL_TRY(movie->finish(0, motion.frames));
  return errors;
}

// Draws and writes a frame for each step, while the next step is read.
Status draw_steps(const RenderOptions& options, const Composition& composition, Drawing& drawing, Timings& timings) {
  Player& player = *drawing.player;
  const std::vector<double>& times = player.steps().times();
  SPLATVOL_TRY_ASSIGN(range, parse_steps(options.steps, times.size()));
  SPLATVOL_TRY_ASSIGN(movie, Movie::create(options.movie, options.progress_frames, options.frames_per_second));
  for (std::size_t step = range.first; step <= range.last; ++step) {
    const double start = seconds_now();
    const std::uint64_t before = player.streamer().volume().bytes_read();
    SPLATVOL_TRY(player.show_step(step));
    if (drawing.max_error && step == range.first) SPLATVOL_TRY(find_cut(options, drawing, timings));
    SPLATVOL_TRY(draw_frame(options, drawing, timings));
    const double seconds = seconds_now() - start;
    const std::uint64_t after = player.streamer().volume().bytes_read();
    timings.steps.push_back(
        {step, times[step], seconds, splats_of(player).splats, after >= before ? after - before : after});
    if (step < range.last) player.read_ahead(step + 1);
    SPLATVOL_TRY_ASSIGN(image, player.image());
    SPLATVOL_TRY(write_frame(options, composition, drawing, movie.frame_path(static_cast<int>(step)), image));
  }
  return movie.finish(static_cast<int>(range.first), static_cast<int>(range.last - range.first + 1));
}

}  // namespace

void Timings::add(const PlayerTimes& times) {
  cut.push_back(times.cut);
  sort.push_back(times.draw.sort);
  draw.push_back(times.draw.draw);
  frame.push_back(times.frame);
  if (first_image > 0) return;
  fetch = times.fetch;
  upload = times.draw.upload;
}

Result<Drawing> prepare_drawing(const RenderOptions& options, const Scene& scene) {
  PlayerOptions setup{.kernel = kernel_of(options)};
  SPLATVOL_TRY(store(parse_bytes(options.memory), setup.memory));
  SPLATVOL_TRY(store(parse_bytes(options.gpu_memory), setup.gpu_memory));
  SPLATVOL_TRY_ASSIGN(device, parse_device(options.device));
  setup.device = device == Device::automatic && options.exact ? Device::cpu : device;
  SPLATVOL_TRY_ASSIGN(reader_options, reader_options_of(options.reading, 0));
  setup.read_surface = surface_reader(reader_options);
  SPLATVOL_TRY_ASSIGN(steps, open_steps(options.volume));
  if (!options.steps.empty() && steps.times().empty())
    return fail(ErrorCode::invalid_argument, "{}: no time series, so it has no steps", steps.name());
  SPLATVOL_TRY_ASSIGN(step, find_step(steps, options.step));

  Drawing drawing{.detail = options.detail, .how = how_to_draw(options), .max_error = options.max_error};
  SPLATVOL_TRY(store(Player::open(std::move(steps), step, scene, setup), drawing.player));
  if (options.grows && drawing.player->info().point_count() <= points_drawn_at_once) {
    drawing.max_error.reset();
    drawing.detail.tolerance_percent = 0;
  }
  if (drawing.max_error || options.splats)
    drawing.detail.goal =
        ErrorGoal{drawing.max_error.value_or(0), options.splats.value_or(std::numeric_limits<std::uint64_t>::max())};
  return drawing;
}

Result<std::vector<Error>> draw_picture(const RenderOptions& options, const Composition& composition, Drawing& drawing,
                                        Timings& timings, double start) {
  std::vector<Error> errors;
  if (options.plays()) {
    SPLATVOL_TRY(draw_steps(options, composition, drawing, timings));
    return errors;
  }
  if (options.milliseconds) {
    SPLATVOL_TRY_ASSIGN(pacing, drawing.player->draw_at_pace(1e-3 * *options.milliseconds, drawing.how));
    timings.add(drawing.player->times());
    timings.pacing = std::move(pacing);
    return errors;
  }
  const bool progresses = !options.moves() && !options.progress_frames.empty();
  if (progresses) {
    SPLATVOL_TRY(store(draw_progress(options, composition, drawing, timings, start), errors));
  }
  if (drawing.max_error) SPLATVOL_TRY(find_cut(options, drawing, timings));
  if (options.moves()) return draw_path(options, composition, drawing, timings);
  if (!progresses && !drawing.max_error) SPLATVOL_TRY(draw_frame(options, drawing, timings));
  return errors;
}

Status draw_steady_frames(const RenderOptions& options, Drawing& drawing, Timings& timings) {
  timings.cut.clear();
  timings.sort.clear();
  timings.draw.clear();
  timings.frame.clear();
  ProgressBar bar("draw");
  for (int i = 0; i < options.repeat; ++i) {
    SPLATVOL_TRY(drawing.player->exact() ? draw_exact(drawing, false) : drawing.player->draw_again(drawing.how));
    timings.add(drawing.player->times());
    bar.update((i + 1.0) / options.repeat);
  }
  return {};
}

const FrameSplats& splats_of(const Player& player) {
  static const FrameSplats none;
  return player.frame() ? *player.frame() : none;
}

Provenance provenance_of(const RenderOptions& options, const Drawing& drawing) {
  const Player& player = *drawing.player;
  const FrameSplats& frame = splats_of(player);
  const format::Volume& volume = player.streamer().volume();
  Provenance provenance = {{"software", "svrender " SPLATVOL_VERSION},
                           {"file", volume.name()},
                           {"scene", options.scene.empty() ? "one that fits the data" : options.scene},
                           {"attribute", player.scene().attribute},
                           {"sample_spacing", fmt::format("{}", player.sample_spacing())}};
  if (volume.series()) {
    provenance["step"] = fmt::format("{}", volume.step());
    provenance["time"] = fmt::format("{}", volume.time());
  }
  if (player.exact()) {
    provenance["exact"] = "true";
    provenance["segments"] = fmt::format("{}", player.exact()->segments);
    return provenance;
  }
  provenance["kernel"] = options.kernel.value_or("moments");
  provenance["sort"] = options.sort;
  provenance["splats"] = fmt::format("{}", frame.splats);
  provenance["renderer"] = player.rasterizer().description();
  if (frame.detail.goal)
    provenance["expected_error"] = fmt::format("{}", frame.expected_error);
  else if (frame.detail.resolution)
    provenance["resolution"] = fmt::format("{}", *frame.detail.resolution);
  else
    provenance["tolerance"] = fmt::format("{}", frame.detail.tolerance_percent);
  if (drawing.search && !options.moves() && !options.plays())
    provenance["estimated_error"] = fmt::format("{}", drawing.search->estimate.error);
  return provenance;
}

}  // namespace splatvol
