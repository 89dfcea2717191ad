// The octree of indices over a reduced point set (spec/svol-1.md, section 6).
#pragma once

#include <cstdint>
#include <span>

#include "builder/material.h"
#include "builder/morton.h"
#include "builder/reduction.h"
#include "format/octree.h"
#include "format/volume_info.h"

namespace splatvol {

/// An attribute and its values as the file stores them, [point].
struct StoredAttribute {
  format::Attribute description;
  std::vector<float> values;
};

/// What the index is made from; in Morton order over all points, but for the spans over resolutions and attributes.
struct IndexInput {
  Cube cube;
  std::span<const MortonKey> keys;
  std::span<const dvec3> positions;
  std::span<const std::uint8_t> segments;
  std::span<const Resolution> resolutions;
  std::span<const Material> materials;  // [resolution]
  std::span<const StoredAttribute> attributes;
  std::span<const format::ValueBins> bins;  // [attribute]
};

/// Splits cells that hold more than `leaf_points` points, down to the finest cell. Nodes in depth-first order, two
/// arrays of size codes ("octant", "moments"), summaries over the points and their material. first_resolution is the
/// coarsest whose clusters all lie on one side of the node's border: the clusters of resolution r are the leaves of the
/// octree over resolution r + 1.
[[nodiscard]] format::NodeArrays build_index(const IndexInput& input, std::uint64_t leaf_points);

}  // namespace splatvol
