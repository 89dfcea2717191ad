#include "builder/reduction/clusters.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <random>
#include <ranges>
#include <set>

#include "builder/scattered/delaunay_edges.h"
#include "builder/scattered/growing_delaunay.h"
#include "tests/builder/support/point_sets.h"

namespace splatvol::test {
namespace {

std::set<Edge> as_set(std::span<const Edge> edges) {
  std::set<Edge> result;
  for (const auto& [a, b] : edges) EXPECT_TRUE(result.insert({std::min(a, b), std::max(a, b)}).second) << a << " " << b;
  return result;
}

std::set<Edge> edges_of(std::span<const dvec3> positions) { return as_set(delaunay_edges(positions)); }

// The edges of all tetrahedra, by another triangulation.
std::set<Edge> tetrahedra_edges(std::span<const dvec3> positions) {
  GrowingDelaunay triangulation;
  EXPECT_TRUE(triangulation.insert(positions));
  std::set<Edge> edges;
  for (const GrowingDelaunay::Cell& cell : triangulation.cells())
    for (std::size_t a = 0; a < 4; ++a)
      for (std::size_t b = 0; b < 4; ++b)
        if (cell.is_finite() && cell.corners[a] < cell.corners[b]) edges.insert({cell.corners[a], cell.corners[b]});
  return edges;
}

TEST(DelaunayEdges, AreThoseOfTheTetrahedra) {
  for (const auto& positions : {uniform_points(500), lattice_points({8, 8, 8}), uniform_points(4), uniform_points(5)})
    EXPECT_EQ(edges_of(positions), tetrahedra_edges(positions)) << positions.size();
}

TEST(DelaunayEdges, DoNotDependOnTheOrderOfThePoints) {
  for (const auto& positions : {lattice_points({6, 6, 6}), lattice_points({15, 15, 1}), uniform_points(300)}) {
    std::vector<std::uint32_t> order(positions.size());
    std::iota(order.begin(), order.end(), 0u);
    std::ranges::shuffle(order, std::mt19937(4));
    std::vector<dvec3> shuffled;
    for (const std::uint32_t i : order) shuffled.push_back(positions[i]);
    std::vector<Edge> edges = delaunay_edges(shuffled);
    for (Edge& edge : edges) edge = {order[edge[0]], order[edge[1]]};
    EXPECT_EQ(as_set(edges), edges_of(positions));
  }
}

TEST(DelaunayEdges, JoinPointsWithoutVolumeToo) {
  EXPECT_TRUE(edges_of({}).empty());
  EXPECT_TRUE(edges_of(uniform_points(1)).empty());
  EXPECT_EQ(edges_of(uniform_points(2)), (std::set<Edge>{{0, 1}}));
  EXPECT_EQ(edges_of(lattice_points({4, 1, 1})), (std::set<Edge>{{0, 1}, {1, 2}, {2, 3}}));
  // By Euler's formula, a triangulation of n points in a plane, h of them on the hull, has 3 n - 3 - h edges.
  EXPECT_EQ(edges_of(lattice_points({10, 7, 1})).size(), 3u * 70 - 3 - 30);
  std::vector<dvec3> slanted = uniform_points(40);
  for (dvec3& p : slanted)
    p = {std::round(64 * p.x), std::round(64 * p.y), std::round(64 * p.x) + std::round(64 * p.y)};
  const auto edges = edges_of(slanted);
  EXPECT_GT(edges.size(), 2u * 40);
  EXPECT_LT(edges.size(), 3u * 40);
}

// Points of reduction nodes that are hard to divide, in Morton order.
std::map<std::string, Sorted> hard_nodes() {
  std::map<std::string, std::vector<dvec3>> nodes;
  for (const int count : {1, 2, 3, 4, 5, 8, 9, 100, 512}) nodes[std::to_string(count)] = uniform_points(count);
  nodes["all equal"] = std::vector<dvec3>(100, dvec3(0.1, 0.2, 0.3));
  nodes["two positions"] = std::vector<dvec3>(100, dvec3(0.1, 0.2, 0.3));
  for (int i = 0; i < 50; ++i) nodes["two positions"].emplace_back(0.9, 0.2, 0.3);
  nodes["half equal"] = uniform_points(200);
  for (std::size_t i = 0; i < 100; ++i) nodes["half equal"][i] = dvec3(0.5);
  nodes["of one key, but not equal"] = uniform_points(40);
  for (int i = 0; i < 40; ++i) nodes["of one key, but not equal"].emplace_back(0.25 + i * 0x1p-50, 0.25, 0.25);
  nodes["line"] = uniform_points(300);
  for (dvec3& p : nodes["line"]) p = {p.x, 0.3, 0.7};
  nodes["slanted line"] = uniform_points(300);
  for (dvec3& p : nodes["slanted line"]) p = dvec3(p.x);
  nodes["plane"] = uniform_points(300);
  for (dvec3& p : nodes["plane"]) p.z = 0.5;
  for (const dvec3& p : lattice_points({8, 8, 8})) nodes["lattice"].push_back((p + 0.5) / 8.0);
  for (const dvec3& p : lattice_points({20, 20, 1})) nodes["flat lattice"].push_back((p + 0.5) / 20.0);
  for (const dvec3& p : uniform_points(300)) nodes["sphere"].push_back(0.5 + 0.5 * glm::normalize(p - 0.5));
  nodes["nine decades"] = uniform_points(500);
  for (dvec3& p : nodes["nine decades"]) p = {std::pow(10, -9 * p.x), std::pow(10, -9 * p.y), std::pow(10, -9 * p.z)};
  nodes["thin"] = uniform_points(500);
  for (dvec3& p : nodes["thin"]) p.z *= 1e-8;
  std::map<std::string, Sorted> sorted;
  for (auto& [name, positions] : nodes) sorted[name] = sort_points(positions);
  return sorted;
}

std::vector<std::uint32_t> owners_of(Reduction method, std::uint32_t leaf_points, const Sorted& node) {
  std::vector<std::uint32_t> owners(node.keys.size(), 12345);
  find_clusters(method, leaf_points, node.keys, node.positions, owners);
  return owners;
}

// The first point of each key.
struct Distinct {
  std::vector<std::uint32_t> firsts;
  std::vector<dvec3> positions;
  explicit Distinct(const Sorted& node) {
    for (std::uint32_t i = 0; i < node.keys.size(); ++i)
      if (i == 0 || node.keys[i] != node.keys[i - 1]) {
        firsts.push_back(i);
        positions.push_back(node.positions[i]);
      }
  }
};

TEST(FindClusters, EachPointGoesWithOneThatStaysAndOnlyOneOfAKeyStays) {
  for (const auto& [name, node] : hard_nodes())
    for (const Reduction method : {Reduction::mis, Reduction::kdtree})
      for (const std::uint32_t leaf_points : {8u, 20u}) {
        SCOPED_TRACE(name + ", " + reduction_name(method));
        const auto owners = owners_of(method, leaf_points, node);
        for (std::size_t i = 0; i < owners.size(); ++i) {
          ASSERT_LT(owners[i], owners.size());
          ASSERT_EQ(owners[owners[i]], owners[i]);
          if (i > 0 && node.keys[i] == node.keys[i - 1]) {
            ASSERT_EQ(owners[i], owners[i - 1]);
          }
        }
      }
}

TEST(FindClusters, TheIndependentSetIsOneAndMaximal) {
  for (const auto& [name, node] : hard_nodes()) {
    SCOPED_TRACE(name);
    const auto owners = owners_of(Reduction::mis, 8, node);
    const Distinct distinct(node);
    const auto edges = edges_of(distinct.positions);
    std::vector<std::set<std::uint32_t>> neighbours(distinct.firsts.size());
    for (const auto& [a, b] : edges) neighbours[a].insert(b), neighbours[b].insert(a);
    const auto stays = [&](std::uint32_t i) { return owners[distinct.firsts[i]] == distinct.firsts[i]; };
    const auto before = [&](std::uint32_t a, std::uint32_t b) {
      return std::pair(neighbours[a].size(), a) < std::pair(neighbours[b].size(), b);
    };
    for (std::uint32_t i = 0; i < distinct.firsts.size(); ++i) {
      const auto& near = neighbours[i];
      if (stays(i)) {
        ASSERT_TRUE(std::ranges::none_of(near, stays));
        continue;
      }
      // A neighbour that came before keeps it out, and it goes with the nearest neighbour that stays.
      ASSERT_TRUE(std::ranges::any_of(near, [&](std::uint32_t k) { return stays(k) && before(k, i); }));
      double least = std::numeric_limits<double>::infinity();
      for (const std::uint32_t k : near)
        if (stays(k)) least = std::min(least, glm::length(distinct.positions[k] - distinct.positions[i]));
      const dvec3& owner = node.positions[owners[distinct.firsts[i]]];
      ASSERT_LE(glm::length(owner - distinct.positions[i]), least * (1 + 1e-15));
    }
  }
}

TEST(FindClusters, BucketsAreHalvesOfHalvesInBoxesOfTheirOwn) {
  for (const auto& [name, node] : hard_nodes())
    for (const std::uint32_t leaf_points : {8u, 20u}) {
      SCOPED_TRACE(name + ", " + std::to_string(leaf_points));
      const auto owners = owners_of(Reduction::kdtree, leaf_points, node);
      const Distinct distinct(node);
      std::map<std::uint32_t, std::vector<dvec3>> buckets;
      std::map<std::uint32_t, Box> boxes;
      for (std::size_t i = 0; i < distinct.firsts.size(); ++i) {
        const std::uint32_t owner = owners[distinct.firsts[i]];
        buckets[owner].push_back(distinct.positions[i]);
        boxes[owner].include({distinct.positions[i], distinct.positions[i]});
      }
      // All buckets at one depth of the tree have `least` or `most` points. At the last depth but one, `most` may be
      // one too many.
      std::size_t least = distinct.firsts.size(), most = least;
      while (least > leaf_points) least = least / 2, most = (most + 1) / 2;
      for (const auto& [owner, bucket] : buckets) {
        if (most <= leaf_points || bucket.size() == least) {
          ASSERT_GE(bucket.size(), least);
          ASSERT_LE(bucket.size(), most);
        } else {
          ASSERT_GE(bucket.size(), most / 2);
          ASSERT_LE(bucket.size(), (most + 1) / 2);
        }
        const Box& box = boxes[owner];
        const dvec3 center = (box.low + box.high) / 2.0;
        for (const dvec3& p : bucket)
          ASSERT_LE(glm::length(node.positions[owner] - center), glm::length(p - center) * (1 + 1e-15));
        for (const auto& [other, other_box] : boxes) {
          if (owner == other) continue;
          ASSERT_TRUE(glm::any(glm::lessThanEqual(box.high, other_box.low)) ||
                      glm::any(glm::lessThanEqual(other_box.high, box.low)));
        }
      }
    }
}

TEST(FindClusters, KeepAboutASixth) {
  const Sorted node = sort_points(uniform_points(512));
  for (const auto& [method, low, high] :
       {std::tuple(Reduction::mis, 0.13, 0.23), std::tuple(Reduction::kdtree, 0.124, 0.126)}) {
    const auto owners = owners_of(method, 8, node);
    const auto kept = std::ranges::count_if(std::views::iota(0u, 512u), [&](unsigned i) { return owners[i] == i; });
    EXPECT_GT(static_cast<double>(kept) / 512, low) << reduction_name(method);
    EXPECT_LT(static_cast<double>(kept) / 512, high) << reduction_name(method);
  }
}

TEST(Clusters, AreThePointsOfEachOwner) {
  const std::vector<std::uint32_t> owners = {2, 1, 2, 1, 2, 5};
  Clusters clusters;
  for (int round = 0; round < 2; ++round) {
    clusters.assign(owners);
    const auto of = [&](std::size_t i) {
      const auto cluster = clusters.of(i);
      return std::vector(cluster.begin(), cluster.end());
    };
    EXPECT_EQ(of(0), std::vector<std::uint32_t>());
    EXPECT_EQ(of(1), (std::vector<std::uint32_t>{1, 3}));
    EXPECT_EQ(of(2), (std::vector<std::uint32_t>{0, 2, 4}));
    EXPECT_EQ(of(5), (std::vector<std::uint32_t>{5}));
  }
}

}  // namespace
}  // namespace splatvol::test
