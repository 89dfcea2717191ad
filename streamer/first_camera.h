// The camera of a first picture.
#pragma once

#include <vector>

#include "scene/scene.h"
#include "streamer/survey.h"

namespace splatvol {

/// Returns a perspective camera that looks down at the splats' box from its front right, with `up` (an axis) upwards.
/// The larger a side of the box, the more the camera faces it. The splats fill the picture of this aspect (width /
/// height), less a margin of 5 % at each side. Some far splats of the outermost 0.2 % are left out if the rest would
/// be less than a third as large with them. `turns`: the camera is so far away that the splats stay in the picture
/// as it turns round the vertical axis through the middle of their box. At least one splat; `edge` is the size of a
/// picture of a splat without a size.
[[nodiscard]] Camera fit_camera(const std::vector<SurveySplat>& splats, int up, double aspect, double edge,
                                bool turns = false);

/// Returns the middle of the splats' box, without the outliers that fit_camera leaves out. At least one splat.
[[nodiscard]] dvec3 middle_of(const std::vector<SurveySplat>& splats);

}  // namespace splatvol
