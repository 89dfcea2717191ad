
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <limits>
#include <nlohmann/json.hpp>
#include <span>
#include <string_view>
#include <variant>

#include "base/file.h"
#include "base/json.h"
#include "scene/scene.h"

namespace splatvol {
namespace {

constexpr int largest_image_side = 16384;
constexpr double largest_number = 1e100;  // of lengths and values: squares stay in the range of double precision
constexpr double largest_light = 1e37;    // of colours and light, which are drawn in single precision

Result<double> number(const JsonField& field) { return field.number(largest_number); }

Result<double> positive(const JsonField& field) {
  SPLATVOL_TRY_ASSIGN(value, number(field));
  if (!(value > 0)) return field.wrong("not above 0");
  return value;
}

/// Reads a number, for colours and light: from 0 up.
Result<double> light(const JsonField& field) {
  SPLATVOL_TRY_ASSIGN(amount, number(field));
  if (amount < 0) return field.wrong("{} is negative", amount);
  if (amount > largest_light) return field.wrong("beyond {}", largest_light);
  return amount;
}

/// Reads a whole number, also with a fraction of 0.
Result<int> whole(const JsonField& field, int least, int most) {
  SPLATVOL_TRY_ASSIGN(value, number(field));
  if (value != std::floor(value) || value < least || value > most)
    return field.wrong("not a whole number from {} to {}", least, most);
  return static_cast<int>(value);
}

Result<dvec3> vector(const JsonField& field) {
  SPLATVOL_TRY_ASSIGN(list, field.numbers(3, largest_number));
  return dvec3(list[0], list[1], list[2]);
}

Result<dvec3> color(const JsonField& field) {
  SPLATVOL_TRY_ASSIGN(rgb, vector(field));
  if (rgb.r < 0 || rgb.g < 0 || rgb.b < 0) return field.wrong("negative colour");
  for (std::size_t channel = 0; channel < 3; ++channel) SPLATVOL_TRY(light(field.element(channel)));
  return rgb;
}

/// Reads a name or a path.
Result<std::string> name(const JsonField& field) {
  SPLATVOL_TRY_ASSIGN(text, field.text());
  if (text.empty()) return field.wrong("empty");
  return text;
}

Status read_projection(const JsonField& field, Camera& camera) {
  if (const JsonField projection = field.member("projection"); projection.exists()) {
    SPLATVOL_TRY_ASSIGN(name, projection.text());
    if (name != "perspective" && name != "orthographic")
      return projection.wrong("'{}' is neither perspective nor orthographic", name);
    if (name == "orthographic") camera.projection = Camera::Projection::orthographic;
  }
  if (camera.projection == Camera::Projection::orthographic) {
    SPLATVOL_TRY_SET(camera.parallel_height, positive(field.member("parallel_height")));
    return {};
  }
  const JsonField angle = field.member("vertical_fov_degrees");
  SPLATVOL_TRY_ASSIGN(degrees, number(angle));
  if (degrees <= 0 || degrees >= 180) return angle.wrong("not between 0 and 180");
  camera.vertical_fov_degrees = degrees;
  return {};
}

Status read_size(const JsonField& image, Scene& scene) {
  SPLATVOL_TRY(image.check_names({"width", "height"}));
  SPLATVOL_TRY_SET(scene.width, whole(image.member("width"), 1, largest_image_side));
  SPLATVOL_TRY_SET(scene.height, whole(image.member("height"), 1, largest_image_side));
  return {};
}

constexpr std::size_t most_control_points = 4096;  // the time to make a table grows with them

/// Reads the control points of one curve: rows of t and `channels` values that are not negative.
Result<std::vector<std::vector<double>>> read_curve(const JsonField& field, std::size_t channels) {
  if (field.size() == 0) return field.wrong("not a list of control points");
  if (field.size() > most_control_points)
    return field.wrong("{} control points; at most {} are drawn", field.size(), most_control_points);
  std::vector<std::vector<double>> rows;
  for (std::size_t i = 0; i < field.size(); ++i) {
    const JsonField point = field.element(i);
    SPLATVOL_TRY_ASSIGN(row, point.numbers(1 + channels, largest_number));
    if (row[0] < 0 || row[0] > 1) return point.wrong("t = {} is outside [0, 1]", row[0]);
    if (!rows.empty() && row[0] < rows.back()[0]) return point.wrong("t = {} is below the one before", row[0]);
    for (std::size_t channel = 1; channel <= channels; ++channel) {
      if (row[channel] < 0) return point.wrong("{} is negative", row[channel]);
      if (channels > 1) SPLATVOL_TRY(light(point.element(channel)));
    }
    rows.push_back(std::move(row));
  }
  return rows;
}

constexpr std::array<std::pair<std::string_view, ValueAxis>, 3> axes = {
    {{"linear", ValueAxis::linear}, {"log", ValueAxis::log}, {"asinh", ValueAxis::asinh}}};

/// Reads how t runs over the domain, which has been read.
Status read_axis(const JsonField& field, const JsonField& domain, TransferFunction& function) {
  if (const JsonField axis = field.member("axis"); axis.exists()) {
    SPLATVOL_TRY_ASSIGN(name, axis.text());
    const auto found = std::ranges::find(axes, name, &std::pair<std::string_view, ValueAxis>::first);
    if (found == axes.end()) return axis.wrong("'{}' is neither linear nor log nor asinh", name);
    function.axis = found->second;
  }
  if (function.axis == ValueAxis::log && !(function.lo > 0))
    return domain.wrong("[{}, {}] is not above 0, which the axis log needs; asinh shows both signs", function.lo,
                        function.hi);
  const JsonField width = field.member("linear_width");
  if (function.axis == ValueAxis::asinh) {
    SPLATVOL_TRY_SET(function.linear_width, number(width));
    if (function.linear_width < 1e-100) return width.wrong("not at least 1e-100");
  } else if (width.exists()) {
    return width.wrong("only the axis asinh has one");
  }
  // Neighbours on the axis must differ: rounding could make them one.
  if (!(function.t_of(function.hi) > 0))
    return domain.wrong("[{}, {}] is no interval of the axis", function.lo, function.hi);
  return {};
}

// Reads a peak of the density. It falls linearly to 0 on both sides, and is `width` wide in values. A side that reaches
// out of the domain ends there. The domain and the axis have been read.
Result<std::vector<TransferFunction::Density>> read_isovalue(const JsonField& field, const TransferFunction& function) {
  SPLATVOL_TRY(field.check_names({"value", "width", "density"}));
  SPLATVOL_TRY_ASSIGN(value, number(field.member("value")));
  if (value < function.lo || value > function.hi)
    return field.member("value").wrong("{} is outside of the domain [{}, {}]; widen the domain", value, function.lo,
                                       function.hi);
  SPLATVOL_TRY_ASSIGN(width, positive(field.member("width")));
  SPLATVOL_TRY_ASSIGN(density, number(field.member("density")));
  if (density < 0) return field.member("density").wrong("{} is negative", density);
  const auto t_of = [&](double at) { return std::clamp(function.t_of(at), 0.0, 1.0); };
  const double t = t_of(value);
  const double low = std::min(t_of(value - 0.5 * width), t), high = std::max(t_of(value + 0.5 * width), t);
  return std::vector<TransferFunction::Density>{{0, 0}, {low, 0}, {t, density}, {high, 0}, {1, 0}};
}

Status read_domain(const JsonField& field, TransferFunction& function) {
  const JsonField domain = field.member("domain");
  SPLATVOL_TRY_ASSIGN(ends, domain.numbers(2, largest_number));
  if (!(ends[0] < ends[1])) return domain.wrong("[{}, {}] is not an interval", ends[0], ends[1]);
  function.lo = ends[0];
  function.hi = ends[1];
  return read_axis(field, domain, function);
}

Result<std::vector<TransferFunction::Color>> read_colors(const JsonField& field) {
  SPLATVOL_TRY_ASSIGN(rows, read_curve(field, 3));
  std::vector<TransferFunction::Color> colors;
  for (const auto& row : rows) colors.push_back({row[0], {row[1], row[2], row[3]}});
  return colors;
}

Result<TransferFunction> read_transfer_function(const JsonField& field) {
  SPLATVOL_TRY(
      field.check_names({"domain", "axis", "linear_width", "colors", "density", "density_factor", "isovalue"}));
  TransferFunction function;
  SPLATVOL_TRY(read_domain(field, function));
  if (field.has("density_factor")) SPLATVOL_TRY_SET(function.density_factor, positive(field.member("density_factor")));
  SPLATVOL_TRY_SET(function.colors, read_colors(field.member("colors")));
  if (field.has("isovalue")) {
    if (field.has("density")) return field.wrong("both density and isovalue; leave one of them out");
    SPLATVOL_TRY_SET(function.densities, read_isovalue(field.member("isovalue"), function));
    return function;
  }
  SPLATVOL_TRY_ASSIGN(densities, read_curve(field.member("density"), 1));
  for (const auto& row : densities) function.densities.push_back({row[0], row[1]});
  return function;
}

Result<SceneOpacity> read_opacity_function(const JsonField& field) {
  SPLATVOL_TRY(field.check_names({"attribute", "domain", "axis", "linear_width", "factor"}));
  SceneOpacity opacity;
  SPLATVOL_TRY_SET(opacity.attribute, name(field.member("attribute")));
  SPLATVOL_TRY(read_domain(field, opacity.function));
  const JsonField factors_field = field.member("factor");
  SPLATVOL_TRY_ASSIGN(factors, read_curve(factors_field, 1));
  for (std::size_t i = 0; i < factors.size(); ++i) {
    if (factors[i][1] > 1) return factors_field.element(i).wrong("{} is above 1", factors[i][1]);
    opacity.function.densities.push_back({factors[i][0], factors[i][1]});
  }
  opacity.function.colors = {{0, dvec3(1)}};
  return opacity;
}

Result<std::optional<Lighting>> read_lighting(const JsonField& field) {
  if (const auto is_lit = field.truth()) return *is_lit ? std::optional(Lighting{}) : std::nullopt;
  if (!field.is_object()) return field.wrong("neither true nor false nor an object");
  SPLATVOL_TRY(field.check_names({"ambient", "diffuse"}));
  SPLATVOL_TRY_ASSIGN(ambient, light(field.member("ambient")));
  SPLATVOL_TRY_ASSIGN(diffuse, light(field.member("diffuse")));
  return Lighting{ambient, diffuse};
}

Status read_truth(const JsonField& field, bool& truth) {
  if (field.exists()) SPLATVOL_TRY_SET(truth, field.truth());
  return {};
}

Status read_opacity(const JsonField& field, double& opacity) {
  if (!field.exists()) return {};
  SPLATVOL_TRY_SET(opacity, number(field));
  if (opacity < 0 || opacity > 1) return field.wrong("{} is outside [0, 1]", opacity);
  return {};
}

Result<SceneColoring> read_coloring(const JsonField& field) {
  SPLATVOL_TRY(field.check_names({"attribute", "domain", "axis", "linear_width", "colors"}));
  SceneColoring coloring;
  SPLATVOL_TRY_SET(coloring.attribute, name(field.member("attribute")));
  SPLATVOL_TRY(read_domain(field, coloring.function));
  SPLATVOL_TRY_SET(coloring.function.colors, read_colors(field.member("colors")));
  coloring.function.densities = {{0, 1}};
  return coloring;
}

constexpr std::array<std::pair<std::string_view, NearSide>, 3> near_sides = {
    {{"shown", NearSide::shown}, {"translucent", NearSide::translucent}, {"hidden", NearSide::hidden}}};

Status read_near_side(const JsonField& field, SceneSurface& surface) {
  if (!field.exists()) return {};
  SPLATVOL_TRY_ASSIGN(word, field.text());
  const auto found = std::ranges::find(near_sides, word, [](auto& side) { return side.first; });
  if (found == near_sides.end()) return field.wrong("'{}' is none of shown, translucent and hidden", word);
  if (surface.boundary.empty() && found->second != NearSide::shown)
    return field.wrong(
        "only a patch, \"boundary\", has a near side: a file of a surface does not tell where cells are");
  surface.near_side = found->second;
  return {};
}

Result<SceneSurface> read_surface(const JsonField& field) {
  SPLATVOL_TRY(field.check_names({"file", "boundary", "color", "color_by", "opacity", "shown", "edges", "near_side"}));
  SceneSurface surface;
  if (field.has("file") && field.has("boundary")) return field.wrong("give \"file\" or \"boundary\", not both");
  if (field.has("boundary"))
    SPLATVOL_TRY_SET(surface.boundary, name(field.member("boundary")));
  else
    SPLATVOL_TRY_SET(surface.file, name(field.member("file")));
  if (field.has("color")) SPLATVOL_TRY_SET(surface.color, color(field.member("color")));
  if (field.has("color_by")) SPLATVOL_TRY_SET(surface.color_by, read_coloring(field.member("color_by")));
  SPLATVOL_TRY(read_opacity(field.member("opacity"), surface.opacity));
  SPLATVOL_TRY(read_truth(field.member("shown"), surface.shown));
  SPLATVOL_TRY(read_truth(field.member("edges"), surface.edges));
  SPLATVOL_TRY(read_near_side(field.member("near_side"), surface));
  return surface;
}

Result<SceneContour> read_contour(const JsonField& field) {
  SPLATVOL_TRY(field.check_names({"values", "color", "color_by", "opacity", "shown"}));
  SceneContour contour;
  const JsonField values = field.member("values");
  if (values.size() == 0) return values.wrong("not a list of values");
  SPLATVOL_TRY_SET(contour.values, values.each(&number));
  if (field.has("color") && field.has("color_by")) return field.wrong("give \"color\" or \"color_by\", not both");
  if (field.has("color")) SPLATVOL_TRY_SET(contour.color, color(field.member("color")));
  if (field.has("color_by")) SPLATVOL_TRY_SET(contour.color_by, read_coloring(field.member("color_by")));
  SPLATVOL_TRY(read_opacity(field.member("opacity"), contour.opacity));
  SPLATVOL_TRY(read_truth(field.member("shown"), contour.shown));
  return contour;
}

Result<std::vector<dvec3>> corners(const JsonField& field, std::size_t count) {
  if (field.size() != count) return field.wrong("not a list of {} positions", count);
  return field.each(&vector);
}

Status read_number_of_seeds(const JsonField& field, std::size_t& count) {
  if (!field.exists()) return {};
  SPLATVOL_TRY_SET(count, whole(field, 1, static_cast<int>(most_seeds)));
  return {};
}

Result<Seeds> read_seeds(const JsonField& field) {
  SPLATVOL_TRY(field.check_names({"positions", "line", "rectangle", "patch", "count", "counts"}));
  const auto shapes = {"positions", "line", "rectangle", "patch"};
  if (std::ranges::count_if(shapes, [&](const char* shape) { return field.has(shape); }) != 1)
    return field.wrong("give one of \"positions\", \"line\", \"rectangle\" and \"patch\"");
  if (field.has("counts") != field.has("rectangle") ||
      (field.has("count") && !field.has("line") && !field.has("patch")))
    return field.wrong("\"counts\" is for a rectangle, \"count\" for a line or a patch");
  if (const JsonField positions = field.member("positions"); positions.exists()) {
    if (positions.size() == 0) return positions.wrong("not a list of positions");
    return positions.each(&vector).map([](std::vector<dvec3> all) { return Seeds(std::move(all)); });
  }
  if (field.has("line")) {
    SPLATVOL_TRY_ASSIGN(ends, corners(field.member("line"), 2));
    SeedLine line{ends[0], ends[1]};
    SPLATVOL_TRY(read_number_of_seeds(field.member("count"), line.count));
    return line;
  }
  if (field.has("patch")) {
    SeedPatch patch;
    SPLATVOL_TRY_SET(patch.patch, name(field.member("patch")));
    SPLATVOL_TRY(read_number_of_seeds(field.member("count"), patch.count));
    return patch;
  }
  SPLATVOL_TRY_ASSIGN(all, corners(field.member("rectangle"), 3));
  SeedRectangle rectangle{all[0], all[1], all[2]};
  const JsonField counts = field.member("counts");
  if (counts.size() != 2) return counts.wrong("not a list of two numbers");
  for (std::size_t side = 0; side < 2; ++side)
    SPLATVOL_TRY(read_number_of_seeds(counts.element(side), rectangle.counts[side]));
  return rectangle;
}

constexpr std::array<std::pair<std::string_view, StreamlineDirection>, 3> directions = {
    {{"both", StreamlineDirection::both},
     {"forward", StreamlineDirection::forward},
     {"backward", StreamlineDirection::backward}}};

Result<SceneStreamlines> read_streamlines(const JsonField& field) {
  SPLATVOL_TRY(
      field.check_names({"vector", "seeds", "direction", "length", "steps", "radius", "color", "color_by", "shown"}));
  SceneStreamlines streamlines;
  SPLATVOL_TRY_SET(streamlines.vector, name(field.member("vector")));
  SPLATVOL_TRY_SET(streamlines.seeds, read_seeds(field.member("seeds")));
  if (const JsonField direction = field.member("direction"); direction.exists()) {
    SPLATVOL_TRY_ASSIGN(word, direction.text());
    const auto found = std::ranges::find(directions, word, [](const auto& known) { return known.first; });
    if (found == directions.end()) return direction.wrong("'{}' is none of both, forward and backward", word);
    streamlines.direction = found->second;
  }
  if (field.has("length")) SPLATVOL_TRY_SET(streamlines.max_length, positive(field.member("length")));
  if (field.has("steps"))
    SPLATVOL_TRY_SET(streamlines.max_steps, whole(field.member("steps"), 1, std::numeric_limits<int>::max()));
  SPLATVOL_TRY_SET(streamlines.radius, positive(field.member("radius")));
  if (field.has("color")) SPLATVOL_TRY_SET(streamlines.color, color(field.member("color")));
  if (field.has("color_by")) SPLATVOL_TRY_SET(streamlines.color_by, read_coloring(field.member("color_by")));
  SPLATVOL_TRY(read_truth(field.member("shown"), streamlines.shown));
  return streamlines;
}

Status read_plane(const JsonField& field, dvec3& point, dvec3& normal) {
  SPLATVOL_TRY_SET(point, vector(field.member("point")));
  SPLATVOL_TRY_SET(normal, vector(field.member("normal")));
  if (normal == dvec3(0)) return field.wrong("the normal has no direction; give one that is not [0, 0, 0]");
  return {};
}

Result<SceneSlice> read_slice(const JsonField& field) {
  SPLATVOL_TRY(field.check_names({"point", "normal", "opacity", "shown"}));
  SceneSlice slice;
  SPLATVOL_TRY(read_plane(field, slice.point, slice.normal));
  SPLATVOL_TRY(read_opacity(field.member("opacity"), slice.opacity));
  SPLATVOL_TRY(read_truth(field.member("shown"), slice.shown));
  return slice;
}

Result<SceneClipPlane> read_clip_plane(const JsonField& field) {
  SPLATVOL_TRY(field.check_names({"point", "normal", "active"}));
  SceneClipPlane plane;
  SPLATVOL_TRY(read_plane(field, plane.point, plane.normal));
  SPLATVOL_TRY(read_truth(field.member("active"), plane.active));
  return plane;
}

// Each costs time in every pixel.
constexpr std::size_t most_planes = 64;

template <class Element>
Status read_planes(const JsonField& field, Result<Element> (*read)(const JsonField& field), std::vector<Element>& all) {
  if (!field.exists()) return {};
  if (field.size() > most_planes) return field.wrong("{} planes; at most {} are drawn", field.size(), most_planes);
  SPLATVOL_TRY_SET(all, field.each(read));
  return {};
}

constexpr std::size_t most_surfaces = 4096;

Result<std::vector<SceneSurface>> read_surfaces(const JsonField& field) {
  if (field.size() > most_surfaces)
    return field.wrong("{} surfaces; at most {} are drawn: join some in one file", field.size(), most_surfaces);
  return field.each(read_surface);
}

constexpr int fewest_ticks = 2, most_ticks = 20;

Result<ScalarBar> read_scalar_bar(const JsonField& field) {
  SPLATVOL_TRY(field.check_names({"ticks", "unit"}));
  ScalarBar bar;
  if (field.has("ticks")) SPLATVOL_TRY_SET(bar.ticks, whole(field.member("ticks"), fewest_ticks, most_ticks));
  if (field.has("unit")) SPLATVOL_TRY_SET(bar.unit, field.member("unit").text());
  return bar;
}

Result<Box> read_clip_box(const JsonField& field) {
  SPLATVOL_TRY(field.check_names({"low", "high"}));
  SPLATVOL_TRY_ASSIGN(low, vector(field.member("low")));
  SPLATVOL_TRY_ASSIGN(high, vector(field.member("high")));
  if (!(low.x < high.x && low.y < high.y && low.z < high.z)) return field.wrong("low is not below high");
  return Box{low, high};
}

Result<Scene> read_scene(const JsonField& field) {
  if (!field.is_object()) return fail(ErrorCode::invalid_data, "a scene is a JSON object");
  SPLATVOL_TRY(field.check_names({"file",       "pieces",      "step",       "exact",
                                  "max_error",  "tolerance",   "kernel",     "splats",
                                  "resolution", "sort",        "sampling",   "camera",
                                  "image",      "background",  "attribute",  "transfer_function",
                                  "clip_box",   "lighting",    "outline",    "surfaces",
                                  "slices",     "clip_planes", "scalar_bar", "opacity",
                                  "contours",   "streamlines"}));
  Scene scene;
  SPLATVOL_TRY_SET(scene.camera, read_camera(field.member("camera")));
  SPLATVOL_TRY(read_size(field.member("image"), scene));
  SPLATVOL_TRY(make_view(scene.camera, scene.width, scene.height));

  SPLATVOL_TRY_SET(scene.attribute, name(field.member("attribute")));
  SPLATVOL_TRY_SET(scene.transfer_function, read_transfer_function(field.member("transfer_function")));
  if (field.has("opacity")) SPLATVOL_TRY_SET(scene.opacity, read_opacity_function(field.member("opacity")));

  if (field.has("background")) SPLATVOL_TRY_SET(scene.background, color(field.member("background")));
  if (field.has("clip_box")) SPLATVOL_TRY_SET(scene.clip_box, read_clip_box(field.member("clip_box")));
  if (field.has("lighting")) SPLATVOL_TRY_SET(scene.lighting, read_lighting(field.member("lighting")));
  SPLATVOL_TRY(read_truth(field.member("outline"), scene.outline));
  if (field.has("scalar_bar")) SPLATVOL_TRY_SET(scene.scalar_bar, read_scalar_bar(field.member("scalar_bar")));
  if (field.has("surfaces")) SPLATVOL_TRY_SET(scene.surfaces, read_surfaces(field.member("surfaces")));
  if (const JsonField contours = field.member("contours"); contours.exists()) {
    SPLATVOL_TRY_SET(scene.contours, contours.each(&read_contour));
    SPLATVOL_TRY(check_contours(scene.contours));
  }
  if (const JsonField streamlines = field.member("streamlines"); streamlines.exists())
    SPLATVOL_TRY_SET(scene.streamlines, streamlines.each(&read_streamlines));
  SPLATVOL_TRY(read_planes(field.member("slices"), &read_slice, scene.slices));
  SPLATVOL_TRY(read_planes(field.member("clip_planes"), &read_clip_plane, scene.clip_planes));
  return scene;
}

// Reads a number that has no other bound than that of a count.
template <class Count>
Status read_count(const JsonField& field, int least, std::optional<Count>& count) {
  if (!field.exists()) return {};
  constexpr double most = 1e15;  // a double holds whole numbers beyond
  SPLATVOL_TRY_ASSIGN(read, number(field));
  if (read != std::floor(read) || read < least || read > most) return field.wrong("not a whole number from {}", least);
  count = static_cast<Count>(read);
  return {};
}

Result<Quality> read_quality(const JsonField& field) {
  Quality quality;
  SPLATVOL_TRY(read_truth(field.member("exact"), quality.exact));
  if (field.has("max_error")) SPLATVOL_TRY_SET(quality.max_error, positive(field.member("max_error")));
  if (const JsonField tolerance = field.member("tolerance"); tolerance.exists()) {
    SPLATVOL_TRY_ASSIGN(percent, number(tolerance));
    if (percent < 0 || percent > 100) return tolerance.wrong("{} is outside [0, 100]", percent);
    quality.tolerance_percent = percent;
  }
  SPLATVOL_TRY(read_count(field.member("splats"), 1, quality.max_splats));
  SPLATVOL_TRY(read_count(field.member("resolution"), 0, quality.resolution));
  if (const Status checked = check_quality(quality); !checked) return field.wrong("{}", checked.error().message);
  return quality;
}

Result<Drawing> read_drawing(const JsonField& field) {
  Drawing drawing;
  if (const JsonField kernel = field.member("kernel"); kernel.exists()) {
    SPLATVOL_TRY_ASSIGN(word, kernel.text());
    drawing.kernel = kernel_named(word);
    if (!drawing.kernel) return kernel.wrong("'{}' is neither moments nor octant", word);
  }
  if (const JsonField sort = field.member("sort"); sort.exists()) {
    SPLATVOL_TRY_ASSIGN(word, sort.text());
    drawing.sort = sort_named(word);
    if (!drawing.sort) return sort.wrong("'{}' is none of none, axis and exact", word);
  }
  if (field.has("sampling"))
    SPLATVOL_TRY_SET(drawing.sample_spacing, whole(field.member("sampling"), 1, max_sample_spacing));
  return drawing;
}

Result<SceneUse> read_use(const JsonField& field) {
  SceneUse use;
  if (field.has("file")) SPLATVOL_TRY_SET(use.file, name(field.member("file")));
  if (const JsonField pieces = field.member("pieces"); pieces.exists()) {
    if (use.file.empty()) return pieces.wrong("pieces of no file: name the first one as \"file\"");
    SPLATVOL_TRY_SET(use.pieces, pieces.each(name));
  }
  SPLATVOL_TRY(read_count(field.member("step"), 0, use.step));
  SPLATVOL_TRY_SET(use.quality, read_quality(field));
  SPLATVOL_TRY_SET(use.drawing, read_drawing(field));
  return use;
}

Result<UsedScene> read_used_scene(const JsonField& field) {
  SPLATVOL_TRY_ASSIGN(scene, read_scene(field));
  SPLATVOL_TRY_ASSIGN(use, read_use(field));
  return UsedScene{std::move(scene), std::move(use)};
}

nlohmann::ordered_json json_of(const dvec3& v) { return {v.x, v.y, v.z}; }

nlohmann::ordered_json json_of(const Camera& camera) {
  nlohmann::ordered_json document;
  if (camera.projection == Camera::Projection::perspective)
    document = {{"projection", "perspective"}, {"vertical_fov_degrees", camera.vertical_fov_degrees}};
  else
    document = {{"projection", "orthographic"}, {"parallel_height", camera.parallel_height}};
  document["position"] = json_of(camera.position);
  document["focal_point"] = json_of(camera.focal_point);
  document["up"] = json_of(camera.up);
  return document;
}

/// Writes the domain and its axis.
void add_domain(const TransferFunction& function, nlohmann::ordered_json& document) {
  document["domain"] = {function.lo, function.hi};
  if (function.axis != ValueAxis::linear)
    document["axis"] = std::ranges::find(axes, function.axis, [](auto& axis) { return axis.second; })->first;
  if (function.axis == ValueAxis::asinh) document["linear_width"] = function.linear_width;
}

void add_colors(const TransferFunction& function, nlohmann::ordered_json& document) {
  for (const auto& [t, rgb] : function.colors) document["colors"].push_back({t, rgb.r, rgb.g, rgb.b});
}

nlohmann::ordered_json json_of(const SceneColoring& coloring) {
  nlohmann::ordered_json document = {{"attribute", coloring.attribute}};
  add_domain(coloring.function, document);
  add_colors(coloring.function, document);
  return document;
}

nlohmann::ordered_json json_of(const SceneContour& contour) {
  nlohmann::ordered_json document = {{"values", contour.values}};
  if (contour.color) document["color"] = json_of(*contour.color);
  if (contour.color_by) document["color_by"] = json_of(*contour.color_by);
  document["opacity"] = contour.opacity;
  document["shown"] = contour.shown;
  return document;
}

nlohmann::ordered_json json_of(const SceneSurface& surface) {
  nlohmann::ordered_json document = {surface.boundary.empty()
                                         ? nlohmann::ordered_json::array({"file", surface.file})
                                         : nlohmann::ordered_json::array({"boundary", surface.boundary}),
                                     {"color", json_of(surface.color)},
                                     {"opacity", surface.opacity},
                                     {"shown", surface.shown},
                                     {"edges", surface.edges}};
  if (surface.color_by) document["color_by"] = json_of(*surface.color_by);
  if (surface.near_side != NearSide::shown && !surface.boundary.empty())
    document["near_side"] =
        std::ranges::find(near_sides, surface.near_side, [](auto& side) { return side.second; })->first;
  return document;
}

nlohmann::ordered_json json_of(const Seeds& seeds) {
  const auto list_of = [](std::span<const dvec3> positions) {
    auto list = nlohmann::ordered_json::array();
    for (const dvec3& position : positions) list.push_back(json_of(position));
    return list;
  };
  if (const auto* line = std::get_if<SeedLine>(&seeds))
    return {{"line", list_of(std::array{line->start, line->end})}, {"count", line->count}};
  if (const auto* rectangle = std::get_if<SeedRectangle>(&seeds))
    return {{"rectangle", list_of(std::array{rectangle->corner, rectangle->first, rectangle->second})},
            {"counts", rectangle->counts}};
  if (const auto* patch = std::get_if<SeedPatch>(&seeds)) return {{"patch", patch->patch}, {"count", patch->count}};
  return {{"positions", list_of(std::get<std::vector<dvec3>>(seeds))}};
}

nlohmann::ordered_json json_of(const SceneStreamlines& streamlines) {
  nlohmann::ordered_json document = {{"vector", streamlines.vector}, {"seeds", json_of(streamlines.seeds)}};
  document["direction"] =
      std::ranges::find(directions, streamlines.direction, [](const auto& known) { return known.second; })->first;
  if (streamlines.max_length) document["length"] = *streamlines.max_length;
  document["steps"] = streamlines.max_steps;
  document["radius"] = streamlines.radius;
  document["color"] = json_of(streamlines.color);
  if (streamlines.color_by) document["color_by"] = json_of(*streamlines.color_by);
  document["shown"] = streamlines.shown;
  return document;
}

nlohmann::ordered_json json_of(const SceneSlice& slice) {
  return {{"point", json_of(slice.point)},
          {"normal", json_of(slice.normal)},
          {"opacity", slice.opacity},
          {"shown", slice.shown}};
}

nlohmann::ordered_json json_of(const SceneClipPlane& plane) {
  return {{"point", json_of(plane.point)}, {"normal", json_of(plane.normal)}, {"active", plane.active}};
}

void add_densities(const TransferFunction& function, nlohmann::ordered_json& document) {
  for (const auto& [t, extinction] : function.densities) document["density"].push_back({t, extinction});
  if (function.density_factor != 1) document["density_factor"] = function.density_factor;
}

void add_quality(const Quality& quality, nlohmann::ordered_json& document) {
  if (quality.exact) document["exact"] = true;
  if (quality.max_error) document["max_error"] = *quality.max_error;
  if (quality.tolerance_percent) document["tolerance"] = *quality.tolerance_percent;
  if (quality.max_splats) document["splats"] = *quality.max_splats;
  if (quality.resolution) document["resolution"] = *quality.resolution;
}

void add_drawing(const Drawing& drawing, nlohmann::ordered_json& document) {
  if (drawing.kernel) document["kernel"] = name_of(*drawing.kernel);
  if (drawing.sort) document["sort"] = name_of(*drawing.sort);
  if (drawing.sample_spacing) document["sampling"] = *drawing.sample_spacing;
}

std::string text_of(const nlohmann::ordered_json& document, int indent = 1) {
  return json_text(document, indent) + (indent < 0 ? "" : "\n");
}

}  // namespace

Result<Camera> read_camera(const JsonField& json) {
  SPLATVOL_TRY(
      json.check_names({"projection", "vertical_fov_degrees", "parallel_height", "position", "focal_point", "up"}));
  Camera camera;
  SPLATVOL_TRY_SET(camera.position, vector(json.member("position")));
  SPLATVOL_TRY_SET(camera.focal_point, vector(json.member("focal_point")));
  SPLATVOL_TRY_SET(camera.up, vector(json.member("up")));
  SPLATVOL_TRY(read_projection(json, camera));
  return camera;
}

// Both read all fields: a field that one of them refuses would be lost by the other.
Result<UsedScene> parse_used_scene(const std::string& text) try {
  return read_json(text, &read_used_scene);
} catch (const std::exception& error) {
  return fail(ErrorCode::out_of_budget, "cannot hold the scene: {}", error.what());
}

Result<Scene> parse_scene(const std::string& text) {
  SPLATVOL_TRY_ASSIGN(used, parse_used_scene(text));
  return std::move(used.scene);
}

std::string camera_to_json(const Camera& camera) { return text_of(json_of(camera)); }

std::string scene_to_json(const Scene& scene) { return to_json({scene, {}}); }

std::string to_json(const UsedScene& used, int indent) {
  const auto& [scene, use] = used;
  nlohmann::ordered_json document;
  if (!use.file.empty()) document["file"] = use.file;
  if (!use.pieces.empty()) document["pieces"] = use.pieces;
  if (use.step) document["step"] = *use.step;
  add_quality(use.quality, document);
  add_drawing(use.drawing, document);
  document["camera"] = json_of(scene.camera);
  document["image"] = {{"width", scene.width}, {"height", scene.height}};
  document["background"] = json_of(scene.background);
  document["attribute"] = scene.attribute;
  nlohmann::ordered_json& function = document["transfer_function"];
  add_domain(scene.transfer_function, function);
  add_colors(scene.transfer_function, function);
  add_densities(scene.transfer_function, function);
  if (scene.opacity) {
    nlohmann::ordered_json& opacity = document["opacity"];
    opacity["attribute"] = scene.opacity->attribute;
    add_domain(scene.opacity->function, opacity);
    for (const auto& [t, factor] : scene.opacity->function.densities) opacity["factor"].push_back({t, factor});
  }
  document["lighting"] = false;
  if (scene.lighting)
    document["lighting"] = {{"ambient", scene.lighting->ambient}, {"diffuse", scene.lighting->diffuse}};
  if (scene.outline) document["outline"] = true;
  if (scene.scalar_bar != ScalarBar())
    document["scalar_bar"] = {{"ticks", scene.scalar_bar.ticks}, {"unit", scene.scalar_bar.unit}};
  if (scene.clip_box)
    document["clip_box"] = {{"low", json_of(scene.clip_box->low)}, {"high", json_of(scene.clip_box->high)}};
  for (const SceneSurface& surface : scene.surfaces) document["surfaces"].push_back(json_of(surface));
  for (const SceneContour& contour : scene.contours) document["contours"].push_back(json_of(contour));
  for (const SceneStreamlines& streamlines : scene.streamlines) document["streamlines"].push_back(json_of(streamlines));
  for (const SceneSlice& slice : scene.slices) document["slices"].push_back(json_of(slice));
  for (const SceneClipPlane& plane : scene.clip_planes) document["clip_planes"].push_back(json_of(plane));
  return text_of(document, indent);
}

Result<UsedScene> load_used_scene(const std::string& path_or_json) {
  const bool is_text = path_or_json.starts_with('{');
  std::string text = path_or_json;
  if (!is_text) SPLATVOL_TRY_SET(text, read_text_file(path_or_json));
  auto used = parse_used_scene(text);
  if (!used) return fail_in(is_text ? "the scene" : path_or_json, used.error());
  std::error_code error;
  const std::filesystem::path folder =
      is_text ? std::filesystem::current_path(error) : std::filesystem::absolute(path_or_json, error).parent_path();
  const auto make_absolute = [&](std::string& path) { path = (folder / path).lexically_normal().string(); };
  for (SceneSurface& surface : used->scene.surfaces)
    if (surface.boundary.empty()) make_absolute(surface.file);
  if (!used->use.file.empty() && !is_url(used->use.file)) make_absolute(used->use.file);
  for (std::string& piece : used->use.pieces) make_absolute(piece);
  return used;
}

Result<Scene> load_scene(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(used, load_used_scene(path));
  return std::move(used.scene);
}

}  // namespace splatvol
