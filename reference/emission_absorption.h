// The emission-absorption integral along a ray, front to back.
#pragma once

#include <vector>

#include "scene/scene.h"

namespace splatvol {

/// The light that a ray has gathered so far.
struct RayLight {
  dvec3 color{0};    // premultiplied
  double depth = 0;  // optical depth
  double transmittance = 1;
  double lighting = 1;  // factor on the colours that are added next

  [[nodiscard]] vec4 rgba() const;
};

/// A transfer function cut at its bends and jumps into pieces on which colour and extinction are linear.
class PiecewiseTransfer {
 public:
  explicit PiecewiseTransfer(const TransferFunction& function);

  /// Adds a stretch of `length` > 0 world units at the far end of `light`. The value runs linearly from `front` to
  /// `back` (both finite). Integrates dC = c(v) kappa(v) T ds in integration steps that span at most 1/512 of the
  /// domain. In each step the absorption is exact; the emission is exact if colour or extinction is constant.
  void add(double front, double back, double length, RayLight& light) const;

 private:
  struct Sample {
    dvec3 rgb;
    double extinction;
  };
  struct Piece {
    double low, high;        // values
    Sample at_low, at_high;  // limits from inside
    bool is_transparent;

    [[nodiscard]] Sample sample(double value) const;
  };

  void add_in_piece(const Piece& piece, double front, double back, double length, RayLight& light) const;
  static void add_step(const Sample& front, const Sample& back, double length, RayLight& light);

  std::vector<double> breaks_;  // values, ascending, no two equal
  std::vector<Piece> pieces_;   // one more than breaks: the first and the last are unbounded and constant
  double largest_step_;
};

}  // namespace splatvol
