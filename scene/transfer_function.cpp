#include "scene/transfer_function.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

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

/// The function at any t. Outside of [0, 1] its ends hold: before a jump at 0, and behind one at 1.
template <class Point, class Value>
Value at(const std::vector<Point>& points, Value Point::*value, double t) {
  return t < 0 ? limit_from_below(points, value, 0) : interpolate(points, value, std::min(t, 1.0));
}

}  // namespace

double TransferFunction::t_of(double value) const {
  if (axis == ValueAxis::linear) return (value - lo) / (hi - lo);
  if (axis == ValueAxis::log)
    return value > 0 ? std::log(value / lo) / std::log(hi / lo) : -std::numeric_limits<double>::infinity();
  const double low = std::asinh(lo / linear_width), high = std::asinh(hi / linear_width);
  return (std::asinh(value / linear_width) - low) / (high - low);
}

double TransferFunction::value_at(double t) const {
  if (t == 0 || t == 1) return t == 0 ? lo : hi;
  if (axis == ValueAxis::linear) return lo + t * (hi - lo);
  if (axis == ValueAxis::log) return lo * std::exp(t * std::log(hi / lo));
  const double low = std::asinh(lo / linear_width), high = std::asinh(hi / linear_width);
  return linear_width * std::sinh(low + t * (high - low));
}

dvec3 TransferFunction::color_at(double t) const { return at(colors, &Color::rgb, t); }

double TransferFunction::extinction_at(double t) const {
  return density_factor * at(densities, &Density::extinction, t);
}

dvec3 TransferFunction::color(double value) const { return std::isnan(value) ? dvec3(0) : color_at(t_of(value)); }

double TransferFunction::extinction(double value) const { return std::isnan(value) ? 0 : extinction_at(t_of(value)); }

AxisMoments TransferFunction::moments_of(double mean, double deviation) const {
  if (axis == ValueAxis::linear) return {t_of(mean), deviation / (hi - lo)};
  if (axis == ValueAxis::log) {
    if (!(mean > 0)) return {-1, 0};
    const double variance = std::log1p(std::pow(std::min(deviation / mean, 1e9), 2)), width = std::log(hi / lo);
    return {t_of(mean) - 0.5 * variance / width, std::sqrt(variance) / width};
  }
  // The nodes of Gauss and Hermite, with the weights 1/6, 2/3 and 1/6.
  const double away = std::numbers::sqrt3 * deviation;
  const double low = t_of(mean - away), middle = t_of(mean), high = t_of(mean + away);
  const double average = (low + 4 * middle + high) / 6;
  const double variance = ((low - average) * (low - average) + 4 * (middle - average) * (middle - average) +
                           (high - average) * (high - average)) /
                          6;
  return {average, std::sqrt(variance)};
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
  constexpr double shortest = 1e-14;
  const std::vector<Color>& colors = function.colors;
  const std::vector<Density>& densities = function.densities;
  const double factor = function.density_factor;
  const std::vector<double> all = bends(function);
  std::vector<LinearPiece> pieces;
  double begin = 0;
  for (std::size_t i = 1; i < all.size(); ++i) {
    const double after = all[i - 1], end = all[i];
    if (end - begin < shortest) continue;
    pieces.push_back(
        {begin, end,
         dvec4(interpolate(colors, &Color::rgb, after), factor * interpolate(densities, &Density::extinction, after)),
         dvec4(limit_from_below(colors, &Color::rgb, end),
               factor * limit_from_below(densities, &Density::extinction, end))});
    begin = end;
  }
  return pieces;
}

}  // namespace splatvol
