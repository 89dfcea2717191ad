// Integrals over the cells that a file keeps.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>

#include "base/error.h"
#include "format/volume.h"
#include "splatvol/integrals.h"

namespace splatvol {

/// Integrates attributes over the cells of a file, of a series at the volume's step. Each tetrahedron is cut exactly:
/// by the box, by the planes, and where its linear values leave a range. Its volume counts as positive, however its
/// corners are ordered. One without volume does not count at all, and one with a missing value at a corner does not
/// count for this attribute.
///
/// Reads the chunks that meet the region, by their boxes and the ranges of their values, and holds at most `memory`
/// bytes of parts of the file. `progress` gets the share done. Sums do not depend on memory and threads: those of a
/// chunk are added by themselves, and then in the order of chunks. All additions are compensated.
///
/// Fails if the file keeps no cells or lacks an attribute, and if the region is none: NaN, a normal without direction,
/// or a box or range whose ends are exchanged.
[[nodiscard]] Result<Integrals> integrate_cells(const format::Volume& volume, const IntegralRequest& request,
                                                std::uint64_t memory, std::size_t threads,
                                                const std::function<void(double)>& progress);

}  // namespace splatvol
