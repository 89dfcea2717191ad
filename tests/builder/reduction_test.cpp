#include "builder/reduction.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <map>
#include <numeric>
#include <random>
#include <set>

namespace splatvol {
namespace {

constexpr Cube unit_cube{{0, 0, 0}, 1};

struct Sorted {
  std::vector<dvec3> positions;
  std::vector<MortonKey> keys;
};

Sorted sort_points(std::vector<dvec3> positions) {
  std::ranges::stable_sort(positions, {}, [](const dvec3& p) { return morton_key(p, unit_cube); });
  Sorted sorted{std::move(positions), {}};
  for (const dvec3& p : sorted.positions) sorted.keys.push_back(morton_key(p, unit_cube));
  return sorted;
}

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
  return cases;
}

// The definition, recursively: split while a cell holds more than N members.
void split(const std::vector<MortonKey>& keys, const std::vector<std::uint64_t>& members, int depth, std::uint32_t n,
           std::map<std::uint64_t, std::pair<int, std::size_t>>& leaves) {
  if (members.size() <= n || depth == max_morton_depth) {
    for (const std::uint64_t m : members) leaves[m] = {depth, members.size()};
    return;
  }
  std::array<std::vector<std::uint64_t>, 8> octants;
  for (const std::uint64_t m : members) octants[octant_at(keys[m], depth)].push_back(m);
  for (const auto& octant : octants)
    if (!octant.empty()) split(keys, octant, depth + 1, n, leaves);
}

TEST(MortonKey, OrdersByInterleavedBitsOfFortyTwoLevels) {
  const dvec3 p{0.3, 0.6, 0.9};
  const auto [x, y, z] = finest_cell(p, unit_cube);
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
  EXPECT_EQ(finest_cell({1, 1, 1}, unit_cube)[0], (1ull << max_morton_depth) - 1);
  EXPECT_EQ(finest_cell({0, 0, 0}, unit_cube)[0], 0u);
}

TEST(FindLeaves, AgreesWithRecursiveSplitting) {
  for (const auto& [name, positions] : hard_cases())
    for (const std::uint32_t n : {1u, 8u, 25u}) {
      const Sorted sorted = sort_points(positions);
      Resolution resolution;
      resolution.members.resize(sorted.keys.size());
      std::iota(resolution.members.begin(), resolution.members.end(), 0u);
      find_leaves(sorted.keys, n, resolution);
      std::map<std::uint64_t, std::pair<int, std::size_t>> leaves;
      split(sorted.keys, resolution.members, 0, n, leaves);
      for (std::size_t m = 0; m < resolution.size(); ++m) {
        ASSERT_EQ(resolution.depths[m], leaves[m].first) << name << ", N = " << n << ", member " << m;
        ASSERT_EQ(resolution.counts[m], std::min<std::size_t>(leaves[m].second, 255)) << name;
      }
    }
}

TEST(ReduceByOctree, KeepsTheNearestToEachLeafsCentreAndNestsClusters) {
  for (const auto& [name, positions] : hard_cases()) {
    const Sorted sorted = sort_points(positions);
    const auto resolutions = reduce_by_octree(sorted.keys, sorted.positions, unit_cube, 8);
    ASSERT_EQ(resolutions.back().size(), positions.size());
    EXPECT_LE(resolutions.front().size(), 512u) << name;
    for (std::size_t r = 0; r + 1 < resolutions.size(); ++r) {
      const Resolution &coarse = resolutions[r], &fine = resolutions[r + 1];
      const std::set<std::uint64_t> kept(coarse.members.begin(), coarse.members.end());
      std::map<std::uint64_t, std::pair<int, std::size_t>> leaves;
      // Exactly one of each leaf of the finer resolution is kept, and none of its members is nearer to the centre.
      for (std::size_t begin = 0; begin < fine.size();) {
        const dvec3 center = cell_center(sorted.positions[fine.members[begin]], unit_cube, fine.depths[begin]);
        std::size_t end = begin;
        double nearest = 10, of_kept = 10;
        int kept_here = 0;
        while (end < fine.size() &&
               common_depth(sorted.keys[fine.members[begin]], sorted.keys[fine.members[end]]) >= fine.depths[begin]) {
          const double distance = glm::length(sorted.positions[fine.members[end]] - center);
          nearest = std::min(nearest, distance);
          if (kept.contains(fine.members[end])) of_kept = distance, ++kept_here;
          ++end;
        }
        ASSERT_EQ(kept_here, 1) << name;
        ASSERT_LE(of_kept, nearest * (1 + 1e-9)) << name;
        begin = end;
      }
      // A leaf of the coarser octree never lies inside a leaf of the finer one, so clusters nest.
      std::map<std::uint64_t, std::uint8_t> fine_depth;
      for (std::size_t m = 0; m < fine.size(); ++m) fine_depth[fine.members[m]] = fine.depths[m];
      for (std::size_t m = 0; m < coarse.size(); ++m)
        ASSERT_LE(coarse.depths[m], fine_depth[coarse.members[m]]) << name;
    }
  }
}

TEST(LeafBegins, LeafKeepsTheMemberOfItsNumber) {
  for (const auto& [name, positions] : hard_cases()) {
    const Sorted sorted = sort_points(positions);
    const auto resolutions = reduce_by_octree(sorted.keys, sorted.positions, unit_cube, 8);
    for (std::size_t r = 0; r + 1 < resolutions.size(); ++r) {
      const auto begins = leaf_begins(sorted.keys, resolutions[r + 1]);
      const auto& fine = resolutions[r + 1].members;
      ASSERT_EQ(begins.size(), resolutions[r].size() + 1) << name;
      ASSERT_EQ(begins.back(), fine.size()) << name;
      for (std::size_t k = 0; k + 1 < begins.size(); ++k) {
        ASSERT_LE(fine[begins[k]], resolutions[r].members[k]) << name;
        ASSERT_GE(fine[begins[k + 1] - 1], resolutions[r].members[k]) << name;
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

TEST(FindSegments, NamesTheCoarsestResolutionOfEachPoint) {
  const Sorted sorted = sort_points(random_points(3000));
  const auto resolutions = reduce_by_octree(sorted.keys, sorted.positions, unit_cube, 8);
  const auto segments = find_segments(resolutions);
  for (std::size_t r = 0; r < resolutions.size(); ++r)
    EXPECT_EQ(std::ranges::count_if(segments, [r](std::uint8_t s) { return s <= r; }),
              static_cast<long>(resolutions[r].size()));
}

}  // namespace
}  // namespace splatvol
