// All points of an input, in Morton order.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "builder/material.h"
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
  std::vector<std::vector<double>> values;    // [attribute][point]; NaN: missing, or beyond single precision
  std::vector<std::vector<dvec3>> gradients;  // [attribute][point], of any length; 0: none
  Material material;                          // of the cells, without extents; empty, as gradients, where none are used
  std::vector<std::string> attributes;
  CellCensus cells;
  PointCensus census;

  [[nodiscard]] std::size_t size() const { return positions.size(); }
};

/// Appends to the material and the gradients of `points` what `vertices` of a mesh own, given its values.
void append_material(const VertexMaterial& mesh, const std::vector<std::vector<double>>& values,
                     std::span<const std::size_t> vertices, PointSet& points);

/// Reads every piece and sorts; with `use_cells`, adds up what each point owns of them. Fails where there is no point
/// with finite coordinates, or their extent overflows. The result does not depend on the number of threads. `progress`
/// gets the share of pieces read.
[[nodiscard]] Result<PointSet> gather_points(Source& source, bool use_cells,
                                             const std::function<void(double)>& progress);

}  // namespace splatvol
