// Small pictures of golden files, as text.
#pragma once

#include <filesystem>
#include <string>

#include "base/error.h"
#include "scene/scene.h"

namespace splatvol::test {

/// Width and height of the pictures, and of the blocks of pixels that the text holds the means of.
inline constexpr int golden_size = 64, golden_block = 4;

/// Reads the scene of a file. FILE.json has the parts that differ from scene.json beside it.
[[nodiscard]] Result<Scene> golden_scene(const std::filesystem::path& file);

/// Draws all points of a file and returns the picture as text. The kernel is octant if the file has no moments. If the
/// file keeps cells, their exact picture follows. The text has a line with the way, `splats` or `cells`, then a line
/// for each row of blocks, with four hexadecimal digits for each of red, green, blue and alpha: from 0 to 1. Fails if
/// the file cannot be drawn or the picture is empty.
[[nodiscard]] Result<std::string> golden_picture(const std::string& file, const Scene& scene);

}  // namespace splatvol::test
