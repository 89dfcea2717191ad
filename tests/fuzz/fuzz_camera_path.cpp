// Camera paths and recordings of svview: read, written and read again. The first character tells which.
#include <cmath>
#include <string>

#include "player/camera_path.h"
#include "player/events.h"
#include "tests/fuzz/fuzz.h"

using namespace splatvol;
using splatvol::fuzz::require;
using splatvol::fuzz::require_ok;

namespace {

template <class Load>
auto load(std::span<const std::byte> bytes, const Load& load_file) {
  const fuzz::NamedBytes file(bytes);
  return load_file(file.path());
}

void check_path(std::span<const std::byte> bytes) {
  const auto path = load(bytes, load_camera_path);
  if (!path) return;
  const std::string written = path_to_json(*path);
  const auto again = load(std::as_bytes(std::span(written)), load_camera_path);
  require_ok(again, "a written path can be read");
  require(again->seconds == path->seconds && again->cameras == path->cameras, "a path comes back");
  for (const double part : {0.0, 0.1, 0.5, 0.99, 1.0, 2.0}) {
    const Camera camera = camera_at(*path, part);
    require(!std::isnan(camera.position.x) && !std::isnan(camera.up.y), "cameras between are numbers");
  }
}

void check_recording(std::span<const std::byte> bytes) {
  const auto frames = load(bytes, load_recording);
  if (!frames) return;
  std::string written;
  for (const FrameInput& frame : *frames) written += to_line(frame);
  const auto again = load(std::as_bytes(std::span(written)), load_recording);
  require_ok(again, "a written recording can be read");
  std::string last;
  for (const FrameInput& frame : *again) last += to_line(frame);
  require(last == written, "a recording comes back");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const auto rest = fuzz::bytes_of(data + 1, size - 1);
  if (data[0] == 'c') check_path(rest);
  if (data[0] == 'r') check_recording(rest);
  return 0;
}
