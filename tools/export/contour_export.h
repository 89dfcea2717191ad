// Exports the surface of a value in the cells that a file keeps.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "base/error.h"
#include "base/replaceable.h"
#include "format/splat_reader.h"
#include "format/volume.h"

namespace splatvol {

struct ContourReport {
  std::uint64_t triangles = 0;
  std::uint64_t vertices = 0;  // 0: the format has no numbers of vertices
  std::uint64_t left_out = 0;  // cells of the file of a shape or field that this program does not know
  double area = 0;
  bool closed = false;  // each edge belongs to an even number of triangles, mostly two
  double volume = 0;    // inside, if closed; negative if the contour is the border of a hole
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
