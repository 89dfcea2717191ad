// Points that are reduced together.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "base/math.h"
#include "builder/mesh/boundary.h"
#include "builder/mesh/moments.h"
#include "builder/sorting/morton.h"

namespace splatvol {

/// A cell of the index's octree: a leaf, or a part of one that has more points than can be held at once, all of one
/// key.
struct NodePart {
  std::size_t begin, end;  // points of the batch
  int depth;
  std::uint64_t leaf;  // of the index, by number
  bool continued;      // not its first part
};

/// Points that follow each other in Morton order, as whole cells. Arrays over the points; those of the material are
/// empty as long as it is not known.
struct PointBatch {
  std::uint64_t first = 0;  // number of the first point
  std::vector<MortonKey> keys;
  std::vector<dvec3> positions;
  std::vector<std::vector<double>> values;  // [attribute]; NaN: missing
  std::vector<SpatialMoments> moments;
  std::vector<std::vector<ValueMoments>> value_moments;  // [attribute]
  std::vector<std::vector<dvec3>> gradients;             // [attribute], of any length; 0: none
  std::vector<BoundaryPlane> planes;                     // empty where there are none
  std::vector<NodePart> cells;
  std::vector<NodePart> blocks;         // of cells, where material is to be estimated; else none
  std::optional<dvec3> before, behind;  // places of the neighbours in Morton order

  [[nodiscard]] std::size_t size() const { return positions.size(); }
};

/// Calls visit(a, b) for each pair of arrays over the points of two batches with as many attributes.
template <class A, class B, class Visit>
void for_each_array(A& a, B& b, const Visit& visit) {
  visit(a.keys, b.keys);
  visit(a.positions, b.positions);
  visit(a.moments, b.moments);
  visit(a.planes, b.planes);
  for (std::size_t i = 0; i < a.values.size(); ++i) {
    visit(a.values[i], b.values[i]);
    visit(a.value_moments[i], b.value_moments[i]);
    visit(a.gradients[i], b.gradients[i]);
  }
}

}  // namespace splatvol
