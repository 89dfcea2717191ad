#include "scene/transfer_function.h"

#include <algorithm>
#include <cmath>

namespace splatvol {
namespace {

/// Evaluates the piecewise linear function through `points` at t. Where two points share a t, the later one holds from
/// there on.
template <class Point, class Value>
Value interpolate(const std::vector<Point>& points, Value Point::*value, double t) {
  const auto after = std::ranges::upper_bound(points, t, {}, &Point::t);
  if (after == points.begin()) return points.front().*value;
  const Point& left = *(after - 1);
  if (after == points.end() || left.t == t) return left.*value;
  const double share = (t - left.t) / (after->t - left.t);
  return left.*value * (1 - share) + (*after).*value * share;
}

/// The limit of the same function at t from below.
template <class Point, class Value>
Value limit_from_below(const std::vector<Point>& points, Value Point::*value, double t) {
  const auto next = std::ranges::lower_bound(points, t, {}, &Point::t);
  if (next == points.begin()) return points.front().*value;
  const Point& left = *(next - 1);
  if (next == points.end()) return left.*value;
  const double share = (t - left.t) / (next->t - left.t);
  return left.*value * (1 - share) + (*next).*value * share;
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

std::vector<double> bends(const TransferFunction& function) {
  std::vector<double> result{0, 1};
  for (const auto& point : function.colors) result.push_back(std::clamp(point.t, 0.0, 1.0));
  for (const auto& point : function.densities) result.push_back(std::clamp(point.t, 0.0, 1.0));
  std::ranges::sort(result);
  const auto repeated = std::ranges::unique(result);
  result.erase(repeated.begin(), repeated.end());
  return result;
}

std::vector<LinearPiece> linear_pieces(const TransferFunction& function) {
  using glm::dvec4;
  using Color = TransferFunction::Color;
  using Density = TransferFunction::Density;
  constexpr double shortest = 1e-9;
  const auto& [lo, hi, colors, densities] = function;
  const std::vector<double> all = bends(function);
  std::vector<LinearPiece> pieces;
  double begin = 0;
  for (std::size_t i = 1; i < all.size(); ++i) {
    const double after = all[i - 1], end = all[i];
    if (end - begin < shortest) continue;
    pieces.push_back(
        {begin, end,
         dvec4(interpolate(colors, &Color::rgb, after), interpolate(densities, &Density::extinction, after)),
         dvec4(limit_from_below(colors, &Color::rgb, end), limit_from_below(densities, &Density::extinction, end))});
    begin = end;
  }
  return pieces;
}

}  // namespace splatvol
