// Exports a file's points and their material as a .vtu file.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "base/error.h"
#include "exporter/splat_groups.h"
#include "format/volume.h"

namespace splatvol {

struct VtuReport {
  std::uint64_t points = 0;
  double mass = 0;  // of these points
  std::uint64_t file_bytes = 0;
};

/// Writes the points in the box, in file order, as vertices with these arrays in double precision:
/// - for each selected attribute A, its value (NaN: missing);
/// - "mass", "centroid", "covariance" (XX, YY, ZZ, XY, YZ, XZ) of the point's material at the selection's resolution;
/// - for each A, over the material that has a value: "A mean", "A deviation" (standard deviation) and "A covariance"
///   (with the position), NaN if there is no such material;
/// - "A gradient": the gradient of the linear field that fits this material best, S^-1 c with the covariance S of the
///   position and the covariance c, in values per unit of length. It is 0 across directions without extent, and if
///   there is no material;
/// - "A gradient direction": the gradient that the file stores for the point (spec 8, gradient), of length 1 or 0. Left
///   out if the file has none.
///
/// Writes appended raw data of the file version 1.0. Memory does not grow with the number of points. The file appears
/// whole or not at all. Output does not depend on threads. Fails if an attribute has the name of another array, or if
/// no point is in the box.
[[nodiscard]] Result<VtuReport> export_vtu(const format::Volume& volume, const std::string& path,
                                           const format::SplatSelection& selection,
                                           const std::function<void(double)>& progress);

}  // namespace splatvol
