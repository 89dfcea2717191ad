// Transfer functions: colour and extinction of a value.
#pragma once

#include <vector>

#include "base/math.h"

namespace splatvol {

/// Colour and extinction as functions of the value, piecewise linear in t = (value - lo) / (hi - lo), clamped outside.
/// Two control points with the same t are a jump. A missing value (NaN) has extinction 0.
struct TransferFunction {
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
  std::vector<Color> colors;       // at least one, t not decreasing
  std::vector<Density> densities;  // at least one, t not decreasing

  [[nodiscard]] dvec3 color(double value) const;
  [[nodiscard]] double extinction(double value) const;

  [[nodiscard]] bool operator==(const TransferFunction&) const = default;
};

/// Returns the t of every control point, clamped to [0, 1], with 0 and 1: rising, no two equal. Between two neighbours
/// the function is linear.
[[nodiscard]] std::vector<double> bends(const TransferFunction& function);

/// An interval of t in which colour and extinction are linear.
struct LinearPiece {
  double begin, end;
  glm::dvec4 at_begin, at_end;  // colour, extinction: limits from inside the piece
};

/// Returns the pieces of [0, 1] in order. Bends closer together than 1e-9 are one jump.
[[nodiscard]] std::vector<LinearPiece> linear_pieces(const TransferFunction& function);

}  // namespace splatvol
