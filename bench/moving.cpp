// Measures the pictures that a person sees while a hand moves: moving FILE --scene SCENE.json -o OUT.json
// Uses the viewer without a window, by a real clock. Events come when a hand would make them, however long the viewer
// draws. Keeps the pictures that were shown, and compares them with exact ones afterwards. bench/svbench moving
// runs it on several views, and judges what it wrote.
#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <nlohmann/json.hpp>

#include "base/file.h"
#include "base/json.h"
#include "bench/moving/hand.h"
#include "bench/moving/pictures.h"
#include "renderer/cpu/srgb_bytes.h"
#include "renderer/gl/context.h"
#include "scene/srgb.h"
#include "tools/command_line.h"
#include "tools/tool.h"
#include "viewer/frame_loop.h"
#include "viewer/viewer.h"
#include "viewer/window/byte_target.h"

namespace splatvol {
namespace {

using nlohmann::ordered_json;

struct Options {
  std::string volume, scene, output, dump;
  std::vector<std::string> scripts;
  std::string size = "1280x800", memory = "512M", exact_memory = "4G";
  bool has_panel = true;
  int compared = 16;  // moving pictures of a script
  double longest_rest = 8;
};

struct DrawnFrame {
  double begin, seconds;  // of all of it
  double window_seconds;  // besides drawing the picture
  std::uint64_t shown;    // number of the picture
};

// The parts of a scene that scripts change.
struct Changeable {
  explicit Changeable(const Scene& scene)
      : camera(scene.camera), function(scene.transfer_function), contours(scene.contours) {}

  void put_into(Scene& scene) const {
    scene.camera = camera;
    scene.transfer_function = function;
    scene.contours = contours;
  }
  [[nodiscard]] bool operator==(const Changeable&) const = default;

  Camera camera;
  TransferFunction function;
  std::vector<SceneContour> contours;
};

// A scene that a hand made, and the time of the last event of it.
struct Asked {
  Changeable scene;
  double time;
};

// The frames and pictures of a script. Times are seconds since its start.
struct Record {
  Script script;
  std::vector<DrawnFrame> frames = {};
  std::vector<Asked> asked = {};
  std::vector<KeptPicture> pictures = {};
  bool came_to_rest = false;
};

// A viewer and a hand at it.
class Bench {
 public:
  static Result<std::unique_ptr<Bench>> open(const Options& options);
  [[nodiscard]] Result<Record> run(const std::string& name);
  [[nodiscard]] std::size_t step_count() const { return session().times().size(); }
  [[nodiscard]] const Scene& first_scene() const { return session().first_scene(); }

 private:
  explicit Bench(const Options& options, const WindowResized& size)
      : options_(options), size_(size), keeper_(!options.dump.empty()) {}
  [[nodiscard]] PicturePlace place() const;
  [[nodiscard]] Session& session() const { return *viewer_->session(); }
  [[nodiscard]] Status note_frame(double begin, Record& record, const Hand& hand);
  [[nodiscard]] Result<bool> follow(Record& record, Hand& hand, const std::function<bool()>& is_done);
  [[nodiscard]] FrameInput input_of(const std::vector<Act>& acts);
  void move_contour(double share);
  [[nodiscard]] Status put_back();

  const Options& options_;
  WindowResized size_;
  PictureKeeper keeper_;
  ByteTarget framebuffer_;  // laid out like a window's
  std::unique_ptr<Viewer> viewer_;
  double last_input_ = 0;
  std::optional<Changeable> start_;  // of the script
  double asked_time_ = 0;
};

Result<std::unique_ptr<Bench>> Bench::open(const Options& options) {
  SPLATVOL_TRY_ASSIGN(size, parse_image_size(options.size));
  SPLATVOL_TRY_ASSIGN(memory, parse_bytes(options.memory));
  const WindowResized window{size[0], size[1], size[0], size[1], 1};
  std::unique_ptr<Bench> bench(new Bench(options, window));
  SPLATVOL_TRY(bench->framebuffer_.resize(window.width, window.height));
  ViewerOptions setup{.volume = options.volume, .scene = options.scene, .window = window};
  setup.settings.memory = memory;
  setup.settings.device = Device::cpu;
  setup.settings.on_picture = [keeper = &bench->keeper_](const CompletePicture& picture) { keeper->add(picture); };
  SPLATVOL_TRY_ASSIGN(viewer, Viewer::create(setup));
  bench->viewer_ = std::move(viewer);
  bench->last_input_ = seconds_now();
  // The first frames, up to the first picture.
  Hand idle({});
  Record dropped;
  FrameInput input{0, {window}};
  if (!options.has_panel)
    input.events.insert(input.events.end(), {KeyChanged{key::tab, true}, KeyChanged{key::tab, false}});
  bench->framebuffer_.use();
  SPLATVOL_TRY(bench->viewer_->frame(input));
  const auto has_picture = [&] { return bench->viewer_->session() && bench->session().shown_number() > 0; };
  SPLATVOL_TRY_ASSIGN(shows, bench->follow(dropped, idle, has_picture));
  if (!shows) return fail(ErrorCode::invalid_data, "{}: shows nothing", options.volume);
  return bench;
}

PicturePlace Bench::place() const {
  const double left = options_.has_panel ? ViewerState::panel_width : 0;
  return {left, size_.width - left, static_cast<double>(size_.height)};
}

// Does what the panel would do, and returns the events for the viewer.
FrameInput Bench::input_of(const std::vector<Act>& acts) {
  const double now = seconds_now();
  FrameInput input{now - std::exchange(last_input_, now), {}};
  for (const Act& act : acts) {
    if (act.event) input.events.push_back(*act.event);
    if (act.contour) move_contour(*act.contour);
    if (!act.opacity) continue;
    input.events.emplace_back(PointerMoved{0.5 * ViewerState::panel_width, 300 * *act.opacity / 3});
    session().scene.transfer_function = start_->function;
    for (auto& density : session().scene.transfer_function.densities) density.extinction *= *act.opacity;
  }
  if (!acts.empty()) asked_time_ = acts.back().seconds;
  return input;
}

void Bench::move_contour(double share) {
  const std::string& name = session().scene.attribute;
  const int number = std::max(0, session().info().find_attribute(name));
  const format::Attribute& attribute = session().info().attributes[static_cast<std::size_t>(number)];
  session().scene.contours[0].values[0] = start_->contours[0].values[0] + share * (attribute.max - attribute.min);
}

// Notes a frame that began at a time.
Status Bench::note_frame(double begin, Record& record, const Hand& hand) {
  const double end = hand.seconds();
  if (!viewer_->session()) return {};
  SPLATVOL_TRY(viewer_->drawn());
  const std::uint64_t shown = session().shown_number();
  keeper_.note_shown(shown, end);
  record.frames.push_back({begin, end - begin, viewer_->window_seconds(), shown});
  if (const Changeable scene(session().scene); record.asked.empty() || record.asked.back().scene != scene)
    record.asked.push_back({scene, asked_time_});
  return {};
}

// Follows the hand by svview's loop, until the end of a time or until `is_done`. Returns whether that came.
Result<bool> Bench::follow(Record& record, Hand& hand, const std::function<bool()>& is_done) {
  const double end = options_.longest_rest + (record.script.acts.empty() ? 0 : record.script.acts.back().seconds);
  std::optional<double> begin;
  FrameLoop loop(*viewer_, {.take_input = [&](double seconds) { return input_of(hand.take(seconds)); },
                            .begin =
                                [&](const FrameInput&) {
                                  framebuffer_.use();
                                  begin = hand.seconds();
                                  return Status();
                                },
                            .show = [] {}});
  while (hand.seconds() < end) {
    if (is_done()) return true;
    SPLATVOL_TRY(loop.step());
    if (begin) SPLATVOL_TRY(note_frame(*std::exchange(begin, {}), record, hand));
  }
  return false;
}

// Shows the view's scene again, and waits for its finest picture.
Status Bench::put_back() {
  Changeable(session().first_scene()).put_into(session().scene);
  Hand idle({});
  Record dropped;
  viewer_->redraw();
  SPLATVOL_TRY(viewer_->frame(input_of({})));
  return follow(dropped, idle, [this] { return viewer_->is_settled(); }).map([](bool) {});
}

Result<Record> Bench::run(const std::string& name) {
  Record record{.script = script_of(name, place())};
  if (record.script.begins_at_scene) SPLATVOL_TRY(put_back());
  start_ = Changeable(session().scene);
  static_cast<void>(keeper_.take_shown());
  asked_time_ = 0;
  Hand hand(record.script.acts);
  last_input_ = seconds_now();
  SPLATVOL_TRY_ASSIGN(came_to_rest, follow(record, hand, [&] { return hand.is_done() && viewer_->is_settled(); }));
  record.came_to_rest = came_to_rest;
  record.pictures = keeper_.take_shown();
  return record;
}

// Keeps the pixels of some pictures only: of an even choice of those that moved, and of all others.
void choose_compared(std::vector<KeptPicture>& pictures, int most) {
  const auto moving = std::ranges::count_if(pictures, [](const KeptPicture& picture) { return picture.recipe.moves; });
  std::ptrdiff_t number = 0;
  for (KeptPicture& picture : pictures) {
    if (!picture.recipe.moves) continue;
    const std::ptrdiff_t i = number++;
    if (moving <= most || (i + 1) * most / moving > i * most / moving) continue;
    picture.sample = {};
    picture.bytes = std::vector<std::uint8_t>();
  }
}

ordered_json json_of(const KeptPicture& picture, const std::vector<Asked>& asked) {
  ordered_json json = {{"number", picture.number},
                       {"shown", *picture.shown},
                       {"moves", picture.recipe.moves},
                       {"step", picture.step},
                       {"splats", picture.recipe.recipe.most_splats()},
                       {"spacing", picture.recipe.recipe.sample_spacing},
                       {"seconds", picture.seconds}};
  if (picture.recipe.moves) json["told_error"] = picture.recipe.error;
  const auto is_its = [&, scene = Changeable(picture.scene)](const Asked& other) {
    return other.time <= *picture.shown && other.scene == scene;
  };
  const auto found = std::find_if(asked.rbegin(), asked.rend(), is_its);
  if (found != asked.rend()) {
    json["asked"] = found->time;
    json["is_last"] = found == asked.rbegin();
  }
  return json;
}

// A picture and the exact one side by side.
Status dump(const std::string& path, const KeptPicture& picture, ExactPictures& exact) {
  SPLATVOL_TRY_ASSIGN(true_picture, exact.picture_of(picture.scene, picture.step));
  std::vector<std::uint8_t> true_bytes;
  encode_srgb(true_picture, picture.scene.background, true_bytes);
  const int width = picture.scene.width, height = picture.scene.height;
  Image both{2 * width, height, std::vector<vec4>(std::size_t{2} * width * height)};
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const std::size_t i = 4 * (static_cast<std::size_t>(y) * width + x);
      const auto pixel = [i](const std::vector<std::uint8_t>& bytes) {
        return vec4(linear_of_byte(bytes[i]), linear_of_byte(bytes[i + 1]), linear_of_byte(bytes[i + 2]), 1);
      };
      both.at(x, y) = pixel(picture.bytes);
      both.at(x + width, y) = pixel(true_bytes);
    }
  return write_image(path, both, dvec3(0), {});
}

// Compares the pictures of a script. Writes the worst of those that moved into a folder, if there is one.
Result<ordered_json> judged(const Record& record, ExactPictures& exact, const Options& options) {
  ordered_json pictures = ordered_json::array();
  const KeptPicture* worst = nullptr;
  double most = 0;
  for (const KeptPicture& picture : record.pictures) {
    ordered_json json = json_of(picture, record.asked);
    if (!picture.sample.pixels.empty()) {
      SPLATVOL_TRY_ASSIGN(true_sample, exact.sample_of(picture.scene, picture.step));
      const Differences differences = compare(*true_sample, picture.sample, picture.scene.background);
      json["rmse"] = differences.rmse;
      json["srgb_rmse"] = differences.srgb_rmse;
      if (differences.light) json["light"] = *differences.light;
      if (differences.alpha) json["alpha"] = *differences.alpha;
      if (picture.recipe.moves && differences.rmse >= most) worst = &picture, most = differences.rmse;
    }
    pictures.push_back(std::move(json));
  }
  if (worst && !options.dump.empty())
    SPLATVOL_TRY(dump(fmt::format("{}/{}.png", options.dump, record.script.name), *worst, exact));
  return pictures;
}

Result<ordered_json> json_of(const Record& record, ExactPictures& exact, const Options& options) {
  SPLATVOL_TRY_ASSIGN(pictures, judged(record, exact, options));
  ordered_json motions = ordered_json::array(), frames = ordered_json::array();
  for (const Motion& motion : record.script.motions) motions.push_back({motion.begin, motion.end});
  for (const DrawnFrame& frame : record.frames)
    frames.push_back({frame.begin, frame.seconds, frame.window_seconds, frame.shown});
  return ordered_json{{"name", record.script.name},
                      {"motions", motions},
                      {"is_steady", record.script.is_steady},
                      {"came_to_rest", record.came_to_rest},
                      {"has_cells", exact.has_cells()},
                      {"pictures", pictures},
                      {"frames", frames}};
}

Result<std::vector<Record>> run_scripts(const Options& options, Scene& scene) {
  SPLATVOL_TRY_ASSIGN(context, HeadlessContext::create());
  SPLATVOL_TRY_ASSIGN(bench, Bench::open(options));
  scene = bench->first_scene();
  std::vector<Record> records;
  for (const std::string& name : script_names()) {
    const bool is_wanted = options.scripts.empty() || std::ranges::find(options.scripts, name) != options.scripts.end();
    if (!is_wanted || (name == "play" && bench->step_count() < 2)) continue;
    if (name == "contour" && scene.contours.empty()) continue;
    SPLATVOL_TRY_ASSIGN(record, bench->run(name));
    choose_compared(record.pictures, options.compared);
    records.push_back(std::move(record));
  }
  return records;
}

Status run(const Options& options) {
  SPLATVOL_TRY(check_outputs({options.output}, {options.volume, options.scene}));
  SPLATVOL_TRY_ASSIGN(exact_memory, parse_bytes(options.exact_memory));
  Scene scene;
  SPLATVOL_TRY_ASSIGN(records, run_scripts(options, scene));
  SPLATVOL_TRY_ASSIGN(exact, ExactPictures::open(options.volume, scene, exact_memory));
  ordered_json scripts = ordered_json::array();
  for (const Record& record : records) {
    SPLATVOL_TRY_ASSIGN(json, json_of(record, exact, options));
    scripts.push_back(std::move(json));
  }
  return write_text_file(options.output, json_text(ordered_json{{"scripts", scripts}}) + "\n");
}

}  // namespace
}  // namespace splatvol

int main(int argc, char** argv) {
  using namespace splatvol;
  CommandLine app("Uses the viewer by a real clock, and compares what it shows with exact pictures.", "moving");
  Options options;
  app.add_option("volume", options.volume, "The .svol file")->required();
  app.add_option("--scene", options.scene, "The view; default: one that fits the data");
  app.add_option("-o,--output", options.output, "Where to write what happened")->required()->check(check_json_path);
  app.add_option("--scripts", options.scripts, "What the hand does; default: all")
      ->one_of(script_names())
      ->delimiter(',');
  app.add_option("--size", options.size, "Size of the window")
      ->capture_default_str()
      ->check(check_of(parse_image_size));
  app.add_option("--memory", options.memory, "As svview's")->capture_default_str()->check(check_of(parse_bytes));
  app.add_option("--exact-memory", options.exact_memory, "Memory to draw exact pictures")
      ->capture_default_str()
      ->check(check_of(parse_bytes));
  app.add_option("--compared", options.compared, "Compare so many moving pictures of each script")
      ->range(1, 1000)
      ->capture_default_str();
  app.add_option("--longest-rest", options.longest_rest, "Wait so many seconds for a picture at rest")
      ->range(0.0, 1000.0)
      ->capture_default_str();
  app.add_option("--dump", options.dump, "Folder for the worst moving picture of each script, beside the exact one")
      ->existing_folder();
  app.add_flag(
      "--no-panel", [&] { options.has_panel = false; }, "Hide the panel: the picture fills the window");
  return run_tool(app, argc, argv, [&] { return run(options); });
}
