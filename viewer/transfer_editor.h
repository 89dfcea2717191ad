// Editor of colours and opacities, over the values' histogram.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "format/layout.h"
#include "format/volume_info.h"
#include "scene/color_map_file.h"
#include "scene/scene.h"

namespace splatvol {

/// Holds the editor's state between frames. Draws with Dear ImGui, into the window that is open.
class TransferEditor {
 public:
  /// Draws the editor and changes `function`. The button "fit" sets `fitting`; "all values" sets the range `all`. The
  /// values of `contours` are lines that can be dragged. Returns whether "visible" is pressed.
  [[nodiscard]] bool draw(TransferFunction& function, const TransferFunction& fitting,
                          const format::Attribute& attribute, const std::array<std::uint64_t, 64>& histogram,
                          const format::StepRange& all, std::vector<SceneContour>& contours);

  /// Draws the editor of an opacity's factors, and changes them.
  void draw_factors(TransferFunction& factors, const format::Attribute& attribute,
                    const std::array<std::uint64_t, 64>& histogram);

  /// Adds colour maps to the presets. One of the same name takes the other's place.
  void add_presets(std::vector<NamedColorMap> maps);

 private:
  struct Area;
  void choose_preset(TransferFunction& function) const;
  void draw_histogram(const Area& area, const TransferFunction& function, const format::Attribute& attribute,
                      const std::array<std::uint64_t, 64>& histogram) const;
  static void edit_range(TransferFunction& function, const format::Attribute& attribute);
  // `name`, `unit`: of the densities.
  void edit_densities(TransferFunction& function, const format::Attribute& attribute,
                      const std::array<std::uint64_t, 64>& histogram, const char* name, const char* unit,
                      std::span<SceneContour> contours = {});
  void edit_contours(const Area& area, const TransferFunction& function, std::span<SceneContour> contours);
  void edit_colors(TransferFunction& function);
  void pick_color(TransferFunction& function) const;

  std::vector<NamedColorMap> presets_;  // besides the built-in ones
  bool log_counts_ = true;
  bool log_opacity_ = false;
  std::optional<std::size_t> density_;  // control point that is held
  std::optional<std::size_t> color_;
  struct ContourValue {
    std::size_t contour, value;
  };
  std::optional<ContourValue> contour_;  // that is held
  std::size_t picked_color_ = 0;
  double top_ = 0;  // density at the area's upper edge
};

}  // namespace splatvol
