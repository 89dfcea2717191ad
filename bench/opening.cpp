// A mesh that is opened in the window: opening MESH...
// Draws without a window, at 60 frames a second at most. Tells when the first picture came, and the picture of the
// whole mesh; and meanwhile, how long frames of the interface took, and how long it took from a key to its picture: a
// key is pressed four times a second. SPLATVOL_CACHE chooses the cache; a mesh that it has is not converted.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <optional>
#include <thread>
#include <vector>

#include "base/json.h"
#include "renderer/gl/context.h"
#include "tools/command_line.h"
#include "tools/tool.h"
#include "viewer/viewer.h"
#include "viewer/window/byte_target.h"

namespace splatvol {
namespace {

constexpr double frame_seconds = 1.0 / 60;
constexpr double seconds_between_keys = 0.25;

// Returns the value that this share of the values does not exceed; NaN if there is none.
double quantile(std::vector<double> values, double share) {
  if (values.empty()) return std::nan("");
  std::ranges::sort(values);
  return values[static_cast<std::size_t>(std::ceil(share * static_cast<double>(values.size() - 1)))];
}

struct Times {
  double first_picture = 0, whole_picture = 0;  // seconds from the start
  bool had_preview = false;
  std::vector<double> frames;  // seconds that a frame took besides its picture
  std::vector<double> keys;    // seconds from a key to the first picture that it has changed
};

// A key that turns the view, until a picture shows it.
class Key {
 public:
  std::vector<Event> press(double now) {
    asked_ = now;
    code_ = code_ == '1' ? '2' : '1';
    return {KeyChanged{code_, true}, KeyChanged{code_, false}};
  }
  [[nodiscard]] bool is_due(double now) const { return !waits() && now - asked_ >= seconds_between_keys; }
  [[nodiscard]] bool waits() const { return waited_for_.has_value(); }
  void wait_for(const Camera& camera) { waited_for_ = camera; }
  void note_picture(const Camera& shown, double now, Times& times) {
    if (!waited_for_ || !(shown == *waited_for_)) return;
    times.keys.push_back(now - asked_);
    waited_for_.reset();
  }
  void forget() { waited_for_.reset(); }

 private:
  int code_ = '1';
  double asked_ = 0;
  std::optional<Camera> waited_for_;
};

Result<Times> open_mesh(const std::vector<std::string>& files) {
  constexpr int width = 1280, height = 800;
  SPLATVOL_TRY_ASSIGN(context, HeadlessContext::create());
  ByteTarget target;
  SPLATVOL_TRY(target.resize(width, height));
  Times times;
  Key key;
  ViewerOptions setup{.volume = files[0], .window = {width, height, width, height, 1}};
  setup.use.pieces = {files.begin() + 1, files.end()};
  setup.settings.on_picture = [&](const CompletePicture& picture) {
    key.note_picture(picture.scene.camera, seconds_now(), times);
  };
  const double start = seconds_now();
  SPLATVOL_TRY_ASSIGN(viewer, Viewer::create(setup));
  const Session* shown = nullptr;
  for (FrameInput input{0, {setup.window}};; input = {frame_seconds, {}}) {
    const double begin = seconds_now();
    const bool presses = shown && key.is_due(begin);
    if (presses) input.events = key.press(begin);
    target.use();
    SPLATVOL_TRY(viewer->frame(input));
    times.frames.push_back(viewer->window_seconds());
    const Session* session = viewer->session();
    if (session != shown) key.forget();
    shown = session;
    if (presses && session && !key.waits()) key.wait_for(session->scene.camera);
    const bool has_picture = session && session->shown_number() > 0;
    if (has_picture && times.first_picture == 0) times.first_picture = seconds_now() - start;
    if (has_picture && !session->converted()) times.had_preview = true;
    if (has_picture && session->converted()) break;
    for (const Messages::Message& message : viewer->messages().all())
      if (message.is_error) return fail(ErrorCode::io, "{}", message.text);
    const double left = frame_seconds - (seconds_now() - begin);
    if (left > 0) std::this_thread::sleep_for(std::chrono::duration<double>(left));
  }
  times.whole_picture = seconds_now() - start;
  return times;
}

Status measure(const std::vector<std::string>& files) {
  SPLATVOL_TRY_ASSIGN(times, open_mesh(files));
  const nlohmann::ordered_json document = {{"first_picture_seconds", times.first_picture},
                                           {"had_preview", times.had_preview},
                                           {"whole_picture_seconds", times.whole_picture},
                                           {"frames", times.frames.size()},
                                           {"frame_milliseconds_median", 1e3 * quantile(times.frames, 0.5)},
                                           {"frame_milliseconds_99", 1e3 * quantile(times.frames, 0.99)},
                                           {"keys", times.keys.size()},
                                           {"key_milliseconds_median", 1e3 * quantile(times.keys, 0.5)},
                                           {"key_milliseconds_95", 1e3 * quantile(times.keys, 0.95)}};
  fmt::print("{}\n", json_text(document, 1));
  return {};
}

}  // namespace
}  // namespace splatvol

int main(int argc, char** argv) {
  using namespace splatvol;
  std::vector<std::string> files;
  CommandLine app("Opens a mesh in the viewer, and tells how soon it is seen.", "opening");
  app.add_option("files", files, "The files of the mesh")->required();
  return run_tool(app, argc, argv, [&] { return measure(files); });
}
