// The gradient of a value between scattered points, and the value's moments with it.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>

#include "base/math.h"
#include "builder/mesh/moments.h"

namespace splatvol {

/// Fits a gradient to differences of a value, by least squares.
class GradientFit {
 public:
  /// Adds a difference `rise` of the value over `offset`. Offsets should have a length of about 1.
  void add(const dvec3& offset, double rise) {
    add_square(normal_, 1, offset);
    right_ += rise * offset;
    ++count_;
  }

  [[nodiscard]] bool empty() const { return count_ == 0; }

  /// Returns the gradient: none in directions that no offset has. Requires at least one offset.
  [[nodiscard]] dvec3 gradient() const {
    const SymmetricMatrix& s = normal_;
    const double least = 1e-12 * count_;
    const dmat3 matrix(s.xx + least, s.xy, s.xz, s.xy, s.yy + least, s.yz, s.xz, s.yz, s.zz + least);
    return glm::inverse(matrix) * right_;
  }

 private:
  SymmetricMatrix normal_;
  dvec3 right_{0};
  std::uint32_t count_ = 0;
};

/// Returns the moments of a value that is linear in a point's material: `value` at the point, with `gradient`.
/// `covariance`: of position and value, which is the material's covariance times the gradient. Limits mean and range to
/// [low, high].
[[nodiscard]] inline ValueMoments linear_value_moments(const SpatialMoments& material, double value,
                                                       const dvec3& gradient, const dvec3& covariance, double low,
                                                       double high) {
  ValueMoments moments;
  moments.mass = material.mass;
  moments.centroid = material.centroid;
  moments.covariance = covariance;
  moments.variance = std::max(0.0, glm::dot(gradient, covariance));
  moments.mean = std::clamp(value + glm::dot(gradient, material.centroid), low, high);
  const double reach = std::sqrt(3 * moments.variance);  // half the width of a uniform distribution
  moments.min = std::max(low, moments.mean - reach);
  moments.max = std::min(high, moments.mean + reach);
  return moments;
}

}  // namespace splatvol
