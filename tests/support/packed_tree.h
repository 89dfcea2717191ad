// Packs a whole index from arrays of nodes, and reads it back, for tests.
#pragma once

#include <span>

#include "base/error.h"
#include "format/octree.h"
#include "format/volume.h"

namespace splatvol::test {

/// A tree as arrays over its nodes in depth-first order, children in octant order; summaries are [node][attribute].
using Tree = format::NodeArrays;

/// Packs a tree. Fails if the arrays are not a tree, or the tree is deeper than format::max_node_depth.
[[nodiscard]] Result<format::PackedIndexPage> pack_tree(const Tree& tree, format::IndexPacker::Emit emit);
[[nodiscard]] Result<format::PackedIndex> pack_tree(const Tree& tree);

/// Unpacks a tree as a reader of the file does. Size codes below first_resolution are 0.
[[nodiscard]] Result<Tree> read_tree(const format::PackedIndexPage& root, std::span<const std::byte> pages,
                                     format::NodeShape shape);
[[nodiscard]] Result<Tree> read_tree(const format::PackedIndex& index);

/// Reads the tree of a file, with the summaries of one attribute: [node].
[[nodiscard]] Result<Tree> read_tree(const format::Volume& volume, int attribute);

}  // namespace splatvol::test
