#include "scene/isovalue.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

namespace splatvol {
namespace {

constexpr double usual_width = 0.02;  // of the domain

// Optical depth of a shell if the value runs through its domain over the data's size. A shell is still opaque if the
// value changes a hundred times as fast: a translucent one would show the splats.
constexpr double usual_depth = 200;

// Returns the number with the fewest digits that is accepted: what was meant, without the rounding of t. Else the
// number itself.
template <class Accept>
double shortest(double number, const Accept& accept) {
  for (int digits = 1; digits <= 17; ++digits) {
    const double rounded = std::strtod(fmt::format("{:.{}g}", number, digits).c_str(), nullptr);
    if (accept(rounded)) return rounded;
  }
  return number;
}

// A shell in t, and what it adds to a function.
struct Shell {
  double low, middle, high;
  std::optional<dvec3> color;  // none: that of the function
  double density;
};

// Returns a domain in which two values have room for shells.
std::pair<double, double> domain_with(const TransferFunction& function, double low, double high) {
  const double lo = std::min(function.lo, low), hi = std::max(function.hi, high);
  const bool is_log = function.axis == ValueAxis::log;
  const double room = is_log ? std::pow(hi / lo, usual_width) : usual_width * (hi - lo);
  return {low > function.lo ? lo
          : is_log          ? lo / room
                            : lo - room,
          high < function.hi ? hi
          : is_log           ? hi * room
                             : hi + room};
}

// The same function over a domain that has more values.
TransferFunction over_domain(const TransferFunction& function, double lo, double hi) {
  TransferFunction wider = function;
  wider.lo = lo, wider.hi = hi;
  const auto move = [&](auto& points) {
    for (auto& point : points) point.t = wider.t_of(function.value_at(std::clamp(point.t, 0.0, 1.0)));
  };
  move(wider.colors);
  move(wider.densities);
  return wider;
}

// Adds a shell, instead of what the function has there.
void add_shell(TransferFunction& function, const Shell& shell) {
  const TransferFunction before = function;
  const auto clear = [&](auto& points) {
    std::erase_if(points, [&](const auto& point) { return point.t >= shell.low && point.t <= shell.high; });
    return std::ranges::find_if(points, [&](const auto& point) { return point.t > shell.high; });
  };
  const auto add = [](auto& points, auto at, auto added) { points.insert(at, added.begin(), added.end()); };
  using Density = TransferFunction::Density;
  const double peak = before.extinction_at(shell.middle) + shell.density;
  add(function.densities, clear(function.densities),
      std::vector<Density>{{shell.low, before.extinction_at(shell.low)},
                           {shell.middle, peak},
                           {shell.high, before.extinction_at(shell.high)}});
  if (!shell.color) return;
  using Color = TransferFunction::Color;
  add(function.colors, clear(function.colors),
      std::vector<Color>{{shell.low, before.color_at(shell.low)},
                         {shell.low, *shell.color},
                         {shell.high, *shell.color},
                         {shell.high, before.color_at(shell.high)}});
}

}  // namespace

std::vector<TransferFunction::Density> densities_of(const TransferFunction& function, const Isovalue& isovalue) {
  const auto t_of = [&](double value) { return std::clamp(function.t_of(value), 0.0, 1.0); };
  const double t = t_of(isovalue.value);
  const double low = std::min(t_of(isovalue.value - 0.5 * isovalue.width), t);
  const double high = std::max(t_of(isovalue.value + 0.5 * isovalue.width), t);
  return {{0, 0}, {low, 0}, {t, isovalue.density}, {high, 0}, {1, 0}};
}

std::optional<Isovalue> isovalue_of(const TransferFunction& function) {
  const auto& points = function.densities;
  if (points.size() != 5 || points[0].t != 0 || points[4].t != 1) return {};
  for (const std::size_t i : {0, 1, 3, 4})
    if (points[i].extinction != 0) return {};
  const double value =
      shortest(function.value_at(points[2].t), [&](double near) { return function.t_of(near) == points[2].t; });
  const double below = value - function.value_at(points[1].t), above = function.value_at(points[3].t) - value;
  // A side that ends with the domain tells nothing.
  const double half = points[1].t == 0 ? above : points[3].t == 1 ? below : 0.5 * (below + above);
  if (!(half > 0)) return {};
  const double width = shortest(2 * half, [&](double near) {
    return densities_of(function, {value, near, points[2].extinction}) == points;
  });
  return Isovalue{value, width, points[2].extinction};
}

Isovalue fitting_isovalue(const TransferFunction& function, double value, std::optional<double> width, double size) {
  Isovalue isovalue{value, 0, 0};
  const double t = std::clamp(function.t_of(value), 0.0, 1.0);
  const double low = std::max(t - 0.5 * usual_width, 0.0), high = std::min(t + 0.5 * usual_width, 1.0);
  isovalue.width = width ? *width : (function.value_at(high) - function.value_at(low)) * usual_width / (high - low);
  const auto points = densities_of(function, isovalue);
  const double share = std::max(points[3].t - points[1].t, 1e-9);
  isovalue.density = 2 * usual_depth / (share * size);
  return isovalue;
}

Status show_isovalue(Scene& scene, double value, std::optional<double> width, double size) {
  TransferFunction& function = scene.transfer_function;
  if (function.axis == ValueAxis::log && !(value > 0))
    return fail(ErrorCode::invalid_argument, "isovalue: {} is not above 0, which the axis log needs", value);
  const double span = std::max(function.hi, value) - std::min(function.lo, value);
  const double half = 0.5 * width.value_or(usual_width * span);
  if (value > function.hi) function.hi = value + half;
  if (value < function.lo)
    function.lo = function.axis == ValueAxis::log ? std::max(value - half, 0.5 * value) : value - half;
  function.densities = densities_of(function, fitting_isovalue(function, value, width, size));
  if (!scene.lighting) scene.lighting = Lighting();
  return {};
}

Scene with_shells(const Scene& scene, double size) {
  constexpr double usual_passes = 10;  // of the domain, over the data
  std::vector<Contour> contours = contours_of(scene).surfaces;
  const TransferFunction& function = scene.transfer_function;
  if (function.axis == ValueAxis::log)
    std::erase_if(contours, [](const Contour& contour) { return !(contour.value > 0); });
  Scene shown = scene;
  shown.contours.clear();
  if (contours.empty()) return shown;
  const double half = 0.5 * usual_width;
  const auto [lo, hi] = domain_with(function, contours.front().value, contours.back().value);
  TransferFunction& wider = shown.transfer_function = over_domain(function, lo, hi);
  // Shells are as dense as they are, whatever the factor of the volume.
  const double factor = std::exchange(wider.density_factor, 1);
  for (TransferFunction::Density& density : wider.densities) density.extinction *= factor;
  for (std::size_t i = 0; i < contours.size(); ++i) {
    const auto middle_to = [&](std::size_t other) {
      return 0.5 * (wider.t_of(contours[i].value) + wider.t_of(contours[other].value));
    };
    const double t = std::clamp(wider.t_of(contours[i].value), 0.0, 1.0);
    const double low = std::max({t - half, 0.0, i > 0 ? middle_to(i - 1) : 0.0});
    const double high = std::min({t + half, 1.0, i + 1 < contours.size() ? middle_to(i + 1) : 1.0});
    const double opacity = contours[i].opacity;
    const double depth = opacity < 1 ? std::min(usual_depth, -usual_passes * std::log1p(-opacity)) : usual_depth;
    const auto color = contours[i].is_colored ? std::nullopt : std::optional(contours[i].color);
    add_shell(wider, {low, t, high, color, 2 * depth / (std::max(high - low, 1e-9) * size)});
  }
  return shown;
}

}  // namespace splatvol
