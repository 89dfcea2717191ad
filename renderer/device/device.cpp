#include "renderer/device/device.h"

#include <algorithm>
#include <array>
#include <cstddef>

#include "renderer/cpu/tile_rasterizer.h"
#ifdef SPLATVOL_OPENGL
#include "renderer/gl/gl_rasterizer.h"
#endif

namespace splatvol {
namespace {

struct Listed {
  Device device;
  std::string_view name;
  Result<std::unique_ptr<Rasterizer>> (*make)(const RasterizerOptions& options, bool is_automatic);  // null: not built
};

#ifdef SPLATVOL_OPENGL
constexpr auto make_gl = &GlRasterizer::make;
#else
constexpr std::nullptr_t make_gl = nullptr;
#endif

// In the order in which `automatic` tries them. The last one cannot fail.
constexpr std::array devices = {Listed{Device::gl, "gl", make_gl}, Listed{Device::cpu, "cpu", &TileRasterizer::make}};

}  // namespace

Result<Device> parse_device(std::string_view name) {
  if (name == "auto") return Device::automatic;
  const auto* listed = std::ranges::find(devices, name, &Listed::name);
  if (listed == devices.end())
    return fail(ErrorCode::invalid_argument, "'{}' is no device: auto, cpu and gl are", name);
  if (listed->make) return listed->device;
  return fail(ErrorCode::invalid_argument, "this program was built without OpenGL: take --device cpu");
}

Result<std::unique_ptr<Rasterizer>> make_rasterizer(Device device, const RasterizerOptions& options) {
  if (device == Device::automatic) {
    for (const Listed& listed : devices)
      if (listed.make)
        if (auto made = listed.make(options, true)) return made;
  }
  const auto* listed = std::ranges::find(devices, device, &Listed::device);
  if (listed != devices.end() && listed->make) return listed->make(options, false);
  return fail(ErrorCode::device, "this program was built without OpenGL");
}

}  // namespace splatvol
