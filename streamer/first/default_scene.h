// A first view of a volume that has no scene. docs/scene.md, "The first picture", says why each choice is made.
#pragma once

#include <optional>
#include <string>

#include "base/error.h"
#include "format/volume.h"
#include "scene/scene.h"

namespace splatvol {

/// The size, background and use of a first picture.
struct FirstPicture {
  int width = 512, height = 512;
  dvec3 background{0};         // linear; colours and densities stand out from it
  bool turns = false;          // the camera will turn round the volume: all of it stays in the picture
  std::optional<int> up = {};  // axis; none: up_axis_of, but for a sheet
};

/// Returns the axis that is upwards: the file's, else y.
[[nodiscard]] int up_axis_of(const format::VolumeInfo& info);

/// Makes a scene that shows the data. The camera fits what choose_first_attribute's values show, for every attribute
/// alike, and what other attributes show near them. Reads some hundred KiB. `attribute` empty: that of
/// choose_first_attribute. Fails if the file cannot be read, lacks the attribute (the message lists those that it has),
/// or has no value of it.
[[nodiscard]] Result<Scene> default_scene(const format::Volume& volume, const std::string& attribute,
                                          const FirstPicture& picture = {});

/// Factors on the extinction by the values of an attribute, and the density with which they fit the data.
struct FittingOpacity {
  SceneOpacity opacity;
  double density;  // extinction per world unit
};

/// Makes an opacity that shows of an attribute what default_scene shows of it. Fails as default_scene.
[[nodiscard]] Result<FittingOpacity> fitting_opacity(const format::Volume& volume, const std::string& attribute,
                                                     const FirstPicture& picture = {});

/// Gives a scene this opacity. Then all values that are shown have one density.
void show_opacity(Scene& scene, FittingOpacity fitting);

/// Returns the scene's transfer function with its colours spread over the values that are seen: the 2nd to the 98th
/// percentile, weighted by the light that they give in the scene's picture. Fails as default_scene.
[[nodiscard]] Result<TransferFunction> visible_colors(const format::Volume& volume, const Scene& scene);

/// Returns the middle of what a scene shows. Fails if the file cannot be read or lacks the scene's attribute.
[[nodiscard]] Result<dvec3> middle_of_visible(const format::Volume& volume, const Scene& scene);

/// Returns the box round the material of a volume, from some coarse splats. Fails if the file cannot be read.
[[nodiscard]] Result<Box> domain_of(const format::Volume& volume);

}  // namespace splatvol
