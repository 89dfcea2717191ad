// How densely splats must be drawn so that together they are as dense as the material.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "base/math.h"
#include "format/columns.h"

namespace splatvol {

/// A splat of the kernel `moments` and where it is.
struct PlacedShape {
  dvec3 centroid{0};
  format::SplatShape shape;
};

/// Fits the shapes' densities. Ellipsoids that overlap do not add up to the same density everywhere: they ripple, most
/// where large cells meet small ones. The factors make the mean of the density within each splat's own material 1, what
/// the material has since a splat's mass is its volume, and keep the mass of every neighbourhood. About 450 bytes a
/// splat while it runs. Requires splats in Morton order, fewer than 2^32. Does not depend on the number of threads.
void fit_densities(std::span<PlacedShape> splats);

}  // namespace splatvol
