// The demo's input: a knotted vortex on a mesh that is fine where the flow varies, and a scene that shows it.
#pragma once

#include <cstddef>
#include <string>

#include "base/error.h"
#include "base/replaceable.h"

namespace splatvol {

/// Writes about `points` points, and the tetrahedra between them, to a .vtu file.
[[nodiscard]] Status write_flow(const std::string& path, std::size_t points, Replace replace);

/// Writes the scene to a .json file.
[[nodiscard]] Status write_flow_scene(const std::string& path);

}  // namespace splatvol
