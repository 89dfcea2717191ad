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

std::vector<BarColors> bar_colors_of(const Scene& scene) {
  std::vector<BarColors> all;
  const auto add = [&](const std::string& attribute, TransferFunction function) {
    function.densities.clear();
    const bool is_there = std::ranges::any_of(
        all, [&](const BarColors& one) { return one.attribute == attribute && one.function == function; });
    if (!is_there) all.push_back({attribute, std::move(function)});
  };
  const auto add_by = [&](const auto& parts) {
    for (const auto& part : parts)
      if (part.shown && part.color_by) add(part.color_by->attribute, part.color_by->function);
  };
  const bool has_volume = std::ranges::any_of(scene.transfer_function.densities,
                                              [](const auto& density) { return density.extinction > 0; });
  const auto has_its_colors = [](const SceneContour& one) { return one.shown && !one.color && !one.color_by; };
  if (has_volume || std::ranges::any_of(scene.slices, &SceneSlice::shown) ||
      std::ranges::any_of(scene.contours, has_its_colors))
    add(scene.attribute, scene.transfer_function);
  add_by(scene.contours);
  add_by(scene.surfaces);
  add_by(scene.streamlines);
  if (all.empty()) add(scene.attribute, scene.transfer_function);
  return all;
}

}  // namespace splatvol
