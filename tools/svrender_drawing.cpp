#include "tools/svrender_drawing.h"

#include <fmt/format.h>

#include <cmath>
#include <cstdlib>
#include <iterator>
#include <limits>

#include "player/camera_motion.h"
#include "player/choice.h"
#include "player/movie.h"
#include "player/statistics.h"
#include "tools/reading.h"
#include "tools/tool.h"
#include "tools/version.h"

namespace splatvol {
namespace {

// Whether nobody says how fine a picture is to be.
bool is_default(const RenderOptions& options) { return options.quality == Quality(); }

// A frame of a moving camera has all of its splats; one of a picture that is being read has those that are there.
std::optional<double> wait_seconds_of(const RenderOptions& options) {
  if (options.moves()) return 1e6;
  return options.progresses() ? std::optional(0.0) : std::nullopt;
}

Status draw_frame(const RenderOptions& options, Drawn& drawn, Timings& timings) {
  // If nobody asked for an exact picture, a step that has no cells is drawn by splats.
  const bool is_asked = drawn.chosen.quality.exact && !is_default(options);
  const bool is_exact = is_asked || (drawn.is_exact && drawn.player->has_cells());
  const Recipe recipe{is_exact ? std::nullopt : std::optional(drawn.splats), drawn.sample_spacing};
  SPLATVOL_TRY(drawn.player->draw(recipe, wait_seconds_of(options)));
  timings.add(drawn.player->times());
  return {};
}

// Finds the picture of an error, in a few pictures of this view. Further views and steps are drawn alike: cells, or a
// cut of the same expected error, and the same samples.
Status find_cut(Drawn& drawn, Timings& timings) {
  const double max_error = *drawn.chosen.quality.max_error;
  SPLATVOL_TRY_ASSIGN(picture, drawn.player->draw_picture({.max_error = max_error}));
  timings.add(drawn.player->times());
  drawn.search = std::move(picture.search);
  drawn.splats.goal = ErrorGoal{drawn.search->learned * max_error};
  drawn.sample_spacing = drawn.player->sample_spacing();
  drawn.is_exact = drawn.player->exact().has_value();
  return {};
}

Status write_frame(const RenderOptions& options, const Composition& composition, const Drawn& drawn,
                   const std::string& path, Image image) {
  return write_page(composition, drawn.player->view(), time_of(*drawn.player), std::move(image), path,
                    provenance_of(options, drawn));
}

// Draws and writes frames until the picture is complete, and prints a line for each. Prints and returns the errors of
// parts that could not be read.
Result<std::vector<Error>> draw_progress(const RenderOptions& options, const Composition& composition, Drawn& drawn,
                                         Timings& timings, double start) {
  SPLATVOL_TRY_ASSIGN(frames, Movie::create("", options.progress_frames, 1));
  std::vector<Error> errors;
  for (int number = 0;; ++number) {
    SPLATVOL_TRY(draw_frame(options, drawn, timings));
    const FrameSplats& frame = *drawn.player->frame();
    const FrameProgress& progress = frame.progress;
    const std::string path = frames.frame_path(number);
    SPLATVOL_TRY_ASSIGN(image, drawn.player->image());
    const StreamerStatistics statistics = drawn.player->streamer().statistics();
    timings.progress.push_back({seconds_now() - start, statistics.cut_seconds + statistics.fetch_seconds, frame.splats,
                                statistics.bytes_read, progress.missing_bytes});
    SPLATVOL_TRY(write_frame(options, composition, drawn, path, std::move(image)));
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

// Draws the frames of a moving camera, each with all of its splats. Returns the errors of parts that could not be read.
Result<std::vector<Error>> draw_path(const RenderOptions& options, const Composition& composition, Drawn& drawn,
                                     Timings& timings) {
  std::optional<Movie> movie;
  if (!options.progress_frames.empty() || !options.movie.empty()) {
    SPLATVOL_TRY(store(Movie::create(options.movie, options.progress_frames, options.frames_per_second), movie));
  }
  const CameraMotion motion = motion_of(options, composition);
  Scene scene = composition.scene;
  std::vector<Error> errors;
  ProgressBar bar("draw");
  for (int number = 0; number < motion.frames; ++number) {
    scene.camera = camera_at(composition.scene.camera, motion, number);
    SPLATVOL_TRY(drawn.player->set_scene(scene));
    SPLATVOL_TRY(draw_frame(options, drawn, timings));
    std::ranges::copy(splats_of(*drawn.player).progress.errors, std::back_inserter(errors));
    if (movie) {
      SPLATVOL_TRY_ASSIGN(image, drawn.player->image());
      SPLATVOL_TRY(write_frame(options, composition, drawn, movie->frame_path(number), std::move(image)));
    }
    bar.update((number + 1.0) / motion.frames);
  }
  if (movie) SPLATVOL_TRY(movie->finish(0, motion.frames));
  return errors;
}

// Draws and writes a frame for each step, while the next step is read.
Status draw_steps(const RenderOptions& options, const Composition& composition, Drawn& drawn, Timings& timings) {
  Player& player = *drawn.player;
  const std::vector<double>& times = player.steps().times();
  SPLATVOL_TRY_ASSIGN(range, parse_steps(options.steps, times.size()));
  SPLATVOL_TRY_ASSIGN(movie, Movie::create(options.movie, options.progress_frames, options.frames_per_second));
  for (std::size_t step = range.first; step <= range.last; ++step) {
    const double start = seconds_now();
    const std::uint64_t before = player.streamer().volume().bytes_read();
    SPLATVOL_TRY(player.show_step(step));
    if (drawn.chosen.quality.max_error && step == range.first) SPLATVOL_TRY(find_cut(drawn, timings));
    SPLATVOL_TRY(draw_frame(options, drawn, timings));
    const double seconds = seconds_now() - start;
    const std::uint64_t after = player.streamer().volume().bytes_read();
    timings.steps.push_back(
        {step, times[step], seconds, splats_of(player).splats, after >= before ? after - before : after});
    if (step < range.last) player.read_ahead(step + 1);
    SPLATVOL_TRY_ASSIGN(image, player.image());
    SPLATVOL_TRY(write_frame(options, composition, drawn, movie.frame_path(static_cast<int>(step)), image));
  }
  return movie.finish(static_cast<int>(range.first), static_cast<int>(range.last - range.first + 1));
}

// Draws the frames of a moving camera, or of steps.
Result<std::vector<Error>> draw_movement(const RenderOptions& options, const Composition& composition, Drawn& drawn,
                                         Timings& timings) {
  if (options.plays()) {
    SPLATVOL_TRY(draw_steps(options, composition, drawn, timings));
    return std::vector<Error>();
  }
  if (drawn.chosen.quality.max_error) SPLATVOL_TRY(find_cut(drawn, timings));
  return draw_path(options, composition, drawn, timings);
}

// The same where nobody says how fine: the first view decides whether all frames are exact. Else all have one error,
// even those of a small file.
Result<std::vector<Error>> draw_default_movement(const RenderOptions& options, const Composition& composition,
                                                 Drawn& drawn, Timings& timings) {
  SPLATVOL_TRY_SET(drawn.chosen, drawn.player->default_quality());
  drawn.is_exact = drawn.chosen.quality.exact;
  if (!drawn.is_exact) drawn.chosen.quality = {.max_error = default_max_error};
  return draw_movement(options, composition, drawn, timings);
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

Result<Drawn> prepare(const RenderOptions& options, format::Steps steps, const Scene& scene) {
  const Quality& quality = options.quality;
  PlayerOptions setup{.drawing = options.drawing};
  SPLATVOL_TRY(store(parse_bytes(options.memory), setup.memory));
  SPLATVOL_TRY(store(parse_bytes(options.gpu_memory), setup.gpu_memory));
  SPLATVOL_TRY_ASSIGN(device, parse_device(options.device));
  setup.device = device == Device::automatic ? Device::cpu : device;
  if (quality.exact) setup.draws = DrawnParts::cells;
  if (asks_for_splats(quality)) setup.draws = DrawnParts::splats;
  SPLATVOL_TRY_ASSIGN(reader_options, reader_options_of(options.reading, 0));
  setup.read_surface = surface_reader(reader_options);
  if (!options.steps.empty() && steps.times().empty())
    return fail(ErrorCode::invalid_argument, "{}: no time series, so it has no steps", steps.name());
  SPLATVOL_TRY_ASSIGN(step, find_step(steps, options.step));

  Drawn drawn{.chosen = {quality}};
  SPLATVOL_TRY(store(Player::open(std::move(steps), step, scene, setup), drawn.player));
  if (quality.max_error || asks_for_splats(quality)) drawn.splats = expected_detail(quality);
  return drawn;
}

Result<std::vector<Error>> draw_pictures(const RenderOptions& options, const Composition& composition, Drawn& drawn,
                                         Timings& timings, double start) {
  if (options.moves() || options.plays())
    return is_default(options) ? draw_default_movement(options, composition, drawn, timings)
                               : draw_movement(options, composition, drawn, timings);
  std::vector<Error> errors;
  if (options.quality.milliseconds) {
    PaceSearch search(1e-3 * *options.quality.milliseconds);
    SPLATVOL_TRY(drawn.player->draw_all(search));
    timings.rungs = search.drawn();
    timings.add(drawn.player->times());
    return errors;
  }
  if (options.progresses()) {
    SPLATVOL_TRY_SET(errors, draw_progress(options, composition, drawn, timings, start));
    if (!options.quality.max_error) return errors;
  }
  ProgressBar bar("draw");
  SPLATVOL_TRY_ASSIGN(picture, drawn.player->draw_picture(options.quality, [&](double share) { bar.update(share); }));
  timings.add(drawn.player->times());
  drawn.chosen = picture.chosen;
  drawn.search = std::move(picture.search);
  return errors;
}

Status draw_steady_frames(const RenderOptions& options, Drawn& drawn, Timings& timings) {
  timings.cut.clear();
  timings.sort.clear();
  timings.draw.clear();
  timings.frame.clear();
  ProgressBar bar("draw");
  for (int i = 0; i < options.repeat; ++i) {
    SPLATVOL_TRY(drawn.player->draw_again());
    timings.add(drawn.player->times());
    bar.update((i + 1.0) / options.repeat);
  }
  return {};
}

std::optional<double> time_of(const Player& player) {
  const std::vector<double>& times = player.steps().times();
  return times.empty() ? std::nullopt : std::optional(times[player.step()]);
}

const FrameSplats& splats_of(const Player& player) {
  static const FrameSplats none;
  return player.frame() ? *player.frame() : none;
}

Provenance provenance_of(const RenderOptions& options, const Drawn& drawn) {
  const Player& player = *drawn.player;
  const FrameSplats& frame = splats_of(player);
  const format::Volume& volume = player.streamer().volume();
  Provenance provenance = {{"software", "svrender " SPLATVOL_VERSION},
                           {"file", options.inputs.size() > 1 || options.volume != options.inputs[0]
                                        ? fmt::format("{}", fmt::join(options.inputs, " "))
                                        : volume.name()},
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
  provenance["kernel"] = name_of(kernel_of(player.options().drawing));
  provenance["sort"] = name_of(player.sort());
  provenance["splats"] = fmt::format("{}", frame.splats);
  provenance["renderer"] = player.rasterizer().description();
  if (frame.detail.goal)
    provenance["expected_error"] = fmt::format("{}", frame.expected_error);
  else if (frame.detail.resolution)
    provenance["resolution"] = fmt::format("{}", *frame.detail.resolution);
  else
    provenance["tolerance"] = fmt::format("{}", frame.detail.tolerance_percent);
  if (drawn.search && !options.moves() && !options.plays())
    provenance["estimated_error"] = fmt::format("{}", drawn.search->estimate.error);
  return provenance;
}

}  // namespace splatvol
