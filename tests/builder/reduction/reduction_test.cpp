#include "tests/builder/support/point_sets.h"
#include "tests/support/whole_reduction.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <map>
#include <numeric>
#include <random>

#include "builder/points/batches.h"
#include "builder/reduction/batch_reduction.h"
#include "builder/reduction/cascade.h"
#include "tests/builder/support/piece_source.h"
#include "tests/builder/support/random_material.h"
#include "tests/support/whole_material.h"

namespace splatvol {
namespace {

using test::sort_points;
using test::Sorted;
using test::unit_cube;

std::vector<dvec3> random_points(
    std::size_t count, const std::function<double(double)>& shape = [](double x) { return x; }) {
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<dvec3> points(count);
  for (dvec3& p : points) p = {shape(uniform(random)), shape(uniform(random)), shape(uniform(random))};
  return points;
}

// Every distribution that has broken an octree before.
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

TEST(MortonKey, CommonDepthIsTheSmallestSharedCell) {
  for (int depth = 0; depth < max_morton_depth; ++depth) {
    const double cell = std::ldexp(1.0, -depth);
    const dvec3 a{0.25 * cell, 0.25 * cell, 0.25 * cell}, b{0.25 * cell, 0.75 * cell, 0.25 * cell};
    EXPECT_EQ(common_depth(morton_key(a, unit_cube), morton_key(b, unit_cube)), depth);
  }
  EXPECT_EQ(common_depth(morton_key({0.5, 0.5, 0.5}, unit_cube), morton_key({0.5, 0.5, 0.5}, unit_cube)),
            max_morton_depth);
}

TEST(MortonKey, BordersOfTheCubeAreInside) {
  EXPECT_EQ(finest_node({1, 1, 1}, unit_cube)[0], (1ull << max_morton_depth) - 1);
  EXPECT_EQ(finest_node({0, 0, 0}, unit_cube)[0], 0u);
}

TEST(LeafDepth, IsThatOfTheDefinition) {
  for (const auto& [name, positions] : hard_cases()) {
    const Sorted sorted = sort_points(positions);
    const std::vector<MortonKey>& keys = sorted.keys;
    for (const std::size_t n : {1, 8, 25, 512, 100'000})
      test::visit_octree(keys, n, [&](std::size_t begin, std::size_t, int depth, bool leaf) {
        if (!leaf) return;
        const int shared = begin == 0 ? -1 : common_depth(keys[begin - 1], keys[begin]);
        const MortonKey* beyond = begin + n < keys.size() ? &keys[begin + n] : nullptr;
        ASSERT_EQ(leaf_depth(shared, keys[begin], beyond), depth) << name << ", N = " << n << ", point " << begin;
      });
  }
}

// A leaf of the coarser octree never lies inside a leaf of the finer one.
TEST(ReduceByOctree, ClustersNest) {
  for (const auto& [name, positions] : hard_cases()) {
    const Sorted sorted = sort_points(positions);
    const auto resolutions = test::reduce_by_octree(sorted.keys, sorted.positions, unit_cube, 8);
    EXPECT_LE(resolutions.front().size(), coarsest_target) << name;
    for (std::size_t r = 0; r + 1 < resolutions.size(); ++r) {
      const test::Resolution &coarse = resolutions[r], &fine = resolutions[r + 1];
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
  const auto resolutions = test::reduce_by_octree(sorted.keys, sorted.positions, unit_cube, 8);
  const double share = static_cast<double>(resolutions[resolutions.size() - 2].size()) / 100'000;
  EXPECT_GT(share, 0.2);
  EXPECT_LT(share, 0.45);
}

// What the cells of a stream and the cascade make of points with random material. Points are named by their place in
// Morton order, which is also their value.
struct Streamed {
  struct Level {
    std::vector<std::uint64_t> members;
    std::vector<int> node_depths;  // [member]; empty at level 0
    std::vector<StoredSplat> splats;  // [member]
    test::Material material;       // empty at level 0
  };

  Cube cube;
  PointBatch points;
  std::vector<NodePart> cells;  // begin and end counted from the first point of all
  std::vector<Level> levels = std::vector<Level>(1);
  std::vector<std::vector<std::size_t>> ends;  // [point]: levels that are its last
  std::vector<std::uint64_t> counts;           // [level]

  Streamed(std::vector<dvec3> positions, std::uint32_t leaf_points, std::size_t index_leaf_points,
           Reduction method = Reduction::octree) {
    ends.resize(positions.size());
    attribute_.min = 0;
    attribute_.max = static_cast<double>(positions.size());
    test::PieceSource source({test::scattered(std::move(positions))});
    PointStream stream = *PointStream::create(source, false, 1 << 20, testing::TempDir(), [](double) {});
    cube = stream.summary().cube;
    Batches batches(stream, index_leaf_points);
    EXPECT_TRUE(batches.hold_all([&](PointBatch& all) -> Status {
      test::randomize_material(all);
      std::iota(all.values[0].begin(), all.values[0].end(), 0.0);
      points = all;
      return {};
    }));
    Cascade cascade(
        cube, method, leaf_points, {0}, pool_,
        {[this](std::size_t level, const Member& member, int node_depth) { add_splat(level, member, node_depth); },
         [this](std::size_t level, const Member& member) { ends[id(member)].push_back(level); }});
    const double offset = 0;
    const ReductionSettings settings{.cube = cube,
                                     .leaf_points = leaf_points,
                                     .reduces = points.size() > coarsest_target,
                                     .wants_splats = true,
                                     .attributes = std::span(&attribute_, 1),
                                     .offsets = std::span(&offset, 1),
                                     .method = method};
    PointBatch batch;
    ReducedBatch reduced(1);
    while (*batches.next(batch)) {
      EXPECT_EQ(batch.first, levels[0].splats.size());
      for (const NodePart& cell : batch.cells)
        cells.push_back({batch.first + cell.begin, batch.first + cell.end, cell.depth, cell.leaf, cell.continued});
      find_leaves(batch, settings, reduced);
      reduce_batch(batch, settings, pool_, reduced);
      take(batch, reduced, cascade);
      reduced.clear();
    }
    cascade.finish();
    counts = cascade.counts();
    counts.insert(counts.begin(), levels[0].splats.size());
    for (std::uint64_t i = 0; i < points.size(); ++i) levels[0].members.push_back(i);
  }

 private:
  static std::uint64_t id(const Member& member) { return static_cast<std::uint64_t>(member.values[0].value); }

  void take(const PointBatch& batch, ReducedBatch& reduced, Cascade& cascade) {
    levels[0].splats.insert(levels[0].splats.end(), reduced.splats.begin(), reduced.splats.end());
    for (const float i : reduced.finest.point_values[0].values) ends[static_cast<std::size_t>(i)].push_back(0);
    std::size_t m = 0;
    for (std::size_t c = 0; c < batch.cells.size(); ++c)
      for (; m < reduced.cells[c].members_end; ++m) {
        if (batch.cells[c].continued)
          cascade.add_to_last(*reduced.members[m]);
        else
          cascade.push(std::move(reduced.members[m]));
      }
    if (batch.first % 2 == 0) cascade.advance();  // sometimes; what comes of it does not depend on it
  }

  void add_splat(std::size_t level, const Member& member, int node_depth) {
    EXPECT_EQ(member.splats.size(), level + 1);
    EXPECT_EQ(member.stored_values.size(), level + 1);
    EXPECT_EQ(member.point.position, points.positions[id(member)]);
    levels.resize(std::max(levels.size(), level + 1));
    Level& at = levels[level];
    at.members.push_back(id(member));
    at.node_depths.push_back(node_depth);
    at.splats.push_back(member.splats[level]);
    at.material.moments.push_back(member.moments);
    at.material.planes.push_back(member.plane);
    at.material.value_moments.resize(1);
    at.material.value_moments[0].push_back(member.values[0].moments);
  }

  format::Attribute attribute_;
  MemberPool pool_;
};

// Sums of the same numbers in perhaps another order.
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

// The cells are those of the octree, and what is too much for one follows in parts.
void expect_leaves_of_definition(std::span<const NodePart> cells, std::span<const MortonKey> keys,
                                std::size_t index_leaf_points) {
  std::size_t c = 0;
  std::uint64_t leaf = 0;
  test::visit_octree(keys, index_leaf_points, [&](std::size_t begin, std::size_t end, int depth, bool is_leaf) {
    if (!is_leaf || testing::Test::HasFatalFailure()) return;
    for (std::size_t at = begin; at < end && c < cells.size(); ++c) {
      const NodePart& cell = cells[c];
      ASSERT_EQ(cell.begin, at);
      ASSERT_GT(cell.end, at);
      ASSERT_LE(cell.end, std::min(at + index_leaf_points, end));
      ASSERT_EQ(cell.depth, depth);
      ASSERT_EQ(cell.leaf, leaf);
      ASSERT_EQ(cell.continued, at > begin);
      at = cell.end;
    }
    ++leaf;
  });
  EXPECT_EQ(c, cells.size());
  EXPECT_EQ(cells.back().end, keys.size());
}

void expect_same_level(const Streamed& streamed, std::size_t level, const test::Resolution& resolution,
                       const test::Material& material) {
  const Streamed::Level& at = streamed.levels[level];
  ASSERT_EQ(at.members, resolution.members);
  ASSERT_EQ(streamed.counts[level], resolution.size());
  const std::vector<StoredSplat> splats = test::splats_of(streamed.points.positions, resolution, material);
  for (std::size_t m = 0; m < resolution.size(); ++m) {
    ASSERT_EQ(at.splats[m].number, m);
    ASSERT_EQ(at.splats[m].depth, resolution.depths[m]);
    ASSERT_EQ(at.splats[m].count, resolution.counts[m]) << m;
    ASSERT_LE(std::abs(at.splats[m].shape.mass - splats[m].shape.mass), rounding * splats[m].shape.mass);
    expect_near(at.splats[m].centroid, splats[m].centroid, 1);
    expect_near(at.splats[m].shape.boundary, splats[m].shape.boundary, 1e4);  // 1e-4 is the thinnest axis
    if (level == 0) continue;
    expect_same(at.material.moments[m], material.moments[m]);
    expect_same(at.material.value_moments[0][m], material.value_moments[0][m], material.moments[m]);
    // What of many planes is the largest group depends on which are merged first.
    const bool in_parts = at.splats[m].depth == max_morton_depth || resolution.size() == 1;
    if (!in_parts) expect_same(at.material.planes[m], material.planes[m]);
  }
}

void expect_same_reduction(const Streamed& streamed, std::uint32_t leaf_points) {
  const PointBatch& points = streamed.points;
  const auto resolutions = test::reduce_by_octree(points.keys, points.positions, streamed.cube, leaf_points);
  const auto materials = test::merge_clusters(points.positions, resolutions, test::material_of(points));
  const auto segments = test::find_segments(resolutions);
  const std::size_t last = resolutions.size() - 1;
  ASSERT_EQ(streamed.levels.size(), resolutions.size());
  ASSERT_EQ(streamed.counts.size(), resolutions.size());
  for (std::size_t i = 0; i < points.size(); ++i)
    ASSERT_EQ(streamed.ends[i], std::vector<std::size_t>{last - segments[i]}) << "point " << i;
  for (std::size_t level = 0; level <= last; ++level) {
    SCOPED_TRACE("level " + std::to_string(level));
    const test::Resolution& resolution = resolutions[last - level];
    expect_same_level(streamed, level, resolution, materials[last - level]);
  }
}

void expect_batches_of_definition(const std::vector<dvec3>& positions) {
  for (const std::size_t index_leaf_points : {8, 100, 512, 30'000}) {
    SCOPED_TRACE("at most " + std::to_string(index_leaf_points));
    test::PieceSource source({test::scattered(positions)});
    PointStream stream = *PointStream::create(source, false, 1 << 24, testing::TempDir(), [](double) {});
    Batches batches(stream, index_leaf_points);
    std::vector<MortonKey> keys;
    std::vector<NodePart> cells;
    PointBatch batch;
    while (*batches.next(batch)) {
      ASSERT_EQ(batch.first, keys.size());
      keys.insert(keys.end(), batch.keys.begin(), batch.keys.end());
      for (const NodePart& cell : batch.cells)
        cells.push_back({batch.first + cell.begin, batch.first + cell.end, cell.depth, cell.leaf, cell.continued});
    }
    ASSERT_EQ(keys.size(), positions.size());
    expect_leaves_of_definition(cells, keys, index_leaf_points);
  }
}

// Clusters of all sizes, some of coincident points, so that batches end anywhere in the octree.
TEST(Batches, CellsAreThoseOfTheDefinition) {
  std::mt19937_64 random(9);
  std::uniform_real_distribution<double> uniform(0, 1);
  const auto place = [&] { return dvec3(uniform(random), uniform(random), uniform(random)); };
  for (int round = 0; round < 4; ++round) {
    SCOPED_TRACE("round " + std::to_string(round));
    std::vector<dvec3> positions = {{0, 0, 0}, {1, 1, 1}};
    while (positions.size() < 300'000) {
      const dvec3 corner = 0.5 * place();
      const double size = uniform(random) < 0.05 ? 0 : 0.5 * std::pow(10.0, -9 * uniform(random));
      const auto count = static_cast<std::size_t>(std::pow(10.0, 4.5 * uniform(random)));
      for (std::size_t i = 0; i < count; ++i) positions.push_back(corner + size * place());
    }
    expect_batches_of_definition(positions);
    if (HasFatalFailure()) return;
  }
}

// Batches that end anywhere, some with the first octant of a cell that must be split for what follows.
TEST(Batches, MayEndWithAFewPointsOfALargeCell) {
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
      expect_leaves_of_definition(streamed.cells, streamed.points.keys, index_leaf_points);
      // The first part of a cell decides for all: the same only where all points are in one place and the count is
      // full.
      const bool in_parts = std::ranges::any_of(streamed.cells, &NodePart::continued);
      if (!in_parts || (name == "all equal" && index_leaf_points > 255)) expect_same_reduction(streamed, leaf_points);
      if (HasFatalFailure()) return;
    }
}

// A level's members by the leaves of an octree over them.
void visit_leaves(const Streamed& streamed, const Streamed::Level& level, std::size_t leaf_points,
                  const std::function<void(std::size_t begin, std::size_t end, int depth)>& visit) {
  std::vector<MortonKey> keys;
  for (const std::uint64_t i : level.members) keys.push_back(streamed.points.keys[i]);
  test::visit_octree(keys, leaf_points, [&](std::size_t begin, std::size_t end, int depth, bool leaf) {
    if (leaf) visit(begin, end, depth);
  });
}

// What a level's blocks come to by the definition: who stays, and the material of each.
Streamed::Level reduce_nodes(const Streamed& streamed, const Streamed::Level& level, const test::Material& material,
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

void expect_nodes_reduced(const Streamed& streamed, Reduction method, std::uint32_t leaf_points,
                           std::size_t index_leaf_points) {
  const std::size_t last = streamed.levels.size() - 1;
  ASSERT_LE(streamed.counts[last], coarsest_target);
  test::Material material = test::material_of(streamed.points);
  for (std::size_t level = 0; level <= last; ++level) {
    SCOPED_TRACE("level " + std::to_string(level));
    const Streamed::Level& at = streamed.levels[level];
    ASSERT_EQ(at.splats.size(), streamed.counts[level]);
    // The octree's leaves have nothing to do with the clusters.
    visit_leaves(streamed, at, leaf_points, [&](std::size_t begin, std::size_t end, int depth) {
      for (std::size_t m = begin; m < end; ++m) {
        ASSERT_EQ(at.splats[m].number, m);
        ASSERT_EQ(at.splats[m].depth, depth);
        ASSERT_EQ(at.splats[m].count, std::min<std::size_t>(end - begin, 255));
      }
    });
    if (level == last) break;
    const std::size_t node_points =
        std::min<std::size_t>(most_in_reduction_node(method, leaf_points), level == 0 ? index_leaf_points : -1);
    if (level > 0)
      visit_leaves(streamed, at, node_points, [&](std::size_t begin, std::size_t end, int depth) {
        for (std::size_t m = begin; m < end; ++m) ASSERT_EQ(at.node_depths[m], depth);
      });
    const Streamed::Level expected = reduce_nodes(streamed, at, material, method, leaf_points, node_points);
    const Streamed::Level& coarser = streamed.levels[level + 1];
    ASSERT_EQ(coarser.members, expected.members);
    ASSERT_LT(coarser.members.size(), at.members.size());
    for (std::size_t m = 0; m < expected.members.size(); ++m) {
      expect_same(coarser.material.moments[m], expected.material.moments[m]);
      expect_same(coarser.material.value_moments[0][m], expected.material.value_moments[0][m],
                  expected.material.moments[m]);
      expect_same(coarser.material.planes[m], expected.material.planes[m]);
    }
    for (const std::uint64_t i : at.members) {
      const bool stays = std::ranges::binary_search(coarser.members, i);
      ASSERT_EQ(streamed.ends[i] == std::vector<std::size_t>{level}, !stays) << "point " << i;
    }
    material = coarser.material;
  }
  for (const std::uint64_t i : streamed.levels[last].members)
    ASSERT_EQ(streamed.ends[i], std::vector<std::size_t>{last}) << "point " << i;
}

TEST(Cascade, ReducesBlocksByTheirClusters) {
  for (const auto& [name, positions] : hard_cases())
    for (const Reduction method : {Reduction::mis, Reduction::kdtree})
      for (const auto& [leaf_points, index_leaf_points] : {std::pair{8u, 300u}, {8u, 512u}, {20u, 3000u}, {600u, 600u}}) {
        SCOPED_TRACE(name + ", " + reduction_name(method) + ", " + std::to_string(leaf_points) + " and " +
                     std::to_string(index_leaf_points));
        const Streamed streamed(positions, leaf_points, index_leaf_points, method);
        if (name != "all equal") expect_nodes_reduced(streamed, method, leaf_points, index_leaf_points);
        if (HasFatalFailure()) return;
      }
}

// Thousands of points in one finest cell, coincident or not, that are more than a cell may hold.
TEST(Cascade, CellsInPartsKeepAllPointsAndTheirMass) {
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
      expect_leaves_of_definition(streamed.cells, streamed.points.keys, index_leaf_points);

      ASSERT_GE(streamed.levels.size(), 2u);
      for (const auto& ends : streamed.ends) ASSERT_EQ(ends.size(), 1u);
      std::size_t in_one_cell = 0;
      for (std::size_t i = 0; i < positions.size(); ++i) {
        if (glm::length(streamed.points.positions[i] - 0.25) > 1e-9) continue;
        ++in_one_cell;
        EXPECT_EQ(streamed.levels[0].splats[i].count, 255);
        EXPECT_EQ(streamed.levels[0].splats[i].depth, max_morton_depth);
      }
      ASSERT_EQ(in_one_cell, 3000u);
      const auto mass = [](const auto& moments) {
        return std::accumulate(moments.begin(), moments.end(), 0.0,
                               [](double sum, const auto& moment) { return sum + moment.mass; });
      };
      for (std::size_t level = 1; level < streamed.levels.size(); ++level) {
        EXPECT_EQ(streamed.levels[level].members.size(), streamed.counts[level]);
        for (std::size_t m = 0; m < streamed.counts[level]; ++m) EXPECT_EQ(streamed.levels[level].splats[m].number, m);
        const test::Material& material = streamed.levels[level].material;
        EXPECT_NEAR(mass(material.moments) / mass(streamed.points.moments), 1, rounding);
        EXPECT_NEAR(mass(material.value_moments[0]) / mass(streamed.points.value_moments[0]), 1, rounding);
      }
    }
}

}  // namespace
}  // namespace splatvol
