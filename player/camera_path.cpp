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

Result<Camera> read_path_camera(const JsonField& field) {
  SPLATVOL_TRY_ASSIGN(camera, read_camera(field));
  if (const auto view = make_view(camera, 1, 1); !view) return field.wrong("{}", view.error().message);
  return camera;
}

Result<CameraPath> read_path(const JsonField& root) {
  CameraPath path;
  const JsonField seconds = root.member("seconds"), cameras = root.member("cameras");
  SPLATVOL_TRY_SET(path.seconds, seconds.number());
  if (!(path.seconds > 0 && path.seconds <= 86400)) return seconds.wrong("not between 0 and a day");
  SPLATVOL_TRY_SET(path.cameras, cameras.each(read_path_camera));
  if (path.cameras.empty()) return cameras.wrong("no cameras");
  for (const Camera& camera : path.cameras)
    if (camera.projection != path.cameras.front().projection) return cameras.wrong("cameras of both projections");
  return path;
}

double geometric(double a, double b, double part) { return a * std::pow(b / a, part); }

}  // namespace

Camera camera_at(const CameraPath& path, double part) {
  const double position = std::clamp(part, 0.0, 1.0) * static_cast<double>(path.cameras.size() - 1);
  const auto first = std::min(static_cast<std::size_t>(position), path.cameras.size() - 1);
  if (first + 1 >= path.cameras.size()) return path.cameras.back();
  const Camera &a = path.cameras[first], &b = path.cameras[first + 1];
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
  for (const Camera& camera : path.cameras) document["cameras"].push_back(parse_ordered_json(camera_to_json(camera)));
  return json_text(document, 1) + "\n";
}

Result<CameraPath> load_camera_path(const std::string& file) {
  SPLATVOL_TRY_ASSIGN(text, read_text_file(file));
  auto path = read_json(text, read_path, max_nesting);
  return path ? path : fail_in(file + ": not a camera path", path.error());
}

}  // namespace splatvol
