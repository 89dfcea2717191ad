// Numbers of the kernels for the forms that draw. Each line that begins with `inline constexpr float` also becomes a
// line of GLSL (renderer/gl/CMakeLists.txt). docs/design.md, "A splat", has what they belong to.
#pragma once

#include "splat/kernel.h"

namespace splatvol::drawing {

inline constexpr float pi = 3.14159265F;

// A function's values in units of its domain: see renderer/common.h.
inline constexpr float largest_t_deviation = 1e16F;
inline constexpr float farthest_t = 3e17F;

// The kernel `moments`.
inline constexpr float half_axis = 3.29089653F;  // moments_half_width
inline constexpr float low_pass = 0.1F;          // pixel_variance
inline constexpr float faintest_depth = 3e-4F;   // optical depth of the part that is cut
inline constexpr float widest_cut = 0.7F;    // share of the squared radius that is cut off the faintest splat, at most
inline constexpr float least_depth = 1e-7F;  // a splat that is fainter everywhere is left out
inline constexpr float nearest_distance = 1.05F;  // in those at which the eye's plane touches it: a closer one is near
inline constexpr float largest_outline = 8.0F;  // pictures; a larger one makes it near too: clipping is not exact there
inline constexpr float most_change = 0.3F;      // of |d'|^2 within the outline, for the far form
inline constexpr float smallest_pixel = 1e-30F;

// The share of light that is lost with the part `cut` of the squared radius: cut^(7/2) (lost_0 + cut (lost_1 + cut
// lost_2)).
inline constexpr float lost_0 = 0.5935F;
inline constexpr float lost_1 = 0.0813F;
inline constexpr float lost_2 = 0.4829F;

// A chord runs from -1 to 1, with the density (1 - u^2)^(3/2). The share of its mass up to u is 1/2 + an odd
// polynomial, exact to 1e-4. The mean of u there, times the share, is -(1 - u)^2 times another one, exact to 1e-3.
inline constexpr float share_1 = 0.84812573F;
inline constexpr float share_3 = 0.41694202F;
inline constexpr float share_5 = 0.04308751F;
inline constexpr float share_7 = 0.02572878F;
inline constexpr float mean_0 = 0.34125103F;
inline constexpr float mean_1 = 0.10559957F;
inline constexpr float mean_2 = 0.03936548F;
inline constexpr float mean_3 = 0.0791528F;

// Gradients that scatter round their mean.
inline constexpr float scatter_across = 0.636619772F;  // 2 / pi
inline constexpr float scatter_length = 2.54647909F;   // 8 / pi

// The kernel `octant`.
inline constexpr float sigma_per_size = 0.4F;
inline constexpr float half_width_per_sigma = 1.17741002F;  // sqrt(2 ln 2)
inline constexpr float largest_cut = 3.0F;      // sigmas; a square of this half width holds 99.5 % of a Gaussian
inline constexpr float faintest_alpha = 1e-5F;  // a fainter part is cut: a thousand of them hide 1 %
inline constexpr float smallest_sigma = 0.5F;   // pixels; a narrower Gaussian slips between the centres of pixels
inline constexpr float smallest_float = 1.17549435e-38F;

static_assert(half_axis == static_cast<float>(moments_half_width));
static_assert(low_pass == static_cast<float>(pixel_variance));

}  // namespace splatvol::drawing
