// svrender: a picture of a .svol file.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <glm/gtc/quaternion.hpp>
#include <nlohmann/json.hpp>
#include <vector>

#include "base/file.h"
#include "base/http_source.h"
#include "renderer/context.h"
#include "renderer/renderer.h"
#include "renderer/sampling.h"
#include "scene/image.h"
#include "scene/scene.h"
#include "streamer/frame_pacer.h"
#include "streamer/streamer.h"
#include "tools/tool.h"
#include "tools/version.h"

namespace splatvol {
namespace {

struct Options {
  std::string volume;
  std::string scene;
  std::string output;
  std::string size;
  std::string stats;
  std::string progress_frames;  // folder; empty: none
  std::vector<double> path;     // frames, degrees, factor; empty: none
  int fade = 1;                 // frames that a change of resolution takes
  std::string memory = "512M";
  std::string gpu_memory = "1G";
  std::string sort = "exact";
  std::string kernel = "moments";
  std::string sampling = "auto";
  DetailOptions detail;
  std::optional<double> max_error;
  std::optional<std::uint64_t> splats;
  std::optional<double> milliseconds;
  int repeat = 1;
};

// Of the first frame, which reads and uploads; then, for frames with everything resident, a number for each.
struct ProgressFrame {
  double seconds;  // from the program's start to the frame
  double advance;  // of them for choosing and gathering what is there
  std::uint64_t splats, bytes_read, missing_bytes;
};

// Of a camera's path.
struct PathFrame {
  std::uint64_t splats, fading;
  double step;  // from the frame before: RMSE
};

struct Timings {
  std::vector<ProgressFrame> progress;
  std::vector<PathFrame> path;
  std::vector<std::uint64_t> pacing;  // splats of the frames that found out how many are drawn in time
  double first_image = 0;
  double fetch = 0;
  double upload = 0;
  std::vector<double> cut, sort, draw, frame;
};

struct Drawing {
  std::unique_ptr<Streamer> streamer;
  std::unique_ptr<HeadlessContext> context;
  std::unique_ptr<Renderer> renderer;
  DetailOptions detail;
  const FrameSplats* frame = nullptr;
  int sample_spacing = 1;  // of the last frame
  std::uint64_t uploaded_serial = 0;
};

double median(std::vector<double> numbers) {
  if (numbers.empty()) return 0;
  std::ranges::sort(numbers);
  const std::size_t middle = numbers.size() / 2;
  return numbers.size() % 2 == 1 ? numbers[middle] : 0.5 * (numbers[middle - 1] + numbers[middle]);
}

Result<Scene> read_scene(const Options& options) {
  SPLATVOL_TRY_ASSIGN(scene, load_scene(options.scene));
  if (options.size.empty()) return scene;
  SPLATVOL_TRY_ASSIGN(size, parse_image_size(options.size));
  scene.width = size[0];
  scene.height = size[1];
  return scene;
}

KernelKind kernel_of(const Options& options) {
  return options.kernel == "octant" ? KernelKind::octant : KernelKind::moments;
}

SortMode sort_of(const Options& options) {
  if (options.sort == "none") return SortMode::none;
  return options.sort == "axis" ? SortMode::axis : SortMode::exact;
}

int sample_spacing(const Options& options, const View& view, const FrameSplats& frame) {
  if (options.sampling != "auto") return std::atoi(options.sampling.c_str());
  return automatic_sample_spacing(view, frame.detail);
}

Result<Drawing> prepare(const Options& options, const Scene& scene) {
  Drawing drawing;
  const KernelKind kernel = kernel_of(options);
  SPLATVOL_TRY_ASSIGN(memory, parse_bytes(options.memory));
  SPLATVOL_TRY_ASSIGN(source, open_file_or_url(options.volume));
  SPLATVOL_TRY_ASSIGN(streamer,
                      Streamer::open(std::move(source), {memory, scene.attribute, kernel, scene.lighting.has_value()}));
  drawing.streamer = std::move(streamer);
  SPLATVOL_TRY_ASSIGN(context, HeadlessContext::create());
  drawing.context = std::move(context);
  SPLATVOL_TRY_ASSIGN(renderer, Renderer::create(kernel));
  drawing.renderer = std::move(renderer);
  drawing.detail = options.detail;
  if (options.max_error || options.splats || options.milliseconds)
    drawing.detail.goal =
        ErrorGoal{options.max_error.value_or(0), options.splats.value_or(std::numeric_limits<std::uint64_t>::max())};
  SPLATVOL_TRY_ASSIGN(gpu_memory, parse_bytes(options.gpu_memory));
  drawing.detail.max_splats = drawing.renderer->max_splats(scene.width, scene.height, gpu_memory);
  if (drawing.detail.max_splats == 0)
    return fail(ErrorCode::out_of_budget, "{} of GPU memory are too few for a picture of {} x {} pixels",
                options.gpu_memory, scene.width, scene.height);
  drawing.renderer->set_lighting(scene.lighting);
  const double offset = drawing.streamer->value_offset();
  if (Status status = drawing.renderer->set_transfer_function(scene.transfer_function, offset); !status)
    return fail_in(options.scene, status.error());
  return drawing;
}

// All that the view asks for; with --progress-frames what is there of it.
Result<const FrameSplats*> next_splats(const Options& options, const Scene& scene, const View& view,
                                       const Drawing& drawing) {
  if (options.path.empty() && options.progress_frames.empty())
    return drawing.streamer->request(view, scene.transfer_function, drawing.detail);
  const double wait_seconds = options.path.empty() ? 0 : 1e6;
  return drawing.streamer->advance(view, scene.transfer_function, drawing.detail, wait_seconds, 1.0 / options.fade);
}

// Asks for the view's splats, uploads them if they are others than before, draws.
Status draw_frame(const Options& options, const Scene& scene, const View& view, Drawing& drawing, Timings& timings) {
  const double start = seconds_now();
  SPLATVOL_TRY_ASSIGN(frame, next_splats(options, scene, view, drawing));
  drawing.frame = frame;
  const double upload_start = seconds_now();
  if (frame->serial != drawing.uploaded_serial)
    SPLATVOL_TRY(drawing.renderer->set_splats(frame->data, frame->batches));
  else
    SPLATVOL_TRY(drawing.renderer->set_weights(frame->batches));
  drawing.uploaded_serial = frame->serial;
  const double draw_start = seconds_now();
  drawing.sample_spacing = sample_spacing(options, view, *frame);
  SPLATVOL_TRY_ASSIGN(times, drawing.renderer->draw(view, sort_of(options), drawing.sample_spacing));

  timings.cut.push_back(drawing.streamer->statistics().cut_seconds);
  timings.sort.push_back(times.sort);
  timings.draw.push_back(times.draw);
  timings.frame.push_back(seconds_now() - start);
  if (timings.first_image > 0) return {};
  timings.fetch = drawing.streamer->statistics().fetch_seconds;
  timings.upload = draw_start - upload_start + times.upload;
  return {};
}

// Frames of a camera that moves, by next to nothing: for one that stands still, the order of the splats would be kept.
Status draw_steady_frames(const Options& options, const Scene& scene, View view, Drawing& drawing, Timings& timings) {
  timings.cut.clear();
  timings.sort.clear();
  timings.draw.clear();
  timings.frame.clear();
  const dvec3 step = 1e-9 * glm::length(scene.camera.focal_point - scene.camera.position) * view.right;
  ProgressBar bar("draw");
  for (int i = 0; i < options.repeat; ++i) {
    view.eye += step;
    SPLATVOL_TRY(draw_frame(options, scene, view, drawing, timings));
    bar.update((i + 1.0) / options.repeat);
  }
  return {};
}

// The time of a frame whose splats are resident, for a camera that moves by next to nothing.
Result<double> time_frame(const Options& options, const Scene& scene, View view, Drawing& drawing) {
  Timings timings;
  view.eye += 1e-9 * glm::length(scene.camera.focal_point - scene.camera.position) * view.right;
  SPLATVOL_TRY(draw_frame(options, scene, view, drawing, timings));
  return timings.frame.back();
}

// Finds out how many splats can be drawn in the time asked for, in a few frames.
Status pace(const Options& options, const Scene& scene, const View& view, Drawing& drawing, Timings& timings) {
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

Provenance provenance_of(const Options& options, const Scene& scene, const Drawing& drawing) {
  const FrameSplats& frame = *drawing.frame;
  Provenance provenance = {{"software", "svrender " SPLATVOL_VERSION},
                           {"file", drawing.streamer->volume().name()},
                           {"scene", options.scene},
                           {"attribute", scene.attribute},
                           {"kernel", options.kernel},
                           {"sort", options.sort},
                           {"sample_spacing", fmt::format("{}", drawing.sample_spacing)},
                           {"splats", fmt::format("{}", frame.splats)},
                           {"renderer", drawing.context->description()}};
  if (frame.detail.goal)
    provenance["expected_error"] = fmt::format("{}", frame.expected_error);
  else if (frame.detail.resolution)
    provenance["resolution"] = fmt::format("{}", *frame.detail.resolution);
  else
    provenance["tolerance"] = fmt::format("{}", frame.detail.tolerance_percent);
  return provenance;
}

// Draws and writes frames until nothing more comes; a line for each. What could not be read is told, and returned.
Result<std::vector<Error>> draw_progress(const Options& options, const Scene& scene, const View& view, Drawing& drawing,
                                         Timings& timings, double start) {
  std::vector<Error> errors;
  for (int number = 0;; ++number) {
    SPLATVOL_TRY(draw_frame(options, scene, view, drawing, timings));
    const FrameProgress& progress = drawing.frame->progress;
    const std::string path = fmt::format("{}/frame-{:04}.png", options.progress_frames, number);
    SPLATVOL_TRY_ASSIGN(image, drawing.renderer->read_image());
    const StreamerStatistics statistics = drawing.streamer->statistics();
    timings.progress.push_back({seconds_now() - start, statistics.cut_seconds + statistics.fetch_seconds,
                                drawing.frame->splats, statistics.bytes_read, progress.missing_bytes});
    SPLATVOL_TRY(write_image(path, image, scene.background, provenance_of(options, scene, drawing)));
    fmt::print(stderr, "{}: {} splats, {} bytes read, {} bytes in {} chunks and {} pages missing\n", path,
               drawing.frame->splats, statistics.bytes_read, progress.missing_bytes, progress.missing_chunks,
               progress.missing_pages);
    for (const Error& error : progress.errors) {
      fmt::print(stderr, "svrender: {}: drawn coarser\n", error.message);
      errors.push_back(error);
    }
    if (progress.settled) return errors;
  }
}

// The camera of a path's frame: turned about `up` round its focal point, and nearer or farther.
Camera camera_at(const Options& options, Camera camera, int frame) {
  const double part = frame / std::max(options.path[0] - 1, 1.0);
  const glm::dquat turn = glm::angleAxis(glm::radians(part * options.path[1]), glm::normalize(camera.up));
  camera.position =
      camera.focal_point + turn * (camera.position - camera.focal_point) * std::pow(options.path[2], part);
  return camera;
}

// Draws the frames of a path, all of whose splats are waited for, and measures how they follow each other.
Status draw_path(const Options& options, const Scene& scene, Drawing& drawing, Timings& timings) {
  Image last;
  for (int number = 0; number < options.path[0]; ++number) {
    SPLATVOL_TRY_ASSIGN(view, make_view(camera_at(options, scene.camera, number), scene.width, scene.height));
    SPLATVOL_TRY(draw_frame(options, scene, view, drawing, timings));
    SPLATVOL_TRY_ASSIGN(image, drawing.renderer->read_image());
    double step = 0;
    if (number > 0) {
      SPLATVOL_TRY_ASSIGN(difference, compare_images(last, image));
      step = difference.rmse;
    }
    timings.path.push_back({drawing.frame->splats, drawing.frame->progress.fading, step});
    if (!options.progress_frames.empty())
      SPLATVOL_TRY(write_image(fmt::format("{}/frame-{:04}.png", options.progress_frames, number), image,
                               scene.background, provenance_of(options, scene, drawing)));
    last = std::move(image);
  }
  return {};
}

// As in a scene file.
nlohmann::ordered_json lighting_of(const Scene& scene) {
  if (!scene.lighting) return false;
  return {{"ambient", scene.lighting->ambient}, {"diffuse", scene.lighting->diffuse}};
}

nlohmann::ordered_json statistics_of(const Options& options, const Scene& scene, const Drawing& drawing,
                                     const Timings& timings) {
  const FrameSplats& frame = *drawing.frame;
  const StreamerStatistics statistics = drawing.streamer->statistics();
  nlohmann::ordered_json json = {{"file", drawing.streamer->volume().name()},
                                 {"scene", options.scene},
                                 {"attribute", scene.attribute},
                                 {"width", scene.width},
                                 {"height", scene.height},
                                 {"kernel", options.kernel},
                                 {"sort", options.sort},
                                 {"lighting", lighting_of(scene)},
                                 {"sample_spacing", drawing.sample_spacing},
                                 {"splats", frame.splats},
                                 {"nodes", frame.nodes},
                                 {"expected_error", frame.expected_error},
                                 {"resolution_histogram", frame.nodes_by_resolution},
                                 {"splats_by_resolution", frame.splats_by_resolution},
                                 {"file_bytes", drawing.streamer->volume().file_bytes()},
                                 {"bytes_read", statistics.bytes_read},
                                 {"bytes_resident_peak", statistics.bytes_resident_peak},
                                 {"gpu_bytes", drawing.renderer->gpu_bytes()},
                                 {"complete", frame.progress.complete},
                                 {"missing_chunks", frame.progress.missing_chunks},
                                 {"missing_pages", frame.progress.missing_pages},
                                 {"missing_bytes", frame.progress.missing_bytes},
                                 {"repeat", options.repeat},
                                 {"seconds",
                                  {{"cut", median(timings.cut)},
                                   {"fetch", timings.fetch},
                                   {"upload", timings.upload},
                                   {"sort", median(timings.sort)},
                                   {"draw", median(timings.draw)},
                                   {"frame", median(timings.frame)},
                                   {"frame_min", std::ranges::min(timings.frame)},
                                   {"frame_max", std::ranges::max(timings.frame)}}},
                                 {"first_image_seconds", timings.first_image},
                                 {"renderer", drawing.context->description()}};
  for (const ProgressFrame& shown : timings.progress)
    json["progress_frames"].push_back({{"seconds", shown.seconds},
                                       {"advance_seconds", shown.advance},
                                       {"splats", shown.splats},
                                       {"bytes_read", shown.bytes_read},
                                       {"missing_bytes", shown.missing_bytes}});
  for (const PathFrame& drawn : timings.path)
    json["path_frames"].push_back({{"splats", drawn.splats}, {"fading", drawn.fading}, {"step", drawn.step}});
  if (frame.detail.goal) {
    if (options.max_error) json["max_error"] = *options.max_error;
    if (options.splats) json["max_splats"] = *options.splats;
    if (options.milliseconds) {
      json["milliseconds"] = *options.milliseconds;
      json["splats_while_pacing"] = timings.pacing;
    }
    json["effective_max_splats"] = frame.detail.goal->max_splats;
  } else {
    json["tolerance"] = options.detail.tolerance_percent;
    json["effective_tolerance"] = frame.detail.tolerance_percent;
  }
  if (frame.detail.resolution) {
    json["resolution"] = *options.detail.resolution;
    json["effective_resolution"] = *frame.detail.resolution;
  }
  return json;
}

// The statistics' file, made before the work: where it cannot be, the picture is not left alone.
Result<std::optional<AtomicFile>> create_statistics(const std::string& path) {
  if (path.empty() || path == "-") return std::optional<AtomicFile>();
  SPLATVOL_TRY_ASSIGN(file, AtomicFile::create(path));
  return std::optional<AtomicFile>(std::move(file));
}

// What became of the goal.
void print_goal(const Options& options, const Drawing& drawing) {
  const FrameSplats& frame = *drawing.frame;
  fmt::print("{}: {} splats, an error of {:.2g} expected\n", options.output, frame.splats, frame.expected_error);
  if (frame.splats > drawing.detail.goal->max_splats)
    fmt::print("{}: more than {} splats: the coarsest that the view has\n", options.output,
               drawing.detail.goal->max_splats);
  else if (options.max_error && frame.expected_error > *options.max_error)
    fmt::print("{}: more than {:.2g}, to stay within {} of memory and {} splats, or with all points\n", options.output,
               *options.max_error, options.memory, frame.detail.goal->max_splats);
}

void print_summary(const Options& options, const Scene& scene, const Drawing& drawing, const Timings& timings) {
  const FrameSplats& frame = *drawing.frame;
  fmt::print("{}: {} x {} pixels, {} splats in {} nodes, {} of {} bytes read, {:.3f} s\n", options.output, scene.width,
             scene.height, frame.splats, frame.nodes, drawing.streamer->statistics().bytes_read,
             drawing.streamer->volume().file_bytes(), timings.first_image);
  if (frame.detail.goal) {
    print_goal(options, drawing);
    return;
  }
  if (frame.detail.resolution && *frame.detail.resolution < *options.detail.resolution &&
      frame.splats_by_resolution.size() > *options.detail.resolution)
    fmt::print("{}: resolution {} instead of {}, to stay within {} of memory and {} splats\n", options.output,
               *frame.detail.resolution, *options.detail.resolution, options.memory, frame.detail.max_splats);
  if (!frame.detail.resolution && frame.detail.tolerance_percent > options.detail.tolerance_percent)
    fmt::print("{}: tolerance {:.3g} % instead of {:.3g} %, to stay within {} of memory and {} splats\n",
               options.output, frame.detail.tolerance_percent, options.detail.tolerance_percent, options.memory,
               frame.detail.max_splats);
}

// The pictures are there; that they are not what the file should show is for the exit code to say.
Status told(const std::vector<Error>& unreadable) {
  if (unreadable.empty()) return {};
  return fail(unreadable.front().code, "parts of the file that could not be read: {}", unreadable.size());
}

Status render(const Options& options) {
  const double start = seconds_now();
  SPLATVOL_TRY(check_outputs({options.output, options.stats}, {options.volume, options.scene}));
  SPLATVOL_TRY_ASSIGN(scene, read_scene(options));
  if (!options.progress_frames.empty() && !std::filesystem::is_directory(options.progress_frames))
    return fail(ErrorCode::io, "{}: no such folder", options.progress_frames);
  SPLATVOL_TRY_ASSIGN(statistics_file, create_statistics(options.stats));
  const auto view = make_view(scene);
  if (!view) return fail_in(options.scene, view.error());
  SPLATVOL_TRY_ASSIGN(drawing, prepare(options, scene));

  Timings timings;
  std::vector<Error> unreadable;
  if (!options.path.empty()) {
    SPLATVOL_TRY(draw_path(options, scene, drawing, timings));
  } else if (options.milliseconds) {
    SPLATVOL_TRY(pace(options, scene, *view, drawing, timings));
  } else if (options.progress_frames.empty()) {
    SPLATVOL_TRY(draw_frame(options, scene, *view, drawing, timings));
  } else {
    SPLATVOL_TRY_ASSIGN(errors, draw_progress(options, scene, *view, drawing, timings, start));
    unreadable = std::move(errors);
  }
  SPLATVOL_TRY_ASSIGN(image, drawing.renderer->read_image());
  timings.first_image = seconds_now() - start;
  SPLATVOL_TRY(write_image(options.output, image, scene.background, provenance_of(options, scene, drawing)));
  if (options.stats.empty()) {
    print_summary(options, scene, drawing, timings);
    return told(unreadable);
  }

  if (options.path.empty()) SPLATVOL_TRY(draw_steady_frames(options, scene, *view, drawing, timings));
  const std::string text =
      statistics_of(options, scene, drawing, timings).dump(1, ' ', false, nlohmann::json::error_handler_t::replace) +
      "\n";
  if (!statistics_file) {
    fmt::print("{}", text);
    return told(unreadable);
  }
  SPLATVOL_TRY(statistics_file->append(std::as_bytes(std::span(text))));
  SPLATVOL_TRY(statistics_file->commit());
  print_summary(options, scene, drawing, timings);
  return told(unreadable);
}

}  // namespace
}  // namespace splatvol

int main(int argc, char** argv) {
  using namespace splatvol;
  Options options;
  CLI::App app("Draws a .svol file as splats, as fine as the view needs.", "svrender");
  app.add_option("FILE", options.volume, "The .svol file, or its address (http:// or https://)")
      ->required()
      ->type_name("FILE.svol|URL");
  app.add_option("--scene", options.scene, "Scene file (JSON)")->required()->type_name("S.json");
  app.add_option("-o,--output", options.output, "Picture to write: .exr or .png")
      ->required()
      ->type_name("OUT")
      ->check([](const std::string& path) {
        return is_image_path(path) ? std::string() : "'" + path + "' ends in neither .exr nor .png";
      });
  auto* tolerance =
      app.add_option("--tolerance", options.detail.tolerance_percent,
                     "Largest share of the image's shorter side that one splat may cover; 0: all points")
          ->type_name("PERCENT")
          ->check([](const std::string& text) {
            return std::strtod(text.c_str(), nullptr) >= 0 ? std::string() : "'" + text + "' is not a number from 0 up";
          })
          ->capture_default_str();
  auto* resolution = app.add_option("--resolution", options.detail.resolution,
                                    "One resolution for everything, 0 the coarsest, instead of a tolerance")
                         ->check(CLI::NonNegativeNumber);
  const auto is_positive = [](const std::string& text) {
    return std::strtod(text.c_str(), nullptr) > 0 ? std::string() : "'" + text + "' is not a number above 0";
  };
  auto* max_error =
      app.add_option("--max-error", options.max_error,
                     "Expected error of the picture (root mean square of linear RGB), instead of a tolerance: as few "
                     "splats as do for it, where they gain most")
          ->type_name("RMSE")
          ->check(is_positive)
          ->excludes(tolerance)
          ->excludes(resolution);
  auto* splats = app.add_option("--splats", options.splats,
                                "The best picture that is expected of so many splats, instead of a tolerance")
                     ->check(is_positive)
                     ->excludes(tolerance)
                     ->excludes(resolution)
                     ->excludes(max_error);
  auto* milliseconds =
      app.add_option("--milliseconds", options.milliseconds,
                     "The same, of as many splats as are drawn in this time, which a few frames find out")
          ->check(is_positive)
          ->excludes(tolerance)
          ->excludes(resolution)
          ->excludes(max_error)
          ->excludes(splats);
  app.add_option("--kernel", options.kernel,
                 "How a splat looks: an ellipsoid that matches the material, or round as in the paper of 2001")
      ->check(CLI::IsMember({"moments", "octant"}))
      ->capture_default_str();
  app.add_option("--sort", options.sort,
                 "Order of drawing, back to front: none: by node; axis: along the axis nearest to the line of sight, "
                 "sorted once "
                 "for all views; exact: for each view")
      ->check(CLI::IsMember({"none", "axis", "exact"}))
      ->capture_default_str();
  app.add_option(
         "--sampling", options.sampling,
         "Pixels from one sample of the picture to the next, between which it is interpolated: 1 to 64, or auto: "
         "a twelfth of what the tolerance lets a splat cover, at most 6; 1 without one")
      ->type_name("PIXELS")
      ->check([](const std::string& text) {
        return text == "auto" ? std::string() : CLI::Range(1, max_sample_spacing)(text);
      })
      ->capture_default_str();
  app.add_option("--memory", options.memory,
                 "Bytes that the streamer may hold, such as 512M; detail is lost where it would need more")
      ->type_name("SIZE")
      ->check([](const std::string& text) {
        const auto bytes = parse_bytes(text);
        return bytes ? std::string() : bytes.error().message;
      })
      ->capture_default_str();
  app.add_option("--gpu-memory", options.gpu_memory, "Bytes that the renderer may hold on the graphics card; likewise")
      ->type_name("SIZE")
      ->check([](const std::string& text) {
        const auto bytes = parse_bytes(text);
        return bytes ? std::string() : bytes.error().message;
      })
      ->capture_default_str();
  app.add_option("--size", options.size, "Size of the picture in pixels, instead of the scene's")
      ->type_name("WxH")
      ->check([](const std::string& text) {
        const auto size = parse_image_size(text);
        return size ? std::string() : size.error().message;
      });
  app.add_option("--repeat", options.repeat, "Frames to draw for the times in the statistics")
      ->check(CLI::Range(1, 1000000))
      ->capture_default_str();
  app.add_option("--progress-frames", options.progress_frames,
                 "Draw what is there while the rest is read, and write each of these frames into this folder")
      ->type_name("DIR")
      ->excludes(milliseconds);
  app.add_option("--path", options.path,
                 "Draw FRAMES frames of a camera that turns round its focal point by DEGREES in all while its distance "
                 "becomes FACTOR times as long; --progress-frames writes them, --stats has the steps between them")
      ->type_name("FRAMES,DEGREES,FACTOR")
      ->excludes(milliseconds)
      ->delimiter(',')
      ->expected(3)
      ->check([](const std::string& text) {
        const double number = std::strtod(text.c_str(), nullptr);
        return std::isfinite(number) ? std::string() : "'" + text + "' is not a number";
      });
  app.add_option("--fade", options.fade,
                 "With --path or --progress-frames: how many frames a change of resolution takes")
      ->check(CLI::Range(1, 1000000))
      ->capture_default_str();
  app.add_option("--stats", options.stats, "Write statistics as JSON to this file, - for the terminal")
      ->type_name("OUT.json|-");
  return run_tool(app, argc, argv, [&] { return render(options); });
}
