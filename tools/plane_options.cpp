#include "tools/plane_options.h"

#include <charconv>
#include <cmath>
#include <string_view>

#include "scene/isovalue.h"

namespace splatvol {
namespace {

constexpr double largest_number = 1e100;  // as in a scene file

// Reads numbers with commas between them. Fails unless there are so many.
std::optional<std::vector<double>> parse_numbers(std::string_view text, std::size_t count) {
  std::vector<double> numbers;
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t comma = i + 1 < count ? text.find(',') : text.size();
    if (comma == std::string_view::npos) return {};
    double number = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + comma, number);
    if (error != std::errc() || end != text.data() + comma || !(std::abs(number) <= largest_number)) return {};
    numbers.push_back(number);
    text.remove_prefix(std::min(comma + 1, text.size()));
  }
  return numbers;
}

}  // namespace

Result<IsovalueOption> parse_isovalue(const std::string& text) {
  const std::string_view all = text;
  const std::size_t colon = all.find(':');
  const auto value = parse_numbers(all.substr(0, colon), 1);
  if (!value) return fail(ErrorCode::invalid_argument, "'{}' is not a value, or VALUE:WIDTH such as 0.8:0.02", text);
  if (colon == std::string_view::npos) return IsovalueOption{value->front(), std::nullopt};
  const auto width = parse_numbers(all.substr(colon + 1), 1);
  if (!width || !(width->front() > 0))
    return fail(ErrorCode::invalid_argument, "'{}': the width is not a number above 0", text);
  return IsovalueOption{value->front(), width->front()};
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
  app.add_option("--isovalue", options.isovalue,
                 "Show a shell of one value, lit: the density is a narrow peak there, of this width in values "
                 "(default: a fiftieth of the domain)")
      ->type_name("VALUE[:WIDTH]")
      ->check(check_of(parse_isovalue));
}

Status apply(const PlaneOptions& options, double size, Scene& scene) {
  for (const std::string& text : options.slices) {
    SPLATVOL_TRY_ASSIGN(plane, parse_plane(text));
    scene.slices.push_back({.point = plane.point, .normal = plane.normal});
  }
  for (const std::string& text : options.clip_planes) {
    SPLATVOL_TRY_ASSIGN(plane, parse_plane(text));
    scene.clip_planes.push_back({.point = plane.point, .normal = plane.normal});
  }
  if (options.isovalue.empty()) return {};
  SPLATVOL_TRY_ASSIGN(isovalue, parse_isovalue(options.isovalue));
  return show_isovalue(scene, isovalue.value, isovalue.width, size);
}

}  // namespace splatvol
