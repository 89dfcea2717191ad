// A scene file: read, written and read again. What it describes is used: its view, its transfer function, its tables.
// The same text as colour maps.
#include <algorithm>
#include <cmath>
#include <string>

#include "base/json.h"
#include "renderer/transfer_table.h"
#include "scene/color_map_file.h"
#include "scene/scene.h"
#include "tests/fuzz/fuzz.h"

using namespace splatvol;
using splatvol::fuzz::require;
using splatvol::fuzz::require_ok;

namespace {

bool is_finite(const dvec3& v) { return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z); }

bool is_same(const Scene& a, const Scene& b) {
  return a.camera == b.camera && a.width == b.width && a.height == b.height && a.background == b.background &&
         a.attribute == b.attribute && a.transfer_function == b.transfer_function && a.lighting == b.lighting &&
         a.clip_box == b.clip_box && a.outline == b.outline && a.surfaces == b.surfaces && a.slices == b.slices &&
         a.clip_planes == b.clip_planes && a.opacity == b.opacity && a.contours == b.contours;
}

void check_function(const TransferFunction& function) {
  for (const double t : {0.0, 0.25, 0.5, 1.0}) {
    const double value = function.value_at(t);
    require(value >= function.lo && value <= function.hi, "values of t are in the domain");
    require(is_finite(function.color(value)) && std::isfinite(function.extinction(value)), "colours are finite");
  }
  for (const double value : {-1e102, 0.0, 1e102, function.lo, function.hi}) {
    require(function.extinction(value) >= 0, "extinctions are not negative");
    const AxisMoments moments = function.moments_of(value, 1);
    require(!std::isnan(moments.mean) && moments.deviation >= 0, "moments are numbers");
  }
  const std::vector<double> all = bends(function);
  require(all.size() >= 2 && all.front() == 0 && all.back() == 1 &&
              std::ranges::adjacent_find(all, std::greater_equal<>()) == all.end(),
          "bends rise from 0 to 1");
  require(!linear_pieces(function).empty(), "a function has pieces");
}

void check_tables(const TransferFunction& function) {
  for (const std::size_t rows : {1, 5}) {
    const TransferTable table = make_transfer_table(function, 48, rows);
    require(table.entries.size() == 48 * rows, "a table has all entries");
    for (const vec4& entry : table.entries)
      require(!glm::any(glm::isnan(entry)) && entry.a >= 0, "entries are numbers");
  }
  const auto levels = make_peak_levels(function, 16);
  require(levels.size() == 5 && levels.back().size() == 1, "levels end in one entry");
}

void check_color_maps(const std::string& text) {
  const auto maps = parse_color_maps(text);
  require(maps || maps.error().message.find('\n') == std::string::npos, "an error is one line");
  for (const NamedColorMap& map : maps.value_or(std::vector<NamedColorMap>())) {
    require(map.colors.size() >= 2 && map.colors.size() <= 4096, "a map has control points");
    require(map.colors.front().t == 0 && map.colors.back().t == 1 &&
                std::ranges::is_sorted(map.colors, {}, &TransferFunction::Color::t),
            "t runs from 0 to 1");
    for (const auto& color : map.colors)
      for (int k = 0; k < 3; ++k) require(color.rgb[k] >= 0 && color.rgb[k] <= 1, "colours are in range");
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string text(reinterpret_cast<const char*>(data), size);
  check_color_maps(text);
  if (const auto alone = read_json(text, read_camera); alone && make_view(*alone, 1, 1))
    require(read_json(camera_to_json(*alone), read_camera) == *alone, "a camera file comes back");
  const auto used = parse_used_scene(text);
  const auto scene = parse_scene(text);
  require(used.has_value() == scene.has_value(), "a scene's use is part of it");
  if (!scene) {
    require(scene.error().message.find('\n') == std::string::npos, "an error is one line");
    return 0;
  }
  const auto again = parse_scene(scene_to_json(*scene));
  require_ok(again, "a written scene can be read");
  require(is_same(*scene, *again), "a scene comes back");
  const auto used_again = parse_used_scene(to_json(*used, -1));
  require_ok(used_again, "a written use can be read");
  require(used_again->use == used->use && is_same(used_again->scene, *scene), "a scene's use comes back");
  const auto camera = read_json(camera_to_json(scene->camera), read_camera);
  require(camera && *camera == scene->camera, "a camera comes back");

  const auto view = make_view(*scene);
  require_ok(view, "a scene has a view");
  require(is_finite(view->right) && is_finite(view->up) && is_finite(view->forward) && std::isfinite(view->focal),
          "a view is finite");
  for (const Slice& slice : view->slices)
    require(std::abs(glm::length(slice.plane.normal) - 1) < 1e-9, "normals of slices have length 1");
  for (const Plane& plane : view->clip.planes)
    require(std::abs(glm::length(plane.normal) - 1) < 1e-9, "normals of clip planes have length 1");
  check_function(scene->transfer_function);
  if (scene->opacity) check_function(scene->opacity->function);
  const Contours contours = contours_of(*scene);
  require(std::ranges::is_sorted(contours.surfaces, {}, &Contour::value), "contours rise");
  if (!contours.attribute.empty()) check_function(contours.colors);
  if (scene->transfer_function.densities.size() + scene->transfer_function.colors.size() < 64)
    check_tables(scene->transfer_function);
  return 0;
}
