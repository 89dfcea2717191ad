#include "builder/points/material_estimator.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <span>
#include <type_traits>
#include <vector>

#include "builder/sorting/octree_nodes.h"

namespace splatvol {
namespace {

// Points whose box is thinner than this share of the octree's root lie on a plane, up to rounding.
constexpr double flat_share = 1e-9;

void resize_material(PointBatch& batch, bool with_gradients) {
  batch.moments.resize(batch.size());
  for (auto& moments : batch.value_moments) moments.resize(batch.size());
  for (auto& gradients : batch.gradients) gradients.resize(with_gradients ? batch.size() : 0);
}

// The first part of a node has all of its material: the points of such a node share one Morton key.
void clear_material(const NodePart& part, PointBatch& batch) {
  const auto clear = [&](auto& items) {
    std::fill(items.begin() + static_cast<std::ptrdiff_t>(part.begin),
              items.begin() + static_cast<std::ptrdiff_t>(part.end),
              typename std::decay_t<decltype(items)>::value_type{});
  };
  clear(batch.moments);
  for (auto& moments : batch.value_moments) clear(moments);
  for (auto& gradients : batch.gradients)
    if (!gradients.empty()) clear(gradients);
}

}  // namespace

void MaterialEstimator::estimate(PointBatch& batch) {
  resize_material(batch, gradients_);
  const std::vector<NodePart>& parts = batch.estimate_parts;
  tbb::parallel_for(std::size_t{0}, parts.size(), [&](std::size_t p) {
    if (parts[p].continued)
      clear_material(parts[p], batch);
    else
      estimate_node(parts[p], batch);
  });
}

void MaterialEstimator::estimate_node(const NodePart& node, PointBatch& batch) {
  const auto in_node = [&](auto& items) { return std::span(items).subspan(node.begin, node.end - node.begin); };
  const std::span<const dvec3> positions = in_node(batch.positions);
  Box bounds = node_box(batch.keys[node.begin], cube_, node.depth);
  bounds = {glm::max(bounds.low, box_.low), glm::min(bounds.high, box_.high)};
  // Flat points get the node's thickness; the estimate cuts off what is out of proportion.
  for (int axis = 0; axis < 3; ++axis) {
    if (box_.high[axis] - box_.low[axis] > flat_share * cube_.edge) continue;
    const double middle = box_.low[axis] + (box_.high[axis] - box_.low[axis]) / 2,
                 half = node_edge(cube_, node.depth) / 2;
    bounds.low[axis] = middle - half, bounds.high[axis] = middle + half;
  }
  // Rounding may have put points a little outside.
  for (const dvec3& p : positions) bounds.include(p);
  std::vector<std::span<const double>> values;
  for (auto& of_attribute : batch.values) values.push_back(in_node(of_attribute));
  EstimatedMaterial result{in_node(batch.moments), {}, {}};
  for (auto& of_attribute : batch.value_moments) result.value_moments.push_back(in_node(of_attribute));
  for (auto& of_attribute : batch.gradients)
    if (gradients_) result.gradients.push_back(in_node(of_attribute));
  estimates_.local().estimate(positions, values, bounds, result);
}

}  // namespace splatvol
