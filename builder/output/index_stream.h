// The octree of indices over the points (spec/svol-1.md, section 6), made leaf by leaf.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "builder/output/splat_rows.h"
#include "builder/sorting/morton.h"
#include "format/octree.h"

namespace splatvol {

/// What a cell says of the splats of one resolution whose points lie in it. Splats, and the cells that make up a larger
/// one, may be added in any order.
struct SplatBounds {
  std::uint8_t least_depth = 255;  // of the blocks that the clusters of the next coarser one stay in; 255: no splat
  std::uint8_t octant_code = 255;  // size code of the largest octant splat
  double width = 0;                // of the widest moments splat
  Box box;                         // round all moments splats

  /// Adds a splat, of both kernels; `moments` are what it was made from. `depth` and `count` as in SplatRow.
  void include(const dvec3& centroid, const format::SplatShape& shape, const SpatialMoments& moments, int depth,
               std::size_t count);
  void include(const SplatRow& splat, const SpatialMoments& moments) {
    include(splat.centroid, splat.shape, moments, splat.depth, splat.count);
  }

  void include(const SplatBounds& other);
};

/// A leaf of the index, ready to be taken in.
struct IndexLeaf {
  MortonKey key;  // of any place in it
  int depth = 0;
  std::vector<std::uint64_t> counts;            // [segment]: points
  std::vector<SplatBounds> splats;              // [resolution]
  std::vector<format::ValueSummary> summaries;  // [attribute]: of the points and their material
};

/// Grows the index over its leaves, given in Morton order. A node's first_resolution is the coarsest whose clusters all
/// lie on one side of its border: they stay within blocks, leaves of an octree over resolution r + 1 (Reduction).
/// Holds the path to the last leaf and what IndexPacker does. After a failure only destruction is allowed.
class IndexStream {
 public:
  /// As many segments as resolutions; two arrays of size codes ("octant", "moments").
  [[nodiscard]] static format::NodeShape shape(std::size_t resolutions, std::size_t attributes) {
    return {resolutions, 2, attributes};
  }

  /// `emit` as for IndexPacker.
  IndexStream(const Cube& cube, std::size_t resolutions, std::size_t attributes, format::IndexPacker::Emit emit)
      : cube_(cube), shape_(shape(resolutions, attributes)), packer_(shape_, std::move(emit)) {}

  /// Fails where the leaf is of another shape, or does not lie behind the last one, and with what `emit` fails.
  [[nodiscard]] Status add(IndexLeaf leaf);

  /// The root page. Requires a leaf.
  [[nodiscard]] Result<format::PackedIndexPage> finish();

 private:
  [[nodiscard]] Status close_node();

  Cube cube_;
  format::NodeShape shape_;
  format::IndexPacker packer_;
  std::vector<IndexLeaf> open_;  // [depth]: the path to the last leaf, with what was closed below
};

}  // namespace splatvol
