// Exact cell projection: the emission-absorption integral through every tetrahedron, in double precision.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <span>

#include "base/error.h"
#include "base/math.h"
#include "pictures/image.h"
#include "scene/scene.h"
#include "splatvol/surface_depths.h"

namespace splatvol {

/// A field that is linear, or constant, within each tetrahedron.
struct TetMesh {
  std::span<const dvec3> points;                             // world coordinates
  std::span<const double> values;                            // one for each point; NaN: missing
  std::span<const std::array<std::uint32_t, 4>> tetrahedra;  // indices into points; any orientation, flat ones too
  bool constant = false;                                     // values: one for each tetrahedron instead
  std::span<const double> opacity_values = {};               // as values, of the scene's opacity; none without one
  std::span<const double> color_values = {};  // as values, of the attribute that colours contours; none without one

  // [point]: a number below that of points, the same for copies of one vertex; empty: none are. Copies share gradients.
  std::span<const std::uint32_t> vertices = {};
};

/// Fails if arrays differ in length, or if an index is out of range.
[[nodiscard]] Status check_mesh(const TetMesh& mesh);

struct ReferenceOptions {
  int threads = 0;  // at most; 0: as many as the machine has

  /// Called with the share of the picture that is done, in [0, 1]; from any thread, one call at a time.
  std::function<void(double)> progress = {};

  /// Each ray ends at its depth, if any. Must have the picture's size.
  const SurfaceDepths* surface_depths = nullptr;
};

struct ReferencePicture {
  Image image;
  std::uint64_t segments = 0;  // pieces of rays inside a tetrahedron, in front of the eye
};

/// Draws the exact picture of `scene` (its camera, image size and transfer function) through `mesh`.
///
/// Every pixel's centre has one ray. It crosses each tetrahedron on at most one segment, along which the value is
/// linear, or constant. dC = c(v) kappa(v) T ds is integrated along the segments in the order of their entry depths. An
/// integration step spans at most 1/512 of the transfer function's domain and no bend of it. Only the part in front of
/// the eye counts, in orthographic projection too. In a lit scene the colour on each segment is multiplied by the
/// factor for the ray and the tetrahedron's gradient. If the scene has an opacity, the extinction is multiplied by its
/// factor; a step then also spans at most 1/512 of its domain and no bend of it. Exact arithmetic decides which
/// tetrahedra a ray crosses, so a ray inside a face, through an edge or a vertex counts once. All tetrahedra that
/// overlap count.
///
/// A contour is a surface where the value on a segment rises to that of the contour, or falls below. It is lit by the
/// gradient, linear between those of the points (base/point_gradients.h). Values beyond by less than rounding count as
/// that of the contour, so that a face whose vertices all have this value is one surface. Where the value that colours
/// it is missing, it is not drawn.
///
/// A tetrahedron contributes nothing if a value or a position of it, or of one of its vertices, is missing (not
/// finite). Requires coordinates relative to the eye that are 0 or between 1e-100 and 1e100 in size; values beyond
/// 1e100 count as 1e100. The result does not depend on threads. Needs 24 bytes for each point, 20 to 30 for each
/// tetrahedron, and about 100 MiB for each thread. Fails if memory is too small, or an index is out of range. Fails if
/// arrays differ in length, or the opacity or the colours of contours have no values. Fails if a scene with contours
/// has cells of constant values. Fails if the camera is degenerate, or depths of surfaces do not have the picture's
/// size.
[[nodiscard]] Result<ReferencePicture> render_reference(const TetMesh& mesh, const Scene& scene,
                                                        const ReferenceOptions& options = {});

}  // namespace splatvol
