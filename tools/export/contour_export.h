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

/// Writes the surface where the first attribute of the selection has a value, in the cells that meet the selection's
/// box, as `path` says (SurfaceFile): .vtp, .stl or .glb. Only .vtp has values of attributes: of all that are selected,
/// linear along the edges of the mesh. The selection's resolution does not matter.
///
/// The surface is that of the linear interpolation in each tetrahedron, exact up to rounding. Corners with the value or
/// more are inside. Triangles turn counter-clockwise seen from outside. A vertex is computed from the ends of its edge
/// in the order of their ranks, so it has the same bits in all cells, and no gap opens. Its number is the same in them,
/// too. The surface ends at the border of the mesh, of the box, and of cells with a missing value.
///
/// Reads a chunk of cells if its box meets the selection's and its range holds the value. Of `memory`, up
/// to 128 MiB hold parts of the file, and half has room for vertices that chunks to come may share. Fails if that does
/// not suffice. Temporary files beside `path` take as much as the output. Does not depend on threads or memory.
/// Fails if the file keeps no cells, if some have values of their own, if the contour is empty, if the selection has
/// two attributes of one name, or if `path` may not be replaced.
[[nodiscard]] Result<ContourReport> export_contour(const format::Volume& volume, const std::string& path,
                                                   const format::SplatSelection& selection, double value,
                                                   std::uint64_t memory, const std::function<void(double)>& progress,
                                                   Replace replace = Replace::exports);

}  // namespace splatvol
