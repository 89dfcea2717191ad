// The choice of the device that draws.
#pragma once

#include <cstdint>
#include <memory>
#include <string_view>

#include "base/error.h"
#include "renderer/rasterizer.h"
#include "splatvol/device.h"

namespace splatvol {

/// Returns the device of "auto", "cpu" or "gl". Fails for another name, and for "gl" in a build without OpenGL.
[[nodiscard]] Result<Device> parse_device(std::string_view name);

struct RasterizerOptions {
  KernelKind kernel = KernelKind::moments;
  std::uint64_t gpu_bytes = std::uint64_t{1} << 30;  // that OpenGL may take
  bool in_current_context = false;                   // of OpenGL; else the rasterizer makes a context of its own
};

/// Makes a rasterizer. `automatic` cannot fail. `gl` fails with ErrorCode::device if there is no OpenGL 4.5.
/// A rasterizer with a context of its own belongs to this thread, whose current context it becomes.
[[nodiscard]] Result<std::unique_ptr<Rasterizer>> make_rasterizer(Device device, const RasterizerOptions& options);

}  // namespace splatvol
