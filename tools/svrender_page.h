// What svrender draws: the scene, and the page round it.
#pragma once

#include <array>
#include <optional>
#include <string>

#include "format/steps.h"
#include "format/volume_info.h"
#include "pictures/page.h"
#include "scene/scene.h"
#include "tools/svrender_options.h"

namespace splatvol {

/// A scene with all that is drawn round it. The scene's size is that of the picture on the page.
struct Composition {
  Scene scene;
  PageText text;
  Page page;
  std::optional<Box> outline;         // of the domain
  std::optional<dvec3> turned_about;  // with --turntable: the middle of what is visible
  bool data = false;                  // the picture is an .exr: data for programs, without words and lines
  bool transparent = false;
  bool has_time = false;  // the page tells the time of a step

  /// Returns the width and the height of the file that write_page writes, in pixels.
  [[nodiscard]] std::array<int, 2> written_size() const {
    return data ? std::array{scene.width, scene.height} : std::array{page.width, page.height};
  }
};

/// Reads the scene that the options name, or makes one that fits the data, and lays out the page. Reads only the
/// preamble and coarse parts of the volume.
[[nodiscard]] Result<Composition> compose(const RenderOptions& options, const format::Steps& steps);

/// Writes a picture of `view` as a page (.png) or as it is (.exr). `time`: of the step, to be told.
[[nodiscard]] Status write_page(const Composition& composition, const View& view, std::optional<double> time,
                                Image image, const std::string& path, const Provenance& provenance);

/// Reads "white", "black" or "#RRGGBB" (sRGB). Returns linear RGB.
[[nodiscard]] Result<dvec3> parse_color(const std::string& text);

}  // namespace splatvol
