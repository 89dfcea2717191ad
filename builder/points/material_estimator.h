// The material of scattered points by boxes: BoxEstimate.
#pragma once

#include <tbb/enumerable_thread_specific.h>

#include "base/math.h"
#include "builder/points/point_batch.h"
#include "builder/scattered/box_estimate.h"

namespace splatvol {

/// Estimates the material of a batch's points, estimate node by estimate node.
class MaterialEstimator {
 public:
  /// `box`: round all points. `cube`: the octree's root.
  /// `gradients`: whether to find them.
  MaterialEstimator(const Box& box, const Cube& cube, bool gradients = true)
      : box_(box), cube_(cube), gradients_(gradients) {}

  /// Replaces the material of a batch. Thread-safe.
  void estimate(PointBatch& batch);

 private:
  void estimate_node(const NodePart& node, PointBatch& batch);

  Box box_;
  Cube cube_;
  bool gradients_;
  tbb::enumerable_thread_specific<BoxEstimate> estimates_;
};

}  // namespace splatvol
