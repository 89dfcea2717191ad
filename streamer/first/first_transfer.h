// The transfer function of a first picture. Docs: docs/scene.md, "The first picture".
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "scene/scene.h"
#include "streamer/first/survey.h"

namespace splatvol {

/// Returns colours and relative densities, at most 1, for the values of a survey of an attribute. At least one splat
/// must have a value. `whole`: the values are whole numbers, and less than a half is a mean of 0 and others.
/// `share`: they are shares of a whole, whose axis is linear.
[[nodiscard]] TransferFunction choose_transfer_function(const std::vector<SurveySplat>& splats, bool whole = false,
                                                        double least_range = 1e-6, bool share = false);

/// Returns the same for labels from `least` to `most`: all are as dense, but 0 is not drawn. It stands for none.
[[nodiscard]] TransferFunction label_function(double least, double most);

/// Returns the mean extinction over a splat's values, taken as normally distributed; 0 without a value.
[[nodiscard]] double mean_extinction(const TransferFunction& function, const SurveySplat& splat);

/// The ends of a range of t, also beyond [0, 1].
struct VisibleValues {
  double low, high;
};

/// Rays through visible splats, seen with a camera. A splat gets rays by its extinction and its area in a picture of
/// 512 pixels, but by no more than a small part of the picture: so small cells count like large ones.
class PictureRays {
 public:
  /// The splats must outlive the rays.
  PictureRays(const std::vector<SurveySplat>& splats, const TransferFunction& function, const Camera& camera);
  PictureRays(const PictureRays&) = delete;
  PictureRays& operator=(const PictureRays&) = delete;
  ~PictureRays();

  /// Returns the factor on all densities with which the volume's opacity is right: along the rays the mean opacity is
  /// `opacity`. 1 if nothing is visible.
  [[nodiscard]] double density_factor(double opacity) const;

  /// Returns the 2nd to the 98th percentile of the values, as t, weighted by the light that they give in the picture
  /// with this factor on all densities. None if nothing is visible.
  [[nodiscard]] std::optional<VisibleValues> visible_values(double density_factor = 1) const;

 private:
  struct Contents;
  std::unique_ptr<Contents> contents_;
};

/// Returns the function with its colours spread over these values of its domain. A diverging map keeps the value in its
/// middle. Densities stay. The function stays as it is if the values are hardly more than one.
[[nodiscard]] TransferFunction with_visible_colors(TransferFunction function, const VisibleValues& visible);

/// Returns the mean opacity of the most opaque quarter of any side of the picture, seen with a perspective camera.
/// `aspect`: width / height.
[[nodiscard]] double border_opacity(const std::vector<SurveySplat>& splats, const TransferFunction& function,
                                    const Camera& camera, double aspect);

}  // namespace splatvol
