// Points that are reduced together.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "builder/mesh/boundary.h"
#include "builder/mesh/moments.h"
#include "builder/sorting/morton.h"

namespace splatvol {

/// Points of a batch in one octree node: all of the node's points, or some of them if the node has more points than a
/// batch may hold. All points of such a node share one Morton key.
struct NodePart {
  std::size_t begin, end;  // points of the batch
  int depth;               // of the node
  std::uint64_t leaf;      // number of the index leaf; 0 for a part of an estimate node
  bool continued;          // not the node's first part
};

/// Points that follow each other in Morton order, with arrays over the points. The arrays of the material are empty as
/// long as it is not known.
struct PointBatch {
  std::uint64_t first = 0;  // number of the first point
  std::vector<MortonKey> keys;
  std::vector<dvec3> positions;
  std::vector<std::vector<double>> values;  // [attribute]; NaN: missing
  std::vector<SpatialMoments> moments;
  std::vector<double> heights;                           // least_heights; empty if no cells of the input are used
  std::vector<std::vector<ValueMoments>> value_moments;  // [attribute]
  std::vector<std::vector<dvec3>> gradients;             // [attribute], of any length; 0: none. Empty if not wanted
  std::vector<BoundaryPlane> planes;                     // empty if no point has one
  std::vector<NodePart> leaf_parts;                      // of index leaves
  std::vector<NodePart> estimate_parts;                  // of estimate nodes
  std::optional<dvec3> before, behind;                   // positions of the neighbours in Morton order

  [[nodiscard]] std::size_t size() const { return positions.size(); }

  /// Sets the number of attributes.
  void resize_attributes(std::size_t attributes) {
    values.resize(attributes);
    value_moments.resize(attributes);
    gradients.resize(attributes);
  }
};

/// Appends the next points of a stream to a batch, about `points_at_once`. Returns false after the last point. Does not
/// touch the number of the first point, the parts of nodes and the neighbours.
using NextPoints = std::function<Result<bool>(PointBatch&)>;
inline constexpr std::size_t points_at_once = 512;

/// Calls visit(a, b) for each pair of arrays over the points of two batches with as many attributes.
template <class A, class B, class Visit>
void for_each_array(A& a, B& b, const Visit& visit) {
  visit(a.keys, b.keys);
  visit(a.positions, b.positions);
  visit(a.moments, b.moments);
  visit(a.heights, b.heights);
  visit(a.planes, b.planes);
  for (std::size_t i = 0; i < a.values.size(); ++i) {
    visit(a.values[i], b.values[i]);
    visit(a.value_moments[i], b.value_moments[i]);
    visit(a.gradients[i], b.gradients[i]);
  }
}

/// Appends points [begin, end) of another batch with as many attributes, and what is known of them.
inline void append_points(const PointBatch& from, std::size_t begin, std::size_t end, PointBatch& to) {
  for_each_array(from, to, [&](const auto& items, auto& all) {
    const auto at = [&](std::size_t i) { return items.begin() + static_cast<std::ptrdiff_t>(i); };
    if (!items.empty()) all.insert(all.end(), at(begin), at(end));
  });
}

}  // namespace splatvol
