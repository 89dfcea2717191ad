// The index of a .svol file: an octree in pages, without the points (spec/svol-1.md, section 6).
#pragma once

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

inline constexpr std::uint64_t summary_bytes = 16;  // of a node, in an attribute's part: min, max and occupancy

/// Lengths of a node's arrays, from the metadata.
struct NodeShape {
  std::size_t resolutions;  // R + 1
  std::size_t size_bounds;
  std::size_t attributes;
};

/// Return the bound that a size code states, edge 2^(2 - c/8) in world units, and its exponent alone.
[[nodiscard]] inline double size_bound_exponent(std::uint8_t code) { return 2 - code / 8.0; }
[[nodiscard]] inline double size_bound(std::uint8_t code, double edge) {
  return edge * std::exp2(size_bound_exponent(code));
}

/// Returns the size code of a splat: the largest c whose bound is not below `size`. Requires 0 <= size <= 4 edge.
[[nodiscard]] inline std::uint8_t size_code(double size, double edge) {
  const auto code = static_cast<std::uint8_t>(std::clamp(std::floor(8 * std::log2(4 * edge / size)), 0.0, 255.0));
  // Rounding of the logarithm may have given the next larger code.
  return code > 0 && size_bound(code, edge) < size ? static_cast<std::uint8_t>(code - 1) : code;
}

/// The attributes of which the summaries of nodes are read; -1: none.
struct SummaryAttributes {
  int values = -1;
  int opacity = -1;
};

/// Nodes in memory, as arrays over the nodes. Those of a page are in breadth-first order.
struct NodeArrays {
  NodeShape shape;
  std::vector<std::uint8_t> child_masks;
  std::vector<std::uint8_t> first_resolutions;
  std::vector<std::uint64_t> counts;            // [node][segment]
  std::vector<std::uint8_t> size_codes;         // [node][bound][resolution]; below first_resolution not stored, 0
  std::vector<ValueSummary> summaries;          // [node]: of the attribute that was read
  std::vector<ValueSummary> opacity_summaries;  // [node]: of SummaryAttributes::opacity; empty: none

  [[nodiscard]] std::size_t size() const { return child_masks.size(); }
  [[nodiscard]] std::span<const std::uint64_t> counts_of(std::size_t node) const {
    return std::span(counts).subspan(node * shape.resolutions, shape.resolutions);
  }
  [[nodiscard]] std::uint8_t size_code_at(std::size_t node, std::size_t bound, std::size_t resolution) const {
    return size_codes[(node * shape.size_bounds + bound) * shape.resolutions + resolution];
  }
};

/// A page that was read: a forest in breadth-first order.
struct IndexPage {
  static constexpr std::uint32_t no_node = ~std::uint32_t{0};

  NodeArrays nodes;
  std::uint32_t top_nodes = 0;                // number of roots, which come first
  std::uint32_t number = 0;                   // of the page, in a series; the root page comes last
  std::vector<std::uint32_t> first_children;  // [node]: no_node if it is a leaf, or its children are in another page
  std::vector<std::uint32_t> links;           // [node]: index into `pages`, or no_node
  std::vector<IndexPageRef> pages;

  /// Bytes held, for budgets.
  [[nodiscard]] std::uint64_t memory_bytes() const;
};

/// A page ready to be written, with the reference to it. The caller fills in the offset of the reference.
struct PackedIndexPage {
  IndexPageRef ref;
  Bytes bytes;
};

/// A whole index, ready to be written.
struct PackedIndex {
  NodeShape shape;
  PackedIndexPage root;
  TempFile pages;  // the other pages, in file order
};

/// The summaries of a page's nodes, apart from the page: [attribute][node].
using PageSummaries = std::vector<std::vector<ValueSummary>>;

/// The data of a node, without its children.
struct NodeRecord {
  std::uint8_t first_resolution = 0;
  std::vector<std::uint64_t> counts;     // [segment]
  std::vector<std::uint8_t> size_codes;  // [bound][resolution]; below first_resolution not stored
  std::vector<ValueSummary> summaries;   // [attribute]
};

/// Cuts a tree into pages during a depth-first walk, which calls begin_node when it enters a node and end_node when it
/// leaves the node. Holds the path to the open node and the finished nodes below this path that are in no page yet:
/// some hundred nodes for each depth, however many the tree has. After a failure only destruction is allowed.
class IndexPacker {
 public:
  /// Receives the pages in file order: those of children before those of their parents. Offsets begin at 0.
  using Emit = std::function<Status(const PackedIndexPage&)>;

  /// Receives the summaries of a page's nodes: of each page after it was emitted, and last of the root page.
  using EmitSummaries = std::function<Status(const PageSummaries&)>;

  /// With `emit_summaries` makes the pages of a series: they have a number and no summaries, which `emit_summaries`
  /// gets instead. How the tree is cut does not depend on the number of attributes.
  IndexPacker(NodeShape shape, Emit emit, EmitSummaries emit_summaries = {})
      : shape_(shape), emit_(std::move(emit)), emit_summaries_(std::move(emit_summaries)) {}

  /// Enters the root, or a child of the node that was entered last and not left. Ignores the octant of the root. Fails
  /// if the octants of children do not rise, if the node is deeper than max_node_depth, or if the root was left.
  [[nodiscard]] Status begin_node(unsigned octant);

  /// Leaves the node. Fails if the record is of another shape, or if `emit` fails.
  [[nodiscard]] Status end_node(NodeRecord record);

  /// Returns the root page, which is not emitted and kept small. Requires that the root was left.
  [[nodiscard]] Result<PackedIndexPage> finish();

  /// Bytes held.
  [[nodiscard]] std::uint64_t memory_bytes() const;

 private:
  struct Node {
    NodeRecord record;
    std::uint8_t child_mask = 0;
    std::uint32_t weight = 1;          // nodes of its subtree that are in no page yet
    std::optional<IndexPageRef> link;  // to the page of the children, once they are in one
    std::vector<Node> children;
  };

  [[nodiscard]] Status page_out_children(Node& node, std::uint32_t target);
  [[nodiscard]] Status page_out(Node& node);
  [[nodiscard]] std::vector<const Node*> order_forest(std::vector<const Node*> roots) const;
  [[nodiscard]] Result<PackedIndexPage> pack_page(const std::vector<const Node*>& order) const;
  [[nodiscard]] Status emit_page_summaries(const std::vector<const Node*>& order) const;
  [[nodiscard]] NodeShape page_shape() const;
  void append_node(Bytes& structure, const Node& node) const;

  NodeShape shape_;
  Emit emit_;
  EmitSummaries emit_summaries_;  // empty unless the pages are those of a series
  std::uint32_t pages_ = 0;       // emitted
  std::uint64_t offset_ = 0;
  std::uint64_t held_nodes_ = 0;
  std::vector<Node> open_;  // from the root down
  std::optional<Node> root_;
};

/// Returns how many bytes at the start of a page the hash of its reference covers.
[[nodiscard]] constexpr std::uint64_t index_table_bytes(std::size_t attributes) {
  return 8 + sizeof(IndexPagePart) * (1 + attributes);
}

/// Checks and unpacks a page without its attribute parts. `front` holds the first ref.front_bytes bytes of the page.
/// `expected_top_nodes` is the number of the linking node's children (1 for the root). Fails if a page that this page
/// links to ends behind `links_end` within their section. Safe on untrusted bytes: allocates at most a few MiB.
[[nodiscard]] Result<IndexPage> unpack_index_page(const IndexPageRef& ref, std::span<const std::byte> front,
                                                  NodeShape shape, std::uint32_t expected_top_nodes,
                                                  std::uint64_t links_end, std::string_view what);

/// The page part that holds the summaries of an attribute.
struct SummaryPart {
  std::uint64_t offset;  // from the start of the page
  IndexPagePart part;
};

/// Packs a part of a page: appends what the part table has of it, and its bytes.
void append_part(Bytes& table, Bytes& parts, std::span<const std::byte> raw);

/// Return the summaries of nodes as they are in a part, and undo it. The second fails if the part holds another number
/// of nodes. Safe on untrusted bytes.
[[nodiscard]] Bytes pack_summaries(std::span<const ValueSummary> summaries);
[[nodiscard]] Result<std::vector<ValueSummary>> unpack_summaries(const IndexPagePart& part,
                                                                 std::span<const std::byte> packed, std::size_t nodes,
                                                                 std::string_view what);

/// Finds the part of an attribute. Requires a front that unpack_index_page accepted, and attribute < shape.attributes.
[[nodiscard]] SummaryPart find_summary_part(std::span<const std::byte> front, std::size_t attribute, NodeShape shape);

}  // namespace splatvol::format
