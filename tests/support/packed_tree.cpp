#include "tests/support/packed_tree.h"

#include <algorithm>
#include <bit>
#include <filesystem>

namespace splatvol::test {
namespace {

// Appends a node without its summaries.
void append_node(const format::NodeArrays& nodes, std::uint32_t node, Tree& tree) {
  const std::size_t codes = nodes.shape.size_bounds * nodes.shape.resolutions;
  tree.child_masks.push_back(nodes.child_masks[node]);
  tree.first_resolutions.push_back(nodes.first_resolutions[node]);
  for (const std::uint64_t count : nodes.counts_of(node)) tree.counts.push_back(count);
  for (std::size_t i = 0; i < codes; ++i) tree.size_codes.push_back(nodes.size_codes[node * codes + i]);
}

class TreeReader {
 public:
  TreeReader(std::span<const std::byte> section, format::NodeShape shape) : section_(section) { tree_.shape = shape; }

  Result<Tree> read(const format::PackedIndexPage& root) {
    SPLATVOL_TRY_ASSIGN(pages, open(root.ref, root.bytes, 1, section_.size()));
    SPLATVOL_TRY(add(pages, 0));
    return std::move(tree_);
  }

 private:
  using Pages = std::vector<format::IndexPage>;  // one for each attribute, or one if there are no attributes

  Result<Pages> open(const format::IndexPageRef& ref, std::span<const std::byte> bytes, std::uint32_t top_nodes,
                     std::uint64_t links_end) const {
    Pages pages;
    const auto front = bytes.first(ref.front_bytes);
    for (std::size_t a = 0; a < std::max<std::size_t>(1, tree_.shape.attributes); ++a) {
      SPLATVOL_TRY_ASSIGN(page, unpack_index_page(ref, front, tree_.shape, top_nodes, links_end, "test"));
      if (a < tree_.shape.attributes) {
        const auto [offset, part] = find_summary_part(front, a, tree_.shape);
        SPLATVOL_TRY_ASSIGN(
            summaries, unpack_summaries(part, bytes.subspan(offset, part.packed_bytes), page.nodes.size(), "test"));
        page.nodes.summaries = std::move(summaries);
      }
      pages.push_back(std::move(page));
    }
    return pages;
  }

  Status add(const Pages& pages, std::uint32_t node) {
    const format::IndexPage& page = pages[0];
    const format::NodeArrays& nodes = page.nodes;
    append_node(nodes, node, tree_);
    for (std::size_t a = 0; a < tree_.shape.attributes; ++a) tree_.summaries.push_back(pages[a].nodes.summaries[node]);

    const auto children = static_cast<std::uint32_t>(std::popcount(nodes.child_masks[node]));
    if (page.links[node] == format::IndexPage::no_node) {
      for (std::uint32_t c = 0; c < children; ++c) SPLATVOL_TRY(add(pages, page.first_children[node] + c));
      return {};
    }
    const format::IndexPageRef& ref = page.pages[page.links[node]];
    SPLATVOL_TRY_ASSIGN(linked, open(ref, section_.subspan(ref.offset, ref.page_bytes), children, ref.offset));
    for (std::uint32_t c = 0; c < children; ++c) SPLATVOL_TRY(add(linked, c));
    return {};
  }

  std::span<const std::byte> section_;
  Tree tree_;
};

}  // namespace

Result<format::PackedIndexPage> pack_tree(const Tree& tree, format::IndexPacker::Emit emit) {
  const format::NodeShape& shape = tree.shape;
  const std::size_t codes = shape.size_bounds * shape.resolutions;
  if (tree.first_resolutions.size() != tree.size() || tree.counts.size() != tree.size() * shape.resolutions ||
      tree.size_codes.size() != tree.size() * codes || tree.summaries.size() != tree.size() * shape.attributes)
    return fail(ErrorCode::invalid_argument, "index: arrays of different lengths");

  format::IndexPacker packer(shape, std::move(emit));
  std::size_t next = 0;
  const auto part = [](const auto& array, std::size_t node, std::size_t length) {
    const auto begin = array.begin() + static_cast<std::ptrdiff_t>(node * length);
    return std::vector(begin, begin + static_cast<std::ptrdiff_t>(length));
  };
  const auto add = [&](const auto& self, unsigned octant) -> Status {
    if (next == tree.size()) return fail(ErrorCode::invalid_argument, "index: a node lacks children");
    const std::size_t node = next++;
    SPLATVOL_TRY(packer.begin_node(octant));
    for (unsigned child = 0; child < 8; ++child)
      if ((tree.child_masks[node] >> child & 1) != 0) SPLATVOL_TRY(self(self, child));
    return packer.end_node({tree.first_resolutions[node], part(tree.counts, node, shape.resolutions),
                            part(tree.size_codes, node, codes), part(tree.summaries, node, shape.attributes)});
  };
  SPLATVOL_TRY(add(add, 0));
  if (next != tree.size()) return fail(ErrorCode::invalid_argument, "index: nodes without a parent");
  return packer.finish();
}

Result<format::PackedIndex> pack_tree(const Tree& tree) {
  SPLATVOL_TRY_ASSIGN(pages, TempFile::create(std::filesystem::temp_directory_path()));
  SPLATVOL_TRY_ASSIGN(root,
                      pack_tree(tree, [&](const format::PackedIndexPage& page) { return pages.append(page.bytes); }));
  return format::PackedIndex{tree.shape, std::move(root), std::move(pages)};
}

Result<Tree> read_tree(const format::PackedIndexPage& root, std::span<const std::byte> pages, format::NodeShape shape) {
  return TreeReader(pages, shape).read(root);
}

namespace {

Status add_node(const format::Volume& volume, int attribute, const format::IndexPage& page, std::uint32_t node,
                Tree& tree) {
  const format::NodeArrays& nodes = page.nodes;
  append_node(nodes, node, tree);
  if (attribute >= 0) tree.summaries.push_back(nodes.summaries[node]);

  const auto children = static_cast<std::uint32_t>(std::popcount(nodes.child_masks[node]));
  if (page.links[node] == format::IndexPage::no_node) {
    for (std::uint32_t c = 0; c < children; ++c)
      SPLATVOL_TRY(add_node(volume, attribute, page, page.first_children[node] + c, tree));
    return {};
  }
  SPLATVOL_TRY_ASSIGN(linked, volume.read_index_page(page.pages[page.links[node]], nodes.child_masks[node],
                                                     nodes.counts_of(node), {attribute}));
  for (std::uint32_t c = 0; c < children; ++c) SPLATVOL_TRY(add_node(volume, attribute, linked, c, tree));
  return {};
}

}  // namespace

Result<Tree> read_tree(const format::Volume& volume, int attribute) {
  SPLATVOL_TRY_ASSIGN(root, volume.read_index_root({attribute}));
  Tree tree;
  tree.shape = root.nodes.shape;
  SPLATVOL_TRY(add_node(volume, attribute, root, 0, tree));
  return tree;
}

Result<Tree> read_tree(const format::PackedIndex& index) {
  format::Bytes pages(index.pages.size());
  SPLATVOL_TRY(index.pages.read(0, pages));
  return read_tree(index.root, pages, index.shape);
}

}  // namespace splatvol::test
