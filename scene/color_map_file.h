// Colour maps in ParaView's JSON files.
#pragma once

#include <string>
#include <vector>

#include "base/error.h"
#include "scene/scene.h"

namespace splatvol {

struct NamedColorMap {
  std::string name;
  std::vector<TransferFunction::Color> colors;  // linear, t from 0 to 1, at most 4096
};

/// Whether JSON text is of colour maps, and not of a scene.
[[nodiscard]] bool is_color_map_text(const std::string& json);

/// Reads a colour map, or a list of them, as ParaView exports them. Supports the colour spaces RGB, HSV, Lab, CIELAB,
/// Diverging (Moreland, 2009) and Step: control points are added until colours between them are right to 1/255. Values
/// are scaled to t. Leaves out maps of categories (IndexedColors without RGBPoints), opacities and colours of NaN.
/// Fails if a map is damaged or of another space, and if there is none. Errors name the map and not the file.
[[nodiscard]] Result<std::vector<NamedColorMap>> parse_color_maps(const std::string& json);

/// The same for a file. Errors begin with its path.
[[nodiscard]] Result<std::vector<NamedColorMap>> load_color_maps(const std::string& path);

}  // namespace splatvol
