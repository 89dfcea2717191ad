#include <algorithm>
#include <cmath>

#include "scene/scene.h"

namespace splatvol {
namespace {

/// The piecewise-linear function through `points` at t; where two points share a t, the later one holds from there on.
template <class Point, class Value>
Value interpolate(const std::vector<Point>& points, Value Point::*value, double t) {
  const auto after = std::ranges::upper_bound(points, t, {}, &Point::t);
  if (after == points.begin()) return points.front().*value;
  const Point& left = *(after - 1);
  if (after == points.end() || left.t == t) return left.*value;
  const double share = (t - left.t) / (after->t - left.t);
  return left.*value * (1 - share) + (*after).*value * share;
}

double parameter(const TransferFunction& function, double value) {
  return std::clamp((value - function.lo) / (function.hi - function.lo), 0.0, 1.0);
}

}  // namespace

dvec3 TransferFunction::color(double value) const {
  if (std::isnan(value)) return dvec3(0);
  return interpolate(colors, &Color::rgb, parameter(*this, value));
}

double TransferFunction::extinction(double value) const {
  if (std::isnan(value)) return 0;
  return interpolate(densities, &Density::extinction, parameter(*this, value));
}

std::vector<vec4> TransferFunction::table(std::size_t count) const {
  std::vector<vec4> entries(count);
  for (std::size_t i = 0; i < count; ++i) {
    const double t = static_cast<double>(i) / static_cast<double>(count - 1);
    entries[i] = vec4(interpolate(colors, &Color::rgb, t), interpolate(densities, &Density::extinction, t));
  }
  return entries;
}

}  // namespace splatvol
