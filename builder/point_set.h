// All points of an input, in Morton order.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "builder/morton.h"
#include "builder/source.h"

namespace splatvol {

/// What became of the input's points, counted.
struct PointCensus {
  std::uint64_t read = 0;
  std::uint64_t not_finite = 0;  // dropped: a coordinate is NaN or infinite
  std::uint64_t merged = 0;      // vertices of cells whose position and values repeat an earlier one's: the same sample
  std::uint64_t coincident = 0;  // kept, though an earlier point has the same position
  std::uint64_t in_no_cell = 0;  // kept, though the input has cells and none uses them
};

/// Points in Morton order; equal keys by input order.
struct PointSet {
  Cube cube;
  std::vector<dvec3> positions;
  std::vector<MortonKey> keys;
  std::vector<std::vector<double>> values;  // [attribute][point]; NaN: missing
  std::vector<float> spacings;              // shortest edge of the cells at the point; infinity where there is none
  std::vector<std::string> attributes;
  CellCensus cells;
  PointCensus census;

  [[nodiscard]] std::size_t size() const { return positions.size(); }
};

/// Reads every piece and sorts. Fails where there is no point with finite coordinates, or their extent overflows.
/// The result does not depend on the number of threads. `progress` gets the share of pieces read.
[[nodiscard]] Result<PointSet> gather_points(Source& source, const std::function<void(double)>& progress);

}  // namespace splatvol
