#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <map>
#include <numeric>
#include <random>

#include "builder/points/batch_cutter.h"
#include "builder/points/held_points.h"
#include "builder/points/point_stream.h"
#include "builder/reduction/batch_reduction.h"
#include "builder/reduction/cascade.h"
#include "builder/sorting/octree_nodes.h"
#include "tests/builder/support/piece_source.h"
#include "tests/builder/support/point_sets.h"
#include "tests/builder/support/random_material.h"
#include "tests/support/random.h"
#include "tests/support/whole_material.h"
#include "tests/support/whole_points.h"
#include "tests/support/whole_reduction.h"

namespace splatvol::test {
namespace {

std::vector<dvec3> random_points(
    std::size_t count, const std::function<double(double)>& shape = [](double x) { return x; }) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<dvec3> points(count);
  for (dvec3& p : points) p = {shape(uniform(random)), shape(uniform(random)), shape(uniform(random))};
  return points;
}

// Distributions that have broken an octree before.
std::map<std::string, std::vector<dvec3>> hard_cases() {
  std::map<std::string, std::vector<dvec3>> cases;
  cases["uniform"] = random_points(5000);
  cases["nine decades"] = random_points(5000, [](double x) { return std::pow(10.0, -9 * x); });
  cases["line"] = random_points(3000);
  for (dvec3& p : cases["line"]) p = {p.x, 0.3, 0.7};
  cases["plane"] = random_points(3000);
  for (dvec3& p : cases["plane"]) p.z = 0.5;
  cases["one point"] = {{0.2, 0.4, 0.6}};
  cases["all equal"] = std::vector<dvec3>(2000, dvec3(0.1, 0.2, 0.3));
  cases["two clusters"] = random_points(2000);
  for (std::size_t i = 0; i < 2000; ++i) cases["two clusters"][i] *= 1e-12;
  cases["two clusters"].emplace_back(1, 1, 1);
  cases["half in 1e-9 of the volume"] = random_points(4000);
  for (std::size_t i = 0; i < 2000; ++i) {
    dvec3& p = cases["half in 1e-9 of the volume"][i];
    p = dvec3(0.7, 0.3, 0.6) + 1e-3 * p;
  }
  return cases;
}

TEST(MortonKey, OrdersByInterleavedBitsOfFortyTwoLevels) {
  const dvec3 p{0.3, 0.6, 0.9};
  const auto [x, y, z] = finest_node(p, unit_cube);
  const MortonKey key = morton_key(p, unit_cube);
  for (int depth = 0; depth < max_morton_depth; ++depth) {
    const int bit = max_morton_depth - 1 - depth;
    EXPECT_EQ(octant_at(key, depth), (x >> bit & 1) | (y >> bit & 1) << 1 | (z >> bit & 1) << 2);
  }
}

TEST(MortonKey, CommonDepthIsThatOfTheSmallestSharedNode) {
  for (int depth = 0; depth < max_morton_depth; ++depth) {
    const double edge = std::ldexp(1.0, -depth);
    const dvec3 a{0.25 * edge, 0.25 * edge, 0.25 * edge}, b{0.25 * edge, 0.75 * edge, 0.25 * edge};
    EXPECT_EQ(common_depth(morton_key(a, unit_cube), morton_key(b, unit_cube)), depth);
  }
  EXPECT_EQ(common_depth(morton_key({0.5, 0.5, 0.5}, unit_cube), morton_key({0.5, 0.5, 0.5}, unit_cube)),
            max_morton_depth);
}

TEST(MortonKey, BordersOfTheCubeAreInside) {
  EXPECT_EQ(finest_node({1, 1, 1}, unit_cube)[0], (1ull << max_morton_depth) - 1);
  EXPECT_EQ(finest_node({0, 0, 0}, unit_cube)[0], 0u);
}

TEST(LeafAt, IsTheLeafOfTheDefinition) {
  for (const auto& [name, positions] : hard_cases()) {
    const Sorted sorted = sort_points(positions);
    const std::vector<MortonKey>& keys = sorted.keys;
    const auto key = [&](std::size_t i) -> const MortonKey& { return keys[i]; };
    for (const std::size_t n : {1, 8, 25, 512, 100'000})
      visit_octree(keys, n, [&](std::size_t begin, std::size_t end, int depth, bool leaf) {
        if (!leaf) return;
        const int shared_before = begin == 0 ? -1 : common_depth(keys[begin - 1], keys[begin]);
        const KeyLeaf found = leaf_at(key, begin, keys.size(), n, shared_before);
        ASSERT_EQ(found.end, end) << name << ", N = " << n << ", point " << begin;
        ASSERT_EQ(found.depth, depth) << name << ", N = " << n << ", point " << begin;
      });
  }
}

// A leaf of the coarser octree never lies inside a leaf of the finer one.
TEST(ReduceByOctree, ClustersNest) {
  for (const auto& [name, positions] : hard_cases()) {
    const Sorted sorted = sort_points(positions);
    const auto resolutions = reduce_by_octree(sorted.keys, sorted.positions, unit_cube, 8);
    EXPECT_LE(resolutions.front().size(), coarsest_target) << name;
    for (std::size_t r = 0; r + 1 < resolutions.size(); ++r) {
      const Resolution &coarse = resolutions[r], &fine = resolutions[r + 1];
      ASSERT_EQ(fine.begins.size(), coarse.size() + 1);
      for (std::size_t k = 0; k < coarse.size(); ++k) {
        ASSERT_LE(fine.members[fine.begins[k]], coarse.members[k]) << name;
        ASSERT_GE(fine.members[fine.begins[k + 1] - 1], coarse.members[k]) << name;
        ASSERT_LE(coarse.depths[k], fine.depths[fine.begins[k]]) << name;
      }
    }
  }
}

TEST(ReduceByOctree, KeepsAboutAThirdOfUniformPoints) {
  const Sorted sorted = sort_points(random_points(100'000));
  const auto resolutions = reduce_by_octree(sorted.keys, sorted.positions, unit_cube, 8);
  const double share = static_cast<double>(resolutions[resolutions.size() - 2].size()) / 100'000;
  EXPECT_GT(share, 0.2);
  EXPECT_LT(share, 0.45);
}

void append_parts(const PointBatch& batch, std::vector<NodePart>& parts) {
  for (const NodePart& part : batch.leaf_parts)
    parts.push_back({batch.first + part.begin, batch.first + part.end, part.depth, part.leaf, part.continued});
}

// Batches and the cascade's levels, of points with random material. A point's number is its index in Morton order, and
// its value.
struct Streamed {
  struct Level {
    std::vector<std::uint64_t> members;
    std::vector<int> node_depths;     // [member]; empty at level 0
    std::vector<StoredSplat> splats;  // [member]
    Material material;                // empty at level 0
  };

  Cube cube;
  PointBatch points;
  std::vector<NodePart> leaf_parts;  // begin and end counted from the first point of all
  std::vector<Level> levels = std::vector<Level>(1);
  std::vector<std::vector<std::size_t>> ends;  // [point]: levels that are its last
  std::vector<std::uint64_t> counts;           // [level]

  Streamed(std::vector<dvec3> positions, std::uint32_t leaf_points, std::size_t index_leaf_points,
           Reduction method = Reduction::octree) {
    ends.resize(positions.size());
    attribute_.min = 0;
    attribute_.max = static_cast<double>(positions.size());
    PieceSource source({scattered(std::move(positions))});
    WholePoints whole = *read_points(source, false, 1 << 20);
    cube = whole.summary.cube;
    points = std::move(whole.points);
    randomize_material(points);
    std::iota(points.values[0].begin(), points.values[0].end(), 0.0);
    reduce({.cube = cube,
            .leaf_points = leaf_points,
            .reduces = points.size() > coarsest_target,
            .attributes = std::span(&attribute_, 1),
            .method = method},
           index_leaf_points);
    for (std::uint64_t i = 0; i < points.size(); ++i) levels[0].members.push_back(i);
  }

 private:
  static std::uint64_t number(const Member& member) { return static_cast<std::uint64_t>(member.values()[0].value); }

  void reduce(const ReductionSettings& settings, std::size_t index_leaf_points) {
    Cascade cascade(
        cube, settings.method, settings.leaf_points, settings.attributes,
        {[this](std::size_t level, const Member& member, int node_depth) { add_splat(level, member, node_depth); },
         [this](std::size_t level, const Member& member) { ends[number(member)].push_back(level); }});
    BatchCutter batches(stream_of(points), 1, index_leaf_points);
    PointBatch batch;
    ReducedBatch reduced(1);
    while (*batches.next(batch)) {
      EXPECT_EQ(batch.first, levels[0].splats.size());
      append_parts(batch, leaf_parts);
      find_leaves(batch, settings, reduced);
      reduce_batch(batch, settings, reduced);
      add(batch, reduced, cascade);
      reduced.clear();
    }
    cascade.finish();
    counts = cascade.counts();
    counts.insert(counts.begin(), levels[0].splats.size());
  }

  void add(const PointBatch& batch, ReducedBatch& reduced, Cascade& cascade) {
    levels[0].splats.resize(batch.first + batch.size());
    const SplatColumns::Splats& columns = reduced.tail.splats;
    for (std::size_t k = 0; k < reduced.tail.size(); ++k) {
      const auto i = static_cast<std::size_t>(reduced.tail.point_values[0].values[k]);
      levels[0].splats[i] = {columns.centroids[k], 0, columns.shapes[k], columns.depths[k], columns.counts[k]};
      ends[i].push_back(0);
    }
    std::size_t m = 0;
    for (std::size_t p = 0; p < batch.leaf_parts.size(); ++p)
      for (; m < reduced.leaf_parts[p].members_end; ++m) {
        if (batch.leaf_parts[p].continued) {
          cascade.add_to_last(reduced.members[m]);
        } else {
          levels[0].splats[number(reduced.members[m])] = reduced.members[m].splat(0);
          cascade.push(reduced.members[m]);
        }
      }
  }

  void add_splat(std::size_t level, const Member& member, int node_depth) {
    EXPECT_EQ(member.levels, level + 1);
    EXPECT_EQ(member.number, number(member));
    EXPECT_EQ(member.point.position, points.positions[number(member)]);
    levels.resize(std::max(levels.size(), level + 1));
    Level& at = levels[level];
    at.members.push_back(number(member));
    at.node_depths.push_back(node_depth);
    at.splats.push_back(member.splat(level));
    at.material.moments.push_back(member.moments);
    at.material.planes.push_back(member.plane);
    at.material.value_moments.resize(1);
    at.material.value_moments[0].push_back(member.values()[0].moments);
  }

  format::Attribute attribute_;
};

// The same numbers may be added in another order.
constexpr double rounding = 1e-12;

void expect_near(const dvec3& a, const dvec3& b, double scale) {
  ASSERT_LE(glm::length(a - b), rounding * scale) << glm::length(b);
}

void expect_same(const SpatialMoments& a, const SpatialMoments& b) {
  ASSERT_LE(std::abs(a.mass - b.mass), rounding * b.mass);
  const SymmetricMatrix &s = a.covariance, &t = b.covariance;
  const double square = t.xx + t.yy + t.zz;
  expect_near(a.centroid, b.centroid, std::sqrt(square) + glm::length(b.centroid));
  expect_near({s.xx, s.yy, s.zz}, {t.xx, t.yy, t.zz}, square);
  expect_near({s.xy, s.xz, s.yz}, {t.xy, t.xz, t.yz}, square);
}

void expect_same(const ValueMoments& a, const ValueMoments& b, const SpatialMoments& all) {
  ASSERT_LE(std::abs(a.mass - b.mass), rounding * b.mass);
  ASSERT_EQ(a.min, b.min);
  ASSERT_EQ(a.max, b.max);
  const SymmetricMatrix& s = all.covariance;
  const double size = std::sqrt(s.xx + s.yy + s.zz) + glm::length(all.centroid);
  expect_near(a.centroid, b.centroid, size);
  ASSERT_LE(std::abs(a.mean - b.mean), rounding);  // values are up to 1
  ASSERT_LE(std::abs(a.variance - b.variance), rounding);
  expect_near(a.covariance, b.covariance, size);
}

void expect_same(const BoundaryPlane& a, const BoundaryPlane& b) {
  expect_near(a.area, b.area, glm::length(b.area));
  ASSERT_LE(std::abs(a.offset - b.offset), rounding * (std::abs(b.offset) + glm::length(b.area)));
}

// The index leaves are those of the octree. Points that are more than a leaf may hold follow in parts.
void expect_leaves_of_definition(std::span<const NodePart> parts, std::span<const MortonKey> keys,
                                 std::size_t index_leaf_points) {
  std::size_t p = 0;
  std::uint64_t leaf = 0;
  visit_octree(keys, index_leaf_points, [&](std::size_t begin, std::size_t end, int depth, bool is_leaf) {
    if (!is_leaf || testing::Test::HasFatalFailure()) return;
    for (std::size_t at = begin; at < end && p < parts.size(); ++p) {
      const NodePart& part = parts[p];
      ASSERT_EQ(part.begin, at);
      ASSERT_GT(part.end, at);
      ASSERT_LE(part.end, std::min(at + index_leaf_points, end));
      ASSERT_EQ(part.depth, depth);
      ASSERT_EQ(part.leaf, leaf);
      ASSERT_EQ(part.continued, at > begin);
      at = part.end;
    }
    ++leaf;
  });
  EXPECT_EQ(p, parts.size());
  EXPECT_EQ(parts.back().end, keys.size());
}

void expect_same_level(const Streamed& streamed, std::size_t level, const Resolution& resolution,
                       const Material& material) {
  const Streamed::Level& at = streamed.levels[level];
  ASSERT_EQ(at.members, resolution.members);
  ASSERT_EQ(streamed.counts[level], resolution.size());
  const std::vector<StoredSplat> splats = splats_of(streamed.points.positions, resolution, material);
  for (std::size_t m = 0; m < resolution.size(); ++m) {
    ASSERT_EQ(at.splats[m].depth, resolution.depths[m]);
    ASSERT_EQ(at.splats[m].count, resolution.counts[m]) << m;
    ASSERT_LE(std::abs(at.splats[m].shape.mass - splats[m].shape.mass), rounding * splats[m].shape.mass);
    expect_near(at.splats[m].centroid, splats[m].centroid, 1);
    expect_near(at.splats[m].shape.boundary, splats[m].shape.boundary, 1e4);  // 1e-4 is the thinnest axis
    if (level == 0) continue;
    expect_same(at.material.moments[m], material.moments[m]);
    expect_same(at.material.value_moments[0][m], material.value_moments[0][m], material.moments[m]);
    // Which group of many planes is the largest depends on the order of merging.
    const bool in_parts = at.splats[m].depth == max_morton_depth || resolution.size() == 1;
    if (!in_parts) expect_same(at.material.planes[m], material.planes[m]);
  }
}

void expect_same_reduction(const Streamed& streamed, std::uint32_t leaf_points) {
  const PointBatch& points = streamed.points;
  const auto resolutions = reduce_by_octree(points.keys, points.positions, streamed.cube, leaf_points);
  const auto materials = merge_clusters(points.positions, resolutions, material_of(points));
  const auto segments = find_segments(resolutions);
  const std::size_t last = resolutions.size() - 1;
  ASSERT_EQ(streamed.levels.size(), resolutions.size());
  ASSERT_EQ(streamed.counts.size(), resolutions.size());
  for (std::size_t i = 0; i < points.size(); ++i)
    ASSERT_EQ(streamed.ends[i], std::vector<std::size_t>{last - segments[i]}) << "point " << i;
  for (std::size_t level = 0; level <= last; ++level) {
    SCOPED_TRACE("level " + std::to_string(level));
    const Resolution& resolution = resolutions[last - level];
    expect_same_level(streamed, level, resolution, materials[last - level]);
  }
}

void expect_batches_of_definition(const std::vector<dvec3>& positions) {
  for (const std::size_t index_leaf_points : {8, 100, 512, 30'000}) {
    SCOPED_TRACE("at most " + std::to_string(index_leaf_points));
    PieceSource source({scattered(positions)});
    PointStream stream = *PointStream::create(source, false, 1 << 24, testing::TempDir(), [](double) {});
    BatchCutter batches([&](PointBatch& points) { return stream.next(points); }, 1, index_leaf_points);
    std::vector<MortonKey> keys;
    std::vector<NodePart> leaf_parts;
    PointBatch batch;
    while (*batches.next(batch)) {
      ASSERT_EQ(batch.first, keys.size());
      keys.insert(keys.end(), batch.keys.begin(), batch.keys.end());
      append_parts(batch, leaf_parts);
    }
    ASSERT_EQ(keys.size(), positions.size());
    expect_leaves_of_definition(leaf_parts, keys, index_leaf_points);
  }
}

// Clusters of all sizes, some of coincident points, so that batches end anywhere in the octree.
TEST(BatchCutter, IndexLeavesAreThoseOfTheDefinition) {
  std::mt19937_64 random(9);
  std::uniform_real_distribution<double> uniform(0, 1);
  const auto anywhere = [&] { return random_vector(uniform, random); };
  for (int round = 0; round < 4; ++round) {
    SCOPED_TRACE("round " + std::to_string(round));
    std::vector<dvec3> positions = {{0, 0, 0}, {1, 1, 1}};
    while (positions.size() < 300'000) {
      const dvec3 corner = 0.5 * anywhere();
      const double size = uniform(random) < 0.05 ? 0 : 0.5 * std::pow(10.0, -9 * uniform(random));
      const auto count = static_cast<std::size_t>(std::pow(10.0, 4.5 * uniform(random)));
      for (std::size_t i = 0; i < count; ++i) positions.push_back(corner + size * anywhere());
    }
    expect_batches_of_definition(positions);
    if (HasFatalFailure()) return;
  }
}

// Batches end anywhere. Some end with the first octant of a node that is split because of the points behind.
TEST(BatchCutter, BatchesMayEndWithAFewPointsOfALargeNode) {
  std::vector<dvec3> positions = random_points(65'530, [](double x) { return 0.49 * x; });
  for (const auto& [count, low] : {std::pair{10, 0.5}, {20'000, 0.75}})
    for (const dvec3& p : random_points(static_cast<std::size_t>(count), [low](double x) { return low + 0.25 * x; }))
      positions.push_back(p);
  positions.insert(positions.end(), {{0, 0, 0}, {1, 1, 1}});
  expect_batches_of_definition(positions);
}

TEST(Cascade, GivesTheReductionOfTheDefinition) {
  for (const auto& [name, positions] : hard_cases())
    for (const auto& [leaf_points, index_leaf_points] :
         {std::pair{8u, 8u}, {8u, 300u}, {8u, 512u}, {20u, 20u}, {20u, 10'000u}, {600u, 600u}}) {
      SCOPED_TRACE(name + ", " + std::to_string(leaf_points) + " and " + std::to_string(index_leaf_points));
      const Streamed streamed(positions, leaf_points, index_leaf_points);
      expect_leaves_of_definition(streamed.leaf_parts, streamed.points.keys, index_leaf_points);
      // The first part of a leaf decides for all of it. That gives the same reduction only if all points coincide and
      // their count is full.
      const bool in_parts = std::ranges::any_of(streamed.leaf_parts, &NodePart::continued);
      if (!in_parts || (name == "all equal" && index_leaf_points > 255)) expect_same_reduction(streamed, leaf_points);
      if (HasFatalFailure()) return;
    }
}

// Visits the leaves of the octree over a level's members.
void visit_leaves(const Streamed& streamed, const Streamed::Level& level, std::size_t leaf_points,
                  const std::function<void(std::size_t begin, std::size_t end, int depth)>& visit) {
  std::vector<MortonKey> keys;
  for (const std::uint64_t i : level.members) keys.push_back(streamed.points.keys[i]);
  visit_octree(keys, leaf_points, [&](std::size_t begin, std::size_t end, int depth, bool leaf) {
    if (leaf) visit(begin, end, depth);
  });
}

// Reduces a level's nodes by the definition: the members that stay, and the material of each.
Streamed::Level reduce_nodes(const Streamed& streamed, const Streamed::Level& level, const Material& material,
                             Reduction method, std::uint32_t leaf_points, std::size_t node_points) {
  Streamed::Level coarser;
  coarser.material.value_moments.resize(1);
  visit_leaves(streamed, level, node_points, [&](std::size_t begin, std::size_t end, int) {
    std::vector<MortonKey> keys;
    std::vector<dvec3> positions;
    for (std::size_t m = begin; m < end; ++m) {
      keys.push_back(streamed.points.keys[level.members[m]]);
      positions.push_back(streamed.points.positions[level.members[m]]);
    }
    std::vector<std::uint32_t> owners(end - begin);
    find_clusters(method, leaf_points, keys, positions, owners);
    for (std::size_t kept = 0; kept < owners.size(); ++kept) {
      if (owners[kept] != kept) continue;
      SpatialMoments moments;
      ValueMoments values;
      std::vector<BoundaryPlane> planes;
      std::vector<dvec3> shifts;
      for (std::size_t m = 0; m < owners.size(); ++m) {
        if (owners[m] != kept) continue;
        shifts.push_back(positions[m] - positions[kept]);
        merge(moments, material.moments[begin + m], shifts.back());
        merge(values, material.value_moments[0][begin + m], shifts.back());
        planes.push_back(material.planes[begin + m]);
      }
      coarser.members.push_back(level.members[begin + kept]);
      coarser.material.moments.push_back(moments);
      coarser.material.value_moments[0].push_back(values);
      coarser.material.planes.push_back(merge_planes(planes, shifts));
    }
  });
  return coarser;
}

// The octree's leaves do not depend on the clusters.
void expect_octants(const Streamed& streamed, const Streamed::Level& at, std::uint32_t leaf_points) {
  visit_leaves(streamed, at, leaf_points, [&](std::size_t begin, std::size_t end, int depth) {
    for (std::size_t m = begin; m < end; ++m) {
      ASSERT_EQ(at.splats[m].depth, depth);
      ASSERT_EQ(at.splats[m].count, std::min<std::size_t>(end - begin, 255));
    }
  });
}

void expect_same_members(const Streamed::Level& level, const Streamed::Level& expected) {
  ASSERT_EQ(level.members, expected.members);
  for (std::size_t m = 0; m < expected.members.size(); ++m) {
    expect_same(level.material.moments[m], expected.material.moments[m]);
    expect_same(level.material.value_moments[0][m], expected.material.value_moments[0][m],
                expected.material.moments[m]);
    expect_same(level.material.planes[m], expected.material.planes[m]);
  }
}

void expect_nodes_reduced(const Streamed& streamed, Reduction method, std::uint32_t leaf_points,
                          std::size_t index_leaf_points) {
  const std::size_t last = streamed.levels.size() - 1;
  ASSERT_LE(streamed.counts[last], coarsest_target);
  Material material = material_of(streamed.points);
  for (std::size_t level = 0; level <= last; ++level) {
    SCOPED_TRACE("level " + std::to_string(level));
    const Streamed::Level& at = streamed.levels[level];
    ASSERT_EQ(at.splats.size(), streamed.counts[level]);
    expect_octants(streamed, at, leaf_points);
    if (level == last) break;
    const std::size_t node_points =
        std::min<std::size_t>(most_in_reduction_node(method, leaf_points), level == 0 ? index_leaf_points : -1);
    if (level > 0)
      visit_leaves(streamed, at, node_points, [&](std::size_t begin, std::size_t end, int depth) {
        for (std::size_t m = begin; m < end; ++m) ASSERT_EQ(at.node_depths[m], depth);
      });
    const Streamed::Level& coarser = streamed.levels[level + 1];
    ASSERT_LT(coarser.members.size(), at.members.size());
    expect_same_members(coarser, reduce_nodes(streamed, at, material, method, leaf_points, node_points));
    for (const std::uint64_t i : at.members) {
      const bool stays = std::ranges::binary_search(coarser.members, i);
      ASSERT_EQ(streamed.ends[i] == std::vector<std::size_t>{level}, !stays) << "point " << i;
    }
    material = coarser.material;
  }
  for (const std::uint64_t i : streamed.levels[last].members)
    ASSERT_EQ(streamed.ends[i], std::vector<std::size_t>{last}) << "point " << i;
}

TEST(Cascade, ReducesNodesByTheirClusters) {
  for (const auto& [name, positions] : hard_cases())
    for (const Reduction method : {Reduction::mis, Reduction::kdtree})
      for (const auto& [leaf_points, index_leaf_points] :
           {std::pair{8u, 300u}, {8u, 512u}, {20u, 3000u}, {600u, 600u}}) {
        SCOPED_TRACE(name + ", " + reduction_name(method) + ", " + std::to_string(leaf_points) + " and " +
                     std::to_string(index_leaf_points));
        const Streamed streamed(positions, leaf_points, index_leaf_points, method);
        if (name != "all equal") expect_nodes_reduced(streamed, method, leaf_points, index_leaf_points);
        if (HasFatalFailure()) return;
      }
}

// Thousands of points, coincident or not, lie in one of the smallest nodes: more than an index leaf may hold.
TEST(Cascade, LeavesInPartsKeepAllPointsAndTheirMass) {
  for (const auto& [method, apart] : {std::pair{Reduction::octree, 0.0},
                                      {Reduction::octree, 0x1p-50},
                                      {Reduction::mis, 0x1p-50},
                                      {Reduction::kdtree, 0.0}})
    for (const std::size_t index_leaf_points : {300, 512, 2999, 3000, 3001}) {
      SCOPED_TRACE(std::to_string(apart) + " apart, at most " + std::to_string(index_leaf_points) + ", " +
                   reduction_name(method));
      std::vector<dvec3> positions = random_points(1000);
      positions.insert(positions.end(), {{0, 0, 0}, {1, 1, 1}});
      for (int i = 0; i < 3000; ++i) positions.emplace_back(0.25 + apart * (i % 256), 0.25, 0.25);
      const Streamed streamed(positions, 8, index_leaf_points, method);
      expect_leaves_of_definition(streamed.leaf_parts, streamed.points.keys, index_leaf_points);

      ASSERT_GE(streamed.levels.size(), 2u);
      for (const auto& ends : streamed.ends) ASSERT_EQ(ends.size(), 1u);
      std::size_t in_one_node = 0;
      for (std::size_t i = 0; i < positions.size(); ++i) {
        if (glm::length(streamed.points.positions[i] - 0.25) > 1e-9) continue;
        ++in_one_node;
        EXPECT_EQ(streamed.levels[0].splats[i].count, 255);
        EXPECT_EQ(streamed.levels[0].splats[i].depth, max_morton_depth);
      }
      ASSERT_EQ(in_one_node, 3000u);
      const auto mass = [](const auto& moments) {
        return std::accumulate(moments.begin(), moments.end(), 0.0,
                               [](double sum, const auto& moment) { return sum + moment.mass; });
      };
      for (std::size_t level = 1; level < streamed.levels.size(); ++level) {
        EXPECT_EQ(streamed.levels[level].members.size(), streamed.counts[level]);
        const Material& material = streamed.levels[level].material;
        EXPECT_NEAR(mass(material.moments) / mass(streamed.points.moments), 1, rounding);
        EXPECT_NEAR(mass(material.value_moments[0]) / mass(streamed.points.value_moments[0]), 1, rounding);
      }
    }
}

}  // namespace
}  // namespace splatvol::test
