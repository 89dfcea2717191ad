#include "format/octree.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "tests/support/packed_tree.h"
#include "tests/support/results.h"
#include "tests/support/sanitizers.h"

namespace splatvol::test {
namespace {

using namespace format;
using testing::HasSubstr;

// Makes trees of any shape. As in written files, inner nodes have the points of their children.
class TreeMaker {
 public:
  TreeMaker(NodeShape shape, std::uint32_t seed) : random_(seed) { tree_.shape = shape; }

  NodeArrays take() { return std::move(tree_); }
  std::uint32_t draw(std::uint32_t below) { return static_cast<std::uint32_t>(random_() % below); }

  // Adds a node and returns its index. Calls `children` for each child in the mask; it must add the subtree.
  template <class AddChild>
  std::size_t add(std::uint8_t mask, AddChild add_child) {
    const std::size_t node = tree_.size();
    const NodeShape& shape = tree_.shape;
    tree_.child_masks.push_back(mask);
    tree_.first_resolutions.push_back(static_cast<std::uint8_t>(draw(static_cast<std::uint32_t>(shape.resolutions))));
    tree_.counts.resize(tree_.counts.size() + shape.resolutions);
    for (std::size_t i = 0; i < shape.size_bounds * shape.resolutions; ++i)
      tree_.size_codes.push_back(i % shape.resolutions < tree_.first_resolutions.back()
                                     ? std::uint8_t{0}
                                     : static_cast<std::uint8_t>(draw(256)));
    for (std::size_t a = 0; a < shape.attributes; ++a)
      tree_.summaries.push_back({static_cast<float>(draw(1000)), 1000 + static_cast<float>(draw(1000)), random_()});
    for (int i = 0; i < std::popcount(mask); ++i) {
      const std::size_t child = add_child();
      for (std::size_t s = 0; s < shape.resolutions; ++s)
        tree_.counts[node * shape.resolutions + s] += tree_.counts[child * shape.resolutions + s];
    }
    if (mask == 0)
      for (std::size_t s = 0; s < shape.resolutions; ++s)
        tree_.counts[node * shape.resolutions + s] = s == 0 ? 1 : draw(1u << draw(20));
    return node;
  }

  std::size_t add_random(std::size_t depth, std::uint32_t branching) {
    const auto mask = depth > 0 && draw(100) < branching ? static_cast<std::uint8_t>(draw(256)) : std::uint8_t{0};
    return add(mask, [&] { return add_random(depth - 1, branching); });
  }

  std::size_t add_full(std::size_t depth) {
    return add(depth > 0 ? 255 : 0, [&] { return add_full(depth - 1); });
  }

  std::size_t add_chain(std::size_t depth) {
    return add(depth > 0 ? static_cast<std::uint8_t>(1u << draw(8)) : std::uint8_t{0},
               [&] { return add_chain(depth - 1); });
  }

 private:
  std::mt19937_64 random_;
  NodeArrays tree_;
};

struct PackedTree {
  PackedIndexPage root;
  Bytes section;
  std::vector<IndexPageRef> pages;
  std::uint32_t largest_page = 0;
};

Result<PackedTree> pack_tree(const NodeArrays& tree) {
  PackedTree packed;
  auto root = test::pack_tree(tree, [&](const PackedIndexPage& page) -> Status {
    EXPECT_EQ(page.ref.offset, packed.section.size());
    EXPECT_EQ(page.ref.page_bytes, page.bytes.size());
    packed.section.insert(packed.section.end(), page.bytes.begin(), page.bytes.end());
    packed.pages.push_back(page.ref);
    packed.largest_page = std::max(packed.largest_page, read_record<std::uint32_t>(page.bytes, 0));
    return {};
  });
  if (!root) return tl::unexpected(root.error());
  packed.root = std::move(*root);
  return packed;
}

// Packs, reads back and compares. Returns the packed form.
PackedTree expect_comes_back(const NodeArrays& tree) {
  const PackedTree packed = pack_tree(tree).value();
  const auto read = read_tree(packed.root, packed.section, tree.shape);
  EXPECT_TRUE(read) << read.error().message;
  const NodeArrays back = read.value_or(NodeArrays{});
  EXPECT_LE(packed.largest_page, 300u);
  EXPECT_EQ(back.child_masks, tree.child_masks);
  EXPECT_EQ(back.first_resolutions, tree.first_resolutions);
  EXPECT_EQ(back.counts, tree.counts);
  EXPECT_EQ(back.size_codes, tree.size_codes);
  EXPECT_EQ(back.summaries.size(), tree.summaries.size());
  for (std::size_t i = 0; i < std::min(back.summaries.size(), tree.summaries.size()); ++i) {
    EXPECT_EQ(back.summaries[i].min, tree.summaries[i].min);
    EXPECT_EQ(back.summaries[i].max, tree.summaries[i].max);
    EXPECT_EQ(back.summaries[i].occupancy, tree.summaries[i].occupancy);
  }
  return packed;
}

TEST(SizeCode, IsTheTightestBoundThatHolds) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> exponent(-29, 2);
  for (const double edge : {1.0, 3.7e-6, 1e9}) {
    for (int i = 0; i < 20000; ++i) {
      const double size = i < 240 ? edge * std::exp2(2 - i / 8.0) : edge * std::exp2(exponent(random));
      const std::uint8_t code = size_code(size, edge);
      EXPECT_GE(size_bound(code, edge), size);
      if (code < 255) {
        EXPECT_LT(size_bound(static_cast<std::uint8_t>(code + 1), edge), size * (1 + 1e-12));
      }
    }
  }
}

TEST(SizeCode, TakesTheLargestAndTheSmallest) {
  EXPECT_EQ(size_code(4, 1), 0);
  EXPECT_EQ(size_code(1, 1), 16);
  EXPECT_EQ(size_bound(16, 1), 1);
  EXPECT_EQ(size_code(0, 1), 255);
  EXPECT_EQ(size_code(1e-300, 1), 255);
}

TEST(Index, ASingleNodeComesBack) {
  for (const NodeShape shape : {NodeShape{1, 0, 0}, NodeShape{1, 1, 1}, NodeShape{64, 16, 3}}) {
    TreeMaker maker(shape, 1);
    maker.add_full(0);
    const PackedTree packed = expect_comes_back(maker.take());
    EXPECT_TRUE(packed.section.empty());
  }
}

TEST(Index, RandomTreesComeBack) {
  for (std::uint32_t seed = 0; seed < 60; ++seed) {
    const NodeShape shape{1 + seed % 9, seed % 3, seed % 4};
    TreeMaker maker(shape, seed);
    maker.add_random(1 + seed % 7, 40 + seed % 60);
    expect_comes_back(maker.take());
  }
}

TEST(Index, ChainsOfEveryDepthComeBack) {
  for (const std::size_t depth : {1, 2, 41, 42}) {
    TreeMaker maker({5, 1, 1}, 3);
    maker.add_chain(depth);
    expect_comes_back(maker.take());
  }
}

TEST(Index, ABushOnAChainComesBack) {
  TreeMaker maker({5, 1, 1}, 4);
  std::size_t depth = 0;
  std::function<std::size_t()> grow = [&]() -> std::size_t {
    if (++depth > 37) return maker.add_full(4);
    return maker.add(std::uint8_t{8}, grow);
  };
  maker.add(std::uint8_t{1}, grow);
  expect_comes_back(maker.take());
}

template <class T>
bool is_invalid(const Result<T>& result) {
  EXPECT_TRUE(result || result.error().code == ErrorCode::invalid_argument);
  return !result;
}

TEST(Index, RefusesArraysThatAreNoTree) {
  TreeMaker maker({3, 1, 1}, 5);
  maker.add_full(2);
  const NodeArrays good = maker.take();
  const auto refuses = [&](auto change) {
    NodeArrays tree = good;
    change(tree);
    return is_invalid(pack_tree(tree));
  };
  EXPECT_FALSE(refuses([](NodeArrays&) {}));
  EXPECT_TRUE(refuses([](NodeArrays& tree) { tree.child_masks.back() = 1; }));
  EXPECT_TRUE(refuses([](NodeArrays& tree) { tree.child_masks.front() = 127; }));
  EXPECT_TRUE(refuses([](NodeArrays& tree) { tree.counts.pop_back(); }));
  EXPECT_TRUE(refuses([](NodeArrays& tree) { tree.summaries.pop_back(); }));
  EXPECT_TRUE(refuses([](NodeArrays& tree) { tree.size_codes.clear(); }));
  EXPECT_TRUE(refuses([](NodeArrays& tree) { tree = NodeArrays{tree.shape, {}, {}, {}, {}, {}, {}}; }));

  TreeMaker deep({3, 1, 1}, 5);
  deep.add_chain(max_node_depth + 1);
  EXPECT_THAT(pack_tree(deep.take()).error().message, HasSubstr("deeper"));
}

TEST(Index, AFailingSinkStopsIt) {
  TreeMaker maker({3, 1, 1}, 6);
  maker.add_full(4);
  const NodeArrays tree = maker.take();
  int pages = 0;
  EXPECT_EQ(message_of(test::pack_tree(tree,
                                       [&](const PackedIndexPage&) -> Status {
                                         if (++pages == 3) return fail(ErrorCode::io, "the disk is full");
                                         return {};
                                       })),
            "the disk is full");
  EXPECT_EQ(pages, 3);
}

NodeRecord record_of(const NodeShape& shape, std::uint8_t number) {
  return {0, std::vector<std::uint64_t>(shape.resolutions, number),
          std::vector<std::uint8_t>(shape.size_bounds * shape.resolutions, number),
          std::vector<ValueSummary>(shape.attributes)};
}

TEST(IndexPacker, RefusesWhatIsNoWalk) {
  const NodeShape shape{3, 1, 1};
  const auto emit = [](const PackedIndexPage&) -> Status { return {}; };
  const auto refuses = [&](auto walk) {
    IndexPacker packer(shape, emit);
    return is_invalid(walk(packer));
  };
  const auto leaf = [&](IndexPacker& packer, unsigned octant) -> Status {
    SPLATVOL_TRY(packer.begin_node(octant));
    return packer.end_node(record_of(shape, 1));
  };
  const auto parent_of = [&](std::vector<unsigned> octants) {
    return [&, octants](IndexPacker& packer) -> Status {
      SPLATVOL_TRY(packer.begin_node(0));
      for (const unsigned octant : octants) SPLATVOL_TRY(leaf(packer, octant));
      SPLATVOL_TRY(packer.end_node(record_of(shape, 1)));
      return packer.finish().map([](const PackedIndexPage&) {});
    };
  };
  EXPECT_FALSE(refuses(parent_of({0, 3, 7})));
  EXPECT_TRUE(refuses(parent_of({3, 0})));
  EXPECT_TRUE(refuses(parent_of({3, 3})));
  EXPECT_TRUE(refuses(parent_of({8})));
  EXPECT_TRUE(refuses([&](IndexPacker& packer) { return packer.end_node(record_of(shape, 1)); }));
  EXPECT_TRUE(refuses([&](IndexPacker& packer) { return packer.finish().map([](const PackedIndexPage&) {}); }));
  EXPECT_TRUE(refuses([&](IndexPacker& packer) -> Status {
    SPLATVOL_TRY(packer.begin_node(0));
    return packer.finish().map([](const PackedIndexPage&) {});
  }));
  EXPECT_TRUE(refuses([&](IndexPacker& packer) -> Status {
    SPLATVOL_TRY(leaf(packer, 0));
    return leaf(packer, 1);
  }));
  for (const NodeShape other : {NodeShape{2, 1, 1}, NodeShape{3, 2, 1}, NodeShape{3, 1, 0}})
    EXPECT_TRUE(refuses([&](IndexPacker& packer) -> Status {
      SPLATVOL_TRY(packer.begin_node(0));
      return packer.end_node(record_of(other, 1));
    }));
}

// 1.3 million nodes, and the same below a chain down to the deepest node. The forests of the path bound the memory:
// each has at most 8 children with at most 256 nodes.
TEST(IndexPacker, HoldsAPathHoweverManyNodesThereAre) {
  const NodeShape shape{4, 2, 1};
  const std::size_t branching = is_sanitized ? 5 : 6;  // an eighth of the nodes: each takes ten times as long
  for (const std::size_t chain : {0, 35}) {
    std::uint64_t paged = 0, nodes = 0, most_bytes = 0;
    IndexPacker packer(shape, [&](const PackedIndexPage& page) -> Status {
      paged += read_record<std::uint32_t>(page.bytes, 0);
      return {};
    });
    const auto add = [&](const auto& self, std::size_t depth, unsigned octant) -> void {
      ASSERT_TRUE(packer.begin_node(octant));
      ++nodes;
      most_bytes = std::max(most_bytes, packer.memory_bytes());
      const unsigned children = depth < chain                   ? 1
                                : depth < chain + branching     ? 8
                                : depth < chain + branching + 1 ? 4
                                                                : 0;
      for (unsigned child = 0; child < children; ++child) self(self, depth + 1, child);
      ASSERT_TRUE(packer.end_node(record_of(shape, static_cast<std::uint8_t>(nodes % 200))));
    };
    add(add, 0, 0);
    const auto root = value_of(packer.finish());
    paged += read_record<std::uint32_t>(root.bytes, 0);
    EXPECT_GT(nodes, is_sanitized ? 160'000u : 1'300'000u);
    EXPECT_EQ(paged, nodes);
    EXPECT_LE(most_bytes, 8u * 8u * 256u * 256u);  // at eight depths the tree branches; 256 bytes a node
  }
}

// An octree over points that are as dense as in a boundary layer, with six resolutions, each of a third of the next.
class CrowdedTree {
 public:
  explicit CrowdedTree(std::size_t points, std::size_t leaf_points) : leaf_points_(leaf_points) {
    std::mt19937_64 random(9);
    std::normal_distribution<double> normal(0, 1);
    for (std::size_t i = 0; i < points; ++i) {
      const auto coordinate = [&](double width) {
        return static_cast<std::uint64_t>(std::clamp(0.5 + width * normal(random), 0.0, 0.999999) * 0x1p21);
      };
      const std::uint64_t index[3] = {coordinate(0.1), coordinate(0.02), coordinate(0.1)};
      std::uint64_t key = 0;
      for (int bit = 20; bit >= 0; --bit)
        for (int axis = 2; axis >= 0; --axis) key = key << 1 | (index[axis] >> bit & 1);
      keys_.push_back(key);
    }
    std::ranges::sort(keys_);
    tree_.shape = {6, 1, 1};
    add(0, keys_.size(), 0);
  }
  const NodeArrays& tree() const { return tree_; }

 private:
  static std::size_t segment_of(std::uint64_t key) {
    std::uint64_t hash = key * 0x9E3779B97F4A7C15u >> 32;
    std::size_t segment = 5;
    for (; segment > 0 && hash % 3 == 0; hash /= 3) --segment;
    return segment;
  }

  void add(std::size_t begin, std::size_t end, int depth) {
    const std::size_t node = tree_.size();
    tree_.child_masks.push_back(0);
    tree_.first_resolutions.push_back(static_cast<std::uint8_t>(std::min(5, depth / 2)));
    tree_.counts.resize((node + 1) * 6);
    for (std::size_t i = begin; i < end; ++i) ++tree_.counts[node * 6 + segment_of(keys_[i])];
    for (int r = 0; r < 6; ++r)
      tree_.size_codes.push_back(r < tree_.first_resolutions.back()
                                     ? std::uint8_t{0}
                                     : static_cast<std::uint8_t>(8 * (depth + r) + keys_[begin] % 5));
    const auto value = [&](std::size_t i) {
      return static_cast<float>(std::sin(static_cast<double>(keys_[i] >> 20) * 1e-11));
    };
    const auto [min, max] = std::minmax({value(begin), value(end - 1)});
    tree_.summaries.push_back({min, max, std::uint64_t{0xFF} << (keys_[begin] >> 40) % 50});
    if (end - begin <= leaf_points_ || depth == 21) return;
    for (std::size_t child = begin; child < end;) {
      const auto octant = [&](std::size_t i) { return keys_[i] >> (60 - 3 * depth) & 7; };
      std::size_t child_end = child;
      while (child_end < end && octant(child_end) == octant(child)) ++child_end;
      tree_.child_masks[node] = static_cast<std::uint8_t>(tree_.child_masks[node] | 1u << octant(child));
      add(child, child_end, depth + 1);
      child = child_end;
    }
  }

  std::size_t leaf_points_;
  std::vector<std::uint64_t> keys_;
  NodeArrays tree_;
};

TEST(Index, ANodeCostsLittle) {
  const CrowdedTree crowded(400'000, 8);
  const NodeArrays& tree = crowded.tree();
  ASSERT_GT(tree.size(), 100'000u);
  const PackedTree packed = expect_comes_back(tree);

  const double nodes = static_cast<double>(tree.size());
  std::uint64_t structure = packed.root.ref.front_bytes;
  for (const IndexPageRef& page : packed.pages) structure += page.front_bytes;
  const double total = static_cast<double>(packed.section.size() + packed.root.bytes.size());
  RecordProperty("structure_bytes_per_node", std::to_string(static_cast<double>(structure) / nodes));
  RecordProperty("bytes_per_node", std::to_string(total / nodes));
  RecordProperty("nodes_per_page", std::to_string(nodes / static_cast<double>(packed.pages.size() + 1)));
  EXPECT_LE(static_cast<double>(structure) / nodes, 32);
  EXPECT_LE(total / nodes, 32);
  EXPECT_GE(nodes / static_cast<double>(packed.pages.size() + 1), 50);
}

TEST(Index, TheRootPageStaysSmallWithManyAttributes) {
  for (const std::size_t attributes : {1, 20, 200, 2000}) {
    TreeMaker maker({6, 1, attributes}, 8);
    maker.add_full(3);
    const PackedTree packed = pack_tree(maker.take()).value();
    EXPECT_LE(packed.root.bytes.size(), (16u << 10) + index_table_bytes(attributes) + 9 * 16 * attributes);
  }
}

TEST(Index, PagesOnlyLinkBackwards) {
  TreeMaker maker({4, 1, 1}, 10);
  maker.add_full(5);
  const NodeArrays tree = maker.take();
  const PackedTree packed = pack_tree(tree).value();
  ASSERT_GT(packed.pages.size(), 10u);
  std::size_t with_links = 0;
  for (const IndexPageRef& ref : packed.pages) {
    const auto front = std::span(packed.section).subspan(ref.offset, ref.front_bytes);
    const auto page = value_of(unpack_index_page(ref, front, tree.shape, 8, ref.offset, "test"));
    if (page.pages.empty()) continue;
    ++with_links;
    std::uint64_t end = 0;
    for (const IndexPageRef& link : page.pages) end = std::max(end, link.offset + link.page_bytes);
    EXPECT_TRUE(unpack_index_page(ref, front, tree.shape, 8, end, "test"));
    EXPECT_THAT(unpack_index_page(ref, front, tree.shape, 8, end - 1, "test").error().message, HasSubstr("[R16]"));
  }
  EXPECT_GT(with_links, 0u);
}

}  // namespace
}  // namespace splatvol::test
