// The finest level of the reduction, batch by batch: it takes most of a build's time, and batches need no order.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "builder/output/index_leaf_spool.h"
#include "builder/output/index_stream.h"
#include "builder/output/row_packer.h"
#include "builder/output/splat_columns.h"
#include "builder/points/point_batch.h"
#include "builder/reduction/cascade.h"
#include "builder/reduction/clusters.h"
#include "format/codec.h"

namespace splatvol {

/// A batch after the reduction of its finest level. A point is *finest* if no coarser level has it. Every point of a
/// leaf part that is continued is finest, and the leaf part has one member besides, with the material of all its
/// points.
struct ReducedBatch {
  struct LeafPart {
    OpenIndexLeaf leaf;
    std::size_t members_end;  // where the members of the next part begin
  };
  struct Leaf {
    std::size_t end;  // where the points of the next leaf begin
    int depth;
  };
  std::vector<Leaf> leaves;           // of the octree over the points
  std::vector<std::uint32_t> owners;  // [point]: the one that it goes with; empty if each leaf keeps one point
  std::uint64_t first_finest = 0;     // number of the first finest point

  // The finest points: up to the end of a row, then whole rows, then the rest; all are the rest if none are packed.
  SplatColumns finest;
  std::vector<PackedRow> packed;
  SplatColumns tail;

  Members members;                   // points that coarser levels have, with their splats at levels 0 and 1
  std::vector<LeafPart> leaf_parts;  // as in PointBatch

  explicit ReducedBatch(std::size_t attributes) : finest(attributes), tail(attributes), members(attributes, 2) {}

  /// Keeps the memory.
  void clear();
};

/// Gets each point of a level besides level 0 that no coarser level has, by its rank: the number among all points in
/// Morton order. Ranks ascend in a level.
using WatchStays = std::function<Status(std::size_t level, std::uint64_t rank)>;

struct ReductionSettings {
  Cube cube;
  std::uint32_t leaf_points;  // most in a leaf, from 8 up
  bool reduces;               // false: all points are finest
  std::span<const format::Attribute> attributes;

  const RowPacker* packer = nullptr;  // packs whole rows of finest points; null: they are not packed
  std::size_t points_per_chunk = 0;
  Reduction method = Reduction::octree;

  // If the points are a range of all points.
  CascadePart part = {};
  std::function<void(const Member&)> beyond = {};  // Cascade::Sink::beyond
  std::uint64_t finest_before = 0;                 // finest points before the range

  WatchStays stays = {};  // may be empty
};

/// Finds the leaves of the octree over a batch's points, and their clusters. Returns the number of finest points.
std::uint64_t find_leaves(const PointBatch& batch, const ReductionSettings& settings, ReducedBatch& result);

/// Reduces the leaf parts of a batch. Requires find_leaves(). Thread-safe.
void reduce_batch(const PointBatch& batch, const ReductionSettings& settings, ReducedBatch& result);

}  // namespace splatvol
