#include "format/octree.h"

#include <algorithm>
#include <limits>

namespace splatvol::format {
namespace {

// Enough nodes that a page is worth a read, few enough that most of them are used.
constexpr std::uint32_t target_page_nodes = 256;

// The root page shares the preamble with the first points, however many attributes there are.
constexpr std::uint64_t target_root_bytes = 16u << 10;

std::uint32_t target_root_nodes(const NodeShape& shape) {
  const std::uint64_t node_bytes = 32 + summary_bytes * shape.attributes;
  return static_cast<std::uint32_t>(std::min<std::uint64_t>(target_page_nodes, target_root_bytes / node_bytes));
}

void append_varint(Bytes& bytes, std::uint64_t number) {
  for (; number >= 0x80; number >>= 7) bytes.push_back(static_cast<std::byte>(number | 0x80));
  bytes.push_back(static_cast<std::byte>(number));
}

// Reads a structure part front to back. After a read past the end, returns zeros, and `ok` is false.
class StructureReader {
 public:
  explicit StructureReader(std::span<const std::byte> bytes) : bytes_(bytes) {}

  std::uint8_t byte() {
    if (at_ >= bytes_.size()) return ok_ = false, std::uint8_t{0};
    return static_cast<std::uint8_t>(bytes_[at_++]);
  }
  std::uint64_t varint() {
    std::uint64_t number = 0;
    for (int shift = 0; shift < 64; shift += 7) {
      const std::uint8_t next = byte();
      if (shift == 63 && next > 1) ok_ = false;
      number |= static_cast<std::uint64_t>(next & 0x7F) << shift;
      if (next < 0x80) return number;
    }
    ok_ = false;
    return 0;
  }
  IndexPageRef link() {
    if (bytes_.size() - at_ < sizeof(IndexPageRef)) return ok_ = false, IndexPageRef{};
    at_ += sizeof(IndexPageRef);
    return read_record<IndexPageRef>(bytes_, at_ - sizeof(IndexPageRef));
  }
  bool ok() const { return ok_; }
  bool at_end() const { return at_ == bytes_.size(); }

 private:
  std::span<const std::byte> bytes_;
  std::size_t at_ = 0;
  bool ok_ = true;
};

// Returns the most bytes that the structure of a node can have.
std::uint64_t max_structure_bytes(const NodeShape& shape) {
  return 3 + (10 + shape.size_bounds) * shape.resolutions + sizeof(IndexPageRef);
}

IndexPagePart part_at(std::span<const std::byte> front, std::size_t index) {
  return read_record<IndexPagePart>(front, 8 + index * sizeof(IndexPagePart));
}

Status check_table(const IndexPageRef& ref, std::span<const std::byte> front, const NodeShape& shape,
                   std::string_view what) {
  const auto table_bytes = static_cast<std::size_t>(index_table_bytes(shape.attributes));
  if (front.size() != ref.front_bytes || front.size() < table_bytes || hash_bytes(front.first(table_bytes)) != ref.hash)
    return fail(ErrorCode::invalid_data, "{}: checksum mismatch", what);
  const auto nodes = read_record<std::uint32_t>(front, 0);
  if (nodes < 1 || nodes > max_page_nodes) return fail(ErrorCode::invalid_data, "{}: {} nodes [R13]", what, nodes);

  std::uint64_t end = table_bytes;
  for (std::size_t p = 0; p <= shape.attributes; ++p) {
    const IndexPagePart part = part_at(front, p);
    const bool possible = p == 0 ? part.unpacked_bytes <= nodes * max_structure_bytes(shape)
                                 : part.unpacked_bytes == nodes * summary_bytes;
    if (!possible || part.packed_bytes > part.unpacked_bytes)
      return fail(ErrorCode::invalid_data, "{}: a part has the wrong length [R13]", what);
    if (end > ref.page_bytes || part.packed_bytes > ref.page_bytes - end)
      return fail(ErrorCode::invalid_data, "{}: a part passes the end [R15]", what);
    end += part.packed_bytes;
    if (p == 0 && end != ref.front_bytes)
      return fail(ErrorCode::invalid_data, "{}: wrong length of the structure [R15]", what);
  }
  if (end != ref.page_bytes) return fail(ErrorCode::invalid_data, "{}: bytes left over [R15]", what);
  return {};
}

Status read_node(StructureReader& reader, std::uint64_t links_end, std::string_view what, IndexPage& page) {
  NodeArrays& nodes = page.nodes;
  const NodeShape shape = nodes.shape;
  const std::size_t node = nodes.size();
  const std::uint8_t mask = reader.byte();
  const std::uint8_t flags = reader.byte();
  const std::uint8_t first = reader.byte();
  if (!reader.ok() || flags > 1 || (flags == 1 && mask == 0) || first >= shape.resolutions)
    return fail(ErrorCode::invalid_data, "{}: node {} is out of range [R13]", what, node);
  nodes.child_masks.push_back(mask);
  nodes.first_resolutions.push_back(first);
  std::uint64_t all = 0;
  for (std::size_t s = 0; s < shape.resolutions; ++s) {
    nodes.counts.push_back(reader.varint());
    all |= nodes.counts.back();
    if (nodes.counts.back() >> 48 != 0)
      return fail(ErrorCode::invalid_data, "{}: node {} has too many points [R14]", what, node);
  }
  if (all == 0) return fail(ErrorCode::invalid_data, "{}: node {} is empty [R14]", what, node);
  for (std::size_t bound = 0; bound < shape.size_bounds; ++bound)
    for (std::size_t r = 0; r < shape.resolutions; ++r)
      nodes.size_codes.push_back(r < first ? std::uint8_t{0} : reader.byte());
  page.links.push_back(IndexPage::no_node);
  if (flags == 0) return {};
  page.links.back() = static_cast<std::uint32_t>(page.pages.size());
  const IndexPageRef ref = reader.link();
  if (ref.offset > links_end || ref.page_bytes > links_end - ref.offset)
    return fail(ErrorCode::invalid_data, "{}: node {} links to no page before this one [R16]", what, node);
  if (ref.front_bytes > ref.page_bytes || ref.front_bytes < index_table_bytes(shape.attributes) ||
      ref.front_bytes - index_table_bytes(shape.attributes) > max_page_nodes * max_structure_bytes(shape))
    return fail(ErrorCode::invalid_data, "{}: node {} links to a page of the wrong length [R15]", what, node);
  page.pages.push_back(ref);
  return {};
}

Status read_nodes(std::span<const std::byte> structure, std::uint32_t node_count, std::uint64_t links_end,
                  std::string_view what, IndexPage& page) {
  StructureReader reader(structure);
  NodeArrays& nodes = page.nodes;
  const NodeShape shape = nodes.shape;
  if (structure.size() < node_count * (3 + shape.resolutions))
    return fail(ErrorCode::invalid_data, "{}: wrong length of the nodes [R13]", what);
  nodes.counts.reserve(node_count * shape.resolutions);
  nodes.size_codes.reserve(node_count * shape.resolutions * shape.size_bounds);
  for (std::uint32_t node = 0; node < node_count; ++node) SPLATVOL_TRY(read_node(reader, links_end, what, page));
  if (!reader.ok() || !reader.at_end())
    return fail(ErrorCode::invalid_data, "{}: wrong length of the nodes [R13]", what);
  return {};
}

// Finds the children of each node, which follow in breadth-first order, so the masks tell where. Checks that their
// counts add up to those of their parent.
Status connect_children(IndexPage& page, std::string_view what) {
  const NodeArrays& nodes = page.nodes;
  std::uint64_t next = page.top_nodes;
  std::vector<std::uint8_t> depths(nodes.size(), 0);
  for (std::size_t node = 0; node < nodes.size(); ++node) {
    const auto children = static_cast<std::uint64_t>(std::popcount(nodes.child_masks[node]));
    if (children == 0 || page.links[node] != IndexPage::no_node) {
      page.first_children.push_back(IndexPage::no_node);
      continue;
    }
    if (children > nodes.size() - std::min<std::uint64_t>(next, nodes.size()))
      return fail(ErrorCode::invalid_data, "{}: node {} lacks children [R13]", what, node);
    if (next <= node || depths[node] >= max_node_depth)
      return fail(ErrorCode::invalid_data, "{}: node {} is its own child, or too deep [R13]", what, node);
    page.first_children.push_back(static_cast<std::uint32_t>(next));
    std::fill_n(depths.begin() + static_cast<std::ptrdiff_t>(next), children,
                static_cast<std::uint8_t>(depths[node] + 1));
    for (std::size_t s = 0; s < nodes.shape.resolutions; ++s) {
      std::uint64_t sum = 0;
      for (std::uint64_t child = next; child < next + children; ++child)
        sum += nodes.counts_of(static_cast<std::size_t>(child))[s];
      if (sum != nodes.counts_of(node)[s])
        return fail(ErrorCode::invalid_data, "{}: the children of node {} do not add up [R14]", what, node);
    }
    next += children;
  }
  if (next != nodes.size()) return fail(ErrorCode::invalid_data, "{}: nodes without a parent [R13]", what);
  return {};
}

}  // namespace

std::uint64_t IndexPage::memory_bytes() const {
  return sizeof(IndexPage) + nodes.size() * (2 + 2 * sizeof(std::uint32_t)) +
         nodes.counts.size() * sizeof(std::uint64_t) + nodes.size_codes.size() +
         (nodes.summaries.size() + nodes.opacity_summaries.size()) * sizeof(ValueSummary) +
         pages.size() * sizeof(IndexPageRef);
}

Status IndexPacker::begin_node(unsigned octant) {
  if (root_) return fail(ErrorCode::invalid_argument, "index: nodes without a parent");
  if (open_.size() > max_node_depth) return fail(ErrorCode::invalid_argument, "index: deeper than {}", max_node_depth);
  if (!open_.empty()) {
    std::uint8_t& mask = open_.back().child_mask;
    if (octant > 7 || mask >> octant != 0) return fail(ErrorCode::invalid_argument, "index: children out of order");
    mask = static_cast<std::uint8_t>(mask | 1u << octant);
  }
  open_.emplace_back();
  ++held_nodes_;
  return {};
}

Status IndexPacker::end_node(NodeRecord record) {
  if (open_.empty()) return fail(ErrorCode::invalid_argument, "index: no node to leave");
  if (record.counts.size() != shape_.resolutions || record.first_resolution >= shape_.resolutions ||
      record.size_codes.size() != shape_.size_bounds * shape_.resolutions ||
      record.summaries.size() != shape_.attributes)
    return fail(ErrorCode::invalid_argument, "index: a node of another shape");
  Node node = std::move(open_.back());
  open_.pop_back();
  node.record = std::move(record);
  for (const Node& child : node.children) node.weight += child.weight;
  SPLATVOL_TRY(page_out_children(node, open_.empty() ? target_root_nodes(page_shape()) : target_page_nodes));
  if (open_.empty())
    root_ = std::move(node);
  else
    open_.back().children.push_back(std::move(node));
  return {};
}

Result<PackedIndexPage> IndexPacker::finish() {
  if (!root_) return fail(ErrorCode::invalid_argument, "index: without a root");
  const std::vector<const Node*> order = order_forest({&*root_});
  SPLATVOL_TRY_ASSIGN(page, pack_page(order));
  if (emit_summaries_) SPLATVOL_TRY(emit_page_summaries(order));
  return page;
}

NodeShape IndexPacker::page_shape() const {
  NodeShape shape = shape_;
  if (emit_summaries_) shape.attributes = 0;
  return shape;
}

std::uint64_t IndexPacker::memory_bytes() const {
  return held_nodes_ * (sizeof(Node) + shape_.resolutions * (sizeof(std::uint64_t) + shape_.size_bounds) +
                        shape_.attributes * sizeof(ValueSummary));
}

// Puts the forests below the heaviest children into pages of their own, until at most `target` nodes remain.
Status IndexPacker::page_out_children(Node& node, std::uint32_t target) {
  std::vector<Node*> children;
  for (Node& child : node.children) children.push_back(&child);
  std::ranges::stable_sort(children, std::greater<>(), &Node::weight);
  for (Node* child : children) {
    if (node.weight <= target || child->weight == 1) break;
    node.weight -= child->weight - 1;
    SPLATVOL_TRY(page_out(*child));
  }
  return {};
}

Status IndexPacker::page_out(Node& node) {
  std::vector<const Node*> forest;
  for (const Node& child : node.children) forest.push_back(&child);
  const std::vector<const Node*> order = order_forest(std::move(forest));
  SPLATVOL_TRY_ASSIGN(page, pack_page(order));
  page.ref.offset = offset_;
  offset_ += page.bytes.size();
  SPLATVOL_TRY(emit_(page));
  if (emit_summaries_) SPLATVOL_TRY(emit_page_summaries(order));
  ++pages_;
  node.link = page.ref;
  node.children = std::vector<Node>();
  held_nodes_ -= std::exchange(node.weight, 1) - 1;
  return {};
}

// Returns the nodes of the forest with the given roots, down to leaves and linked nodes, in breadth-first order.
std::vector<const IndexPacker::Node*> IndexPacker::order_forest(std::vector<const Node*> roots) const {
  for (std::size_t i = 0; i < roots.size(); ++i)
    for (const Node& child : roots[i]->children) roots.push_back(&child);
  return roots;
}

Status IndexPacker::emit_page_summaries(const std::vector<const Node*>& order) const {
  PageSummaries summaries(shape_.attributes);
  for (std::size_t a = 0; a < shape_.attributes; ++a)
    for (const Node* node : order) summaries[a].push_back(node->record.summaries[a]);
  return emit_summaries_(summaries);
}

Result<PackedIndexPage> IndexPacker::pack_page(const std::vector<const Node*>& order) const {
  const std::size_t attributes = page_shape().attributes;
  std::vector<Bytes> raw(1);
  for (const Node* node : order) append_node(raw[0], *node);
  std::vector<ValueSummary> summaries(order.size());
  for (std::size_t a = 0; a < attributes; ++a) {
    for (std::size_t n = 0; n < order.size(); ++n) summaries[n] = order[n]->record.summaries[a];
    raw.push_back(pack_summaries(summaries));
  }

  Bytes table, parts;
  append_record(table, static_cast<std::uint32_t>(order.size()));
  append_record(table, emit_summaries_ ? pages_ : std::uint32_t{0});
  std::uint64_t front_bytes = 0;
  for (const Bytes& part : raw) {
    append_part(table, parts, part);
    if (front_bytes == 0) front_bytes = parts.size();
  }
  PackedIndexPage page{{0, 0, 0, hash_bytes(table)}, table};
  page.bytes.insert(page.bytes.end(), parts.begin(), parts.end());
  if (page.bytes.size() > std::numeric_limits<std::uint32_t>::max())
    return fail(ErrorCode::unsupported, "an index page with {} attributes would pass 4 GiB", attributes);
  page.ref.front_bytes = static_cast<std::uint32_t>(table.size() + front_bytes);
  page.ref.page_bytes = static_cast<std::uint32_t>(page.bytes.size());
  return page;
}

void IndexPacker::append_node(Bytes& structure, const Node& node) const {
  const NodeRecord& record = node.record;
  structure.push_back(static_cast<std::byte>(node.child_mask));
  structure.push_back(static_cast<std::byte>(node.link ? 1 : 0));
  structure.push_back(static_cast<std::byte>(record.first_resolution));
  for (const std::uint64_t count : record.counts) append_varint(structure, count);
  for (std::size_t bound = 0; bound < shape_.size_bounds; ++bound)
    for (std::size_t r = record.first_resolution; r < shape_.resolutions; ++r)
      structure.push_back(static_cast<std::byte>(record.size_codes[bound * shape_.resolutions + r]));
  if (node.link) append_record(structure, *node.link);
}

Result<IndexPage> unpack_index_page(const IndexPageRef& ref, std::span<const std::byte> front, NodeShape shape,
                                    std::uint32_t expected_top_nodes, std::uint64_t links_end, std::string_view what) {
  SPLATVOL_TRY(check_table(ref, front, shape, what));
  const auto node_count = read_record<std::uint32_t>(front, 0);
  if (node_count < expected_top_nodes) return fail(ErrorCode::invalid_data, "{}: {} nodes [R13]", what, node_count);

  IndexPage page;
  page.nodes.shape = shape;
  page.top_nodes = expected_top_nodes;
  page.number = read_record<std::uint32_t>(front, 4);
  SPLATVOL_TRY_ASSIGN(
      structure, unpack_checked(part_at(front, 0),
                                front.subspan(static_cast<std::size_t>(index_table_bytes(shape.attributes))), what));
  SPLATVOL_TRY(read_nodes(structure, node_count, links_end, what, page));
  SPLATVOL_TRY(connect_children(page, what));
  return page;
}

SummaryPart find_summary_part(std::span<const std::byte> front, std::size_t attribute, NodeShape shape) {
  std::uint64_t offset = index_table_bytes(shape.attributes);
  for (std::size_t p = 0; p <= attribute; ++p) offset += part_at(front, p).packed_bytes;
  return {offset, part_at(front, 1 + attribute)};
}

void append_part(Bytes& table, Bytes& parts, std::span<const std::byte> raw) {
  const Bytes packed = pack(raw);
  append_record(table, IndexPagePart{static_cast<std::uint32_t>(packed.size()), static_cast<std::uint32_t>(raw.size()),
                                     hash_bytes(packed)});
  parts.insert(parts.end(), packed.begin(), packed.end());
}

Bytes pack_summaries(std::span<const ValueSummary> summaries) {
  Bytes raw;
  for (const ValueSummary& summary : summaries) append_record(raw, summary.min);
  for (const ValueSummary& summary : summaries) append_record(raw, summary.max);
  for (const ValueSummary& summary : summaries) append_record(raw, summary.occupancy);
  return raw;
}

Result<std::vector<ValueSummary>> unpack_summaries(const IndexPagePart& part, std::span<const std::byte> packed,
                                                   std::size_t nodes, std::string_view what) {
  SPLATVOL_TRY_ASSIGN(raw, unpack_checked(part, packed, what));
  if (raw.size() != nodes * summary_bytes)
    return fail(ErrorCode::invalid_data, "{}: wrong length of the summaries [R13]", what);
  std::vector<ValueSummary> summaries;
  summaries.reserve(nodes);
  for (std::size_t node = 0; node < nodes; ++node)
    summaries.push_back({read_record<float>(raw, node * 4), read_record<float>(raw, (nodes + node) * 4),
                         read_record<std::uint64_t>(raw, (nodes + node) * 8)});
  if (!std::ranges::all_of(summaries, &ValueSummary::is_valid))
    return fail(ErrorCode::invalid_data, "{}: a range of values is out of range [R13]", what);
  return summaries;
}

}  // namespace splatvol::format
