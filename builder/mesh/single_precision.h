// How much single precision changes the shape of cells.
#pragma once

#include <span>

#include "base/math.h"
#include "builder/mesh/cell_census.h"
#include "builder/mesh/moments.h"

namespace splatvol {

/// Measures the tetrahedra of points whose coordinates were rounded to single precision, and adds the results to
/// `census`: measured_volume, bent_volume, bent, flattened.
///
/// Rounding moves a face by at most the sum over the axes of |n_i| step_i / 2, where n is its normal and step_i the
/// distance between neighbouring numbers of single precision. A tetrahedron counts as bent if that is more than 1/64 of
/// its height over one of its faces. One that is flat counts as made flat if its longest edge is less than 64 such
/// moves: a larger one was flat before, or so thin that its volume does not count. Requires usable positions.
void measure_single_precision(std::span<const dvec3> points, std::span<const Tetrahedron> tetrahedra,
                              CellCensus& census);

}  // namespace splatvol
