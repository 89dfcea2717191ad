#include "scene/shells.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

namespace splatvol {
namespace {

constexpr double usual_width = 0.02;  // of the domain

// Optical depth of a shell if the value runs through its domain over the data's size. A shell is still opaque if the
// value changes a hundred times as fast: a translucent one would show the splats.
constexpr double usual_depth = 200;

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
