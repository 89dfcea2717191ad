// The camera of a first picture.
#pragma once

#include <limits>
#include <vector>

#include "scene/scene.h"
#include "streamer/first/survey.h"

namespace splatvol {

/// Returns a perspective camera that looks down at the splats' box from its front right, with `up` (an axis) upwards.
/// The larger a side of the box, the more the camera faces it. The splats fill the picture of this aspect (width /
/// height), less a margin of 5 % at each side. Some far splats of the outermost 0.2 % are left out if the rest would
/// be less than a third as large with them. `turns`: the camera is so far away that the splats stay in the picture
/// as it turns round the vertical axis through the middle of their box. At least one splat; `edge` is the size of a
/// picture of a splat without a size.
[[nodiscard]] Camera fit_camera(const std::vector<SurveySplat>& splats, int up, double aspect, double edge,
                                bool turns = false);

struct Ball {
  dvec3 center{0};
  double radius = std::numeric_limits<double>::infinity();
};

/// Returns the ball that a picture should show: of all splats, unless they lie in clumps so far apart that no picture
/// shows two of them. This is so if two fifths of the splats lie in a ball with less than a hundredth of the radius of
/// all, and hardly any splats lie round it up to ten times its radius. Then it is four times this ball.
[[nodiscard]] Ball main_clump(const std::vector<SurveySplat>& splats);

/// Returns the splats in the ball that are no larger than it; all splats if none of these has a value.
[[nodiscard]] std::vector<SurveySplat> within(const Ball& ball, const std::vector<SurveySplat>& splats);

/// Returns the box round the middle of splats, without outliers.
[[nodiscard]] Box box_of(const std::vector<SurveySplat>& splats);

/// Returns those of `others` that are near the box of splats: in it, widened at each side by 35 % of its longest edge.
/// Splats larger than a quarter of this edge are no features.
[[nodiscard]] std::vector<SurveySplat> near_box(const Box& box, const std::vector<SurveySplat>& others);

/// Returns the middle of the splats' box, without the outliers that fit_camera leaves out. At least one splat.
[[nodiscard]] dvec3 middle_of(const std::vector<SurveySplat>& splats);

}  // namespace splatvol
