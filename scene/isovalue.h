// Shells round one value: a transfer function whose density is a narrow peak.
#pragma once

#include <optional>
#include <vector>

#include "scene/scene.h"

namespace splatvol {

/// A peak of the density. It falls linearly to 0 on both sides, and is `width` wide in values.
struct Isovalue {
  double value = 0;    // in the function's domain
  double width = 0;    // > 0
  double density = 0;  // extinction per world unit at the value, >= 0

  [[nodiscard]] bool operator==(const Isovalue&) const = default;
};

/// Returns the control points of the density. A side that reaches out of the domain ends there. Requires a value in the
/// domain.
[[nodiscard]] std::vector<TransferFunction::Density> densities_of(const TransferFunction& function,
                                                                  const Isovalue& isovalue);

/// Returns the isovalue of a function that densities_of has made, to some rounding. None for another function.
[[nodiscard]] std::optional<Isovalue> isovalue_of(const TransferFunction& function);

/// Returns an isovalue that shows a shell in data of this size, in world units. `width`: in values; none: a fiftieth
/// of the domain, on its axis.
[[nodiscard]] Isovalue fitting_isovalue(const TransferFunction& function, double value, std::optional<double> width,
                                        double size);

/// Shows a shell, lit. The domain grows to hold its values. Fails with invalid_argument if the axis does not have them.
[[nodiscard]] Status show_isovalue(Scene& scene, double value, std::optional<double> width, double size);

/// Returns a scene that shows its contours as shells of the volume: for splats, which have no contours. Where values
/// run through the domain ten times over the data's `size`, in world units, a translucent shell has about the opacity
/// of its contour. Contours that are coloured by another attribute have the colour of the transfer function.
[[nodiscard]] Scene with_shells(const Scene& scene, double size);

}  // namespace splatvol
