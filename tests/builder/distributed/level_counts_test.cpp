#include "builder/distributed/level_counts.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

#include "builder/distributed/key_ranges.h"
#include "tests/builder/support/point_sets.h"

namespace splatvol {
namespace {

constexpr Cube cube = {dvec3(0), 1.0};
constexpr std::uint32_t leaf_points = 8;
constexpr std::uint64_t most_of_one_key = 512;

PointBatch batch_of(std::vector<dvec3> positions) {
  std::ranges::stable_sort(positions, {}, [](const dvec3& p) { return morton_key(p, cube); });
  PointBatch batch;
  for (const dvec3& p : positions) batch.keys.push_back(morton_key(p, cube));
  batch.positions = std::move(positions);
  return batch;
}

std::vector<std::uint64_t> count(const PointBatch& batch, const KeyBorders& borders) {
  LevelCounts levels(cube, leaf_points, most_of_one_key, borders, {});
  levels.add(batch);
  levels.finish();
  std::vector<std::uint64_t> counts;
  for (const std::vector<std::uint64_t>& level : levels.intervals()) counts.push_back(level[0]);
  return counts;
}

PointBatch part_of(const PointBatch& batch, std::size_t begin, std::size_t end) {
  PointBatch part;
  for (std::size_t i = begin; i < end; ++i) {
    part.keys.push_back(batch.keys[i]);
    part.positions.push_back(batch.positions[i]);
  }
  return part;
}

TEST(LevelCounts, OfRangesAddUp) {
  const PointBatch batch = batch_of(test::uniform_points(100'000));
  const std::vector<std::uint64_t> whole = count(batch, {});
  const RangeBegins begins = choose_ranges(batch.keys, 5, 5000);
  ASSERT_EQ(begins.size(), 4u);
  std::vector<std::uint64_t> sums(whole.size());
  for (std::size_t range = 0; range <= begins.size(); ++range) {
    const auto at = [&](std::size_t r) {
      return static_cast<std::size_t>(std::ranges::lower_bound(batch.keys, begins[r]) - batch.keys.begin());
    };
    const std::size_t begin = range == 0 ? 0 : at(range - 1), end = range == begins.size() ? batch.size() : at(range);
    const std::vector<std::uint64_t> counts = count(part_of(batch, begin, end), borders_of(begins, range));
    for (std::size_t level = 0; level < sums.size(); ++level) sums[level] += counts[level];
  }
  // As long as nodes across the borders have more than 8 members: at three levels, even if each leaf were full.
  for (std::size_t level = 0; level < 4; ++level) EXPECT_EQ(sums[level], whole[level]) << level;
  EXPECT_LT(whole[1], whole[0] / 2);
}

TEST(LevelCounts, DoNotDependOnBatches) {
  const PointBatch batch = batch_of(test::uniform_points(10'000));
  LevelCounts levels(cube, leaf_points, most_of_one_key, {}, {});
  for (std::size_t begin = 0; begin < batch.size(); begin += 7)
    levels.add(part_of(batch, begin, std::min(begin + 7, batch.size())));
  levels.finish();
  const std::vector<std::uint64_t> whole = count(batch, {});
  for (std::size_t level = 0; level < whole.size(); ++level) EXPECT_EQ(levels.intervals()[level][0], whole[level]);
}

TEST(LevelCounts, TakeAllPointsOfAKeyForOneLeaf) {
  std::vector<dvec3> points(3000, dvec3(0.3));
  points.resize(3001, dvec3(0.8));
  const std::vector<std::uint64_t> counts = count(batch_of(points), {});
  EXPECT_EQ(counts[0], 3001u);
  EXPECT_EQ(counts[1], 2u);
}

TEST(LevelCounts, AreCountedBetweenMarks) {
  const PointBatch batch = batch_of(test::uniform_points(5000));
  LevelCounts levels(cube, leaf_points, most_of_one_key, {}, {batch.keys[1000], batch.keys[4000]});
  levels.add(batch);
  levels.finish();
  EXPECT_EQ(levels.intervals()[0], (std::vector<std::uint64_t>{1000, 3000, 1000}));
  const std::vector<std::uint64_t> whole = count(batch, {});
  const std::vector<std::uint64_t> first = levels.intervals()[1];
  EXPECT_EQ(std::accumulate(first.begin(), first.end(), std::uint64_t{0}), whole[1]);
}

}  // namespace
}  // namespace splatvol
