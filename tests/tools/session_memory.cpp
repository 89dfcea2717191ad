// Looks at a file as svview does, with its threads but no window: session_memory FILE --memory SIZE. Ends with exit
// code 1 if a picture fails, or if there is none that is exact at rest.
#include <chrono>
#include <string>
#include <thread>
#include <vector>

#include "player/camera_control.h"
#include "player/session.h"
#include "player/thread_host.h"
#include "tools/command_line.h"
#include "tools/tool.h"

namespace splatvol {
namespace {

constexpr int width = 320, height = 240;
constexpr double frame_seconds = 1.0 / 60;

Status draw_frame(Session& session, double seconds) {
  SPLATVOL_TRY(session.draw(width, height, seconds));
  SPLATVOL_TRY(session.shown_picture());
  return {};
}

// Until the finest picture is there, and what may be read ahead.
Status rest(Session& session) {
  do {
    SPLATVOL_TRY(draw_frame(session, 1));
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  } while (!session.is_settled() || session.is_reading_ahead());
  if (!session.troubles().empty()) return fail(ErrorCode::invalid_data, "{}", session.troubles().back());
  if (!session.exact()) return fail(ErrorCode::invalid_data, "{}: no exact picture", session.path());
  return {};
}

Status turn(Session& session) {
  constexpr int frames = 8;
  for (int frame = 0; frame < frames; ++frame) {
    orbit(session.scene.camera, {width, height}, {20, 5});
    SPLATVOL_TRY(draw_frame(session, frame_seconds));
    while (session.awaits_picture()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return {};
}

Status show_contour_and_slice(Session& session) {
  const format::Attribute shown = session.attribute();
  session.scene.contours = {{.values = {0.5 * (shown.min + shown.max)}, .opacity = 0.5}};
  session.scene.slices = {{.point = 0.5 * (session.bounds().low + session.bounds().high), .normal = {1, 2, 3}}};
  return {};
}

Status show_other_attribute(Session& session) {
  session.show_attribute(session.info().attributes[1].name);
  return {};
}

Status show_other_step(Session& session) {
  session.choose_step(0);
  return {};
}

Status look(const std::string& path, std::uint64_t memory) {
  ThreadHost host;
  const ViewSettings settings{
      .memory = memory, .device = Device::cpu, .in_current_context = false, .quality = {.exact = true}};
  SPLATVOL_TRY_ASSIGN(session, Session::open(path, "", settings, host));
  SPLATVOL_TRY(rest(*session));
  for (const auto change : {turn, show_contour_and_slice, turn, show_other_attribute, show_other_step}) {
    SPLATVOL_TRY(change(*session));
    SPLATVOL_TRY(rest(*session));
  }
  return {};
}

}  // namespace
}  // namespace splatvol

int main(int argc, char** argv) {
  using namespace splatvol;
  CommandLine app("Looks at a file without a window.", "session_memory");
  std::string file, memory;
  app.add_option("file", file, "The .svol file")->required();
  app.add_option("--memory", memory, "As svview's")->required()->check(check_of(parse_bytes));
  return run_tool(app, argc, argv, [&]() -> Status {
    SPLATVOL_TRY_ASSIGN(bytes, parse_bytes(memory));
    return look(file, bytes);
  });
}
