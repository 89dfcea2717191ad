// Colours and densities that stand out from a background.
#pragma once

#include "scene/scene.h"

namespace splatvol {

/// Returns the luminance of a linear colour (Rec. 709).
[[nodiscard]] double luminance(const dvec3& rgb);

/// Returns whether black stands out from a background better than white.
[[nodiscard]] bool is_light(const dvec3& background);

/// Replaces the background. Keeps the contrast of the volume:
/// - If it was dark and is light now, densities double, and colours lose luminance above 0.3. A thin veil of a bright
///   colour is seen on black, but the same veil of a dark colour is hardly seen on white.
/// - If it was light and is dark now, densities halve.
/// - On a dark background colours gain luminance below 0.04, by white.
void adapt_to_background(Scene& scene, const dvec3& background);

}  // namespace splatvol
