// Shares of the memory that a build may hold.
#pragma once

#include <cstddef>
#include <cstdint>

#include "builder/points/batch_cutter.h"

namespace splatvol {

/// The numbers on which the bytes of a build depend, besides its memory.
struct BuildShape {
  std::size_t attributes = 0;
  bool gradients = false;
  bool estimates = false;                 // material, by estimate nodes
  std::uint64_t index_leaf_points = 512;  // most in an index leaf
};

/// Bytes for each part of a reduction. The result of a build does not depend on them.
struct MemoryPlan {
  BatchShape batches;
  std::size_t most_batches = 0;        // in work at a time
  std::size_t rows = 0;                // bytes of rows that are not complete, or wait
  std::uint64_t most_open_leaves = 0;  // of the index
  std::uint64_t least = 0;             // a build of this shape holds so many bytes, even if it is granted fewer
};

/// Bytes of a point in PointBatch.
[[nodiscard]] std::size_t bytes_of_batch_point(std::size_t attributes, bool gradients);

/// Plans the reduction of a build that may hold `memory` bytes. Sorted points take up to 3/16 of them besides.
[[nodiscard]] MemoryPlan plan_memory(std::uint64_t memory, const BuildShape& shape);

}  // namespace splatvol
