// The kernel `moments`: the builder fits it, and the renderer draws it.
#pragma once

#include <numbers>

namespace splatvol {

/// Half axes of a splat's ellipsoid, in deviations of its material: 0.95 times the width of a uniform distribution of
/// the same covariance. Inside, density falls as (1 - rho^2)^(3/2).
inline constexpr double moments_half_width = 0.95 * 2 * std::numbers::sqrt3;

/// Density at the centre of a splat whose mass and half axes are 1.
inline constexpr double moments_peak = 8 / (std::numbers::pi * std::numbers::pi);

/// Variance by which rasterizers widen a splat's material along each axis, in squared pixels: what is narrower falls
/// between the centres of pixels.
inline constexpr double pixel_variance = 0.1;

}  // namespace splatvol
