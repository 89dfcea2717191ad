// The finest step of the reduction, batch by batch: what takes most of a build's time, and needs no order.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "builder/cascade.h"
#include "builder/clusters.h"
#include "builder/index_stream.h"
#include "format/codec.h"
#include "format/volume_writer.h"

namespace splatvol {

/// A cell of the index's octree: a leaf, or a part of one that has more points than can be held at once, all of one
/// key.
struct PointCell {
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
  std::vector<PointCell> cells;
  std::vector<PointCell> blocks;        // of cells, where material is to be estimated; else none
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

/// A leaf of the index while it is filled: counts and splats by steps from the finest resolution on, as far as there
/// are any.
struct OpenLeaf {
  MortonKey key;  // of any point in it
  int depth = 0;
  std::vector<std::uint64_t> counts;            // [step]: points that no coarser resolution has
  std::vector<SplatBounds> splats;              // [step]
  std::vector<format::ValueSummary> summaries;  // [attribute]

  [[nodiscard]] SplatBounds& splats_at(std::size_t step);
  void count(std::size_t step, std::uint64_t points = 1);
  void include(const OpenLeaf& other);       // another part of it
  void include_late(const OpenLeaf& other);  // counts and splats only
};

/// What a batch comes to.
struct ReducedBatch {
  struct Cell {
    OpenLeaf leaf;
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
void reduce_cells(const PointBatch& batch, const ReductionSettings& settings, MemberPool& pool, ReducedBatch& result);

}  // namespace splatvol
