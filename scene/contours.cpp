#include <algorithm>

#include "scene/scene.h"

namespace splatvol {

Contours contours_of(const Scene& scene) {
  Contours all;
  if (scene.lighting) all.lighting = *scene.lighting;
  for (const SceneContour& contour : scene.contours) {
    if (!contour.shown || !(contour.opacity > 0)) continue;
    if (contour.color_by) {
      all.attribute = contour.color_by->attribute;
      all.colors = contour.color_by->function;
      if (all.colors.densities.empty()) all.colors.densities = {{0, 1}};
    }
    for (const double value : contour.values)
      all.surfaces.push_back({value, contour.color.value_or(scene.transfer_function.color(value)),
                              std::min(contour.opacity, 1.0), contour.color_by.has_value()});
  }
  std::ranges::sort(all.surfaces, {}, &Contour::value);
  return all;
}

}  // namespace splatvol
