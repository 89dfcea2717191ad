#include "streamer/first/default_scene.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <iterator>
#include <numeric>
#include <utility>
#include <vector>

#include "base/parallel.h"
#include "format/mesh_box.h"
#include "pictures/contrast.h"
#include "streamer/first/first_attribute.h"
#include "streamer/first/first_camera.h"
#include "streamer/first/first_transfer.h"
#include "streamer/first/survey.h"

namespace splatvol {
namespace {

constexpr std::uint64_t enough_splats = 20000;    // to know where the data is
constexpr std::uint64_t enough_of_others = 5000;  // of each attribute that is not shown
constexpr std::uint64_t enough_for_the_domain = 2000;
constexpr std::size_t most_others = 8;    // attributes whose features the camera frames
constexpr double visible_of_others = 10;  // factor on share_of_densest and share_of_deepest
constexpr double most_for_others = 1.6;   // the camera is at most so many times as far for other attributes
constexpr int most_steps_back = 3;
constexpr double step_back_factor = 1.2;
constexpr double most_at_border = 0.15;        // opacity; more, and the picture crops the material
constexpr double seen_share = 0.1;             // of a pixel
constexpr double fewest_seen = 0.1;            // of all splats; else the camera frames a clump of them
constexpr double largest_filling = 1.0 / 3;    // of the surroundings; what fills more, such as noise, has no place
constexpr double least_in_picture = 0.1;       // of what is visible
constexpr std::size_t fewest_in_picture = 20;  // splats from which values are chosen
constexpr double share_of_densest = 0.03;      // of the largest extinction; above it a splat counts as visible
constexpr double share_of_deepest = 0.1;       // of the largest optical depth of a splat; above it, too
constexpr double share_of_domain = 0.7;        // what is visible is that large: the camera shows all
constexpr double thinnest = 1.0 / 20;          // of the shorter side of a sheet; what is thicker has a side to see
constexpr double opacity_of_material = 0.65;   // mean along rays, on a dark background

// Chooses a transfer function for the values of some splats.
using Chooser = std::function<TransferFunction(const std::vector<SurveySplat>&)>;

// From 0 to 1, but for rounding: the share of a fluid, or a concentration. Solvers smear it over many decades, which
// mean nothing.
bool is_share(const format::Attribute& attribute) {
  constexpr double rounding = 1e-3;
  return std::abs(attribute.min) <= rounding && std::abs(attribute.max - 1) <= rounding;
}

Result<Chooser> chooser_for(const format::Volume& volume, int index) {
  const auto& attribute = volume.info().attributes[static_cast<std::size_t>(index)];
  SPLATVOL_TRY_ASSIGN(kind, kind_of_numbers(volume, index));
  SPLATVOL_TRY_ASSIGN(least_range, least_relative_range(volume, index));
  // svbuild gives it to a mesh without values: the shape is worth a look, whatever the cells.
  if (volume.info().attributes.size() == 1 && attribute.name == "cell_volume")
    return Chooser([](const auto& splats) {
      TransferFunction function = choose_transfer_function(splats);
      function.densities = {{0, 1}};
      return function;
    });
  if (kind != NumberKind::labels)
    return Chooser([kind, least_range, share = is_share(attribute)](const auto& splats) {
      return choose_transfer_function(splats, kind == NumberKind::whole, least_range, share);
    });
  return Chooser([least = attribute.min, most = attribute.max](const auto&) { return label_function(least, most); });
}

Result<std::vector<SurveySplat>> survey(const format::Volume& volume, int index, const SurveyShapes& shapes) {
  SPLATVOL_TRY_ASSIGN(splats, survey_material(volume, index, shapes));
  if (std::ranges::none_of(shapes.shapes, [](const SplatShape& shape) { return shape.mass > 0; }))
    return fail(
        ErrorCode::invalid_data,
        "{}: no point has a volume, as all cells are flat: give cells with a volume, or build with --connectivity none",
        volume.name());
  if (std::ranges::none_of(splats, &SurveySplat::has_value))
    return fail(ErrorCode::invalid_data, "{}: '{}' has no values", volume.name(),
                volume.info().attributes[static_cast<std::size_t>(index)].name);
  return splats;
}

// Returns the splats that are dense, or less dense but so large that rays through them lose as much light.
std::vector<SurveySplat> visible_of(const std::vector<SurveySplat>& splats, const TransferFunction& function,
                                    double share_of_largest = 1) {
  std::vector<double> extinctions, depths;
  for (const SurveySplat& splat : splats) {
    extinctions.push_back(mean_extinction(function, splat));
    depths.push_back(extinctions.back() * std::cbrt(splat.volume));
  }
  const double least_extinction = share_of_largest * share_of_densest * std::ranges::max(extinctions);
  const double least_depth = share_of_largest * share_of_deepest * std::ranges::max(depths);
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

// Four digits are enough for a file that a person edits.
void shorten(TransferFunction& function) {
  for (auto& density : function.densities) {
    if (!(density.extinction > 0)) continue;
    const double unit = std::pow(10, std::floor(std::log10(density.extinction)) - 3);
    density.extinction = std::round(density.extinction / unit) * unit;
  }
  for (auto& [t, rgb] : function.colors) {
    t = std::round(1e4 * t) / 1e4;
    rgb = glm::round(1e4 * rgb) / 1e4;
  }
}

Result<int> find_attribute(const format::Volume& volume, const std::string& name) {
  if (volume.info().attributes.empty()) return fail(ErrorCode::invalid_data, "{}: has no attributes", volume.name());
  if (name.empty()) return choose_first_attribute(volume);
  SPLATVOL_TRY_ASSIGN(index, format::find_attribute(volume.info(), name, volume.name()));
  if (std::isnan(volume.info().attributes[static_cast<std::size_t>(index)].min))
    return fail(ErrorCode::invalid_data, "{}: '{}' has no values", volume.name(), name);
  return index;
}

// Splats count by the area that they cover, up to a pixel of a picture of 512: the smallest cells of a graded mesh
// cannot be seen.
void weigh(std::vector<SurveySplat>& splats, const Camera& camera) {
  const auto view = make_view(camera, 512, 512);
  if (!view) return;
  for (SurveySplat& splat : splats) {
    const double pixel = std::max(std::abs(view->to_view(splat.center).z), splat.longest()) / view->focal;
    const double area = 12 * glm::length(splat.axes[0]) * glm::length(splat.axes[1]);  // of a uniform rectangle
    splat.weight = std::clamp(area / (pixel * pixel), 1e-6, 1.0);
  }
}

// Moves the camera away while the material is cropped, which shows at the sides of the picture: thin material adds up
// along rays.
Camera step_back(std::vector<SurveySplat> splats, const Chooser& choose, Camera camera, double aspect) {
  weigh(splats, camera);
  TransferFunction function = choose(splats);
  for (int step = 0; step < most_steps_back; ++step) {
    const double factor = PictureRays(splats, function, camera).density_factor(opacity_of_material);
    for (auto& density : function.densities) density.extinction *= factor;
    if (border_opacity(splats, function, camera, aspect) < most_at_border) break;
    camera.position = camera.focal_point + step_back_factor * (camera.position - camera.focal_point);
  }
  return camera;
}

// The splats that the camera frames, for all attributes alike: those that the first attribute shows, and near them
// those that other attributes show best. A wake is in the picture of the pressure, too, but a far field is not.
struct Framing {
  Ball ball;
  std::vector<SurveySplat> core, others;
};

// Returns the box round the cells that the file keeps, or else round the splats. These are taken for boxes: those of
// tetrahedra reach farther.
Result<Box> box_of_material(const format::Volume& volume, const std::vector<SurveySplat>& splats) {
  SPLATVOL_TRY_ASSIGN(box, format::box_of_cells(volume));
  return box ? *box : bounds_of(splats);
}

// A sheet across the axis that points upwards is seen from above: there another axis of the picture's plane is up. A
// turn keeps to the first one, and so does a choice.
int axis_up(const format::VolumeInfo& info, const Box& domain, const FirstPicture& picture) {
  if (picture.up) return *picture.up;
  const int up = up_axis_of(info);
  const dvec3 extent = domain.extent();
  const double side = std::min(extent[(up + 1) % 3], extent[(up + 2) % 3]);
  if (picture.turns || extent[up] > thinnest * side) return up;
  return up == 2 ? 1 : 2;
}

// If what is visible fills most of the domain, all of the domain is in the picture, with its outline.
Camera choose_camera(const format::VolumeInfo& info, const std::vector<SurveySplat>& splats, const Box& domain,
                     const Chooser& choose, const Framing& framing, const FirstPicture& picture) {
  const int up = axis_up(info, domain, picture);
  const double aspect = static_cast<double>(picture.width) / picture.height;
  const auto distance = [](const Camera& camera) { return glm::length(camera.position - camera.focal_point); };
  Camera near = fit_camera(framing.core, up, aspect, info.cube.edge, picture.turns);
  const dvec3 away = most_for_others * (near.position - near.focal_point);
  std::vector<SurveySplat> all = framing.core;
  all.insert(all.end(), framing.others.begin(), framing.others.end());
  near = fit_camera(all, up, aspect, info.cube.edge, picture.turns);
  if (distance(near) > glm::length(away)) near.position = near.focal_point + away;
  const Camera far = fit_camera(corners_of(domain), up, aspect, info.cube.edge, picture.turns);
  if (distance(near) >= distance(far)) return near;
  if (distance(near) >= share_of_domain * distance(far)) return far;
  const Camera relaxed = step_back(splats, choose, near, aspect);
  return distance(relaxed) >= share_of_domain * distance(far) ? far : relaxed;
}

// Returns the ball that the picture shows: of all splats, unless their picture would show hardly any, because most are
// far smaller than a pixel.
Ball framed_ball(std::vector<SurveySplat> splats, int width, int height) {
  weigh(splats, fit_camera(splats, 1, static_cast<double>(width) / height, 1));
  const auto seen = std::ranges::count_if(splats, [](const SurveySplat& splat) { return splat.weight > seen_share; });
  const bool shows_little = static_cast<double>(seen) < fewest_seen * static_cast<double>(splats.size());
  return shows_little ? main_clump(splats) : Ball{};
}

double volume_of(const std::vector<SurveySplat>& splats) {
  return std::accumulate(splats.begin(), splats.end(), 0.0,
                         [](double sum, const SurveySplat& splat) { return sum + splat.volume; });
}

// Returns what another attribute shows near the box of the core, unless this fills most of it.
Result<std::vector<SurveySplat>> features_of(const format::Volume& volume, int attribute, const SurveyShapes& shapes,
                                             const Ball& ball, const Box& core) {
  SPLATVOL_TRY_ASSIGN(all, survey_material(volume, attribute, shapes));
  const auto splats = within(ball, all);
  if (std::ranges::none_of(splats, &SurveySplat::has_value)) return std::vector<SurveySplat>();
  const auto features = visible_of(splats, choose_transfer_function(splats), visible_of_others);
  auto near = near_box(core, features);
  const bool fills = volume_of(near) > largest_filling * volume_of(near_box(core, splats));
  return fills ? std::vector<SurveySplat>() : std::move(near);
}

Result<Framing> choose_framing(const format::Volume& volume, int first, const std::vector<SurveySplat>& first_splats,
                               const Chooser& choose, const FirstPicture& picture) {
  Framing framing;
  framing.ball = framed_ball(first_splats, picture.width, picture.height);
  const auto core_splats = within(framing.ball, first_splats);
  framing.core = visible_of(core_splats, choose(core_splats));
  SPLATVOL_TRY_ASSIGN(others, other_quantities(volume, first, most_others));
  if (others.empty()) return framing;
  SPLATVOL_TRY_ASSIGN(ahead, read_survey_ahead(volume, others, enough_of_others));
  SPLATVOL_TRY_ASSIGN(shapes, survey_shapes(volume, enough_of_others));
  const Box core = box_of(framing.core);
  std::vector<Result<std::vector<SurveySplat>>> found(others.size());
  parallel_for(std::size_t{0}, others.size(),
               [&](std::size_t i) { found[i] = features_of(volume, others[i], shapes, framing.ball, core); });
  for (const auto& near : found) {
    if (!near) return tl::unexpected(near.error());
    framing.others.insert(framing.others.end(), near->begin(), near->end());
  }
  return framing;
}

bool is_in_picture(const View& view, const dvec3& position) {
  const dvec3 p = view.to_view(position);
  const double depth = view.orthographic ? 1 : p.z;
  return depth > 0 && std::abs(p.x) * view.focal < 0.5 * view.width * depth &&
         std::abs(p.y) * view.focal < 0.5 * view.height * depth;
}

// If hardly any of what a function shows is in the picture, values are those of the splats that are.
TransferFunction fit_to_picture(const std::vector<SurveySplat>& splats, const Chooser& choose, const View& view) {
  TransferFunction function = choose(splats);
  const auto inside = [&](const SurveySplat& splat) { return is_in_picture(view, splat.center); };
  const std::vector<SurveySplat> visible = visible_of(splats, function);
  const auto count = static_cast<double>(std::ranges::count_if(visible, inside));
  if (count >= least_in_picture * static_cast<double>(visible.size())) return function;
  std::vector<SurveySplat> seen;
  std::ranges::copy_if(splats, std::back_inserter(seen),
                       [&](const SurveySplat& splat) { return splat.has_value && inside(splat); });
  return seen.size() < fewest_in_picture ? function : choose(seen);
}

// Surroundings keep their colour: what is near them is thin, and would be dark as well. On a logarithmic axis they are
// decades away from what is seen.
VisibleValues with_clear_values(VisibleValues visible, const TransferFunction& function) {
  if (function.axis == ValueAxis::log) return visible;
  const auto& densities = function.densities;
  for (std::size_t i = 1; i < densities.size(); ++i) {
    if (densities[i - 1].extinction > 0 || densities[i].extinction > 0) continue;
    visible.low = std::min(visible.low, densities[i - 1].t);
    visible.high = std::max(visible.high, densities[i].t);
  }
  return visible;
}

}  // namespace

int up_axis_of(const format::VolumeInfo& info) { return info.up < 0 ? 1 : info.up; }

Result<Scene> default_scene(const format::Volume& volume, const std::string& attribute, const FirstPicture& picture) {
  SPLATVOL_TRY_ASSIGN(index, find_attribute(volume, attribute));
  SPLATVOL_TRY_ASSIGN(first, choose_first_attribute(volume));
  SPLATVOL_TRY_ASSIGN(ahead, read_survey_ahead(volume, {first, index}, enough_splats));
  SPLATVOL_TRY_ASSIGN(shapes, survey_shapes(volume, enough_splats));
  SPLATVOL_TRY_ASSIGN(first_splats, survey(volume, first, shapes));
  SPLATVOL_TRY_ASSIGN(choose, chooser_for(volume, first));
  SPLATVOL_TRY_ASSIGN(framing, choose_framing(volume, first, first_splats, choose, picture));
  std::vector<SurveySplat> splats = within(framing.ball, first_splats);
  Scene scene;
  scene.width = picture.width;
  scene.height = picture.height;
  scene.outline = true;
  scene.attribute = volume.info().attributes[static_cast<std::size_t>(index)].name;
  SPLATVOL_TRY_ASSIGN(
      domain, first_splats.size() < volume.info().point_count() ? bounds_of(splats) : box_of_material(volume, splats));
  scene.camera = choose_camera(volume.info(), splats, domain, choose, framing, picture);
  if (index != first) {
    SPLATVOL_TRY_ASSIGN(others, survey(volume, index, shapes));
    splats = within(framing.ball, others);
    SPLATVOL_TRY_SET(choose, chooser_for(volume, index));
  }
  weigh(splats, scene.camera);
  SPLATVOL_TRY_ASSIGN(view, make_view(scene.camera, picture.width, picture.height));
  scene.transfer_function = fit_to_picture(splats, choose, view);

  const PictureRays rays(splats, scene.transfer_function, scene.camera);
  const double factor = rays.density_factor(opacity_of_material);
  for (auto& density : scene.transfer_function.densities) density.extinction *= factor;
  if (const auto visible = rays.visible_values(factor))
    scene.transfer_function =
        with_visible_colors(scene.transfer_function, with_clear_values(*visible, scene.transfer_function));
  adapt_to_background(scene, picture.background);
  shorten(scene.transfer_function);
  return scene;
}

Result<FittingOpacity> fitting_opacity(const format::Volume& volume, const std::string& attribute,
                                       const FirstPicture& picture) {
  SPLATVOL_TRY_ASSIGN(scene, default_scene(volume, attribute, picture));
  FittingOpacity fitting{{scene.attribute, std::move(scene.transfer_function)}, 0};
  TransferFunction& factors = fitting.opacity.function;
  for (const auto& density : factors.densities) fitting.density = std::max(fitting.density, density.extinction);
  for (auto& density : factors.densities) density.extinction /= fitting.density > 0 ? fitting.density : 1;
  factors.colors = {{0, dvec3(1)}};
  return fitting;
}

void show_opacity(Scene& scene, FittingOpacity fitting) {
  scene.transfer_function.densities = {{0, fitting.density}};
  scene.transfer_function.density_factor = 1;
  scene.opacity = std::move(fitting.opacity);
}

Result<TransferFunction> visible_colors(const format::Volume& volume, const Scene& scene) {
  SPLATVOL_TRY_ASSIGN(index, find_attribute(volume, scene.attribute));
  SPLATVOL_TRY_ASSIGN(view, make_view(scene));
  const int other = scene.opacity ? volume.info().find_attribute(scene.opacity->attribute) : -1;
  std::vector<int> attributes = {index};
  if (other >= 0) attributes.push_back(other);
  SPLATVOL_TRY_ASSIGN(ahead, read_survey_ahead(volume, attributes, enough_splats));
  SPLATVOL_TRY_ASSIGN(shapes, survey_shapes(volume, enough_splats));
  SPLATVOL_TRY_ASSIGN(splats, survey(volume, index, shapes));
  if (other >= 0) {
    SPLATVOL_TRY_ASSIGN(factors, survey_material(volume, other, shapes));
    for (std::size_t i = 0; i < splats.size(); ++i)
      splats[i].factor = mean_extinction(scene.opacity->function, factors[i]);
  }
  std::erase_if(splats, [&](const SurveySplat& splat) {
    return !is_in_picture(view, splat.center) || !view.clip.contains(splat.center);
  });
  const auto visible = PictureRays(splats, scene.transfer_function, scene.camera).visible_values();
  return visible ? with_visible_colors(scene.transfer_function, *visible) : scene.transfer_function;
}

Result<dvec3> middle_of_visible(const format::Volume& volume, const Scene& scene) {
  SPLATVOL_TRY_ASSIGN(index, find_attribute(volume, scene.attribute));
  SPLATVOL_TRY_ASSIGN(ahead, read_survey_ahead(volume, {index}, enough_splats));
  SPLATVOL_TRY_ASSIGN(shapes, survey_shapes(volume, enough_splats));
  SPLATVOL_TRY_ASSIGN(splats, survey(volume, index, shapes));
  return middle_of(visible_of(within(framed_ball(splats, scene.width, scene.height), splats), scene.transfer_function));
}

Result<Box> domain_of(const format::Volume& volume) {
  if (volume.info().attributes.empty()) return fail(ErrorCode::invalid_data, "{}: has no attributes", volume.name());
  SPLATVOL_TRY_ASSIGN(splats, survey_material(volume, 0, enough_for_the_domain));
  return box_of_material(volume, splats);
}

}  // namespace splatvol
