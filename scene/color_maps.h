// Named colour maps.
#pragma once

#include <span>
#include <string_view>
#include <vector>

#include "scene/scene.h"

namespace splatvol {

struct ColorMap {
  std::string_view name;
  std::vector<TransferFunction::Color> colors;  // linear, t from 0 to 1
};

/// Viridis and inferno (van der Walt and Smith, 2015), Moreland's cool to warm (2009), grey, cividis (Nunez, Anderton
/// and Renslow, 2018), turbo (Mikhailov, 2019).
[[nodiscard]] std::span<const ColorMap> color_maps();

/// Cool to warm with five control points of four digits each: short enough for a scene file that a person edits.
[[nodiscard]] std::vector<TransferFunction::Color> short_cool_to_warm();

/// Returns the same colours from the other end.
[[nodiscard]] std::vector<TransferFunction::Color> reversed(std::span<const TransferFunction::Color> colors);

}  // namespace splatvol
