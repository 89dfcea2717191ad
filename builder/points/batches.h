// Batches of whole cells from a stream of points.
#pragma once

#include <tbb/enumerable_thread_specific.h>

#include <cstdint>
#include <functional>
#include <utility>

#include "builder/points/point_batch.h"
#include "builder/points/point_stream.h"
#include "builder/scattered/box_estimate.h"

namespace splatvol {

/// Cuts a stream of points into the cells of the index's octree, and gives them out in batches.
class Batches {
 public:
  /// `cell_points`: most in a cell, at least 255, as far as leaves count; points of one key come in several parts where
  /// there are more. The stream must outlive this.
  Batches(PointStream& stream, std::uint64_t cell_points);

  /// Takes in all points that are left; `work` may then fill in their material.
  [[nodiscard]] Status hold_all(const std::function<Status(PointBatch&)>& work);

  /// Points in all; before the last is held, those that were sorted, some of which may be merged yet.
  [[nodiscard]] std::uint64_t count() const { return ended_ ? given_ + held_.size() - begin_ : stream_.count(); }

  /// From now on points come with the blocks in which `estimate` is to find their material.
  void estimate_material() { estimates_material_ = true; }

  /// From now on points come from `next`, with their material, and no longer from the stream, whose points and contract
  /// they have.
  void read_from(std::function<Result<bool>(PointBatch&)> next) { next_ = std::move(next); }

  /// The next points; none after the last. What `batch` held is gone, but its memory is used again.
  [[nodiscard]] Result<bool> next(PointBatch& batch);

  /// Fills in the material of a batch that has blocks. Thread-safe, also beside next().
  void estimate(PointBatch& batch);

 private:
  [[nodiscard]] Status fill(std::size_t points);
  [[nodiscard]] NodePart cell_at(std::size_t begin, std::size_t most) const;
  void take(std::size_t end, PointBatch& batch) const;

  PointStream& stream_;
  std::function<Result<bool>(PointBatch&)> next_;
  Box box_;    // round the points
  Cube cube_;  // of the octree
  std::size_t cell_points_;
  bool estimates_material_ = false;
  tbb::enumerable_thread_specific<BoxEstimate> estimates_;
  PointBatch held_;
  std::size_t begin_ = 0;  // of the points that have not been given out; the one before is held as well
  bool ended_ = false;
  std::uint64_t given_ = 0;   // points
  std::uint64_t leaves_ = 0;  // cells that have begun
};

}  // namespace splatvol
