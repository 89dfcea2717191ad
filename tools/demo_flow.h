// The demo's flow: a vortex tube in the shape of a trefoil knot. All but one line integral is in closed form.
#pragma once

#include <vector>

#include "base/math.h"

namespace splatvol {

struct FlowSample {
  dvec3 velocity;
  double vorticity;    // magnitude
  double pressure;     // minus the pressure far away, for density 1
  double temperature;  // in [0, 1]: heat carried by the tube, more and less along it
};

/// A vortex filament of circulation 1 along a trefoil knot, smoothed over a core radius s (Rosenhead 1930, Moore 1972):
///   u(x) = 1 / (4 pi) integral of t x (x - c) / (|x - c|^2 + s^2)^(3/2) along the knot c with tangent t,
///   curl u = 3 s^2 / (4 pi) integral of t / (|x - c|^2 + s^2)^(5/2): exact, as the knot is closed.
/// Pressure follows Bernoulli's law along streamlines, -|u|^2 / 2. Immutable, so thread-safe.
class DemoFlow {
 public:
  DemoFlow();

  /// The corners of the box that holds the interesting part of the flow.
  static constexpr dvec3 low{-2, -2, -1};
  static constexpr dvec3 high{2, 2, 1};

  [[nodiscard]] FlowSample at(dvec3 x) const;

 private:
  struct Segment {
    dvec3 center;
    dvec3 tangent;  // times its length
    double heat;
  };
  std::vector<Segment> knot_;
};

}  // namespace splatvol
