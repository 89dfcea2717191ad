// The surface of a value in the cells that a file keeps.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "extractor/output_arrays.h"
#include "format/splat_reader.h"
#include "format/volume.h"
#include "splatvol/meshes.h"

namespace splatvol {

/// A part of a surface. Its vertices are numbered through all parts.
struct SurfacePart {
  std::span<const dvec3> points = {};                            // of new vertices
  std::vector<std::span<const double>> values = {};              // [array]: of new vertices, side by side
  std::span<const std::array<std::uint64_t, 3>> triangles = {};  // vertices of this part and those before
  std::span<const std::array<dvec3, 3>> corners = {};            // [triangle]
};

/// Where a surface goes, part by part: into a file, or into memory.
class SurfaceOutput {
 public:
  virtual ~SurfaceOutput() = default;

  /// Whether the output has numbers of vertices. Otherwise parts need none, nor points.
  [[nodiscard]] virtual bool has_vertices() const { return true; }

  [[nodiscard]] virtual Status write(const SurfacePart& part) = 0;

  /// Returns the number of triangles so far.
  [[nodiscard]] std::uint64_t triangles() const { return triangles_; }

 protected:
  std::uint64_t triangles_ = 0;
};

struct ContourExtractionReport {
  std::uint64_t triangles = 0;
  std::uint64_t vertices = 0;  // 0: the output has no numbers of vertices
  std::uint64_t left_out = 0;  // cells of the file of a shape or field that this program does not know
  double area = 0;
  bool closed = false;  // each edge belongs to an even number of triangles, mostly two
  double volume = 0;    // inside, if closed; negative if the contour is the border of a hole
};

/// Gives the surface where the first attribute of the selection has a value, in the cells that meet the selection's
/// box, with the values of output_arrays(selection): linear along the edges of the mesh. The selection's resolution
/// does not matter.
///
/// The surface is that of the linear interpolation in each tetrahedron, exact up to rounding. Corners with the value or
/// more are inside. Triangles turn counter-clockwise seen from outside. A vertex is computed from the ends of its edge
/// in the order of their ranks, so it has the same bits in all cells, and no gap opens. Its number is the same in them,
/// too. The surface ends at the border of the mesh, of the box, and of cells with a missing value.
///
/// Reads a chunk of cells if its box meets the selection's and its range holds the value. Of `memory`, up to 128 MiB
/// hold parts of the file, and half has room for vertices that chunks to come may share. Fails if that does not
/// suffice. Does not depend on threads or memory. Fails if the file keeps no cells, if some have values of their own,
/// or if the contour is empty.
[[nodiscard]] Result<ContourExtractionReport> extract_contour(const format::Volume& volume,
                                                              const format::SplatSelection& selection, double value,
                                                              std::uint64_t memory, SurfaceOutput& output,
                                                              const std::function<void(double)>& progress);

/// Returns this surface in memory.
[[nodiscard]] Result<ContourMesh> extract_contour(const format::Volume& volume, const format::SplatSelection& selection,
                                                  double value);

}  // namespace splatvol
