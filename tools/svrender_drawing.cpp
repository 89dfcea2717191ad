#include "tools/svrender_drawing.h"

#include <cmath>
#include <cstdlib>
#include <glm/gtc/quaternion.hpp>
#include <iterator>
#include <limits>

#include "renderer/device/device.h"
#include "renderer/sampling.h"
#include "streamer/frame_pacer.h"
#include "tools/movie.h"
#include "tools/tool.h"
#include "tools/version.h"

namespace splatvol {
namespace {

KernelKind kernel_of(const RenderOptions& options) {
  return options.kernel == "octant" ? KernelKind::octant : KernelKind::moments;
}

SortMode sort_of(const RenderOptions& options) {
  if (options.sort == "none") return SortMode::none;
  return options.sort == "axis" ? SortMode::axis : SortMode::exact;
}

int sample_spacing(const RenderOptions& options, const View& view, const Drawing& drawing) {
  if (options.sampling != "auto") return std::atoi(options.sampling.c_str());
  return automatic_sample_spacing(view, drawing.frame->detail, drawing.compositing);
}

// Returns the splats of the next frame. Alone with --progress-frames, only those that are there already.
Result<const FrameSplats*> next_splats(const RenderOptions& options, const Scene& scene, const View& view,
                                       const Drawing& drawing) {
  if (!options.moves() && (options.plays() || options.progress_frames.empty()))
    return drawing.streamer->request(view, scene.transfer_function, drawing.detail);
  const double wait_seconds = options.moves() ? 1e6 : 0;
  return drawing.streamer->advance(view, scene.transfer_function, drawing.detail, wait_seconds, 1.0 / options.fade);
}

// Gives the splats of the next frame to the renderer. While the device has no room for them, asks for fewer. Returns
// the seconds that the renderer took.
Result<double> set_splats(const RenderOptions& options, const Scene& scene, const View& view, Drawing& drawing) {
  for (std::uint64_t before = std::numeric_limits<std::uint64_t>::max();;) {
    SPLATVOL_TRY_ASSIGN(frame, next_splats(options, scene, view, drawing));
    drawing.frame = frame;
    const double start = seconds_now();
    const Status set = drawing.renderer->set_draw_list(frame->list);
    if (set) return seconds_now() - start;
    if (set.error().code != ErrorCode::out_of_budget || frame->splats >= before) return tl::unexpected(set.error());
    before = frame->splats;
    drawing.detail.device_splats =
        std::max<std::uint64_t>(std::min(drawing.detail.device_splats, frame->splats) / 8 * 7, 1);
  }
}

// Gets the view's splats, uploads what the device does not have, and draws.
Status draw_frame(const RenderOptions& options, const Scene& scene, const View& view, Drawing& drawing,
                  Timings& timings) {
  const double start = seconds_now();
  SPLATVOL_TRY_ASSIGN(upload_seconds, set_splats(options, scene, view, drawing));
  const bool mixes = drawing.can_mix && (options.raster == "slabs" || is_worth_mixing(view, drawing.frame->splats));
  drawing.compositing = mixes ? Compositing::slabs : Compositing::splats;
  SPLATVOL_TRY(drawing.renderer->set_compositing(drawing.compositing));
  drawing.sample_spacing = sample_spacing(options, view, drawing);
  SPLATVOL_TRY_ASSIGN(times, drawing.renderer->draw(view, sort_of(options), drawing.sample_spacing));

  timings.cut.push_back(drawing.streamer->statistics().cut_seconds);
  timings.sort.push_back(times.sort);
  timings.draw.push_back(times.draw);
  timings.frame.push_back(seconds_now() - start);
  if (timings.first_image > 0) return {};
  timings.fetch = drawing.streamer->statistics().fetch_seconds;
  timings.upload = upload_seconds + times.upload;
  return {};
}

// A movement too small to see. Without one, the renderer would keep the order of the splats.
dvec3 tiny_move(const Scene& scene, const View& view) {
  return 1e-9 * glm::length(scene.camera.focal_point - scene.camera.position) * view.right;
}

// Measures the time of a frame whose splats are resident.
Result<double> time_frame(const RenderOptions& options, const Scene& scene, View view, Drawing& drawing) {
  Timings timings;
  view.eye += tiny_move(scene, view);
  SPLATVOL_TRY(draw_frame(options, scene, view, drawing, timings));
  return timings.frame.back();
}

// Finds out how many splats can be drawn in --milliseconds, in a few frames.
Status pace(const RenderOptions& options, const Scene& scene, const View& view, Drawing& drawing, Timings& timings) {
  constexpr int most_frames = 8;
  FramePacer pacer(1e-3 * *options.milliseconds);
  for (int i = 0; i < most_frames; ++i) {
    drawing.detail.goal->max_splats = pacer.splats();
    SPLATVOL_TRY(draw_frame(options, scene, view, drawing, timings));
    SPLATVOL_TRY_ASSIGN(seconds, time_frame(options, scene, view, drawing));
    timings.pacing.push_back(drawing.frame->splats);
    if (pacer.is_near(seconds)) break;
    pacer.add(drawing.frame->splats, seconds);
  }
  return {};
}

// Draws what the control of the error asks for next.
Status draw_request(const RenderOptions& still, const Scene& scene, const View& view, const ErrorControl& control,
                    Drawing& drawing, Timings& timings) {
  const ErrorControl::Request& request = *control.next();
  drawing.detail.goal.reset();
  drawing.detail.resolution.reset();
  if (request.coarser > 0)
    drawing.detail.resolution =
        std::max(drawing.streamer->info().resolutions(), request.coarser + 1) - 1 - request.coarser;
  else
    drawing.detail.goal = request.goal;
  return draw_frame(still, scene, view, drawing, timings);
}

// Finds the cut of --max-error, in a few pictures of this view. Further views and steps take a cut of the same expected
// error.
Status find_cut(const RenderOptions& options, const Scene& scene, const View& view, Drawing& drawing,
                Timings& timings) {
  RenderOptions still = options;
  still.path.clear();
  still.turntable = 0;
  still.progress_frames.clear();
  ErrorControl control({*drawing.max_error, drawing.detail.device_splats, {}, options.grows});
  while (control.next()) {
    SPLATVOL_TRY(draw_request(still, scene, view, control, drawing, timings));
    SPLATVOL_TRY_ASSIGN(image, drawing.renderer->read_image());
    const FrameSplats& frame = *drawing.frame;
    const std::uint64_t allowed = frame.detail.goal.value_or(ErrorGoal{}).max_splats;
    control.add({image, frame.splats, frame.goal_error, frame.finest, allowed});
  }
  drawing.estimate = control.estimate();
  drawing.tried = control.tried();
  drawing.pictures_for_error = control.pictures();
  if (options.moves() || options.plays()) drawing.detail.goal = ErrorGoal{control.learned() * *drawing.max_error};
  return {};
}

Status write_frame(const RenderOptions& options, const Composition& composition, const View& view,
                   const Drawing& drawing, const std::string& path, Image image) {
  return write_page(composition, view, std::move(image), path, provenance_of(options, composition.scene, drawing));
}

// Draws and writes frames until the picture is complete, and prints a line for each. Prints and returns the errors of
// parts that could not be read.
Result<std::vector<Error>> draw_progress(const RenderOptions& options, const Composition& composition, const View& view,
                                         Drawing& drawing, Timings& timings, double start) {
  SPLATVOL_TRY_ASSIGN(frames, Movie::create("", options.progress_frames, 1));
  std::vector<Error> errors;
  for (int number = 0;; ++number) {
    SPLATVOL_TRY(draw_frame(options, composition.scene, view, drawing, timings));
    const FrameProgress& progress = drawing.frame->progress;
    const std::string path = frames.frame_path(number);
    SPLATVOL_TRY_ASSIGN(image, drawing.renderer->read_image());
    const StreamerStatistics statistics = drawing.streamer->statistics();
    timings.progress.push_back({seconds_now() - start, statistics.cut_seconds + statistics.fetch_seconds,
                                drawing.frame->splats, statistics.bytes_read, progress.missing_bytes});
    SPLATVOL_TRY(write_frame(options, composition, view, drawing, path, std::move(image)));
    fmt::print(stderr, "{}: {} splats, {} bytes read, {} bytes in {} parts of rows and {} pages missing\n", path,
               drawing.frame->splats, statistics.bytes_read, progress.missing_bytes, progress.missing_rows,
               progress.missing_pages);
    for (const Error& error : progress.errors) {
      fmt::print(stderr, "svrender: {}: drawn coarser\n", error.message);
      errors.push_back(error);
    }
    if (progress.settled) return errors;
  }
}

// Returns the camera, turned about its `up` by an angle in degrees round a centre.
Camera turned(Camera camera, double degrees, const dvec3& center) {
  const glm::dquat turn = glm::angleAxis(glm::radians(degrees), glm::normalize(camera.up));
  camera.position = center + turn * (camera.position - center);
  camera.focal_point = center + turn * (camera.focal_point - center);
  return camera;
}

int frame_count(const RenderOptions& options) {
  return options.turntable > 0 ? options.turntable : static_cast<int>(std::ceil(options.path[0]));
}

// The camera of a frame: turned, and nearer or farther. The frame after the last of a full turn would be the first.
Camera camera_at(const RenderOptions& options, const Composition& composition, int frame) {
  const Camera& camera = composition.scene.camera;
  if (options.turntable > 0) return turned(camera, 360.0 * frame / options.turntable, *composition.turned_about);
  const bool closed = options.path[1] != 0 && std::fmod(options.path[1], 360) == 0 && options.path[2] == 1;
  const double part = frame / std::max(options.path[0] - (closed ? 0 : 1), 1.0);
  Camera moved = turned(camera, part * options.path[1], camera.focal_point);
  moved.position = moved.focal_point + (moved.position - moved.focal_point) * std::pow(options.path[2], part);
  return moved;
}

// Draws the frames of a moving camera, each with all of its splats, and measures the change from each to the next.
// Returns the errors of parts that could not be read.
Result<std::vector<Error>> draw_path(const RenderOptions& options, const Composition& composition, Drawing& drawing,
                                     Timings& timings) {
  const Scene& scene = composition.scene;
  std::optional<Movie> movie;
  if (!options.progress_frames.empty() || !options.movie.empty()) {
    SPLATVOL_TRY_ASSIGN(created, Movie::create(options.movie, options.progress_frames, options.frames_per_second));
    movie = std::move(created);
  }
  Image last;
  std::vector<Error> errors;
  ProgressBar bar("draw");
  for (int number = 0; number < frame_count(options); ++number) {
    SPLATVOL_TRY_ASSIGN(view, make_view(camera_at(options, composition, number), scene.width, scene.height));
    view.clip_box = scene.clip_box;
    SPLATVOL_TRY(draw_frame(options, scene, view, drawing, timings));
    SPLATVOL_TRY_ASSIGN(image, drawing.renderer->read_image());
    double change = 0;
    if (number > 0) {
      SPLATVOL_TRY_ASSIGN(difference, compare_images(last, image));
      change = difference.rmse;
    }
    std::ranges::copy(drawing.frame->progress.errors, std::back_inserter(errors));
    timings.path.push_back({drawing.frame->splats, drawing.frame->progress.fading, change});
    if (movie) SPLATVOL_TRY(write_frame(options, composition, view, drawing, movie->frame_path(number), image));
    last = std::move(image);
    bar.update((number + 1.0) / frame_count(options));
  }
  if (movie) SPLATVOL_TRY(movie->finish(0, frame_count(options)));
  return errors;
}

Status set_transfer_function(const RenderOptions& options, const Scene& scene, Drawing& drawing) {
  const Status status = drawing.renderer->set_transfer_function(scene.transfer_function, drawing.streamer->units());
  return status ? status : Status(fail_in(options.scene.empty() ? options.volume : options.scene, status.error()));
}

// Changes to a step, which the streamer may have read already.
Status show_step(const RenderOptions& options, const Scene& scene, std::size_t step, Drawing& drawing) {
  if (drawing.streamer->volume().series()) {
    SPLATVOL_TRY(drawing.streamer->set_step(step));
  } else {
    SPLATVOL_TRY_ASSIGN(volume, drawing.steps->volume(step));
    SPLATVOL_TRY(drawing.streamer->set_step(std::move(volume)));
  }
  return set_transfer_function(options, scene, drawing);
}

// Draws and writes a frame for each step, while the next step is read.
Status draw_steps(const RenderOptions& options, const Composition& composition, const View& view, Drawing& drawing,
                  Timings& timings) {
  const Scene& scene = composition.scene;
  SPLATVOL_TRY_ASSIGN(range, parse_steps(options.steps, drawing.steps->times().size()));
  SPLATVOL_TRY_ASSIGN(movie, Movie::create(options.movie, options.progress_frames, options.frames_per_second));
  for (std::size_t step = range.first; step <= range.last; ++step) {
    const double start = seconds_now();
    const std::uint64_t before = drawing.streamer->volume().bytes_read();
    SPLATVOL_TRY(show_step(options, scene, step, drawing));
    if (drawing.max_error && step == range.first) SPLATVOL_TRY(find_cut(options, scene, view, drawing, timings));
    SPLATVOL_TRY(draw_frame(options, scene, view, drawing, timings));
    const double seconds = seconds_now() - start;
    const std::uint64_t after = drawing.streamer->volume().bytes_read();
    timings.steps.push_back(
        {step, drawing.steps->times()[step], seconds, drawing.frame->splats, after >= before ? after - before : after});
    if (step < range.last) drawing.streamer->prefetch_step(step + 1);
    SPLATVOL_TRY_ASSIGN(image, drawing.renderer->read_image());
    SPLATVOL_TRY(write_frame(options, composition, view, drawing, movie.frame_path(static_cast<int>(step)), image));
  }
  return movie.finish(static_cast<int>(range.first), static_cast<int>(range.last - range.first + 1));
}

}  // namespace

Result<Drawing> prepare_drawing(const RenderOptions& options, const Scene& scene) {
  Drawing drawing;
  const KernelKind kernel = kernel_of(options);
  SPLATVOL_TRY_ASSIGN(memory, parse_bytes(options.memory));
  SPLATVOL_TRY_ASSIGN(steps, open_steps(options.volume));
  if (!options.steps.empty() && steps.times().empty())
    return fail(ErrorCode::invalid_argument, "{}: no time series, so it has no steps", steps.name());
  SPLATVOL_TRY_ASSIGN(step, find_step(steps, options.step));
  SPLATVOL_TRY_ASSIGN(volume, steps.volume(step));
  drawing.steps = std::move(steps);
  SPLATVOL_TRY_ASSIGN(streamer,
                      Streamer::open(std::move(volume), {memory, scene.attribute, kernel, scene.lighting.has_value()}));
  drawing.streamer = std::move(streamer);
  SPLATVOL_TRY_ASSIGN(gpu_memory, parse_bytes(options.gpu_memory));
  SPLATVOL_TRY_ASSIGN(device, parse_device(options.device));
  if (device == Device::automatic && options.raster == "slabs") device = Device::cpu;
  SPLATVOL_TRY_ASSIGN(renderer, make_rasterizer(device, {.kernel = kernel, .gpu_bytes = gpu_memory}));
  drawing.renderer = std::move(renderer);
  if (options.raster == "slabs") SPLATVOL_TRY(drawing.renderer->set_compositing(Compositing::slabs));
  drawing.can_mix = options.raster == "slabs" || (options.raster == "auto" && options.sort == "exact" &&
                                                  drawing.renderer->set_compositing(Compositing::slabs));
  drawing.detail = options.detail;
  drawing.max_error = options.max_error;
  if (options.grows && drawing.streamer->info().point_count() <= points_drawn_at_once) {
    drawing.max_error.reset();
    drawing.detail.tolerance_percent = 0;
  }
  if (drawing.max_error || options.splats || options.milliseconds)
    drawing.detail.goal =
        ErrorGoal{drawing.max_error.value_or(0), options.splats.value_or(std::numeric_limits<std::uint64_t>::max())};
  drawing.detail.device_splats = drawing.renderer->plan_picture(scene.width, scene.height);
  if (drawing.detail.device_splats == 0)
    return fail(ErrorCode::out_of_budget, "{} of GPU memory are too few for a picture of {} x {} pixels",
                options.gpu_memory, scene.width, scene.height);
  drawing.renderer->set_lighting(scene.lighting);
  SPLATVOL_TRY(set_transfer_function(options, scene, drawing));
  return drawing;
}

Result<std::vector<Error>> draw_picture(const RenderOptions& options, const Composition& composition, const View& view,
                                        Drawing& drawing, Timings& timings, double start) {
  const Scene& scene = composition.scene;
  if (options.plays()) {
    SPLATVOL_TRY(draw_steps(options, composition, view, drawing, timings));
    return std::vector<Error>();
  }
  if (!options.moves() && !options.milliseconds && !options.progress_frames.empty()) {
    SPLATVOL_TRY_ASSIGN(errors, draw_progress(options, composition, view, drawing, timings, start));
    if (drawing.max_error) SPLATVOL_TRY(find_cut(options, scene, view, drawing, timings));
    return errors;
  }
  if (drawing.max_error) SPLATVOL_TRY(find_cut(options, scene, view, drawing, timings));
  if (options.moves()) return draw_path(options, composition, drawing, timings);
  if (options.milliseconds)
    SPLATVOL_TRY(pace(options, scene, view, drawing, timings));
  else if (!drawing.max_error)
    SPLATVOL_TRY(draw_frame(options, scene, view, drawing, timings));
  return std::vector<Error>();
}

Status draw_steady_frames(const RenderOptions& options, const Scene& scene, View view, Drawing& drawing,
                          Timings& timings) {
  timings.cut.clear();
  timings.sort.clear();
  timings.draw.clear();
  timings.frame.clear();
  const dvec3 move = tiny_move(scene, view);
  ProgressBar bar("draw");
  for (int i = 0; i < options.repeat; ++i) {
    view.eye += move;
    SPLATVOL_TRY(draw_frame(options, scene, view, drawing, timings));
    bar.update((i + 1.0) / options.repeat);
  }
  return {};
}

Provenance provenance_of(const RenderOptions& options, const Scene& scene, const Drawing& drawing) {
  const FrameSplats& frame = *drawing.frame;
  Provenance provenance = {{"software", "svrender " SPLATVOL_VERSION},
                           {"file", drawing.streamer->volume().name()},
                           {"scene", options.scene.empty() ? "one that fits the data" : options.scene},
                           {"attribute", scene.attribute},
                           {"kernel", options.kernel},
                           {"sort", options.sort},
                           {"raster", drawing.raster()},
                           {"sample_spacing", fmt::format("{}", drawing.sample_spacing)},
                           {"splats", fmt::format("{}", frame.splats)},
                           {"renderer", drawing.renderer->description()}};
  if (drawing.streamer->volume().series()) {
    provenance["step"] = fmt::format("{}", drawing.streamer->volume().step());
    provenance["time"] = fmt::format("{}", drawing.streamer->volume().time());
  }
  if (frame.detail.goal)
    provenance["expected_error"] = fmt::format("{}", frame.expected_error);
  else if (frame.detail.resolution)
    provenance["resolution"] = fmt::format("{}", *frame.detail.resolution);
  else
    provenance["tolerance"] = fmt::format("{}", frame.detail.tolerance_percent);
  if (drawing.estimate && !options.moves() && !options.plays())
    provenance["estimated_error"] = fmt::format("{}", drawing.estimate->error);
  return provenance;
}

}  // namespace splatvol
