#include "player/camera_path.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "base/file.h"
#include "base/json.h"
#include "player/camera_control.h"

namespace splatvol {
namespace {

using json = nlohmann::ordered_json;

// A path of ours has 4 levels.
constexpr int max_nesting = 32;

glm::dquat orientation_of(const Camera& camera) {
  const CameraAxes axes = axes_of(camera);
  return glm::quat_cast(dmat3(axes.right, axes.up, -axes.forward));
}

Result<PathView> read_path_view(const JsonField& field) {
  SPLATVOL_TRY_ASSIGN(camera, read_camera(field));
  if (const auto view = make_view(camera, 1, 1); !view) return field.wrong("{}", view.error().message);
  return PathView{camera};
}

Result<CameraPath> read_path(const JsonField& root) {
  CameraPath path;
  const JsonField seconds = root.member("seconds"), cameras = root.member("cameras");
  SPLATVOL_TRY_SET(path.seconds, seconds.number());
  if (!(path.seconds > 0 && path.seconds <= 86400)) return seconds.wrong("not between 0 and a day");
  SPLATVOL_TRY_SET(path.views, cameras.each(read_path_view));
  if (path.views.empty()) return cameras.wrong("no cameras");
  for (const PathView& view : path.views)
    if (view.camera.projection != path.views.front().camera.projection)
      return cameras.wrong("cameras of both projections");
  if (const JsonField names = root.member("names"); names.exists()) {
    SPLATVOL_TRY_ASSIGN(read, names.each([](const JsonField& name) { return name.text(); }));
    if (read.size() != path.views.size()) return names.wrong("not as many as cameras");
    for (std::size_t i = 0; i < read.size(); ++i) path.views[i].name = read[i];
  }
  return path;
}

double geometric(double a, double b, double part) { return a * std::pow(b / a, part); }

}  // namespace

Camera camera_at(const CameraPath& path, double part) {
  const double position = std::clamp(part, 0.0, 1.0) * static_cast<double>(path.views.size() - 1);
  const auto first = std::min(static_cast<std::size_t>(position), path.views.size() - 1);
  if (first + 1 >= path.views.size()) return path.views.back().camera;
  const Camera &a = path.views[first].camera, &b = path.views[first + 1].camera;
  const double share = position - static_cast<double>(first);
  if (share == 0) return a;
  Camera camera = a;
  const glm::dquat turn = glm::slerp(orientation_of(a), orientation_of(b), share);
  camera.vertical_fov_degrees = a.vertical_fov_degrees + share * (b.vertical_fov_degrees - a.vertical_fov_degrees);
  camera.parallel_height = geometric(a.parallel_height, b.parallel_height, share);
  camera.focal_point = a.focal_point + share * (b.focal_point - a.focal_point);
  const double distance =
      geometric(glm::length(a.position - a.focal_point), glm::length(b.position - b.focal_point), share);
  camera.position = camera.focal_point + distance * (turn * dvec3(0, 0, 1));
  camera.up = turn * dvec3(0, 1, 0);
  return camera;
}

std::string path_to_json(const CameraPath& path) {
  json document = {{"seconds", path.seconds}, {"cameras", json::array()}};
  for (const PathView& view : path.views)
    document["cameras"].push_back(parse_ordered_json(camera_to_json(view.camera)));
  if (std::ranges::any_of(path.views, [](const PathView& view) { return !view.name.empty(); }))
    for (const PathView& view : path.views) document["names"].push_back(view.name);
  return json_text(document, 1) + "\n";
}

Result<CameraPath> load_camera_path(const std::string& file) {
  SPLATVOL_TRY_ASSIGN(text, read_text_file(file));
  auto path = read_json(text, read_path, max_nesting);
  return path ? path : fail_in(file + ": not a camera path", path.error());
}

}  // namespace splatvol
