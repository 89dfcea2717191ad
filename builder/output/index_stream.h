// The index over the points (spec/svol-1.md, section 6), made leaf by leaf.
#pragma once

#include <cstdint>
#include <vector>

#include "builder/output/stored_splat.h"
#include "builder/sorting/morton.h"
#include "format/octree.h"

namespace splatvol {

/// Bounds of a node's splats at one resolution: those whose points lie in the node. Splats, and the nodes that a larger
/// node consists of, may be added in any order.
struct SplatBounds {
  std::uint8_t least_depth = 255;  // of the reduction nodes that hold the points; 255: no splat
  std::uint8_t octant_code = 255;  // size code of the largest octant splat
  double width = 0;                // of the widest `moments` splat
  Box box;                         // round all `moments` splats

  /// Adds a splat, of both kernels; it was made from `moments`. `depth` and `count` as in StoredSplat.
  void include(const dvec3& centroid, const SplatShape& shape, const SpatialMoments& moments, int depth,
               std::size_t count);
  void include(const StoredSplat& splat, const SpatialMoments& moments) {
    include(splat.centroid, splat.shape, moments, splat.depth, splat.count);
  }

  void include(const SplatBounds& other);
};

struct IndexLeaf {
  MortonKey key;  // of any position in the leaf
  int depth = 0;
  std::vector<std::uint64_t> counts;            // [segment]: points
  std::vector<SplatBounds> splats;              // [resolution]
  std::vector<format::ValueSummary> summaries;  // [attribute]: of the points and their material
};

/// Grows the index over its leaves, which come in Morton order. A node's first_resolution is the coarsest resolution r
/// at which no cluster crosses the node's border. Clusters stay within reduction nodes, which are leaves of an
/// octree over resolution r + 1 (Reduction). Holds the path to the last leaf and what IndexPacker holds. After a
/// failure only destruction is allowed.
class IndexStream {
 public:
  /// Nodes have as many segments as resolutions, and two arrays of size codes ("octant", "moments").
  [[nodiscard]] static format::NodeShape shape(std::size_t resolutions, std::size_t attributes) {
    return {resolutions, 2, attributes};
  }

  /// `emit` as for IndexPacker.
  IndexStream(const Cube& cube, std::size_t resolutions, std::size_t attributes, format::IndexPacker::Emit emit)
      : cube_(cube), shape_(shape(resolutions, attributes)), packer_(shape_, std::move(emit)) {}

  /// For a time series; `emit_summaries` as for IndexPacker.
  IndexStream(const Cube& cube, std::size_t resolutions, std::size_t attributes, format::IndexPacker::Emit emit,
              format::IndexPacker::EmitSummaries emit_summaries)
      : cube_(cube),
        shape_(shape(resolutions, attributes)),
        packer_(shape_, std::move(emit), std::move(emit_summaries)) {}

  /// Fails if the leaf has another shape or does not follow the last one, or if `emit` fails.
  [[nodiscard]] Status add(IndexLeaf leaf);

  /// Returns the root page. Requires a leaf.
  [[nodiscard]] Result<format::PackedIndexPage> finish();

 private:
  [[nodiscard]] Status close_node();

  Cube cube_;
  format::NodeShape shape_;
  format::IndexPacker packer_;
  std::vector<IndexLeaf> open_;  // [depth]: the path to the last leaf, with what was closed below
};

}  // namespace splatvol
