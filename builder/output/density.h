// Densities with which splats add up to the density of the material.
#pragma once

#include <cstdint>
#include <span>

#include "base/math.h"
#include "format/columns.h"

namespace splatvol {

struct FittedSplat {
  dvec3 centroid{0};
  SplatShape shape;
};

/// Bytes that fit_densities() takes for a splat: its ellipsoid, and those that it sees.
inline constexpr std::uint64_t bytes_of_fit = 520;

/// Fits the shapes' densities, factors on what the kernel `moments` draws. Ellipsoids that overlap do not add up to the
/// same density everywhere: they ripple, most where large cells meet small ones. The material has density 1, because a
/// splat's mass is its volume. The factors make the mean density within each splat's own material 1, and keep the mass
/// of every neighbourhood. Takes about `bytes_of_fit` bytes a splat while it runs. Requires splats in Morton order,
/// fewer than 2^32. Does not depend on the number of threads.
void fit_densities(std::span<FittedSplat> splats);

}  // namespace splatvol
