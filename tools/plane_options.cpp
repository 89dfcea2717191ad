#include "tools/plane_options.h"

#include <string_view>

#include "tools/tool.h"

namespace splatvol {
Result<double> parse_contour(const std::string& text) {
  const auto value = parse_numbers(text, 1);
  if (!value) return fail(ErrorCode::invalid_argument, "'{}' is not a value, such as 0.8", text);
  return value->front();
}

Result<PlaneOption> parse_plane(const std::string& text) {
  const std::string_view all = text;
  const std::size_t colon = all.find(':');
  const auto point = parse_numbers(all.substr(0, colon), 3);
  const auto normal = parse_numbers(colon == std::string_view::npos ? "" : all.substr(colon + 1), 3);
  if (!point || !normal)
    return fail(ErrorCode::invalid_argument, "'{}' is not a point and a normal, such as 0,0,1.5:0,0,1", text);
  const PlaneOption plane{{(*point)[0], (*point)[1], (*point)[2]}, {(*normal)[0], (*normal)[1], (*normal)[2]}};
  if (plane.normal == dvec3(0))
    return fail(ErrorCode::invalid_argument, "'{}': the normal has no direction; give one that is not 0,0,0", text);
  return plane;
}

void add_plane_options(CommandLine& app, PlaneOptions& options) {
  app.add_option("--slice", options.slices,
                 "Show the values on a plane, besides the scene's slices: a point of it and its normal, such as "
                 "0,0,1.5:0,0,1; repeatable")
      ->type_name("X,Y,Z:NX,NY,NZ")
      ->allow_extra_args(false)
      ->check(check_of(parse_plane));
  app.add_option("--clip-plane", options.clip_planes,
                 "Cut off what lies behind a plane, besides the scene's clip planes: a point of it and its normal, "
                 "which points to the side that stays; repeatable")
      ->type_name("X,Y,Z:NX,NY,NZ")
      ->allow_extra_args(false)
      ->check(check_of(parse_plane));
  app.add_option("--contour", options.contours, "Show the surface of one value; several may be given")
      ->type_name("VALUE")
      ->allow_extra_args(false)
      ->check(check_of(parse_contour));
}

Status apply(const PlaneOptions& options, Scene& scene) {
  for (const std::string& text : options.slices) {
    SPLATVOL_TRY_ASSIGN(plane, parse_plane(text));
    scene.slices.push_back({.point = plane.point, .normal = plane.normal});
  }
  for (const std::string& text : options.clip_planes) {
    SPLATVOL_TRY_ASSIGN(plane, parse_plane(text));
    scene.clip_planes.push_back({.point = plane.point, .normal = plane.normal});
  }
  for (const std::string& text : options.contours) {
    SPLATVOL_TRY_ASSIGN(value, parse_contour(text));
    if (!have_value(scene.contours, value)) scene.contours.push_back({.values = {value}});
  }
  return check_contours(scene.contours);
}

}  // namespace splatvol
