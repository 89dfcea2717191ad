#include "streamer/default_scene.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "scene/contrast.h"
#include "streamer/first_attribute.h"
#include "streamer/first_camera.h"
#include "streamer/first_transfer.h"
#include "streamer/survey.h"

namespace splatvol {
namespace {

constexpr std::uint64_t enough_splats = 20000;  // to know where the data is
constexpr std::uint64_t enough_for_the_domain = 2000;
constexpr double share_of_densest = 0.03;     // of the largest extinction; above it a splat counts as visible
constexpr double share_of_deepest = 0.1;      // of the largest optical depth of a splat; above it, too
constexpr double share_of_domain = 0.7;       // what is visible is that large: the camera shows all
constexpr double opacity_of_material = 0.65;  // mean along rays, on a dark background

Result<std::vector<SurveySplat>> survey(const format::Volume& volume, int index) {
  SPLATVOL_TRY_ASSIGN(splats, survey_material(volume, index, enough_splats));
  if (std::ranges::none_of(splats, &SurveySplat::has_value))
    return fail(ErrorCode::invalid_data, "{}: '{}' has no values", volume.name(),
                volume.info().attributes[static_cast<std::size_t>(index)].name);
  return splats;
}

// Returns the splats that are dense, or less dense but so large that rays through them lose as much light.
std::vector<SurveySplat> visible_of(const std::vector<SurveySplat>& splats, const TransferFunction& function) {
  std::vector<double> extinctions, depths;
  for (const SurveySplat& splat : splats) {
    extinctions.push_back(mean_extinction(function, splat));
    depths.push_back(extinctions.back() * std::cbrt(splat.volume));
  }
  const double least_extinction = share_of_densest * std::ranges::max(extinctions);
  const double least_depth = share_of_deepest * std::ranges::max(depths);
  std::vector<SurveySplat> visible;
  for (std::size_t i = 0; i < splats.size(); ++i)
    if (extinctions[i] > least_extinction || depths[i] > least_depth) visible.push_back(splats[i]);
  return visible.empty() ? splats : visible;
}

std::vector<SurveySplat> corners_of(const Box& box) {
  std::vector<SurveySplat> corners(8);
  for (std::size_t c = 0; c < 8; ++c) {
    corners[c].center = {c & 1 ? box.high.x : box.low.x, c & 2 ? box.high.y : box.low.y,
                         c & 4 ? box.high.z : box.low.z};
    corners[c].axes = dmat3(0);
  }
  return corners;
}

// If what is visible fills most of the domain, all of the domain is in the picture, with its outline.
Camera choose_camera(const format::VolumeInfo& info, const std::vector<SurveySplat>& splats,
                     const std::vector<SurveySplat>& visible, const FirstPicture& picture) {
  const int up = info.up < 0 ? 1 : info.up;
  const double aspect = static_cast<double>(picture.width) / picture.height;
  const Camera near = fit_camera(visible, up, aspect, info.cube.edge, picture.turns);
  const Camera far = fit_camera(corners_of(bounds_of(splats)), up, aspect, info.cube.edge, picture.turns);
  const auto distance = [](const Camera& camera) { return glm::length(camera.position - camera.focal_point); };
  const bool fills = distance(near) >= share_of_domain * distance(far);
  return fills && distance(near) < distance(far) ? far : near;
}

// Four digits are enough for a file that a person edits.
void shorten(TransferFunction& function) {
  for (auto& density : function.densities) {
    if (!(density.extinction > 0)) continue;
    const double unit = std::pow(10, std::floor(std::log10(density.extinction)) - 3);
    density.extinction = std::round(density.extinction / unit) * unit;
  }
  for (auto& color : function.colors) color.rgb = glm::round(1e4 * color.rgb) / 1e4;
}

Result<int> find_attribute(const format::Volume& volume, const std::string& name) {
  if (volume.info().attributes.empty()) return fail(ErrorCode::invalid_data, "{}: has no attributes", volume.name());
  if (name.empty()) return choose_first_attribute(volume);
  SPLATVOL_TRY_ASSIGN(index, format::find_attribute(volume.info(), name, volume.name()));
  if (std::isnan(volume.info().attributes[static_cast<std::size_t>(index)].min))
    return fail(ErrorCode::invalid_data, "{}: '{}' has no values", volume.name(), name);
  return index;
}

}  // namespace

Result<Scene> default_scene(const format::Volume& volume, const std::string& attribute, const FirstPicture& picture) {
  SPLATVOL_TRY_ASSIGN(index, find_attribute(volume, attribute));
  SPLATVOL_TRY_ASSIGN(splats, survey(volume, index));
  Scene scene;
  scene.width = picture.width;
  scene.height = picture.height;
  scene.outline = true;
  scene.attribute = volume.info().attributes[static_cast<std::size_t>(index)].name;
  scene.transfer_function = choose_transfer_function(splats);

  // One camera for all attributes: that of the attribute that is shown first.
  std::vector<SurveySplat> visible;
  int first = index;
  if (!attribute.empty()) {
    SPLATVOL_TRY_ASSIGN(chosen, choose_first_attribute(volume));
    first = chosen;
  }
  if (first == index) {
    visible = visible_of(splats, scene.transfer_function);
  } else {
    SPLATVOL_TRY_ASSIGN(first_splats, survey(volume, first));
    visible = visible_of(first_splats, choose_transfer_function(first_splats));
  }
  scene.camera = choose_camera(volume.info(), splats, visible, picture);

  const double factor = density_factor(splats, scene.transfer_function, scene.camera, opacity_of_material);
  for (auto& density : scene.transfer_function.densities) density.extinction *= factor;
  adapt_to_background(scene, picture.background);
  shorten(scene.transfer_function);
  return scene;
}

Result<dvec3> middle_of_visible(const format::Volume& volume, const Scene& scene) {
  SPLATVOL_TRY_ASSIGN(index, find_attribute(volume, scene.attribute));
  SPLATVOL_TRY_ASSIGN(splats, survey(volume, index));
  return middle_of(visible_of(splats, scene.transfer_function));
}

Result<Box> domain_of(const format::Volume& volume) {
  if (volume.info().attributes.empty()) return fail(ErrorCode::invalid_data, "{}: has no attributes", volume.name());
  SPLATVOL_TRY_ASSIGN(splats, survey_material(volume, 0, enough_for_the_domain));
  return bounds_of(splats);
}

}  // namespace splatvol
