// An input's points all in memory, for tests.
#pragma once

#include "base/error.h"
#include "builder/points/input_summary.h"
#include "builder/points/point_batch.h"
#include "builder/sources/source.h"

namespace splatvol::test {

struct WholePoints {
  InputSummary summary;
  PointBatch points;  // in Morton order, copies of vertices merged; no material if the input has none
};

/// Reads a source through PointStream, which may hold `memory` bytes.
[[nodiscard]] Result<WholePoints> read_points(Source& source, bool use_cells = true,
                                              std::size_t memory = std::size_t{1} << 30);

}  // namespace splatvol::test
