#include "renderer/device/device.h"

#include "renderer/cpu/tile_rasterizer.h"
#ifdef SPLATVOL_OPENGL
#include "renderer/gl/gl_rasterizer.h"
#endif

namespace splatvol {
namespace {

#ifdef SPLATVOL_OPENGL
Result<std::unique_ptr<Rasterizer>> make_gl_rasterizer(const RasterizerOptions& options, ContextKind kind) {
  const auto as_rasterizer = [](std::unique_ptr<GlRasterizer> made) {
    return std::unique_ptr<Rasterizer>(std::move(made));
  };
  if (options.in_current_context) {
    if (kind == ContextKind::hardware && is_software_renderer(device_text()))
      return fail(ErrorCode::device, "OpenGL draws in software here");
    return GlRasterizer::create(options.kernel, options.gpu_bytes).map(as_rasterizer);
  }
  SPLATVOL_TRY_ASSIGN(context, HeadlessContext::create(kind));
  return GlRasterizer::create(std::move(context), options.kernel, options.gpu_bytes).map(as_rasterizer);
}
#endif

}  // namespace

Result<Device> parse_device(std::string_view name) {
  if (name == "auto") return Device::automatic;
  if (name == "cpu") return Device::cpu;
  if (name != "gl") return fail(ErrorCode::invalid_argument, "'{}' is no device: auto, cpu and gl are", name);
#ifdef SPLATVOL_OPENGL
  return Device::gl;
#else
  return fail(ErrorCode::invalid_argument, "this program was built without OpenGL: take --device cpu");
#endif
}

Result<std::unique_ptr<Rasterizer>> make_rasterizer(Device device, const RasterizerOptions& options) {
#ifdef SPLATVOL_OPENGL
  if (device == Device::gl) return make_gl_rasterizer(options, ContextKind::any);
  if (device == Device::automatic)
    if (auto on_card = make_gl_rasterizer(options, ContextKind::hardware)) return on_card;
#else
  if (device == Device::gl) return fail(ErrorCode::device, "this program was built without OpenGL");
#endif
  return std::make_unique<TileRasterizer>(options.kernel);
}

}  // namespace splatvol
