#include <algorithm>
#include <cmath>
#include <vector>

#include "scene/scene.h"

namespace splatvol {

bool have_value(std::span<const SceneContour> contours, double value) {
  return std::ranges::any_of(contours, [&](const SceneContour& contour) {
    return std::ranges::find(contour.values, value) != contour.values.end();
  });
}

Status check_contours(const std::vector<SceneContour>& contours) {
  std::vector<double> values;
  const SceneColoring* coloring = nullptr;
  for (const SceneContour& contour : contours) {
    values.insert(values.end(), contour.values.begin(), contour.values.end());
    if (!contour.color_by) continue;
    if (coloring && *coloring != *contour.color_by)
      return fail(ErrorCode::invalid_data, "contours: two differ in color_by; give all the same");
    coloring = &*contour.color_by;
  }
  if (values.size() > most_contour_values)
    return fail(ErrorCode::invalid_data, "contours: {} values; at most {} are drawn", values.size(),
                most_contour_values);
  if (!std::ranges::all_of(values, [](double value) { return std::isfinite(value); }))
    return fail(ErrorCode::invalid_data, "contours: a value is not finite");
  std::ranges::sort(values);
  if (const auto twice = std::ranges::adjacent_find(values); twice != values.end())
    return fail(ErrorCode::invalid_data, "contours: the value {} is given twice; one surface has one look", *twice);
  return {};
}

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

BarColors bar_colors_of(const Scene& scene) {
  Contours contours = contours_of(scene);
  const bool has_volume = std::ranges::any_of(scene.transfer_function.densities,
                                              [](const auto& density) { return density.extinction > 0; });
  const bool has_slices = std::ranges::any_of(scene.slices, &SceneSlice::shown);
  if (has_volume || has_slices) return {scene.attribute, scene.transfer_function};
  if (!contours.attribute.empty()) return {std::move(contours.attribute), std::move(contours.colors)};
  const auto surface =
      std::ranges::find_if(scene.surfaces, [](const SceneSurface& one) { return one.shown && one.color_by; });
  if (contours.surfaces.empty() && surface != scene.surfaces.end())
    return {surface->color_by->attribute, surface->color_by->function};
  const auto tubes =
      std::ranges::find_if(scene.streamlines, [](const SceneStreamlines& one) { return one.shown && one.color_by; });
  if (contours.surfaces.empty() && tubes != scene.streamlines.end())
    return {tubes->color_by->attribute, tubes->color_by->function};
  return {scene.attribute, scene.transfer_function};
}

}  // namespace splatvol
