// The kernel `moments`: what the builder fits and the renderer draws must be the same.
#pragma once

#include <numbers>

namespace splatvol {

/// Half axes of a splat's ellipsoid, in deviations of its material: those of a uniform cell of the same covariance,
/// 0.95 times. Density falls as (1 - rho^2)^(3/2) inside.
inline constexpr double moments_half_width = 0.95 * 2 * std::numbers::sqrt3;

/// Density at the centre of a splat whose mass and half axes are 1, so that it integrates to 1.
inline constexpr double moments_peak = 8 / (std::numbers::pi * std::numbers::pi);

}  // namespace splatvol
