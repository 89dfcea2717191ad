#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <initializer_list>
#include <nlohmann/json.hpp>
#include <numeric>
#include <string_view>

#include "base/file.h"
#include "base/json.h"
#include "scene/isovalue.h"
#include "scene/scene.h"

namespace splatvol {
namespace {

using nlohmann::json;

constexpr int largest_image_side = 16384;
constexpr double largest_number = 1e100;  // of lengths and values: squares stay in the range of double precision
constexpr double largest_light = 1e37;    // of colours and light, which are drawn in single precision

/// Returns how many letters must be added, left out or replaced to turn one word into the other (Levenshtein).
std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  std::iota(row.begin(), row.end(), std::size_t{0});
  for (std::size_t i = 0; i < a.size(); ++i) {
    std::size_t diagonal = std::exchange(row[0], i + 1);
    for (std::size_t j = 0; j < b.size(); ++j) {
      const std::size_t replaced = diagonal + (a[i] == b[j] ? 0 : 1);
      diagonal = std::exchange(row[j + 1], std::min({row[j] + 1, row[j + 1] + 1, replaced}));
    }
  }
  return row.back();
}

/// A value of the file together with its path, so that every error names the field.
class Field {
 public:
  Field(const json& value, std::string path) : value_(value), path_(std::move(path)) {}

  template <class... Args>
  tl::unexpected<Error> wrong(fmt::format_string<Args...> format, Args&&... args) const {
    return fail(ErrorCode::invalid_data, "{}: {}", path_, fmt::format(format, std::forward<Args>(args)...));
  }

  bool is_object() const { return value_.is_object(); }
  bool has(const char* name) const { return is_object() && value_.contains(name); }

  Result<Field> member(const char* name) const {
    if (!is_object()) return wrong("not an object");
    const std::string path = path_.empty() ? name : path_ + "." + name;
    if (!value_.contains(name)) return fail(ErrorCode::invalid_data, "{}: missing", path);
    return Field(value_.at(name), path);
  }

  /// Fails if there is a member of another name, unless the name begins with "x-". A misspelt field would be ignored.
  Status check_names(std::initializer_list<std::string_view> known) const {
    if (!is_object()) return {};
    for (const auto& [name, value] : value_.items()) {
      if (name.starts_with("x-") || std::ranges::find(known, name) != known.end()) continue;
      const auto nearest = std::ranges::min_element(
          known, {}, [&, &word = name](std::string_view other) { return edit_distance(word, other); });
      const std::string prefix = path_.empty() ? "" : path_ + ".";
      return fail(ErrorCode::invalid_data, "{}{}: no such field; the nearest is {}{} (names of your own begin with x-)",
                  prefix, name, prefix, *nearest);
    }
    return {};
  }

  std::size_t size() const { return value_.is_array() ? value_.size() : 0; }
  Field element(std::size_t i) const { return {value_.at(i), fmt::format("{}[{}]", path_, i)}; }

  Result<double> number() const {
    if (!value_.is_number()) return wrong("not a number");
    const double number = value_.get<double>();
    if (!std::isfinite(number)) return wrong("not finite");
    if (std::abs(number) > largest_number) return wrong("beyond {}", largest_number);
    return number;
  }

  /// As number, for colours and light: from 0 up.
  Result<double> light() const {
    SPLATVOL_TRY_ASSIGN(light, number());
    if (light < 0) return wrong("{} is negative", light);
    if (light > largest_light) return wrong("beyond {}", largest_light);
    return light;
  }

  Result<std::vector<double>> numbers(std::size_t count) const {
    if (!value_.is_array() || value_.size() != count) return wrong("not a list of {} numbers", count);
    std::vector<double> list;
    for (std::size_t i = 0; i < count; ++i) {
      SPLATVOL_TRY_ASSIGN(number, element(i).number());
      list.push_back(number);
    }
    return list;
  }

  Result<dvec3> vector() const {
    SPLATVOL_TRY_ASSIGN(list, numbers(3));
    return dvec3(list[0], list[1], list[2]);
  }

  Result<std::string> text() const {
    if (!value_.is_string()) return wrong("not a string");
    return value_.get<std::string>();
  }

  bool is_list() const { return value_.is_array(); }
  bool is_truth() const { return value_.is_boolean(); }
  bool truth() const { return value_.get<bool>(); }

  Result<int> image_side() const {
    SPLATVOL_TRY_ASSIGN(side, number());
    if (side != std::floor(side) || side < 1 || side > largest_image_side)
      return wrong("not a whole number from 1 to {}", largest_image_side);
    return static_cast<int>(side);
  }

 private:
  const json& value_;
  std::string path_;
};

Result<dvec3> vector_at(const Field& parent, const char* name) {
  SPLATVOL_TRY_ASSIGN(field, parent.member(name));
  return field.vector();
}

Result<double> amount_at(const Field& parent, const char* name) {
  SPLATVOL_TRY_ASSIGN(field, parent.member(name));
  return field.light();
}

Result<dvec3> color_at(const Field& parent, const char* name) {
  SPLATVOL_TRY_ASSIGN(field, parent.member(name));
  SPLATVOL_TRY_ASSIGN(rgb, field.vector());
  if (rgb.r < 0 || rgb.g < 0 || rgb.b < 0) return field.wrong("negative colour");
  for (std::size_t channel = 0; channel < 3; ++channel) SPLATVOL_TRY(field.element(channel).light());
  return rgb;
}

Status read_projection(const Field& field, Camera& camera) {
  if (field.has("projection")) {
    SPLATVOL_TRY_ASSIGN(projection, field.member("projection"));
    SPLATVOL_TRY_ASSIGN(name, projection.text());
    if (name != "perspective" && name != "orthographic")
      return projection.wrong("'{}' is neither perspective nor orthographic", name);
    if (name == "orthographic") camera.projection = Camera::Projection::orthographic;
  }
  if (camera.projection == Camera::Projection::orthographic) {
    SPLATVOL_TRY_ASSIGN(height, field.member("parallel_height"));
    SPLATVOL_TRY_ASSIGN(world_units, height.number());
    if (world_units <= 0) return height.wrong("not above 0");
    camera.parallel_height = world_units;
    return {};
  }
  SPLATVOL_TRY_ASSIGN(angle, field.member("vertical_fov_degrees"));
  SPLATVOL_TRY_ASSIGN(degrees, angle.number());
  if (degrees <= 0 || degrees >= 180) return angle.wrong("not between 0 and 180");
  camera.vertical_fov_degrees = degrees;
  return {};
}

Result<Camera> read_camera(const Field& field) {
  SPLATVOL_TRY(
      field.check_names({"projection", "vertical_fov_degrees", "parallel_height", "position", "focal_point", "up"}));
  Camera camera;
  SPLATVOL_TRY_ASSIGN(position, vector_at(field, "position"));
  SPLATVOL_TRY_ASSIGN(focal_point, vector_at(field, "focal_point"));
  SPLATVOL_TRY_ASSIGN(up, vector_at(field, "up"));
  camera.position = position;
  camera.focal_point = focal_point;
  camera.up = up;
  SPLATVOL_TRY(read_projection(field, camera));
  return camera;
}

Status read_size(const Field& scene, int& width, int& height) {
  SPLATVOL_TRY_ASSIGN(image, scene.member("image"));
  SPLATVOL_TRY(image.check_names({"width", "height"}));
  SPLATVOL_TRY_ASSIGN(width_field, image.member("width"));
  SPLATVOL_TRY_ASSIGN(height_field, image.member("height"));
  SPLATVOL_TRY_ASSIGN(columns, width_field.image_side());
  SPLATVOL_TRY_ASSIGN(rows, height_field.image_side());
  width = columns;
  height = rows;
  return {};
}

constexpr std::size_t most_control_points = 4096;  // the time to make a table grows with them

/// Reads the control points of one curve: rows of t and `channels` values that are not negative.
Result<std::vector<std::vector<double>>> read_curve(const Field& parent, const char* name, std::size_t channels) {
  SPLATVOL_TRY_ASSIGN(field, parent.member(name));
  if (field.size() == 0) return field.wrong("not a list of control points");
  if (field.size() > most_control_points)
    return field.wrong("{} control points; at most {} are drawn", field.size(), most_control_points);
  std::vector<std::vector<double>> rows;
  for (std::size_t i = 0; i < field.size(); ++i) {
    const Field point = field.element(i);
    SPLATVOL_TRY_ASSIGN(row, point.numbers(1 + channels));
    if (row[0] < 0 || row[0] > 1) return point.wrong("t = {} is outside [0, 1]", row[0]);
    if (!rows.empty() && row[0] < rows.back()[0]) return point.wrong("t = {} is below the one before", row[0]);
    for (std::size_t channel = 1; channel <= channels; ++channel) {
      if (row[channel] < 0) return point.wrong("{} is negative", row[channel]);
      if (channels > 1) SPLATVOL_TRY(point.element(channel).light());
    }
    rows.push_back(std::move(row));
  }
  return rows;
}

constexpr std::array<std::pair<std::string_view, ValueAxis>, 3> axes = {
    {{"linear", ValueAxis::linear}, {"log", ValueAxis::log}, {"asinh", ValueAxis::asinh}}};

/// Reads how t runs over the domain, which has been read.
Status read_axis(const Field& field, const Field& domain, TransferFunction& function) {
  if (field.has("axis")) {
    SPLATVOL_TRY_ASSIGN(axis, field.member("axis"));
    SPLATVOL_TRY_ASSIGN(name, axis.text());
    const auto found = std::ranges::find(axes, name, &std::pair<std::string_view, ValueAxis>::first);
    if (found == axes.end()) return axis.wrong("'{}' is neither linear nor log nor asinh", name);
    function.axis = found->second;
  }
  if (function.axis == ValueAxis::log && !(function.lo > 0))
    return domain.wrong("[{}, {}] is not above 0, which the axis log needs; asinh shows both signs", function.lo,
                        function.hi);
  if (function.axis == ValueAxis::asinh) {
    SPLATVOL_TRY_ASSIGN(width_field, field.member("linear_width"));
    SPLATVOL_TRY_ASSIGN(width, width_field.number());
    if (width < 1e-100) return width_field.wrong("not at least 1e-100");
    function.linear_width = width;
  } else if (field.has("linear_width")) {
    SPLATVOL_TRY_ASSIGN(width_field, field.member("linear_width"));
    return width_field.wrong("only the axis asinh has one");
  }
  // Neighbours on the axis must differ: rounding could make them one.
  if (!(function.t_of(function.hi) > 0))
    return domain.wrong("[{}, {}] is no interval of the axis", function.lo, function.hi);
  return {};
}

/// Reads the peak that takes the density's place. The domain and the axis have been read.
Result<Isovalue> read_isovalue(const Field& function_field, const TransferFunction& function) {
  SPLATVOL_TRY_ASSIGN(field, function_field.member("isovalue"));
  SPLATVOL_TRY(field.check_names({"value", "width", "density"}));
  SPLATVOL_TRY_ASSIGN(value_field, field.member("value"));
  SPLATVOL_TRY_ASSIGN(value, value_field.number());
  if (value < function.lo || value > function.hi)
    return value_field.wrong("{} is outside of the domain [{}, {}]; widen the domain", value, function.lo, function.hi);
  SPLATVOL_TRY_ASSIGN(width_field, field.member("width"));
  SPLATVOL_TRY_ASSIGN(width, width_field.number());
  if (!(width > 0)) return width_field.wrong("not above 0");
  SPLATVOL_TRY_ASSIGN(density_field, field.member("density"));
  SPLATVOL_TRY_ASSIGN(density, density_field.number());
  if (density < 0) return density_field.wrong("{} is negative", density);
  return Isovalue{value, width, density};
}

Status read_domain(const Field& field, TransferFunction& function) {
  SPLATVOL_TRY_ASSIGN(domain_field, field.member("domain"));
  SPLATVOL_TRY_ASSIGN(domain, domain_field.numbers(2));
  if (!(domain[0] < domain[1])) return domain_field.wrong("[{}, {}] is not an interval", domain[0], domain[1]);
  function.lo = domain[0];
  function.hi = domain[1];
  return read_axis(field, domain_field, function);
}

Result<TransferFunction> read_transfer_function(const Field& scene) {
  SPLATVOL_TRY_ASSIGN(field, scene.member("transfer_function"));
  SPLATVOL_TRY(field.check_names({"domain", "axis", "linear_width", "colors", "density", "isovalue"}));
  TransferFunction function;
  SPLATVOL_TRY(read_domain(field, function));
  SPLATVOL_TRY_ASSIGN(colors, read_curve(field, "colors", 3));
  for (const auto& row : colors) function.colors.push_back({row[0], {row[1], row[2], row[3]}});
  if (field.has("isovalue")) {
    if (field.has("density"))
      return fail(ErrorCode::invalid_data, "transfer_function: both density and isovalue; leave one of them out");
    SPLATVOL_TRY_ASSIGN(isovalue, read_isovalue(field, function));
    function.densities = densities_of(function, isovalue);
    return function;
  }
  SPLATVOL_TRY_ASSIGN(densities, read_curve(field, "density", 1));
  for (const auto& row : densities) function.densities.push_back({row[0], row[1]});
  return function;
}

Result<SceneOpacity> read_opacity_function(const Field& field) {
  SPLATVOL_TRY(field.check_names({"attribute", "domain", "axis", "linear_width", "factor"}));
  SPLATVOL_TRY_ASSIGN(name_field, field.member("attribute"));
  SPLATVOL_TRY_ASSIGN(name, name_field.text());
  if (name.empty()) return name_field.wrong("empty");
  SceneOpacity opacity{name, {}};
  SPLATVOL_TRY(read_domain(field, opacity.function));
  SPLATVOL_TRY_ASSIGN(factors_field, field.member("factor"));
  SPLATVOL_TRY_ASSIGN(factors, read_curve(field, "factor", 1));
  for (std::size_t i = 0; i < factors.size(); ++i) {
    if (factors[i][1] > 1) return factors_field.element(i).wrong("{} is above 1", factors[i][1]);
    opacity.function.densities.push_back({factors[i][0], factors[i][1]});
  }
  opacity.function.colors = {{0, dvec3(1)}};
  return opacity;
}

Result<std::optional<Lighting>> read_lighting(const Field& field) {
  if (field.is_truth()) return field.truth() ? std::optional(Lighting{}) : std::nullopt;
  if (!field.is_object()) return field.wrong("neither true nor false nor an object");
  SPLATVOL_TRY(field.check_names({"ambient", "diffuse"}));
  SPLATVOL_TRY_ASSIGN(ambient, amount_at(field, "ambient"));
  SPLATVOL_TRY_ASSIGN(diffuse, amount_at(field, "diffuse"));
  return Lighting{ambient, diffuse};
}

Status read_truth(const Field& parent, const char* name, bool& truth) {
  if (!parent.has(name)) return {};
  SPLATVOL_TRY_ASSIGN(field, parent.member(name));
  if (!field.is_truth()) return field.wrong("neither true nor false");
  truth = field.truth();
  return {};
}

Status read_opacity(const Field& parent, double& opacity) {
  if (!parent.has("opacity")) return {};
  SPLATVOL_TRY_ASSIGN(field, parent.member("opacity"));
  SPLATVOL_TRY_ASSIGN(number, field.number());
  if (number < 0 || number > 1) return field.wrong("{} is outside [0, 1]", number);
  opacity = number;
  return {};
}

Result<SceneSurface> read_surface(const Field& field) {
  SPLATVOL_TRY(field.check_names({"file", "boundary", "color", "opacity", "shown", "edges"}));
  SceneSurface surface;
  if (field.has("file") && field.has("boundary")) return field.wrong("give \"file\" or \"boundary\", not both");
  const char* name = field.has("boundary") ? "boundary" : "file";
  SPLATVOL_TRY_ASSIGN(name_field, field.member(name));
  SPLATVOL_TRY_ASSIGN(text, name_field.text());
  if (text.empty()) return name_field.wrong("empty");
  (field.has("boundary") ? surface.boundary : surface.file) = text;
  if (field.has("color")) {
    SPLATVOL_TRY_ASSIGN(color, color_at(field, "color"));
    surface.color = color;
  }
  SPLATVOL_TRY(read_opacity(field, surface.opacity));
  SPLATVOL_TRY(read_truth(field, "shown", surface.shown));
  SPLATVOL_TRY(read_truth(field, "edges", surface.edges));
  return surface;
}

Status read_plane(const Field& field, dvec3& point, dvec3& normal) {
  SPLATVOL_TRY_ASSIGN(at, vector_at(field, "point"));
  SPLATVOL_TRY_ASSIGN(direction, vector_at(field, "normal"));
  if (direction == dvec3(0)) return field.wrong("the normal has no direction; give one that is not [0, 0, 0]");
  point = at, normal = direction;
  return {};
}

Result<SceneSlice> read_slice(const Field& field) {
  SPLATVOL_TRY(field.check_names({"point", "normal", "opacity", "shown"}));
  SceneSlice slice;
  SPLATVOL_TRY(read_plane(field, slice.point, slice.normal));
  SPLATVOL_TRY(read_opacity(field, slice.opacity));
  SPLATVOL_TRY(read_truth(field, "shown", slice.shown));
  return slice;
}

Result<SceneClipPlane> read_clip_plane(const Field& field) {
  SPLATVOL_TRY(field.check_names({"point", "normal", "active"}));
  SceneClipPlane plane;
  SPLATVOL_TRY(read_plane(field, plane.point, plane.normal));
  SPLATVOL_TRY(read_truth(field, "active", plane.active));
  return plane;
}

// Each costs time in every pixel.
constexpr std::size_t most_planes = 64;

template <class Element>
Result<std::vector<Element>> read_planes(const Field& scene, const char* name,
                                         Result<Element> (*read)(const Field& field)) {
  std::vector<Element> planes;
  if (!scene.has(name)) return planes;
  SPLATVOL_TRY_ASSIGN(field, scene.member(name));
  if (!field.is_list()) return field.wrong("not a list");
  if (field.size() > most_planes) return field.wrong("{} planes; at most {} are drawn", field.size(), most_planes);
  for (std::size_t i = 0; i < field.size(); ++i) {
    SPLATVOL_TRY_ASSIGN(plane, read(field.element(i)));
    planes.push_back(plane);
  }
  return planes;
}

constexpr std::size_t most_surfaces = 4096;

Result<std::vector<SceneSurface>> read_surfaces(const Field& field) {
  if (!field.is_list()) return field.wrong("not a list");
  if (field.size() > most_surfaces)
    return field.wrong("{} surfaces; at most {} are drawn: join some in one file", field.size(), most_surfaces);
  std::vector<SceneSurface> surfaces;
  for (std::size_t i = 0; i < field.size(); ++i) {
    SPLATVOL_TRY_ASSIGN(surface, read_surface(field.element(i)));
    surfaces.push_back(std::move(surface));
  }
  return surfaces;
}

constexpr int fewest_ticks = 2, most_ticks = 20;

Result<ScalarBar> read_scalar_bar(const Field& field) {
  SPLATVOL_TRY(field.check_names({"ticks", "unit"}));
  if (!field.is_object()) return field.wrong("not an object");
  ScalarBar bar;
  if (field.has("ticks")) {
    SPLATVOL_TRY_ASSIGN(ticks_field, field.member("ticks"));
    SPLATVOL_TRY_ASSIGN(ticks, ticks_field.number());
    if (ticks != std::floor(ticks) || ticks < fewest_ticks || ticks > most_ticks)
      return ticks_field.wrong("not a whole number from {} to {}", fewest_ticks, most_ticks);
    bar.ticks = static_cast<int>(ticks);
  }
  if (field.has("unit")) {
    SPLATVOL_TRY_ASSIGN(unit_field, field.member("unit"));
    SPLATVOL_TRY_ASSIGN(unit, unit_field.text());
    bar.unit = unit;
  }
  return bar;
}

Result<Scene> read_scene(const json& document) {
  if (!document.is_object()) return fail(ErrorCode::invalid_data, "a scene is a JSON object");
  const Field field(document, "");
  SPLATVOL_TRY(field.check_names({"file", "step", "max_error", "tolerance", "kernel", "camera", "image", "background",
                                  "attribute", "transfer_function", "clip_box", "lighting", "outline", "surfaces",
                                  "slices", "clip_planes", "scalar_bar", "opacity"}));
  Scene scene;
  SPLATVOL_TRY_ASSIGN(camera_field, field.member("camera"));
  SPLATVOL_TRY_ASSIGN(camera, read_camera(camera_field));
  scene.camera = camera;
  SPLATVOL_TRY(read_size(field, scene.width, scene.height));
  SPLATVOL_TRY(make_view(scene.camera, scene.width, scene.height));

  SPLATVOL_TRY_ASSIGN(attribute, field.member("attribute"));
  SPLATVOL_TRY_ASSIGN(name, attribute.text());
  if (name.empty()) return attribute.wrong("empty");
  scene.attribute = name;
  SPLATVOL_TRY_ASSIGN(transfer_function, read_transfer_function(field));
  scene.transfer_function = std::move(transfer_function);
  if (field.has("opacity")) {
    SPLATVOL_TRY_ASSIGN(opacity_field, field.member("opacity"));
    SPLATVOL_TRY_ASSIGN(opacity, read_opacity_function(opacity_field));
    scene.opacity = std::move(opacity);
  }

  if (field.has("background")) {
    SPLATVOL_TRY_ASSIGN(background, color_at(field, "background"));
    scene.background = background;
  }
  if (field.has("clip_box")) {
    SPLATVOL_TRY_ASSIGN(box_field, field.member("clip_box"));
    SPLATVOL_TRY(box_field.check_names({"low", "high"}));
    SPLATVOL_TRY_ASSIGN(low, vector_at(box_field, "low"));
    SPLATVOL_TRY_ASSIGN(high, vector_at(box_field, "high"));
    if (!(low.x < high.x && low.y < high.y && low.z < high.z)) return box_field.wrong("low is not below high");
    scene.clip_box = Box{low, high};
  }
  if (field.has("lighting")) {
    SPLATVOL_TRY_ASSIGN(lighting_field, field.member("lighting"));
    SPLATVOL_TRY_ASSIGN(lighting, read_lighting(lighting_field));
    scene.lighting = lighting;
  }
  SPLATVOL_TRY(read_truth(field, "outline", scene.outline));
  if (field.has("scalar_bar")) {
    SPLATVOL_TRY_ASSIGN(bar_field, field.member("scalar_bar"));
    SPLATVOL_TRY_ASSIGN(bar, read_scalar_bar(bar_field));
    scene.scalar_bar = std::move(bar);
  }
  if (field.has("surfaces")) {
    SPLATVOL_TRY_ASSIGN(surfaces_field, field.member("surfaces"));
    SPLATVOL_TRY_ASSIGN(surfaces, read_surfaces(surfaces_field));
    scene.surfaces = std::move(surfaces);
  }
  SPLATVOL_TRY_ASSIGN(slices, read_planes(field, "slices", &read_slice));
  scene.slices = std::move(slices);
  SPLATVOL_TRY_ASSIGN(clip_planes, read_planes(field, "clip_planes", &read_clip_plane));
  scene.clip_planes = std::move(clip_planes);
  return scene;
}

Result<double> positive_at(const Field& parent, const char* name) {
  SPLATVOL_TRY_ASSIGN(field, parent.member(name));
  SPLATVOL_TRY_ASSIGN(number, field.number());
  if (!(number > 0)) return field.wrong("not above 0");
  return number;
}

Result<SceneUse> read_use(const Field& field) {
  SceneUse use;
  if (field.has("file")) {
    SPLATVOL_TRY_ASSIGN(file_field, field.member("file"));
    SPLATVOL_TRY_ASSIGN(file, file_field.text());
    if (file.empty()) return file_field.wrong("empty");
    use.file = file;
  }
  if (field.has("step")) {
    constexpr double most_steps = 1e15;  // a double holds whole numbers beyond
    SPLATVOL_TRY_ASSIGN(step_field, field.member("step"));
    SPLATVOL_TRY_ASSIGN(step, step_field.number());
    if (step != std::floor(step) || step < 0 || step > most_steps) return step_field.wrong("not a whole number from 0");
    use.step = static_cast<std::size_t>(step);
  }
  if (field.has("max_error")) {
    SPLATVOL_TRY_ASSIGN(max_error, positive_at(field, "max_error"));
    use.max_error = max_error;
  }
  if (field.has("tolerance")) {
    SPLATVOL_TRY_ASSIGN(tolerance_field, field.member("tolerance"));
    SPLATVOL_TRY_ASSIGN(tolerance, tolerance_field.number());
    if (tolerance < 0 || tolerance > 100) return tolerance_field.wrong("{} is outside [0, 100]", tolerance);
    if (use.max_error) return tolerance_field.wrong("give max_error or tolerance, not both");
    use.tolerance = tolerance;
  }
  if (field.has("kernel")) {
    SPLATVOL_TRY_ASSIGN(kernel_field, field.member("kernel"));
    SPLATVOL_TRY_ASSIGN(kernel, kernel_field.text());
    if (kernel != "moments" && kernel != "octant")
      return kernel_field.wrong("'{}' is neither moments nor octant", kernel);
    use.kernel = kernel;
  }
  return use;
}

Result<UsedScene> read_used_scene(const json& document) {
  SPLATVOL_TRY_ASSIGN(scene, read_scene(document));
  SPLATVOL_TRY_ASSIGN(use, read_use(Field(document, "")));
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

std::string text_of(const nlohmann::ordered_json& document, int indent = 1) {
  return json_text(document, indent) + (indent < 0 ? "" : "\n");
}

// Parses JSON text and calls `read` with the document. Turns exceptions into errors.
template <class Read>
auto parse(const std::string& text, const Read& read) -> decltype(read(json())) try {
  return read(parse_json(text));
} catch (const json::exception& error) {
  return fail(ErrorCode::invalid_data, "not JSON: {}", error.what());
} catch (const std::exception& error) {
  return fail(ErrorCode::out_of_budget, "cannot hold the scene: {}", error.what());
}

}  // namespace

// Both read all fields: a field that one of them refuses would be lost by the other.
Result<UsedScene> parse_used_scene(const std::string& text) { return parse(text, &read_used_scene); }

Result<Scene> parse_scene(const std::string& text) {
  SPLATVOL_TRY_ASSIGN(used, parse_used_scene(text));
  return std::move(used.scene);
}

Result<Camera> parse_camera(const std::string& text) {
  return parse(text, [](const json& document) -> Result<Camera> {
    SPLATVOL_TRY_ASSIGN(camera, read_camera(Field(document, "")));
    SPLATVOL_TRY(make_view(camera, 1, 1));
    return camera;
  });
}

std::string camera_to_json(const Camera& camera) { return text_of(json_of(camera)); }

std::string scene_to_json(const Scene& scene) { return to_json({scene, {}}); }

std::string to_json(const UsedScene& used, int indent) {
  const auto& [scene, use] = used;
  nlohmann::ordered_json document;
  if (!use.file.empty()) document["file"] = use.file;
  if (use.step) document["step"] = *use.step;
  if (use.max_error) document["max_error"] = *use.max_error;
  if (use.tolerance) document["tolerance"] = *use.tolerance;
  if (!use.kernel.empty()) document["kernel"] = use.kernel;
  document["camera"] = json_of(scene.camera);
  document["image"] = {{"width", scene.width}, {"height", scene.height}};
  document["background"] = json_of(scene.background);
  document["attribute"] = scene.attribute;
  nlohmann::ordered_json& function = document["transfer_function"];
  add_domain(scene.transfer_function, function);
  for (const auto& [t, rgb] : scene.transfer_function.colors) function["colors"].push_back({t, rgb.r, rgb.g, rgb.b});
  // By its name only if it comes back to the last bit.
  const auto isovalue = isovalue_of(scene.transfer_function);
  if (isovalue && densities_of(scene.transfer_function, *isovalue) == scene.transfer_function.densities)
    function["isovalue"] = {{"value", isovalue->value}, {"width", isovalue->width}, {"density", isovalue->density}};
  else
    for (const auto& [t, extinction] : scene.transfer_function.densities)
      function["density"].push_back({t, extinction});
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
  for (const SceneSurface& surface : scene.surfaces)
    document["surfaces"].push_back({surface.boundary.empty()
                                        ? nlohmann::ordered_json::array({"file", surface.file})
                                        : nlohmann::ordered_json::array({"boundary", surface.boundary}),
                                    {"color", json_of(surface.color)},
                                    {"opacity", surface.opacity},
                                    {"shown", surface.shown},
                                    {"edges", surface.edges}});
  for (const SceneSlice& slice : scene.slices)
    document["slices"].push_back({{"point", json_of(slice.point)},
                                  {"normal", json_of(slice.normal)},
                                  {"opacity", slice.opacity},
                                  {"shown", slice.shown}});
  for (const SceneClipPlane& plane : scene.clip_planes)
    document["clip_planes"].push_back(
        {{"point", json_of(plane.point)}, {"normal", json_of(plane.normal)}, {"active", plane.active}});
  return text_of(document, indent);
}

Result<UsedScene> load_used_scene(const std::string& path_or_json) {
  const bool is_text = path_or_json.starts_with('{');
  std::string text = path_or_json;
  if (!is_text) {
    SPLATVOL_TRY_ASSIGN(read, read_text_file(path_or_json));
    text = std::move(read);
  }
  auto used = parse_used_scene(text);
  if (!used) return fail_in(is_text ? "the scene" : path_or_json, used.error());
  std::error_code error;
  const std::filesystem::path folder =
      is_text ? std::filesystem::current_path(error) : std::filesystem::absolute(path_or_json, error).parent_path();
  const auto make_absolute = [&](std::string& path) { path = (folder / path).lexically_normal().string(); };
  for (SceneSurface& surface : used->scene.surfaces)
    if (surface.boundary.empty()) make_absolute(surface.file);
  if (!used->use.file.empty() && !is_url(used->use.file)) make_absolute(used->use.file);
  return used;
}

Result<Scene> load_scene(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(used, load_used_scene(path));
  return std::move(used.scene);
}

}  // namespace splatvol
