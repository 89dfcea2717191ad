// What a volume holds, from its coarse splats alone: enough to choose a first view.
#pragma once

#include <algorithm>
#include <cstdint>
#include <memory>
#include <numbers>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "format/volume.h"

namespace splatvol {

/// A splat of the survey: its material as a uniform ellipsoid.
struct SurveySplat {
  dvec3 center;
  dmat3 axes;             // columns: principal axes times the standard deviations along them, world units
  double volume = 0;      // of the material that has a value
  double value = 0;       // mean
  double deviation = 0;   // standard deviation of the value
  bool has_value = true;  // false: value and deviation mean nothing
  double factor = 1;      // on its extinction, by another attribute
  double weight = 1;      // how much its value counts: the share of a pixel that it covers in a picture, at most 1

  /// Returns how far the material reaches from its centre along a unit vector. Exact for a box along the axes of the
  /// world, if `direction` is one of these.
  [[nodiscard]] double reach(const dvec3& direction) const {
    return std::numbers::sqrt3 * glm::length(direction * axes);
  }

  /// Returns how far it reaches along its longest axis.
  [[nodiscard]] double longest() const { return reach(axes[0] / std::max(glm::length(axes[0]), 1e-300)); }
};

/// Bytes that a survey needs. While they live, it takes them from memory.
using SurveyBytes = std::vector<std::shared_ptr<const BytesAhead>>;

/// Reads what a survey needs of the shapes and of the values of these attributes together, if the file is far
/// (format::Volume::is_far). Fails if it cannot be read.
[[nodiscard]] Result<SurveyBytes> read_survey_ahead(const format::Volume& volume, const std::vector<int>& attributes,
                                                    std::uint64_t most_splats);

/// The shapes of the splats of a survey, which all attributes have in common.
struct SurveyShapes {
  std::size_t resolution = 0;
  std::vector<dvec3> centroids;
  std::vector<SplatShape> shapes;
};

/// Reads the shapes of the splats of VolumeInfo::finest_within: some hundred KiB of any file. Fails if the file cannot
/// be read, is damaged, or lacks moments.
[[nodiscard]] Result<SurveyShapes> survey_shapes(const format::Volume& volume, std::uint64_t most_splats);

/// Reads the values of an attribute of these splats, which are of the same volume. Fails as survey_shapes does.
[[nodiscard]] Result<std::vector<SurveySplat>> survey_material(const format::Volume& volume, int attribute,
                                                               const SurveyShapes& shapes);

/// Reads both.
[[nodiscard]] Result<std::vector<SurveySplat>> survey_material(const format::Volume& volume, int attribute,
                                                               std::uint64_t most_splats);

/// Reads the values of an attribute at the points of VolumeInfo::finest_within; missing ones are NaN.
[[nodiscard]] Result<std::vector<double>> survey_values(const format::Volume& volume, int attribute,
                                                        std::uint64_t most_points);

/// Returns the box round the material of all splats, with or without a value.
[[nodiscard]] Box bounds_of(const std::vector<SurveySplat>& splats);

}  // namespace splatvol
