// Options of the programs that draw a scene.
#pragma once

#include <string>

#include "pictures/image.h"
#include "renderer/device/device.h"
#include "scene/scene.h"
#include "tools/tool.h"

namespace splatvol {

/// An OptionCheck: refuses the path of a picture that write_image could not write.
[[nodiscard]] inline std::string check_image_path(const std::string& path) {
  return is_image_path(path) ? "" : "'" + path + "' ends in neither .exr nor .png";
}

/// Adds --device. Parsing writes a name that parse_device takes into `device`. `automatic`: what auto is.
inline void add_device_option(CommandLine& app, std::string& device, const std::string& automatic) {
  app.add_option("--device", device, "What draws: cpu: the processor; gl: OpenGL; auto: " + automatic)
      ->check(check_of(parse_device), "{auto,cpu,gl}")
      ->capture_default_str();
}

/// Reads a scene file. `size`, such as "640x480", replaces the scene's own size unless it is empty.
[[nodiscard]] inline Result<Scene> load_scene(const std::string& path, const std::string& size) {
  SPLATVOL_TRY_ASSIGN(scene, load_scene(path));
  if (size.empty()) return scene;
  SPLATVOL_TRY_ASSIGN(sides, parse_image_size(size));
  scene.width = sides[0];
  scene.height = sides[1];
  return scene;
}

}  // namespace splatvol
