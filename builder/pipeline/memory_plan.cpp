#include "builder/pipeline/memory_plan.h"

#include <algorithm>

#include "builder/output/index_leaf_spool.h"
#include "builder/output/member.h"
#include "builder/output/splat_columns.h"
#include "builder/points/point_batch.h"
#include "format/columns.h"

namespace splatvol {
namespace {

constexpr std::size_t usual_batches = 8, usual_batch_points = 4096, least_batch_points = 64;

// Bytes of a point while its batch is reduced: in the batch, in a row and, for about half of the points, in a member
// with its splats at two levels.
std::size_t bytes_of_reduced_point(const BuildShape& shape) {
  return bytes_of_batch_point(shape.attributes, shape.gradients) +
         SplatColumns::bytes_of_splat(shape.attributes, shape.gradients) + Member::bytes_of(shape.attributes, 2) / 2;
}

// Points of batches that are cut, and points that wait to be cut. The vector of the latter may be twice as large as it
// must.
struct PointsInWork {
  std::size_t reduced, waiting;
};
PointsInWork points_in_work(const BatchShape& batches, std::size_t count) {
  const std::size_t most = batches.points + batches.node_points;
  return {count * most, 2 * (most + 512)};
}

std::uint64_t bytes_in_work(const BuildShape& shape, const BatchShape& batches, std::size_t count) {
  const PointsInWork points = points_in_work(batches, count);
  return points.reduced * bytes_of_reduced_point(shape) +
         points.waiting * bytes_of_batch_point(shape.attributes, shape.gradients);
}

std::uint64_t bytes_of_leaf(const BuildShape& shape) {
  constexpr std::size_t levels = 12;  // about
  return sizeof(OpenIndexLeaf) + levels * (sizeof(SplatBounds) + sizeof(std::uint64_t)) +
         shape.attributes * sizeof(format::ValueSummary);
}

}  // namespace

std::size_t bytes_of_batch_point(std::size_t attributes, bool gradients) {
  return sizeof(MortonKey) + sizeof(dvec3) + sizeof(SpatialMoments) + sizeof(BoundaryPlane) +
         attributes * (sizeof(double) + sizeof(ValueMoments) + (gradients ? sizeof(dvec3) : 0));
}

MemoryPlan plan_memory(std::uint64_t memory, const BuildShape& shape) {
  const std::size_t node_points =
      std::max<std::size_t>(shape.estimates ? estimate_node_points : 0, shape.index_leaf_points);
  const auto fits = [&](std::size_t points, std::size_t count) {
    return bytes_in_work(shape, {points, node_points}, count) <= memory / 8 * 3;
  };
  MemoryPlan plan{.batches = {usual_batch_points, node_points}, .most_batches = usual_batches};
  while (plan.batches.points > least_batch_points && !fits(plan.batches.points, plan.most_batches)) {
    // Small batches cost more time than few of them.
    if (plan.most_batches > 4)
      plan.most_batches /= 2;
    else
      plan.batches.points /= 2;
  }
  if (!fits(plan.batches.points, plan.most_batches)) plan.most_batches = 2;
  const std::uint64_t in_work = bytes_in_work(shape, plan.batches, plan.most_batches);
  plan.rows = memory > in_work ? std::min<std::uint64_t>(memory / 4, memory - in_work) : 0;
  plan.most_open_leaves = std::clamp<std::uint64_t>(memory / 16 / bytes_of_leaf(shape), 256, std::uint64_t{1} << 14);

  const std::uint64_t least_in_work = bytes_in_work(shape, {least_batch_points, node_points}, 2);
  plan.least = least_in_work + least_in_work / 2;
  return plan;
}

}  // namespace splatvol
