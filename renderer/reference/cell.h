// One tetrahedron on the screen: the pixels that may show it, and the points where a pixel's ray enters and leaves it.
#pragma once

#include <array>
#include <optional>

#include "scene/scene.h"
#include "scene/tile_grid.h"

namespace splatvol {

/// A tetrahedron's vertices; in view coordinates unless a comment says otherwise.
using CellCorners = std::array<dvec3, 4>;

/// A pixel's ray: the points (a z, b z, z) in perspective and (a, b, z) in orthographic projection.
struct PixelRay {
  double a, b;
};

/// A ray's way through a tetrahedron: the depths (view coordinate z) and the values at both ends.
struct Crossing {
  double enter, leave;
  double value_enter, value_leave;

  // Bounds of the values' rounding. Like the values' sides of a number beyond it, they belong to the faces: the cell on
  // the other side has the same.
  double rounding_enter = 0, rounding_leave = 0;
};

/// Returns the direction of the value's gradient in the tetrahedron, in the coordinates of `corners`: a vector of
/// length 1, or 0 if the value is constant or the corners lie in a line or a point. `values` belong to `corners`; both
/// are at most 1e100 in size.
[[nodiscard]] dvec3 gradient_direction(const CellCorners& corners, const std::array<double, 4>& values);

/// Returns the ray through the centre of pixel (x, y).
[[nodiscard]] PixelRay pixel_ray(const View& view, int x, int y);

/// Returns the pixels whose rays may cross the part of the tetrahedron in front of the eye; empty if there is none.
/// The rectangle is never too small, even with the eye inside, and at most a pixel too large.
[[nodiscard]] PixelRectangle pixel_bounds(const View& view, const CellCorners& corners);

/// Returns the sign of a d - b c, without rounding error.
[[nodiscard]] int determinant_sign(double a, double b, double c, double d);

/// Finds the part of a ray's line inside the tetrahedron, behind the eye too.
///
/// The vertices are sheared along the ray to (u, w), so that the ray becomes the line u = w = 0. It meets a face if the
/// signs of E_ij = u_i w_j - u_j w_i agree around the face. The signs are exact. An infinitely small turn of the ray
/// decides those that are 0, then an infinitely small move of the eye. All cells see the same turn and move, so
/// neighbours agree on their common face.
class CellCrosser {
 public:
  /// `values` belong to `corners`.
  CellCrosser(bool orthographic, const CellCorners& corners, const std::array<double, 4>& values)
      : orthographic_(orthographic), corners_(corners), values_(values) {}

  /// Chooses the row of pixels with this b; false if no ray of the row meets the cell.
  [[nodiscard]] bool select_row(double b);

  /// Returns the crossing of the ray (a, b), with the row's b; none if the ray misses the cell.
  [[nodiscard]] std::optional<Crossing> cross(double a);

 private:
  struct FaceHit {
    double depth, value, rounding;
  };

  [[nodiscard]] int edge_sign(int i, int j) const;
  [[nodiscard]] unsigned faces_hit_exactly() const;
  [[nodiscard]] FaceHit hit_face(int opposite) const;
  [[nodiscard]] double zeta(int i) const { return orthographic_ ? 1 : corners_[i].z; }

  bool orthographic_;
  CellCorners corners_;
  std::array<double, 4> values_;
  std::array<double, 4> u_{};
  std::array<double, 4> w_{};
};

}  // namespace splatvol
