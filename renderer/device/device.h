// The choice of the device that draws.
#pragma once

#include <memory>
#include <string_view>

#include "base/error.h"
#include "renderer/rasterizer.h"
#include "splatvol/device.h"

namespace splatvol {

/// Returns the device of "auto", "cpu" or "gl". Fails for another name, and for "gl" in a build without OpenGL.
[[nodiscard]] Result<Device> parse_device(std::string_view name);

/// Makes a rasterizer. `automatic` cannot fail. `gl` fails with ErrorCode::device if there is no OpenGL 4.5.
/// A rasterizer with a context of its own belongs to this thread, whose current context it becomes.
[[nodiscard]] Result<std::unique_ptr<Rasterizer>> make_rasterizer(Device device, const RasterizerOptions& options);

}  // namespace splatvol
