// All points of an input in memory, for tests.
#pragma once

#include <cstdint>

#include "base/error.h"
#include "builder/cell_reduction.h"
#include "builder/point_stream.h"

namespace splatvol::test {

struct WholePoints {
  InputSummary summary;
  PointBatch points;  // in Morton order, equal samples merged, without cells; without material if the input has none
};

/// Reads a source through PointStream, which may hold `memory` bytes.
[[nodiscard]] Result<WholePoints> read_points(Source& source, bool use_cells = true,
                                              std::size_t memory = std::size_t{1} << 30);

}  // namespace splatvol::test
