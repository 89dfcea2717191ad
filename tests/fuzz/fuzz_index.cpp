// A page of the index, and the summaries of its nodes. A page that is a whole tree is packed again: the same tree must
// come back.
#include <algorithm>
#include <bit>
#include <functional>

#include "format/octree.h"
#include "tests/fuzz/fuzz.h"
#include "tests/support/packed_tree.h"

using namespace splatvol;
using namespace splatvol::format;
using splatvol::fuzz::require;
using splatvol::fuzz::require_ok;

namespace {

void check_page(const IndexPage& page) {
  const std::size_t nodes = page.nodes.size();
  require(page.first_children.size() == nodes && page.links.size() == nodes, "arrays have an entry for each node");
  require(page.nodes.counts.size() == nodes * page.nodes.shape.resolutions, "a node has a count for each segment");
  for (std::size_t node = 0; node < nodes; ++node) {
    require(page.nodes.first_resolutions[node] < page.nodes.shape.resolutions, "a first resolution is one of the file");
    const std::uint32_t first = page.first_children[node];
    if (page.links[node] != IndexPage::no_node) require(page.links[node] < page.pages.size(), "a link is there");
    if (first == IndexPage::no_node) continue;
    const auto children = static_cast<std::size_t>(std::popcount(page.nodes.child_masks[node]));
    require(first > node && children <= nodes && first <= nodes - children, "children follow in the page");
  }
}

// Returns the nodes in depth-first order.
test::Tree tree_of(const IndexPage& page) {
  test::Tree tree;
  const NodeArrays& from = page.nodes;
  tree.shape = from.shape;
  tree.shape.attributes = 0;
  const std::size_t codes = from.shape.size_bounds * from.shape.resolutions;
  const std::function<void(std::uint32_t)> add = [&](std::uint32_t node) {
    tree.child_masks.push_back(from.child_masks[node]);
    tree.first_resolutions.push_back(from.first_resolutions[node]);
    const auto counts = from.counts_of(node);
    tree.counts.insert(tree.counts.end(), counts.begin(), counts.end());
    const auto first_code = from.size_codes.begin() + static_cast<std::ptrdiff_t>(node * codes);
    tree.size_codes.insert(tree.size_codes.end(), first_code, first_code + static_cast<std::ptrdiff_t>(codes));
    for (std::uint32_t c = 0; c < static_cast<std::uint32_t>(std::popcount(from.child_masks[node])); ++c)
      add(page.first_children[node] + c);
  };
  add(0);
  return tree;
}

void check_round_trip(const IndexPage& page) {
  if (page.top_nodes != 1 || !page.pages.empty()) return;
  const test::Tree tree = tree_of(page);
  const auto packed = test::pack_tree(tree);
  if (!packed) return;  // deeper than an index may be
  const auto again = test::read_tree(*packed);
  require_ok(again, "a packed tree can be read");
  require(again->child_masks == tree.child_masks && again->first_resolutions == tree.first_resolutions &&
              again->counts == tree.counts && again->size_codes == tree.size_codes,
          "the same tree comes back");
}

void check_summaries(std::span<const std::byte> bytes, IndexPage& page) {
  const IndexPagePart part{static_cast<std::uint32_t>(bytes.size()), static_cast<std::uint32_t>(bytes.size()),
                           hash_bytes(bytes)};
  auto summaries = unpack_summaries(part, bytes, page.nodes.size(), "fuzz");
  if (!summaries) return;
  page.nodes.summaries = std::move(*summaries);
  require(page.nodes.summaries.size() == page.nodes.size(), "a summary for each node");
  require(std::ranges::all_of(page.nodes.summaries, &ValueSummary::is_valid), "summaries are ranges");
  const Bytes again = pack_summaries(page.nodes.summaries);
  require(std::ranges::equal(again, bytes) || again.size() == bytes.size(), "summaries have the same length");
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  fuzz::Input input(fuzz::bytes_of(data, size));
  const NodeShape shape{input.take_in(1, max_resolutions), input.take_in(0, max_size_bounds), input.take_in(0, 2)};
  const std::uint32_t top_nodes = input.take_in(1, 8);
  const std::uint32_t nodes = input.take<std::uint16_t>();
  const auto links_end = input.take<std::uint32_t>();
  const std::size_t structure_bytes = std::min<std::size_t>(input.take<std::uint16_t>(), input.rest().size());
  const auto structure = input.rest().first(structure_bytes);
  const auto summaries = input.rest().subspan(structure_bytes);

  Bytes front;
  append_record(front, nodes);
  append_record(front, std::uint32_t{0});
  for (std::size_t part = 0; part <= shape.attributes; ++part) {
    const auto bytes = part == 0 ? structure : summaries;
    append_record(front, IndexPagePart{static_cast<std::uint32_t>(bytes.size()),
                                       static_cast<std::uint32_t>(bytes.size()), hash_bytes(bytes)});
  }
  IndexPageRef ref{links_end, 0, 0, hash_bytes(front)};
  front.insert(front.end(), structure.begin(), structure.end());
  ref.front_bytes = static_cast<std::uint32_t>(front.size());
  ref.page_bytes = static_cast<std::uint32_t>(front.size() + shape.attributes * summaries.size());
  auto page = unpack_index_page(ref, front, shape, top_nodes, links_end, "fuzz");
  if (!page) return 0;
  check_page(*page);
  check_round_trip(*page);
  if (shape.attributes > 0) check_summaries(summaries, *page);
  return 0;
}
