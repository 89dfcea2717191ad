#include "builder/output/index_stream.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <random>

#include "builder/output/index_leaf_spool.h"
#include "tests/builder/support/point_sets.h"
#include "tests/builder/support/random_material.h"
#include "tests/support/packed_tree.h"
#include "tests/support/random.h"
#include "tests/support/whole_material.h"
#include "tests/support/whole_reduction.h"

namespace splatvol::test {
namespace {

std::map<std::string, Sorted> distributions() {
  std::mt19937_64 random(11);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::normal_distribution<double> normal(0, 1);
  const auto draw = [&](std::size_t count, auto map) {
    std::vector<dvec3> points(count);
    for (dvec3& p : points) p = glm::clamp(map(random_vector(uniform, random)), 0.0, 1.0);
    return points;
  };
  const auto both = [](std::vector<dvec3> a, const std::vector<dvec3>& b) {
    a.insert(a.end(), b.begin(), b.end());
    return a;
  };
  const auto anywhere = [](dvec3 p) { return p; };
  const auto at_one_position = [](dvec3) { return dvec3(0.1, 0.2, 0.3); };
  const std::vector<dvec3> uniform_points = draw(4000, anywhere);
  std::map<std::string, Sorted> all;
  all["uniform"] = sort_points(uniform_points);
  all["clustered"] = sort_points(draw(4000, [&](dvec3 p) {
    const dvec3 center = glm::round(3.0 * p) / 3.0;
    return center + random_vector(normal, random) * std::pow(10.0, -6 * p.x);
  }));
  all["all coincident"] = sort_points(draw(3000, at_one_position));
  all["half coincident"] = sort_points(both(uniform_points, draw(3000, at_one_position)));
  all["half in 1e-9 of the volume"] =
      sort_points(both(uniform_points, draw(4000, [](dvec3 p) { return dvec3(0.7, 0.3, 0.6) + 1e-3 * p; })));
  // Nodes have one child all the way down: some points are closer than the finest node's edge, some a little farther.
  all["on both sides of the finest border"] =
      sort_points(draw(3000, [](dvec3 p) { return 0.5 + 0x1p-41 * (p - 0.5); }));
  all["on a line"] = sort_points(draw(3000, [](dvec3 p) { return dvec3(p.x, 0.3, 0.7); }));
  all["nine decades"] = sort_points(draw(4000, [](dvec3 p) { return glm::pow(dvec3(10), -9.0 * p); }));
  all["one point"] = sort_points({{0.2, 0.4, 0.6}});
  return all;
}

// Points with random material and values, and their splats.
struct Model {
  PointBatch points;
  std::vector<float> values;
  std::vector<Resolution> resolutions;
  std::vector<std::uint8_t> segments;
  std::vector<Material> materials;
  std::vector<std::vector<StoredSplat>> splats;  // [resolution]
  format::ValueBins bins{0, 1};

  explicit Model(const Sorted& sorted) {
    points.positions = sorted.positions;
    points.keys = sorted.keys;
    randomize_material(points);
    std::mt19937_64 random(6);
    std::uniform_real_distribution<float> uniform(0, 1);
    for (std::size_t i = 0; i < points.size(); ++i)
      values.push_back(random() % 8 == 0 ? std::nanf("") : uniform(random));
    resolutions = reduce_by_octree(points.keys, points.positions, unit_cube, 8);
    segments = find_segments(resolutions);
    materials = merge_clusters(points.positions, resolutions, material_of(points));
    for (std::size_t r = 0; r < resolutions.size(); ++r)
      splats.push_back(splats_of(points.positions, resolutions[r], materials[r]));
  }

  // Calls visit(leaf) for each index leaf in Morton order.
  template <class Visit>
  Status for_each_leaf(std::uint64_t leaf_points, const Visit& visit) const {
    std::vector<std::size_t> next(resolutions.size());  // member
    Status status;
    visit_octree(points.keys, leaf_points, [&](std::size_t begin, std::size_t end, int depth, bool is_leaf) {
      if (!is_leaf || !status) return;
      IndexLeaf leaf{points.keys[begin],
                     depth,
                     counts(begin, end),
                     std::vector<SplatBounds>(resolutions.size()),
                     {summary(begin, end)}};
      for (std::size_t r = 0; r < resolutions.size(); ++r)
        for (std::size_t& m = next[r]; m < resolutions[r].size() && resolutions[r].members[m] < end; ++m)
          leaf.splats[r].include(splats[r][m], materials[r].moments[m]);
      status = visit(std::move(leaf));
    });
    return status;
  }

  // Makes every node from all of its points, without its children.
  [[nodiscard]] Tree tree(std::uint64_t leaf_points) const {
    Tree tree;
    tree.shape = IndexStream::shape(resolutions.size(), 1);
    visit_octree(points.keys, leaf_points, [&](std::size_t begin, std::size_t end, int depth, bool leaf) {
      add_node(begin, end, depth, leaf, tree);
    });
    return tree;
  }

 private:
  [[nodiscard]] std::vector<std::uint64_t> counts(std::size_t begin, std::size_t end) const {
    std::vector<std::uint64_t> counts(resolutions.size());
    for (std::size_t i = begin; i < end; ++i) ++counts[segments[i]];
    return counts;
  }

  [[nodiscard]] format::ValueSummary summary(std::size_t begin, std::size_t end) const {
    format::ValueSummary summary = bins.summarize(std::span(values).subspan(begin, end - begin));
    for (std::size_t i = begin; i < end; ++i) {
      const ValueMoments& value = points.value_moments[0][i];
      summary.include(summarize_range(static_cast<float>(value.min), static_cast<float>(value.max), bins));
    }
    return summary;
  }

  void add_node(std::size_t begin, std::size_t end, int depth, bool leaf, Tree& tree) const {
    tree.child_masks.push_back(0);
    for (std::size_t i = begin; !leaf && i < end; ++i)
      tree.child_masks.back() =
          static_cast<std::uint8_t>(tree.child_masks.back() | 1u << octant_at(points.keys[i], depth));
    for (const std::uint64_t count : counts(begin, end)) tree.counts.push_back(count);
    tree.summaries.push_back(summary(begin, end));

    std::vector<std::uint8_t> octant_codes(resolutions.size(), 255), moments_codes(resolutions.size(), 255);
    std::size_t first = 0;
    for (std::size_t r = 0; r < resolutions.size(); ++r) {
      double octant_size = 0, moments_size = 0;
      bool inside = false;
      for (std::size_t m = 0; m < resolutions[r].size(); ++m) {
        const std::uint64_t i = resolutions[r].members[m];
        if (i < begin || i >= end) continue;
        const int leaf_depth = resolutions[r].depths[m];
        inside = inside || leaf_depth >= depth;
        octant_size = std::max(octant_size, std::ldexp(1.0, -leaf_depth) / std::cbrt(resolutions[r].counts[m]));
        moments_size = std::max(moments_size, splat_size(i, r, m, depth));
      }
      // The clusters of the next coarser resolution are leaves over this one. A cluster crosses the border unless all
      // of this resolution's leaves that meet the node are inside.
      if (!inside) first = r;
      octant_codes[r] = octant_size > 0 ? format::size_code(octant_size, 1) : std::uint8_t{255};
      moments_codes[r] = moments_size > 0 ? format::size_code(moments_size, 1) : std::uint8_t{255};
    }
    std::fill_n(octant_codes.begin(), first, std::uint8_t{0});  // not stored
    std::fill_n(moments_codes.begin(), first, std::uint8_t{0});
    tree.first_resolutions.push_back(static_cast<std::uint8_t>(first));
    tree.size_codes.insert(tree.size_codes.end(), octant_codes.begin(), octant_codes.end());
    tree.size_codes.insert(tree.size_codes.end(), moments_codes.begin(), moments_codes.end());
  }

  // Size of one `moments` splat, in the node at `depth` that holds its point.
  [[nodiscard]] double splat_size(std::size_t point, std::size_t resolution, std::size_t member, int depth) const {
    SplatBounds splat;
    splat.include(splats[resolution][member], materials[resolution].moments[member]);
    const dvec3 center = node_center(points.positions[point], unit_cube, depth);
    const double half = std::ldexp(0.5, -depth);
    double size = splat.width;
    for (int axis = 0; axis < 3; ++axis)
      size = std::max(
          {size, (center[axis] - half - splat.box.low[axis]) / 2, (splat.box.high[axis] - (center[axis] + half)) / 2});
    return size;
  }
};

Result<Tree> grow(const Model& model, std::uint64_t leaf_points) {
  format::Bytes pages;
  IndexStream stream(unit_cube, model.resolutions.size(), 1, [&](const format::PackedIndexPage& page) -> Status {
    pages.insert(pages.end(), page.bytes.begin(), page.bytes.end());
    return {};
  });
  SPLATVOL_TRY(model.for_each_leaf(leaf_points, [&](IndexLeaf&& leaf) { return stream.add(std::move(leaf)); }));
  SPLATVOL_TRY_ASSIGN(root, stream.finish());
  return read_tree(root, pages, IndexStream::shape(model.resolutions.size(), 1));
}

TEST(IndexStream, GrowsTheTreeOfTheDefinition) {
  for (const auto& [name, points] : distributions()) {
    const Model model(points);
    for (const std::uint64_t leaf_points : {1, 20, 512}) {
      const Tree expected = model.tree(leaf_points);
      const auto tree = grow(model, leaf_points);
      ASSERT_TRUE(tree) << name << ": " << tree.error().message;
      EXPECT_EQ(tree->child_masks, expected.child_masks) << name;
      EXPECT_EQ(tree->first_resolutions, expected.first_resolutions) << name;
      EXPECT_EQ(tree->counts, expected.counts) << name;
      EXPECT_EQ(tree->size_codes, expected.size_codes) << name;
      const auto same = [](const format::ValueSummary& a, const format::ValueSummary& b) {
        return a.min == b.min && a.max == b.max && a.occupancy == b.occupancy;
      };
      EXPECT_TRUE(std::ranges::equal(tree->summaries, expected.summaries, same)) << name;
    }
  }
}

TEST(IndexStream, RefusesLeavesThatDoNotFollow) {
  const auto leaf = [](double x, int depth, std::size_t resolutions = 2, std::size_t attributes = 1) {
    return IndexLeaf{morton_key(dvec3(x, 0, 0), unit_cube), depth, std::vector<std::uint64_t>(resolutions, 1),
                     std::vector<SplatBounds>(resolutions), std::vector<format::ValueSummary>(attributes)};
  };
  const auto refuses = [&](std::vector<IndexLeaf> leaves) {
    IndexStream stream(unit_cube, 2, 1, [](const format::PackedIndexPage&) -> Status { return {}; });
    Status status;
    for (std::size_t i = 0; i < leaves.size() && status; ++i) status = stream.add(std::move(leaves[i]));
    if (status) status = stream.finish().map([](const format::PackedIndexPage&) {});
    EXPECT_TRUE(status || status.error().code == ErrorCode::invalid_argument);
    return !status;
  };
  EXPECT_FALSE(refuses({leaf(0.1, 0)}));
  EXPECT_FALSE(refuses({leaf(0.1, 1), leaf(0.6, 2), leaf(0.8, 42)}));
  EXPECT_TRUE(refuses({}));
  EXPECT_TRUE(refuses({leaf(0.6, 1), leaf(0.1, 1)}));                // backwards
  EXPECT_TRUE(refuses({leaf(0.1, 2), leaf(0.1, 2)}));                // twice
  EXPECT_TRUE(refuses({leaf(0.1, 1), leaf(0.4, 2)}));                // inside the one before
  EXPECT_TRUE(refuses({leaf(0.1, 2), leaf(0.4, 1), leaf(0.6, 1)}));  // round the one before
  EXPECT_TRUE(refuses({leaf(0.1, 43)}));
  EXPECT_TRUE(refuses({leaf(0.1, -1)}));
  EXPECT_TRUE(refuses({leaf(0.1, 0, 3)}));
  EXPECT_TRUE(refuses({leaf(0.1, 0, 2, 2)}));
}

// The leaves need more than one read of the file. Levels from the finest on become resolutions from the coarsest on.
TEST(IndexLeafSpool, GivesLeavesBackByResolution) {
  constexpr std::size_t leaves = 20'000, resolutions = 5;
  IndexLeafSpool spool(testing::TempDir());
  const auto make = [](std::size_t k) {
    OpenIndexLeaf leaf;
    leaf.key = {k, ~k};
    leaf.depth = static_cast<int>(k % 43);
    for (std::size_t level = 0; level < k % (resolutions + 1); ++level) leaf.count(level, k + level);
    for (std::size_t level = 0; level < k % resolutions; ++level)
      leaf.splats_at(level).width = static_cast<double>(100 * k + level);
    leaf.summaries = {{static_cast<float>(k), 0, k}, {1, 2, 3}};
    return leaf;
  };
  for (std::size_t k = 0; k < leaves; ++k) ASSERT_TRUE(spool.append(make(k)));
  std::size_t next = 0;
  ASSERT_TRUE(spool.read(resolutions, {}, [&](IndexLeaf leaf) -> Status {
    OpenIndexLeaf expected = make(next++);
    EXPECT_EQ(leaf.key, expected.key);
    EXPECT_EQ(leaf.depth, expected.depth);
    expected.counts.resize(resolutions);
    expected.splats.resize(resolutions);
    EXPECT_TRUE(std::equal(leaf.counts.rbegin(), leaf.counts.rend(), expected.counts.begin(), expected.counts.end()));
    for (std::size_t r = 0; r < resolutions; ++r)
      EXPECT_EQ(leaf.splats.at(r).width, expected.splats[resolutions - 1 - r].width);
    EXPECT_EQ(leaf.summaries.size(), 2u);
    EXPECT_EQ(leaf.summaries[0].occupancy, expected.summaries[0].occupancy);
    return {};
  }));
  EXPECT_EQ(next, leaves);
}

}  // namespace
}  // namespace splatvol::test
