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

  /// Adds a surface. `opacity`: [0, 1].
  void add_surface(const dvec3& rgb, double opacity);
};

/// What runs linearly along a stretch of a ray, at its two ends.
struct Ends {
  double front, back;

  [[nodiscard]] double at(double share) const { return front + share * (back - front); }
};

/// A transfer function cut at its bends and jumps into pieces on which colour and extinction are linear.
class PiecewiseTransfer {
 public:
  explicit PiecewiseTransfer(const TransferFunction& function);

  /// Adds a stretch of `length` > 0 world units at the far end of `light`, with these values (finite). Integrates
  /// dC = c(v) kappa(v) T ds in integration steps that span at most 1/512 of the domain. In each step the absorption is
  /// exact; the emission is exact if colour or extinction is constant. `factor`: on the extinction; in a step, their
  /// product counts as linear.
  void add(const Ends& values, double length, RayLight& light, const Ends& factor = {1, 1}) const;

  /// The same with the factors of an opacity, whose extinctions are factors. A step spans at most 1/512 of its domain
  /// too, and no bend of it.
  void add(const Ends& values, const PiecewiseTransfer& opacity, const Ends& opacity_values, double length,
           RayLight& light) const;

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

  template <class Visit>
  void visit_pieces(const Ends& values, const Visit& visit) const;
  void add_in_piece(const Piece& piece, const Ends& values, double length, RayLight& light, const Ends& factor) const;
  [[nodiscard]] int steps_in(const Piece& piece, const Ends& values) const;
  static void add_step(const Sample& front, const Sample& back, double length, RayLight& light);

  std::vector<double> breaks_;  // values, ascending, no two equal
  std::vector<Piece> pieces_;   // one more than breaks: the first and the last are unbounded and constant
  double largest_step_;
};

}  // namespace splatvol
