// Exports a file's points and their material as a .vtu file.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>

#include "base/error.h"
#include "base/replaceable.h"
#include "format/volume.h"
#include "tools/export/splat_groups.h"

namespace splatvol {

struct VtuReport {
  std::uint64_t points = 0;
  double mass = 0;  // of these points
  std::uint64_t file_bytes = 0;
  std::map<std::string, std::string> renamed;  // arrays whose usual name an attribute has: their names in the file
};

/// Writes the points in the box, in file order, as vertices with these arrays in double precision:
/// - for each selected attribute A, its value (NaN: missing); the components of a vector together (output_arrays);
/// - "mass", "centroid", "covariance" (XX, YY, ZZ, XY, YZ, XZ) of the point's material at the selection's resolution;
/// - for each A, over the material that has a value: "A mean", "A deviation" (standard deviation) and "A covariance"
///   (with the position), NaN if there is no such material;
/// - "A gradient": the gradient of the linear field that fits this material best, S^-1 c with the covariance S of the
///   position and the covariance c, in values per unit of length. It is 0 across directions without extent, and if
///   there is no material;
/// - "A gradient direction": the gradient that the file stores for the point (spec 8, gradient), of length 1 or 0. Left
///   out if the file has none.
///
/// An attribute keeps its name. Another array that is called so gets the first free one of "mass (splat)", "mass (splat
/// 2)" and so on.
///
/// Writes appended raw data of the file version 1.0, with the mark of an export (base/replaceable.h). Memory does not
/// grow with the number of points. The file appears whole or not at all. Output does not depend on threads. Fails if
/// the selection has two attributes of one name, if no point is in the box, or if `path` may not be replaced.
[[nodiscard]] Result<VtuReport> export_vtu(const format::Volume& volume, const std::string& path,
                                           const format::SplatSelection& selection,
                                           const std::function<void(double)>& progress,
                                           Replace replace = Replace::exports);

}  // namespace splatvol
