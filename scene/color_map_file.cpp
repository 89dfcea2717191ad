#include "scene/color_map_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>

#include "base/file.h"
#include "base/json.h"
#include "scene/srgb.h"

namespace splatvol {
namespace {

using Colors = std::vector<TransferFunction::Color>;

constexpr int max_nesting = 32;  // an export of ParaView has 3 levels
constexpr std::size_t most_control_points = 4096;
constexpr double largest_value = 1e100;
constexpr double tolerance = 1 / 255.0;

dvec3 decode(const dvec3& srgb) { return {linear_of(srgb.r), linear_of(srgb.g), linear_of(srgb.b)}; }
dvec3 encode(const dvec3& linear) { return {srgb_of(linear.r), srgb_of(linear.g), srgb_of(linear.b)}; }

// CIE 1976 L*a*b*, white point D65.
constexpr dvec3 white(0.9505, 1, 1.089);

dvec3 lab_of(const dvec3& srgb) {
  const dvec3 c = decode(srgb);
  const dvec3 xyz(0.4124 * c.r + 0.3576 * c.g + 0.1805 * c.b, 0.2126 * c.r + 0.7152 * c.g + 0.0722 * c.b,
                  0.0193 * c.r + 0.1192 * c.g + 0.9505 * c.b);
  const auto f = [](double t) { return t > 0.008856 ? std::cbrt(t) : 7.787 * t + 16 / 116.0; };
  const double x = f(xyz.x / white.x), y = f(xyz.y / white.y), z = f(xyz.z / white.z);
  return {116 * y - 16, 500 * (x - y), 200 * (y - z)};
}

dvec3 of_lab(const dvec3& lab) {
  const auto inverse = [](double f) { return f * f * f > 0.008856 ? f * f * f : (f - 16 / 116.0) / 7.787; };
  const double y = (lab.x + 16) / 116;
  const dvec3 xyz = white * dvec3(inverse(y + lab.y / 500), inverse(y), inverse(y - lab.z / 200));
  return encode({3.2406 * xyz.x - 1.5372 * xyz.y - 0.4986 * xyz.z, -0.9689 * xyz.x + 1.8758 * xyz.y + 0.0415 * xyz.z,
                 0.0557 * xyz.x - 0.2040 * xyz.y + 1.0570 * xyz.z});
}

dvec3 hsv_of(const dvec3& c) {
  const double high = std::max({c.r, c.g, c.b}), chroma = high - std::min({c.r, c.g, c.b});
  if (chroma <= 0) return {0, 0, high};
  const double sixths = high == c.r   ? (c.g - c.b) / chroma
                        : high == c.g ? 2 + (c.b - c.r) / chroma
                                      : 4 + (c.r - c.g) / chroma;
  return {(sixths < 0 ? sixths + 6 : sixths) / 6, chroma / high, high};
}

dvec3 of_hsv(const dvec3& hsv) {
  const auto channel = [&](double shift) {
    const double k = std::fmod(shift + 6 * hsv.x, 6);
    return hsv.z * (1 - hsv.y * std::clamp(std::min(k, 4 - k), 0.0, 1.0));
  };
  return {channel(5), channel(3), channel(1)};
}

// Moreland's polar form of Lab: magnitude, saturation, hue.
struct Msh {
  double m, s, h;
};

Msh msh_of(const dvec3& srgb) {
  const dvec3 lab = lab_of(srgb);
  const double m = glm::length(lab);
  return {m, m > 1e-3 ? std::acos(std::clamp(lab.x / m, -1.0, 1.0)) : 0, std::atan2(lab.z, lab.y)};
}

dvec3 of_msh(const Msh& c) {
  return of_lab({c.m * std::cos(c.s), c.m * std::sin(c.s) * std::cos(c.h), c.m * std::sin(c.s) * std::sin(c.h)});
}

constexpr double least_saturation = 0.05;

// Returns the hue at an unsaturated end: turned so that the way there looks uniform.
double turned_hue(const Msh& saturated, double unsaturated_m) {
  if (saturated.m >= unsaturated_m - 0.1) return saturated.h;
  const double turn = saturated.s * std::sqrt(unsaturated_m * unsaturated_m - saturated.m * saturated.m) /
                      (saturated.m * std::sin(saturated.s));
  return saturated.h > -std::numbers::pi / 3 ? saturated.h + turn : saturated.h - turn;
}

dvec3 between_diverging(const dvec3& from, const dvec3& to, double part) {
  Msh a = msh_of(from), b = msh_of(to);
  const double apart = std::abs(std::remainder(a.h - b.h, 2 * std::numbers::pi));
  if (a.s > least_saturation && b.s > least_saturation && apart > std::numbers::pi / 3) {
    const double middle = std::max({a.m, b.m, 88.0});  // white or nearly so
    if (part < 0.5) {
      b = {middle, 0, 0};
      part *= 2;
    } else {
      a = {middle, 0, 0};
      part = 2 * part - 1;
    }
  }
  if (a.s < least_saturation && b.s > least_saturation) a.h = turned_hue(b, a.m);
  if (b.s < least_saturation && a.s > least_saturation) b.h = turned_hue(a, b.m);
  return of_msh({std::lerp(a.m, b.m, part), std::lerp(a.s, b.s, part), std::lerp(a.h, b.h, part)});
}

dvec3 between_hsv(const dvec3& from, const dvec3& to, double part, bool wraps) {
  dvec3 a = hsv_of(from), b = hsv_of(to);
  if (wraps && std::abs(a.x - b.x) > 0.5) (a.x < b.x ? a.x : b.x) += 1;
  return of_hsv(glm::mix(a, b, part));
}

// Returns the colour between two, all sRGB.
using Between = std::function<dvec3(const dvec3& from, const dvec3& to, double part)>;

Result<Between> between_in(const JsonField& field, const std::string& space, bool wraps) {
  if (space == "RGB") return [](const dvec3& a, const dvec3& b, double part) { return glm::mix(a, b, part); };
  if (space == "Lab" || space == "CIELAB")
    return [](const dvec3& a, const dvec3& b, double part) { return of_lab(glm::mix(lab_of(a), lab_of(b), part)); };
  if (space == "HSV")
    return [wraps](const dvec3& a, const dvec3& b, double part) { return between_hsv(a, b, part, wraps); };
  if (space == "Diverging") return between_diverging;
  if (space == "Step") return [](const dvec3& a, const dvec3& b, double part) { return part < 1 ? a : b; };
  return fail(ErrorCode::unsupported, "{}: the colour space '{}' (RGB, HSV, Lab, CIELAB, Diverging and Step are known)",
              field.path(), space);
}

struct Point {
  double t;
  dvec3 srgb;
};

// Adds control points from behind `from.t` up to `to.t`: as many as linear light between them needs.
void add_between(Colors& colors, const Point& from, const Point& to, const Between& between) {
  constexpr int most_pieces = 64;
  const auto at = [&](double part) { return between(from.srgb, to.srgb, part); };
  const auto is_fine = [&](int pieces) {
    for (int i = 0; i < pieces; ++i) {
      const dvec3 low = decode(at(double(i) / pieces)), high = decode(at((i + 1.0) / pieces));
      for (const double share : {0.25, 0.5, 0.75}) {
        const dvec3 error = glm::abs(encode(glm::mix(low, high, share)) - at((i + share) / pieces));
        if (std::max({error.x, error.y, error.z}) > tolerance) return false;
      }
    }
    return true;
  };
  int pieces = 1;
  while (pieces < most_pieces && !is_fine(pieces)) pieces *= 2;
  for (int i = 1; i <= pieces; ++i)
    colors.push_back({std::lerp(from.t, to.t, double(i) / pieces), decode(at(double(i) / pieces))});
}

Result<std::vector<Point>> points_of(const JsonField& field) {
  if (field.size() < 8 || field.size() % 4 != 0) return field.wrong("not two or more groups of four numbers");
  SPLATVOL_TRY_ASSIGN(numbers, field.numbers(field.size(), largest_value));
  std::vector<Point> points;
  for (std::size_t i = 0; i < numbers.size(); i += 4) {
    const Point point{numbers[i], {numbers[i + 1], numbers[i + 2], numbers[i + 3]}};
    if (!points.empty() && !(point.t >= points.back().t)) return field.element(i).wrong("values must not fall");
    for (int k = 0; k < 3; ++k)
      if (!(point.srgb[k] >= 0 && point.srgb[k] <= 1)) return field.element(i).wrong("colours are not between 0 and 1");
    points.push_back(point);
  }
  const double low = points.front().t, width = points.back().t - low;
  if (!(width > 0)) return field.wrong("all values are the same");
  for (Point& point : points) point.t = (point.t - low) / width;
  points.back().t = 1;
  return points;
}

Result<NamedColorMap> map_of(const JsonField& item) {
  NamedColorMap map;
  std::string space = "RGB";
  const JsonField space_field = item.member("ColorSpace"), wrap = item.member("HSVWrap");
  if (item.has("Name")) SPLATVOL_TRY_SET(map.name, item.member("Name").text());
  if (space_field.exists()) SPLATVOL_TRY_SET(space, space_field.text());
  const bool wraps = wrap.truth().value_or(wrap.number().value_or(0) != 0);
  SPLATVOL_TRY_ASSIGN(between, between_in(space_field, space, wraps));
  SPLATVOL_TRY_ASSIGN(points, points_of(item.member("RGBPoints")));
  if (points.size() > most_control_points)
    return item.wrong("{} colours; at most {} are drawn", points.size(), most_control_points);
  const bool steps = space == "Step";
  map.colors.push_back({0, decode(points.front().srgb)});
  for (std::size_t i = 1; i < points.size(); ++i) {
    if (steps) map.colors.push_back({points[i].t, decode(points[i - 1].srgb)});
    if (steps || points[i].t == points[i - 1].t)
      map.colors.push_back({points[i].t, decode(points[i].srgb)});
    else
      add_between(map.colors, points[i - 1], points[i], between);
  }
  if (map.colors.size() > most_control_points)
    return item.wrong("needs {} control points; at most {} are drawn", map.colors.size(), most_control_points);
  return map;
}

// An export is a list of maps; a map alone is taken too.
Result<std::vector<NamedColorMap>> read_maps(const JsonField& root) {
  std::vector<NamedColorMap> maps;
  for (std::size_t i = 0; i < (root.is_list() ? root.size() : 1); ++i) {
    const JsonField item = root.is_list() ? root.element(i) : root;
    if (!item.has("RGBPoints")) continue;
    SPLATVOL_TRY_ASSIGN(map, map_of(item));
    if (map.name.empty()) map.name = fmt::format("map {}", maps.size() + 1);
    maps.push_back(std::move(map));
  }
  if (maps.empty()) return root.wrong("none with RGBPoints");
  return maps;
}

}  // namespace

bool is_color_map_text(const std::string& json) { return json.find("\"RGBPoints\"") != std::string::npos; }

Result<std::vector<NamedColorMap>> parse_color_maps(const std::string& text) {
  auto maps = read_json(text, read_maps, max_nesting);
  return maps ? maps : fail_in("no colour map", maps.error());
}

Result<std::vector<NamedColorMap>> load_color_maps(const std::string& path) {
  SPLATVOL_TRY_ASSIGN(text, read_text_file(path));
  auto maps = parse_color_maps(text);
  if (!maps) return fail_in(path, maps.error());
  return maps;
}

}  // namespace splatvol
