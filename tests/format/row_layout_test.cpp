#include <gtest/gtest.h>

#include <random>

#include "format/volume_info.h"

namespace splatvol::format {
namespace {

VolumeInfo info_of(std::vector<std::uint64_t> counts, std::vector<std::uint32_t> points_per_chunk,
                   std::vector<ColumnScope> scopes) {
  VolumeInfo info;
  info.resolution_counts = std::move(counts);
  info.points_per_chunk = std::move(points_per_chunk);
  for (const ColumnScope scope : scopes) info.columns.push_back({ColumnKind::unknown, scope, -1});
  return info;
}

// Enumerates rows and chunks as the introduction of the specification defines them.
struct Enumerated {
  struct Row {
    std::size_t resolution;
    std::uint64_t group;
    std::vector<int> columns;
  };
  std::vector<Group> groups;
  std::vector<Row> rows;

  explicit Enumerated(const VolumeInfo& info) {
    std::uint64_t begin = 0;
    for (std::size_t s = 0; s < info.resolutions(); ++s) {
      for (; begin < info.resolution_counts[s]; begin += groups.back().count)
        groups.push_back({s, begin,
                          static_cast<std::uint32_t>(
                              std::min<std::uint64_t>(info.points_per_chunk[s], info.resolution_counts[s] - begin))});
    }
    for (std::size_t r = 0; r < info.resolutions(); ++r)
      for (std::uint64_t g = 0; g < groups.size() && groups[g].segment <= r; ++g) {
        Row row{r, g, {}};
        for (std::size_t c = 0; c < info.columns.size(); ++c)
          if (info.columns[c].scope == ColumnScope::resolution || groups[g].segment == r)
            row.columns.push_back(static_cast<int>(c));
        rows.push_back(row);
      }
  }
};

void expect_agrees(const VolumeInfo& info) {
  const RowLayout layout(info);
  const Enumerated expected(info);
  ASSERT_EQ(layout.group_count(), expected.groups.size());
  ASSERT_EQ(layout.row_count(), expected.rows.size());
  for (std::uint64_t g = 0; g < expected.groups.size(); ++g) {
    const Group group = layout.group(g);
    EXPECT_EQ(group.segment, expected.groups[g].segment);
    EXPECT_EQ(group.begin, expected.groups[g].begin);
    EXPECT_EQ(group.count, expected.groups[g].count);
    const std::uint64_t segment_begin = group.segment == 0 ? 0 : info.resolution_counts[group.segment - 1];
    EXPECT_EQ(layout.group_at(group.segment, group.begin - segment_begin), g);
    EXPECT_EQ(layout.group_at(group.segment, group.begin - segment_begin + group.count - 1), g);
  }
  std::uint64_t chunks = 0;
  for (std::uint64_t row = 0; row < expected.rows.size(); ++row) {
    EXPECT_EQ(layout.resolution_of_row(row), expected.rows[row].resolution);
    EXPECT_EQ(layout.group_of_row(row), expected.rows[row].group);
    EXPECT_EQ(layout.row(expected.rows[row].resolution, expected.rows[row].group), row);
    EXPECT_EQ(layout.columns_of_row(row), expected.rows[row].columns);
    EXPECT_EQ(layout.chunks_before(row), chunks);
    chunks += expected.rows[row].columns.size();
  }
  EXPECT_EQ(layout.chunks_before(layout.row_count()), chunks);
}

constexpr ColumnScope segment = ColumnScope::segment;
constexpr ColumnScope resolution = ColumnScope::resolution;

TEST(RowLayout, AgreesWithEnumeration) {
  std::mt19937 random(1);
  for (int trial = 0; trial < 200; ++trial) {
    std::vector<std::uint64_t> counts;
    std::uint64_t count = 0;
    std::vector<std::uint32_t> points_per_chunk;
    for (std::size_t r = 1 + random() % 6; r > 0; --r) {
      counts.push_back(count += 1 + random() % 300);
      points_per_chunk.push_back(64 + random() % 64);
    }
    std::vector<ColumnScope> scopes = {segment};
    for (std::size_t c = random() % 5; c > 0; --c) scopes.push_back(random() % 2 == 0 ? segment : resolution);
    expect_agrees(info_of(counts, points_per_chunk, scopes));
  }
}

TEST(RowLayout, TakesTheSmallestAndFullGroups) {
  expect_agrees(info_of({1}, {64}, {segment}));
  expect_agrees(info_of({1, 2}, {64, 65}, {segment, resolution}));
  expect_agrees(info_of({64, 128, 192}, {64, 64, 64}, {segment, resolution, segment}));
  expect_agrees(info_of({64, 65, 130}, {64, 64, 64}, {resolution, segment}));
  expect_agrees(info_of({65, 165, 1190}, {64, 100, 1024}, {resolution, segment}));
}

TEST(RowLayout, CountsWithoutOverflowUpToTheLargestFile) {
  std::vector<std::uint64_t> counts;
  for (std::uint64_t r = 0; r < 64; ++r) counts.push_back((std::uint64_t{1} << 48) - 64 + r);
  const RowLayout layout(info_of(counts, std::vector<std::uint32_t>(64, 64), {segment, resolution}));
  EXPECT_EQ(layout.group_count(), (std::uint64_t{1} << 42) - 1 + 63);
  // Resolution r has the groups of segment 0 and one for each segment after it.
  const std::uint64_t first = (std::uint64_t{1} << 42) - 1;
  EXPECT_EQ(layout.row_count(), 64 * first + 63 * 64 / 2);
  EXPECT_EQ(layout.chunks_before(layout.row_count()), layout.row_count() + layout.group_count());
  EXPECT_EQ(layout.resolution_of_row(layout.row_count() - 1), 63u);
}

}  // namespace
}  // namespace splatvol::format
