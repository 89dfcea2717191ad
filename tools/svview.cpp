// svview: a .svol file in a window.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>
#include <tuple>

#include "base/file.h"
#include "base/json.h"
#include "pictures/image.h"
#include "player/camera_path.h"
#include "renderer/gl/context.h"
#include "tools/reading.h"
#include "tools/scene_options.h"
#include "tools/tool.h"
#include "tools/version.h"
#include "viewer/frame_loop.h"
#include "viewer/page_of.h"
#include "viewer/viewer.h"
#include "viewer/window/byte_target.h"
#include "viewer/window/window.h"

namespace splatvol {
namespace {

struct Options {
  std::string volume;
  std::vector<std::string> files;  // as given: the volume, or the files of a mesh
  std::string scene;
  std::string size = "1200x800";
  std::string memory = default_memory(512);
  std::string gpu_memory = "1G";
  std::string device = "auto";
  ReadingOptions reading;  // of surfaces
  std::optional<std::size_t> step;
  std::string kernel;
  Quality quality;
  MotionLimits moving;
  double moving_milliseconds = 1e3 * MotionLimits().seconds;
  std::string record;      // file; empty: none
  std::string replay;      // file
  std::string screenshot;  // file
  std::string stats;       // file
  bool in_window = false;
  std::string play;    // camera path
  std::string frames;  // folder for its frames
  double fps = 30;
};

constexpr double frame_seconds = 1.0 / 60;
constexpr double picture_wait_seconds = 0.002;  // from one look for a picture to the next

Result<ViewerOptions> viewer_options(const Options& options) {
  SPLATVOL_TRY_ASSIGN(memory, parse_bytes(options.memory));
  SPLATVOL_TRY_ASSIGN(gpu_memory, parse_bytes(options.gpu_memory));
  SPLATVOL_TRY_ASSIGN(device, parse_device(options.device));
  ViewerOptions setup{.volume = options.volume, .scene = options.scene, .settings = {}};
  setup.settings.memory = memory;
  setup.settings.gpu_memory = gpu_memory;
  setup.settings.device = device;
  setup.settings.moving = {options.moving.max_error, 1e-3 * options.moving_milliseconds};
  setup.use = {
      .file = options.volume,
      .pieces = {options.files.begin() + std::min<std::ptrdiff_t>(1, std::ssize(options.files)), options.files.end()},
      .step = options.step,
      .quality = options.quality,
      .drawing = {.kernel = kernel_named(options.kernel)}};
  SPLATVOL_TRY_ASSIGN(reader_options, reader_options_of(options.reading, 0));
  setup.settings.read_surface = surface_reader(reader_options);
  return setup;
}

Result<WindowResized> window_size(const Options& options) {
  SPLATVOL_TRY_ASSIGN(size, parse_image_size(options.size));
  return WindowResized{size[0], size[1], size[0], size[1], 1};
}

// Fails if a recording would replace another file.
Status check_recording(const std::string& path) {
  std::error_code error;
  if (!std::filesystem::exists(path, error) || std::filesystem::is_empty(path, error) || load_recording(path))
    return {};
  return fail(ErrorCode::invalid_argument, "{}: is there and is no recording: remove it, or give another name", path);
}

Status look(const Options& options) {
  SPLATVOL_TRY_ASSIGN(size, window_size(options));
  SPLATVOL_TRY_ASSIGN(setup, viewer_options(options));
  setup.recent_files = usual_recent_files_path();
  SPLATVOL_TRY_ASSIGN(window, Window::open(size.width, size.height, "svview"));
  setup.clipboard = window->clipboard();
  setup.window = window->size();
  SPLATVOL_TRY_ASSIGN(viewer, Viewer::create(setup));
  window->set_title(viewer->title());
  std::string title = viewer->title();
  std::optional<RecordingFile> recording;
  if (!options.record.empty()) {
    SPLATVOL_TRY_ASSIGN(file, RecordingFile::create(options.record));
    recording.emplace(std::move(file));
  }
  const auto record = [&](const FrameInput& input) { return recording ? recording->add(input) : Status{}; };
  FrameLoop loop(*viewer, {.take_input = [&](double seconds) { return window->take_input(seconds); },
                           .begin = record,
                           .show = [&] { window->swap(); }});
  while (!window->should_close() && !viewer->wants_to_close()) {
    SPLATVOL_TRY(loop.step());
    if (viewer->title() != title) window->set_title(title = viewer->title());
  }
  return {};
}

// A recording is drawn onto a stage: a window, or a picture instead.
class Stage {
 public:
  static Result<std::unique_ptr<Stage>> create(bool in_window, const WindowResized& size) {
    auto stage = std::make_unique<Stage>();
    if (in_window) {
      SPLATVOL_TRY(store(Window::open(size.width, size.height, "svview"), stage->window_));
      return stage;
    }
    SPLATVOL_TRY(store(HeadlessContext::create(), stage->context_));
    stage->target_.emplace();
    return stage;
  }

  // Prepares for a frame of this size.
  Status begin(const WindowResized& size) {
    if (!target_) return {};
    SPLATVOL_TRY(target_->resize(std::max(1, size.pixel_width), std::max(1, size.pixel_height)));
    target_->use();
    return {};
  }
  void end(const Viewer& viewer) {
    if (!window_) return;
    if (viewer.has_drawn()) window_->swap();
    static_cast<void>(window_->take_input(0));  // dropped: only the recording's events count
  }

 private:
  std::unique_ptr<HeadlessContext> context_;
  std::unique_ptr<Window> window_;
  std::optional<ByteTarget> target_;
};

const WindowResized* last_size(const FrameInput& input) {
  const WindowResized* size = nullptr;
  for (const Event& event : input.events)
    if (const auto* resized = std::get_if<WindowResized>(&event)) size = resized;
  return size;
}

struct ReplayTimes {
  double first_picture = 0;  // seconds from the program's start
  std::vector<double> frames;
  std::vector<std::uint64_t> splats;  // of each frame
  double rest = 0;                    // from the last event to the finest picture
};

// Returns the recording's frames. The first one has the window's size.
Result<std::vector<FrameInput>> load_inputs(const Options& options) {
  std::vector<FrameInput> inputs;
  if (!options.replay.empty()) {
    SPLATVOL_TRY(store(load_recording(options.replay), inputs));
  }
  if (inputs.empty() || !last_size(inputs.front())) {
    SPLATVOL_TRY_ASSIGN(size, window_size(options));
    inputs.insert(inputs.begin(), {frame_seconds, {size}});
  }
  return inputs;
}

// Draws the recording's frames, then frames without events until nothing changes any more. Returns the last size.
Result<WindowResized> draw_inputs(const std::vector<FrameInput>& inputs, double start, Stage& stage, Viewer& viewer,
                                  ReplayTimes& times) {
  WindowResized size{};
  const auto draw = [&](const FrameInput& input) -> Status {
    if (const WindowResized* resized = last_size(input)) size = *resized;
    SPLATVOL_TRY(stage.begin(size));
    return viewer.frame(input);
  };
  for (const FrameInput& input : inputs) {
    const double frame_start = seconds_now();
    SPLATVOL_TRY(draw(input));
    glFinish();
    times.frames.push_back(seconds_now() - frame_start);
    const FrameSplats* drawn = viewer.session() ? viewer.session()->frame() : nullptr;
    times.splats.push_back(drawn ? drawn->splats : 0);
    if (times.first_picture == 0) times.first_picture = seconds_now() - start;
    stage.end(viewer);
  }
  viewer.end_recording();
  const FrameInput idle{1, {}};  // seconds: longer than any change takes
  const double rest_start = seconds_now();
  SPLATVOL_TRY(draw(idle));
  while (!viewer.is_settled()) {
    if (viewer.awaits_picture()) {
      std::this_thread::sleep_for(std::chrono::duration<double>(picture_wait_seconds));
      continue;
    }
    stage.end(viewer);
    SPLATVOL_TRY(draw(idle));
  }
  times.rest = seconds_now() - rest_start;
  viewer.redraw();  // a window that was swapped has lost the frame
  SPLATVOL_TRY(draw({0, {}}));
  return size;
}

// The pictures are written; the exit code says that they lack parts of the file.
Status failure_of(const std::vector<std::string>& unreadable) {
  if (unreadable.empty()) return {};
  return fail(ErrorCode::invalid_data, "parts of the file that could not be read: {}, the first: {}", unreadable.size(),
              unreadable.front());
}

void tell_left_out(const Session& session) {
  if (const auto left_out = session.left_out())
    fmt::print(stderr, "svview: {}: --memory grants more\n", left_out->message);
}

// Draws a recording and writes the statistics and the last picture.
Status replay(const Options& options) {
  const double start = seconds_now();
  SPLATVOL_TRY_ASSIGN(inputs, load_inputs(options));
  SPLATVOL_TRY_ASSIGN(setup, viewer_options(options));
  setup.settings.works_aside = false;  // the next event may need it
  SPLATVOL_TRY_ASSIGN(stage, Stage::create(options.in_window, *last_size(inputs.front())));
  setup.window = *last_size(inputs.front());
  SPLATVOL_TRY_ASSIGN(viewer, Viewer::create(setup));
  ReplayTimes times;
  SPLATVOL_TRY_ASSIGN(size, draw_inputs(inputs, start, *stage, *viewer, times));
  SPLATVOL_TRY(viewer->drawn());
  if (!options.stats.empty()) {
    const nlohmann::ordered_json statistics = {{"first_picture_seconds", times.first_picture},
                                               {"frame_seconds", times.frames},
                                               {"frame_splats", times.splats},
                                               {"rest_seconds", times.rest}};
    SPLATVOL_TRY(write_text_file(options.stats, json_text(statistics, 1) + "\n"));
  }
  if (!options.screenshot.empty()) {
    SPLATVOL_TRY_ASSIGN(image, read_framebuffer(std::max(1, size.pixel_width), std::max(1, size.pixel_height)));
    SPLATVOL_TRY(write_image(options.screenshot, image, dvec3(0), {{"software", "svview " SPLATVOL_VERSION}}));
  }
  if (!viewer->session()) return {};
  tell_left_out(*viewer->session());
  return failure_of(viewer->session()->troubles());
}

// Writes the frames of a camera path, each with its finest picture.
Status play(const Options& options) {
  SPLATVOL_TRY_ASSIGN(path, load_camera_path(options.play));
  SPLATVOL_TRY_ASSIGN(size, parse_image_size(options.size));
  SPLATVOL_TRY_ASSIGN(setup, viewer_options(options));
  SPLATVOL_TRY(make_folder(options.frames));
  setup.settings.in_current_context = false;
  setup.settings.hurries = false;
  SPLATVOL_TRY_ASSIGN(file, Session::read(setup.use, setup.scene, setup.settings));
  InlineHost host;
  SPLATVOL_TRY_ASSIGN(session, Session::open(std::move(file), host));
  const int count = std::max(1, static_cast<int>(std::lround(path.seconds * options.fps)));
  SPLATVOL_TRY_ASSIGN(page, lay_out_page(size[0], size[1], {}));
  ProgressBar bar("draw");
  for (int i = 0; i < count; ++i) {
    session->scene.camera = camera_at(path, count > 1 ? static_cast<double>(i) / (count - 1) : 0);
    do SPLATVOL_TRY(session->draw(size[0], size[1], 1));
    while (!session->is_settled());
    SPLATVOL_TRY_ASSIGN(image, page_of(*session, page, {}));
    SPLATVOL_TRY(write_image(fmt::format("{}/frame-{:05}.png", options.frames, i), image, session->scene.background,
                             {{"software", "svview " SPLATVOL_VERSION}, {"file", session->path()}}));
    bar.update((i + 1.0) / count);
  }
  tell_left_out(*session);
  return failure_of(session->troubles());
}

Status run(Options options) {
  if (!options.files.empty()) options.volume = options.files[0];
  if (options.scene.empty() && options.volume.ends_with(".json")) options.scene = std::exchange(options.volume, "");
  if (!options.record.empty()) SPLATVOL_TRY(check_recording(options.record));
  SPLATVOL_TRY(check_outputs({options.record, options.screenshot, options.stats},
                             {options.volume, options.scene.starts_with('{') ? "" : options.scene, options.replay}));
  if (!options.play.empty()) return play(options);
  if (!options.replay.empty() || !options.screenshot.empty()) return replay(options);
  return look(options);
}

void add_view_options(CommandLine& app, Options& options) {
  app.add_option("volume", options.files,
                 "The .svol file, the index of a series of files (.svols), or its address (https://..., ssh://...); a "
                 "scene that "
                 "names one; or a mesh or points, in one file, several files or a folder, which svbuild converts and "
                 "keeps in its cache")
      ->type_name("FILE.svol|URL|S.json|MESH...");
  app.add_option("--scene", options.scene,
                 "Scene to begin with (docs/scene.md), as a file or as its text; default: one that fits the data")
      ->type_name("S.json|TEXT");
  app.add_option("--step", options.step, "Number of the time step to begin with; default: the scene's, or the last")
      ->type_name("N");
  app.add_option("--size", options.size, "Size of the window")
      ->type_name("WxH")
      ->capture_default_str()
      ->check(check_of(parse_image_size));
  for (const auto& [name, value, what] :
       {std::tuple{"--memory", &options.memory, "Memory for what is read of the file, and while it is drawn"},
        std::tuple{"--gpu-memory", &options.gpu_memory, "Memory of the graphics card for splats and picture"}})
    app.add_option(name, *value, what)->type_name("SIZE")->capture_default_str()->check(check_of(parse_bytes));
  add_reading_options(app, options.reading);
  auto* max_error =
      app.add_option("--max-error", options.quality.max_error,
                     fmt::format("Error of the picture at rest (root mean square of linear RGB): finer and finer "
                                 "pictures up to it; all points of a file with up to {}",
                                 fmt::group_digits(most_points_at_once)))
          ->type_name("RMSE")
          ->check(check_positive)
          ->default_str(fmt::format("{}", default_max_error));
  app.add_option("--tolerance", options.quality.tolerance_percent,
                 "Percent of the picture that a splat may cover, at rest, instead of an error; 0: all points")
      ->type_name("PERCENT")
      ->range(0.0, 100.0)
      ->check(check_finite)
      ->excludes(max_error);
  app.add_option("--moving-error", options.moving.max_error,
                 "Error that pictures may have while something moves; for less error, they come more slowly")
      ->type_name("RMSE")
      ->check(check_positive)
      ->capture_default_str();
  app.add_option("--moving-milliseconds", options.moving_milliseconds,
                 "Longest time of one of these pictures; twice that where its error would show as a false colour")
      ->type_name("T")
      ->check(check_positive)
      ->capture_default_str();
  add_device_option(app, options.device, "OpenGL if it runs on a graphics card, else the processor");
  app.add_option("--kernel", options.kernel, "Shape of a splat, as in svrender")
      ->one_of({"moments", "octant"})
      ->default_str("moments");
}

void add_recording_options(CommandLine& app, Options& options) {
  auto* record = app.add_option("--record", options.record, "Write all that is done in the window into this file")
                     ->type_name("OUT");
  auto* replayed =
      app.add_option("--replay", options.replay, "Draw a recording without a window, then end")->type_name("RECORDING");
  auto* screenshot =
      app.add_option("--screenshot", options.screenshot,
                     "Write the last picture, after --replay, into this file (.png, .exr); no window is opened")
          ->type_name("OUT")
          ->check(check_image_path);
  app.add_option("--stats", options.stats, "With --replay: write each frame's time as JSON to this file")
      ->type_name("OUT.json")
      ->check(check_json_path)
      ->needs(replayed);
  app.add_flag("--window", options.in_window, "Replay in a window");
  auto* path = app.add_option("--play", options.play, "Draw the frames of a camera path, without a window")
                   ->type_name("PATH.json")
                   ->needs(app.get_option("volume"));
  path->needs(app.add_option("--frames", options.frames, "Folder for these frames")->type_name("DIR")->needs(path));
  app.add_option("--fps", options.fps, "Frames for each second of the path")
      ->range(0.01, 1000.0)
      ->check(check_finite)
      ->capture_default_str();
  record->excludes(replayed)->excludes(screenshot)->excludes(path);
}

}  // namespace
}  // namespace splatvol

int main(int argc, char** argv) {
  using namespace splatvol;
  CommandLine app(
      "Shows a mesh or a .svol file in a window: turn, zoom, edit the transfer function. F1 there lists the keys.",
      "svview");
  Options options;
  add_view_options(app, options);
  add_recording_options(app, options);
  return run_tool(app, argc, argv, [&] { return run(options); });
}
