// The finest level of the reduction, batch by batch: what takes most of a build's time, and needs no order.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "builder/output/index_leaf_spool.h"
#include "builder/output/index_stream.h"
#include "builder/points/point_batch.h"
#include "builder/reduction/cascade.h"
#include "builder/reduction/clusters.h"
#include "format/codec.h"
#include "format/volume_writer.h"

namespace splatvol {

/// What a batch comes to.
struct ReducedBatch {
  struct Cell {
    OpenIndexLeaf leaf;
    std::size_t members_end;  // where those of the next cell begin
  };
  struct Leaf {
    std::size_t end;  // where the points of the next one begin
    int depth;
  };
  std::vector<Leaf> leaves;                 // of the octree over the points
  std::vector<std::uint32_t> owners;        // [point]: the one that it goes with; empty where each leaf keeps one
  std::uint64_t first_finest = 0;           // number of the first point that no coarser resolution has
  std::vector<SplatRow> splats;             // of all points, where they are wanted
  SplatRows finest;                         // points that no coarser resolution has: up to where a chunk ends,
  std::vector<format::Bytes> packed;        // whole chunks behind them,
  SplatRows tail;                           // and the rest; all in the first where nothing is to be packed
  std::vector<MemberPool::Handle> members;  // the others, their second splat made; of a cell that is continued one
                                            // with the material of that part, whose points are all finest
  std::vector<Cell> cells;
  format::Histograms histograms;       // of all points
  std::vector<std::uint64_t> missing;  // [attribute]

  explicit ReducedBatch(std::size_t attributes)
      : finest(attributes), tail(attributes), histograms(attributes), missing(attributes) {}

  /// Keeps the memory.
  void clear();
};

struct ReductionSettings {
  Cube cube;
  std::uint32_t leaf_points;  // most in a leaf, from 8 up
  bool reduces;               // false: all points stay
  bool wants_splats;          // in ReducedBatch
  std::span<const format::Attribute> attributes;
  std::span<const double> offsets;  // of the attributes

  // Packs a chunk of the finest rows; none: they are not to be packed.
  std::function<format::Bytes(const SplatRows&)> pack = nullptr;
  std::size_t points_per_chunk = 0;
  Reduction method = Reduction::octree;
};

/// Finds the leaves of the octree over a batch's points, and their clusters; returns how many of these no coarser
/// resolution has.
std::uint64_t find_leaves(const PointBatch& batch, const ReductionSettings& settings, ReducedBatch& result);

/// Reduces the cells of a batch, whose leaves and clusters are found. Thread-safe.
void reduce_batch(const PointBatch& batch, const ReductionSettings& settings, MemberPool& pool, ReducedBatch& result);

}  // namespace splatvol
