// The reduction on several threads.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>

#include "base/error.h"
#include "builder/output/row_collector.h"
#include "builder/output/row_files.h"
#include "builder/output/row_packer.h"
#include "builder/points/batch_cutter.h"
#include "builder/points/material_estimator.h"
#include "builder/reduction/reduction_pass.h"

namespace splatvol {

/// The stages of a reduction, from points to packed rows.
struct ReductionStages {
  BatchCutter& batches;
  MaterialEstimator* estimator;  // null: the points have their material
  ReductionPass& pass;
  RowCollector& rows;
  const RowPacker& packer;
  RowFiles& files;
};

/// Runs all batches through the stages, and finishes the pass; rows that are not complete stay in `rows`. Batches are
/// cut, added and written in order. The work between does not depend on order, and several batches are worked on at a
/// time, at most `most_batches`. `progress` gets the number of points that are done.
[[nodiscard]] Status run_reduction(const ReductionStages& stages, std::size_t attributes,
                                   const std::function<void(std::uint64_t points)>& progress,
                                   std::size_t most_batches = 8);

}  // namespace splatvol
