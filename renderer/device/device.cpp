#include "renderer/device/device.h"

#include <algorithm>
#include <array>

#include "renderer/cpu/tile_rasterizer.h"
#ifdef SPLATVOL_OPENGL
#include "renderer/gl/gl_rasterizer.h"
#endif

namespace splatvol {
namespace {

constexpr std::array<std::string_view, 3> names = {"auto", "cpu", "gl"};  // [Device]

#ifdef SPLATVOL_OPENGL
constexpr bool has_gl = true;
constexpr auto make_gl = &GlRasterizer::make;
#else
constexpr bool has_gl = false;
Result<std::unique_ptr<Rasterizer>> make_gl(const RasterizerOptions& /*options*/, bool /*is_automatic*/) {
  return fail(ErrorCode::device, "this program was built without OpenGL");
}
#endif

}  // namespace

Result<Device> parse_device(std::string_view name) {
  const auto* found = std::ranges::find(names, name);
  if (found == names.end()) return fail(ErrorCode::invalid_argument, "'{}' is no device: auto, cpu and gl are", name);
  const auto device = static_cast<Device>(found - names.begin());
  if (device == Device::gl && !has_gl)
    return fail(ErrorCode::invalid_argument, "this program was built without OpenGL: take --device cpu");
  return device;
}

Result<std::unique_ptr<Rasterizer>> make_rasterizer(Device device, const RasterizerOptions& options) {
  if (device != Device::cpu) {
    auto made = make_gl(options, device == Device::automatic);
    if (made || device == Device::gl) return made;
  }
  return std::make_unique<TileRasterizer>(options.kernel);
}

}  // namespace splatvol
