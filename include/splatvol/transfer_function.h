// Transfer functions: colour and extinction of a value.
#pragma once

#include <vector>

#include "splatvol/export.h"
#include "splatvol/geometry.h"

namespace splatvol {

/// How t runs over the domain: with the value, with its logarithm, or with asinh(value / linear_width).
enum class ValueAxis { linear, log, asinh };

/// Mean and standard deviation of t.
struct AxisMoments {
  double mean, deviation;
};

/// Colour and extinction as functions of the value, piecewise linear in t, clamped outside of [0, 1]. With u the value
/// on its axis, t = (u(value) - u(lo)) / (u(hi) - u(lo)). Two control points with the same t are a jump: the later one
/// holds from there on. A missing value (NaN) has extinction 0. On a logarithmic axis, values up to 0 lie below lo.
struct SPLATVOL_EXPORT TransferFunction {
  struct Color {
    double t;
    dvec3 rgb;  // linear

    [[nodiscard]] bool operator==(const Color&) const = default;
  };
  struct Density {
    double t;
    double extinction;  // per world length unit, >= 0

    [[nodiscard]] bool operator==(const Density&) const = default;
  };

  double lo = 0;
  double hi = 1;
  std::vector<Color> colors;           // at least one, t not decreasing
  std::vector<Density> densities;      // at least one, t not decreasing
  ValueAxis axis = ValueAxis::linear;  // log: lo > 0
  double linear_width = 1;             // > 0; asinh: smaller values are shown about linearly, larger ones by logarithms
  double density_factor = 1;           // > 0: on all densities

  [[nodiscard]] dvec3 color(double value) const;
  [[nodiscard]] double extinction(double value) const;

  /// Returns the t of a value, also beyond [0, 1]; minus infinity for values up to 0 on a logarithmic axis.
  [[nodiscard]] double t_of(double value) const;

  /// Returns the value of a t of [0, 1]; exactly lo and hi at the ends.
  [[nodiscard]] double value_at(double t) const;

  /// Colour and extinction at a t.
  [[nodiscard]] dvec3 color_at(double t) const;
  [[nodiscard]] double extinction_at(double t) const;

  /// Returns the moments of t of normally distributed values. On a logarithmic axis the values count as lognormally
  /// distributed; a mean up to 0 has a t of -1. On the asinh axis, three values stand for the distribution.
  [[nodiscard]] AxisMoments moments_of(double mean, double deviation) const;

  [[nodiscard]] bool operator==(const TransferFunction&) const = default;
};

}  // namespace splatvol
