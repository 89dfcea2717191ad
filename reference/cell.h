// One tetrahedron on the screen: where it may appear, and where a pixel's ray enters and leaves it.
#pragma once

#include <array>
#include <optional>

#include "scene/scene.h"

namespace splatvol {

/// A range of pixels, both ends included; columns from the left, rows from the bottom.
struct PixelRectangle {
  int x0, x1, y0, y1;

  [[nodiscard]] bool is_empty() const { return x0 > x1 || y0 > y1; }
};

/// A tetrahedron's vertices; in view coordinates where nothing else is said.
using CellCorners = std::array<dvec3, 4>;

/// A pixel's ray: the points (a z, b z, z) in perspective and (a, b, z) in orthographic projection.
struct PixelRay {
  double a, b;
};

/// A ray's way through a tetrahedron; depths are view coordinates z, with the value at both ends.
struct Crossing {
  double enter, leave;
  double value_enter, value_leave;
};

/// The direction of the gradient of the value, which is linear in the tetrahedron, in the coordinates of `corners`:
/// length 1; 0 where the value is constant or the corners lie in a line or a point. `values` belong to `corners`; both
/// at most 1e100 in size.
[[nodiscard]] dvec3 gradient_direction(const CellCorners& corners, const std::array<double, 4>& values);

/// The ray through the centre of pixel (x, y).
[[nodiscard]] PixelRay pixel_ray(const View& view, int x, int y);

/// The pixels whose rays may cross the part of the tetrahedron in front of the eye; empty where there is none.
/// Never too small, also where the eye is inside, and at most a pixel too large.
[[nodiscard]] PixelRectangle pixel_bounds(const View& view, const CellCorners& corners);

/// The sign of a d - b c, without rounding error.
[[nodiscard]] int determinant_sign(double a, double b, double c, double d);

/// The part of the ray's line inside the tetrahedron, behind the eye too.
///
/// The vertices are sheared along the ray to (u, w): the ray becomes the line u = w = 0, and meets a face where the
/// signs of E_ij = u_i w_j - u_j w_i agree around it. The signs are exact; those that are 0 are decided by an
/// infinitely small turn of the ray, then by one of the eye. All cells see the same turn, so neighbours agree on their
/// common face.
class CellCrosser {
 public:
  /// `values` belong to `corners`.
  CellCrosser(bool orthographic, const CellCorners& corners, const std::array<double, 4>& values)
      : orthographic_(orthographic), corners_(corners), values_(values) {}

  /// Chooses the row of pixels with this b; false where no ray of the row meets the cell.
  [[nodiscard]] bool select_row(double b);

  /// The crossing of the ray (a, b), with the row's b.
  [[nodiscard]] std::optional<Crossing> cross(double a);

 private:
  struct FaceHit {
    double depth, value;
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
