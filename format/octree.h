// The paged, index-only octree of a .svol file (spec/svol-1.md, section 6).
#pragma once

#include <bit>
#include <cmath>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "base/error.h"
#include "base/temp_file.h"
#include "format/codec.h"
#include "format/columns.h"
#include "format/layout.h"

namespace splatvol::format {

/// Sizes of a node's arrays, from the metadata.
struct NodeShape {
  std::size_t resolutions;  // R + 1
  std::size_t size_bounds;
  std::size_t attributes;
};

/// The bound that a size code states: edge 2^(2 - c/8), world units, and the exponent alone.
[[nodiscard]] inline double size_bound_exponent(std::uint8_t code) { return 2 - code / 8.0; }
[[nodiscard]] inline double size_bound(std::uint8_t code, double edge) {
  return edge * std::exp2(size_bound_exponent(code));
}

/// The size code of a splat: the largest c whose bound is not below `size`. Requires 0 <= size <= 4 edge.
[[nodiscard]] inline std::uint8_t size_code(double size, double edge) {
  const auto code = static_cast<std::uint8_t>(std::clamp(std::floor(8 * std::log2(4 * edge / size)), 0.0, 255.0));
  // The logarithm may be rounded up to the next code.
  return code > 0 && size_bound(code, edge) < size ? static_cast<std::uint8_t>(code - 1) : code;
}

/// Nodes in memory, as arrays over the nodes: of a page, in breadth-first order.
struct NodeArrays {
  NodeShape shape;
  std::vector<std::uint8_t> child_masks;
  std::vector<std::uint8_t> first_resolutions;
  std::vector<std::uint64_t> counts;     // [node][segment]
  std::vector<std::uint8_t> size_codes;  // [node][bound][resolution]; below first_resolution not stored, 0
  std::vector<ValueSummary> summaries;   // [node]: of the attribute that was asked for

  [[nodiscard]] std::size_t size() const { return child_masks.size(); }
  [[nodiscard]] std::span<const std::uint64_t> counts_of(std::size_t node) const {
    return std::span(counts).subspan(node * shape.resolutions, shape.resolutions);
  }
  [[nodiscard]] std::uint8_t size_code_at(std::size_t node, std::size_t bound, std::size_t resolution) const {
    return size_codes[(node * shape.size_bounds + bound) * shape.resolutions + resolution];
  }
};

/// A page as read: a forest in breadth-first order.
struct IndexPage {
  static constexpr std::uint32_t no_node = ~std::uint32_t{0};

  NodeArrays nodes;
  std::uint32_t top_nodes = 0;                // the first nodes: the forest's roots
  std::vector<std::uint32_t> first_children;  // [node]: no_node for leaves and where the children are in another page
  std::vector<std::uint32_t> links;           // [node]: index into `pages`, or no_node
  std::vector<IndexPageRef> pages;

  /// Bytes held, for budgets.
  [[nodiscard]] std::uint64_t memory_bytes() const;
};

/// A page ready to be written: its bytes and what a reference to it says (the offset is for the caller to fill in).
struct PackedIndexPage {
  IndexPageRef ref;
  Bytes bytes;
};

/// A whole index, ready to be written.
struct PackedIndex {
  NodeShape shape;
  PackedIndexPage root;
  TempFile pages;  // the others, in file order
};

/// What a node says of itself; which children it has follows from those that it gets.
struct NodeRecord {
  std::uint8_t first_resolution = 0;
  std::vector<std::uint64_t> counts;     // [segment]
  std::vector<std::uint8_t> size_codes;  // [bound][resolution]; below first_resolution not stored
  std::vector<ValueSummary> summaries;   // [attribute]
};

/// Cuts a tree into pages while it is walked depth first: begin_node where a node is entered, end_node where it is
/// left. Holds the path to the open node and what hangs on it that is in no page yet: some hundred nodes for each
/// level, however many the tree has. After a failure only destruction is allowed.
class IndexPacker {
 public:
  /// Gets the pages in file order: children's before their parents', offsets filled in from 0.
  using Emit = std::function<Status(const PackedIndexPage&)>;

  IndexPacker(NodeShape shape, Emit emit) : shape_(shape), emit_(std::move(emit)) {}

  /// Enters the root, whose octant means nothing, or a child of the node entered last and not left. Fails where octants
  /// do not rise from one child to the next, below max_node_depth, and behind the root.
  [[nodiscard]] Status begin_node(unsigned octant);

  /// Leaves the node. Fails where the record is of another shape, and with what `emit` fails.
  [[nodiscard]] Status end_node(NodeRecord record);

  /// The root page, which is not emitted and kept small. Requires that the root was left.
  [[nodiscard]] Result<PackedIndexPage> finish();

  /// Bytes held.
  [[nodiscard]] std::uint64_t memory_bytes() const;

 private:
  struct Node {
    NodeRecord record;
    std::uint8_t child_mask = 0;
    std::uint32_t weight = 1;          // of its subtree, the nodes that are in no page yet
    std::optional<IndexPageRef> link;  // where the children are that are no longer here
    std::vector<Node> children;
  };

  [[nodiscard]] Status page_out_children(Node& node, std::uint32_t target);
  [[nodiscard]] Status page_out(Node& node);
  [[nodiscard]] Result<PackedIndexPage> pack_page(std::vector<const Node*> order) const;
  void append_node(Bytes& block, const Node& node) const;

  NodeShape shape_;
  Emit emit_;
  std::uint64_t offset_ = 0;
  std::uint64_t held_nodes_ = 0;
  std::vector<Node> open_;  // from the root down
  std::optional<Node> root_;
};

/// Bytes at the start of a page that a reference's hash covers.
[[nodiscard]] constexpr std::uint64_t index_table_bytes(std::size_t attributes) {
  return 8 + sizeof(IndexBlock) * (1 + attributes);
}

/// Checks and unpacks a page without its attribute blocks. `front` holds the page's first ref.front_bytes bytes;
/// `expected_top_nodes` is the number of the linking node's children (1 for the root); the pages that this one links to
/// must end at or before `links_end` within their section. Safe on untrusted bytes: what it allocates is bounded by a
/// few MiB.
[[nodiscard]] Result<IndexPage> unpack_index_page(const IndexPageRef& ref, std::span<const std::byte> front,
                                                  NodeShape shape, std::uint32_t expected_top_nodes,
                                                  std::uint64_t links_end, std::string_view what);

/// An attribute's block, as the table of a page describes it.
struct SummaryBlock {
  std::uint64_t offset;  // from the start of the page
  IndexBlock block;
};

/// Finds an attribute's block. Requires a front that unpack_index_page accepted, and attribute < shape.attributes.
[[nodiscard]] SummaryBlock find_summary_block(std::span<const std::byte> front, std::size_t attribute, NodeShape shape);

/// Checks and unpacks an attribute's block into the page's summaries. Safe on untrusted bytes.
[[nodiscard]] Status unpack_summaries(const IndexBlock& block, std::span<const std::byte> packed, std::string_view what,
                                      IndexPage& page);

}  // namespace splatvol::format
