// A file's points and what they stand for as a .vtu file.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "base/error.h"
#include "exporter/splat_reader.h"
#include "format/volume.h"

namespace splatvol {

struct VtuReport {
  std::uint64_t points = 0;
  double mass = 0;  // of these
  std::uint64_t file_bytes = 0;
};

/// Writes the points in the box, in file order, as vertices with arrays in double precision: for each selected
/// attribute its value (NaN: missing); what the point stands for at the selection's resolution: "mass", "centroid",
/// "covariance" (XX, YY, ZZ, XY, YZ, XZ); and for each attribute, of the part that has a value, "A mean", "A deviation"
/// (standard) and "A covariance" (with the position), NaN where there is none. Its gradient: "A gradient", that of the
/// linear field that fits this part best, S^-1 c of both covariances, in values per unit of length, 0 across what has
/// no extent and where there is no material; "A gradient direction", the file's own at the point, of length 1 or 0,
/// where the file has it (spec 8, gradient).
///
/// Appended raw data of the file version 1.0. Memory does not grow with the points. The file appears whole or not at
/// all; output does not depend on threads. Fails where an attribute is called as another array, and where no point is
/// in the box.
[[nodiscard]] Result<VtuReport> export_vtu(const format::Volume& volume, const std::string& path,
                                           const ExportSelection& selection,
                                           const std::function<void(double)>& progress);

}  // namespace splatvol
