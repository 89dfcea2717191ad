#include "viewer/coloring.h"

#include "scene/color_maps.h"

namespace splatvol {

SceneColoring coloring_by(const Scene& scene, const format::Attribute& attribute) {
  const auto is_by = [&](const std::optional<SceneColoring>& coloring) {
    return coloring && coloring->attribute == attribute.name;
  };
  for (const SceneContour& contour : scene.contours)
    if (is_by(contour.color_by)) return *contour.color_by;
  for (const SceneSurface& surface : scene.surfaces)
    if (is_by(surface.color_by)) return *surface.color_by;
  SceneColoring coloring{attribute.name, scene.transfer_function};
  coloring.function.densities = {{0, 1}};  // as a scene file has it
  coloring.function.density_factor = 1;
  if (scene.attribute == attribute.name) return coloring;
  coloring.function = {.colors = color_maps()[0].colors, .densities = {{0, 1}}};
  coloring.function.lo = attribute.min;
  coloring.function.hi = attribute.max > attribute.min ? attribute.max : attribute.min + 1;
  return coloring;
}

}  // namespace splatvol
