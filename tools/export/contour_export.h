// Exports the surface of a value in the cells that a file keeps.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "base/error.h"
#include "base/replaceable.h"
#include "extractor/contour_extraction.h"
#include "format/splat_reader.h"
#include "format/volume.h"

namespace splatvol {

struct ContourReport : ContourExtractionReport {
  std::uint64_t file_bytes = 0;
};

/// Writes the surface of extract_contour as `path` says (SurfaceFile): .vtp, .stl or .glb. Only .vtp has values of
/// attributes.
///
/// Temporary files beside `path` take as much as the output. Fails as extract_contour does, if the selection has two
/// attributes of one name, or if `path` may not be replaced.
[[nodiscard]] Result<ContourReport> export_contour(const format::Volume& volume, const std::string& path,
                                                   const format::SplatSelection& selection, double value,
                                                   std::uint64_t memory, const std::function<void(double)>& progress,
                                                   Replace replace = Replace::exports);

}  // namespace splatvol
