#include "builder/output/row_collector.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

#include "builder/output/index_leaf_spool.h"
#include "builder/output/row_files.h"
#include "builder/output/row_packer.h"
#include "builder/points/batch_cutter.h"
#include "builder/points/held_points.h"
#include "builder/reduction/reduction_pipeline.h"
#include "tests/builder/support/piece_source.h"
#include "tests/builder/support/random_material.h"
#include "tests/support/whole_material.h"
#include "tests/support/whole_points.h"

namespace splatvol::test {
namespace {

using format::ColumnKind;
using format::ColumnScope;

constexpr std::uint32_t leaf_points = 8;
const GroupSizes group_sizes = {{96, 64, 72}};  // [segment]

void run(PointBatch points, std::uint64_t index_leaf_points, ReductionPass& pass, RowCollector& rows,
         const RowPacker& packer, RowFiles& files) {
  BatchCutter batches(stream_of(std::move(points)), 1, index_leaf_points);
  EXPECT_TRUE(run_reduction({batches, nullptr, pass, rows, packer, files}, 1, [](std::uint64_t) {}));
}

// Points with random material, every other one a cube that overlaps others. Each point's value is its number.
WholePoints overlapping_points(std::size_t count) {
  PieceSource source({scattered(random_points(count))});
  WholePoints whole = *read_points(source, false, 1 << 20);
  PointBatch& points = whole.points;
  randomize_material(points);
  for (std::size_t i = 0; i < points.size(); i += 2) {
    const double edge = i % 4 == 0 ? 0.03 : 0.1, variance = edge * edge / 12;
    points.moments[i] = {edge * edge * edge, dvec3(0), {variance, variance, variance, 0, 0, 0}};
  }
  std::iota(points.values[0].begin(), points.values[0].end(), 0.0);
  return whole;
}

format::VolumeInfo four_columns(std::size_t count) {
  format::VolumeInfo info;
  info.cube = {dvec3(0), 10};
  format::Attribute& attribute = info.attributes.emplace_back();
  attribute.min = 0;
  attribute.max = static_cast<double>(count);
  info.columns = {{ColumnKind::position, ColumnScope::segment, -1},
                  {ColumnKind::octant, ColumnScope::resolution, -1},
                  {ColumnKind::moments, ColumnScope::resolution, -1},
                  {ColumnKind::value, ColumnScope::segment, 0}};
  return info;
}

// Rows of a pass over points with random material, unpacked. A point's number is its index in Morton order, and its
// value.
struct Rows {
  PointBatch points;
  std::vector<Resolution> resolutions;
  std::vector<std::vector<format::PackedChunk>> packed;   // [row][column]
  std::vector<std::vector<SplatShape>> shapes;            // [row]
  std::vector<std::vector<float>> values;                 // [row]; empty unless the segment is the resolution's own
  std::vector<std::vector<std::uint8_t>> depths, counts;  // [row]

  Rows() {
    constexpr std::size_t count = 6000;
    WholePoints whole = overlapping_points(count);
    const Cube cube = whole.summary.cube;
    points = std::move(whole.points);
    resolutions = reduce_by_octree(points.keys, points.positions, cube, leaf_points);

    const format::VolumeInfo info = four_columns(count);
    AtomicFile finest = *AtomicFile::create(testing::TempDir() + "finest");
    const RowPacker packer(info);
    RowFiles files(testing::TempDir(), finest);
    RowCollector rows(info, group_sizes);
    const ReductionSettings settings{cube, leaf_points, true, info.attributes, &packer, group_sizes.of(0)};
    ReductionPass pass(settings, rows, [](const OpenIndexLeaf&) -> Status { return {}; });
    run(points, 100, pass, rows, packer, files);
    std::vector<PendingRow> rest = *rows.extract_rest();
    EXPECT_TRUE(write_rows(rest, packer, files));
    read(files, pass.counts().size(), finest);
  }

 private:
  void read(RowFiles& files, std::size_t levels, const AtomicFile& finest) {
    const auto written = *open_file(finest.path_to_write());
    std::uint64_t coarse_bytes = 0, finest_bytes = 0;
    EXPECT_TRUE(files.read(levels, [&](std::span<const format::ChunkEntry> entries, std::span<const std::byte> bytes) {
      coarse_bytes += bytes.size();
      if (!bytes.empty()) {
        add_row(entries, bytes);
        return Status{};
      }
      format::Bytes row(
          std::accumulate(entries.begin(), entries.end(), std::size_t{0},
                          [](std::size_t sum, const format::ChunkEntry& entry) { return sum + entry.packed_bytes; }));
      EXPECT_TRUE(written->read(finest_bytes, row));
      finest_bytes += row.size();
      add_row(entries, row);
      return Status{};
    }));
    EXPECT_EQ(coarse_bytes, files.coarse_bytes());
    EXPECT_EQ(finest_bytes, finest.position());
  }

  void add_row(std::span<const format::ChunkEntry> entries, std::span<const std::byte> bytes) {
    std::vector<format::PackedChunk>& chunks = packed.emplace_back();
    for (const format::ChunkEntry& entry : entries) {
      ASSERT_LE(entry.packed_bytes, bytes.size());
      const auto part = bytes.first(entry.packed_bytes);
      chunks.push_back({entry, {part.begin(), part.end()}});
      bytes = bytes.subspan(part.size());
    }
    EXPECT_TRUE(bytes.empty());
    unpack(chunks);
  }

  void unpack(std::span<const format::PackedChunk> chunks) {
    const bool own = chunks.size() == 4;
    ASSERT_TRUE(own || chunks.size() == 2);
    const format::PackedChunk &octants = chunks[own ? 1 : 0], &moments = chunks[own ? 2 : 1];
    const std::size_t size = next_row_size();
    shapes.emplace_back(size);
    depths.emplace_back(size);
    counts.emplace_back(size);
    EXPECT_TRUE(format::unpack_moments(moments.entry, moments.bytes, shapes.back(), 10, "").has_value());
    EXPECT_TRUE(format::unpack_octants(octants.entry, octants.bytes, depths.back(), counts.back(), "").has_value());
    values.emplace_back(own ? size : 0);
    if (own) {
      EXPECT_TRUE(format::unpack_values(chunks[3].entry, chunks[3].bytes, values.back(), "").has_value());
    }
  }

  // Points of the next row. Resolutions come from coarse to fine, in each of them its segments, in each of these its
  // groups.
  std::size_t next_row_size() {
    while (begin_ == segment_points()) {
      begin_ = 0;
      if (++segment_ > resolution_) ++resolution_, segment_ = 0;
    }
    const std::size_t most = group_sizes.of(resolutions.size() - 1 - segment_);
    const std::size_t size = std::min(most, segment_points() - begin_);
    begin_ += size;
    return size;
  }
  [[nodiscard]] std::size_t segment_points() const {
    return resolutions.at(segment_).size() - (segment_ > 0 ? resolutions[segment_ - 1].size() : 0);
  }

  std::size_t resolution_ = 0, segment_ = 0, begin_ = 0;
};

// The splats of each resolution in file order, as the oracle has them.
std::vector<StoredSplat> splats_in_file_order(const Rows& rows) {
  const auto materials = merge_clusters(rows.points.positions, rows.resolutions, material_of(rows.points));
  std::vector<std::vector<StoredSplat>> splats;
  for (std::size_t r = 0; r < rows.resolutions.size(); ++r)
    splats.push_back(splats_of(rows.points.positions, rows.resolutions[r], materials[r]));
  const std::vector<std::uint64_t> order = file_order(rows.resolutions);
  std::vector<StoredSplat> all;
  for (std::size_t r = 0; r < rows.resolutions.size(); ++r) {
    std::vector<const StoredSplat*> splat_of(rows.points.size());  // [point]
    for (std::size_t m = 0; m < rows.resolutions[r].size(); ++m)
      splat_of[rows.resolutions[r].members[m]] = &splats[r][m];
    for (const std::uint64_t i : order)
      if (splat_of[i] != nullptr) all.push_back(*splat_of[i]);
  }
  return all;
}

template <class T>
std::vector<T> flat(const std::vector<std::vector<T>>& rows) {
  std::vector<T> all;
  for (const auto& row : rows) all.insert(all.end(), row.begin(), row.end());
  return all;
}

TEST(RowFiles, RowsComeInFileOrderEachOnce) {
  const Rows rows;
  ASSERT_GE(rows.resolutions.size(), 3u);
  std::vector<float> order;
  for (const std::uint64_t i : file_order(rows.resolutions)) order.push_back(static_cast<float>(i));
  EXPECT_EQ(flat(rows.values), order);

  const std::vector<StoredSplat> expected = splats_in_file_order(rows);
  const auto shapes = flat(rows.shapes);
  const auto depths = flat(rows.depths), counts = flat(rows.counts);
  ASSERT_EQ(shapes.size(), expected.size());
  for (std::size_t k = 0; k < expected.size(); ++k) {
    ASSERT_EQ(depths[k], expected[k].depth) << k;
    ASSERT_EQ(counts[k], expected[k].count) << k;
    // One quantisation step of the log code is 2^(1/128).
    ASSERT_NEAR(shapes[k].mass, expected[k].shape.mass, 0.01 * expected[k].shape.mass) << k;
    ASSERT_NEAR(shapes[k].deviations[0], expected[k].shape.deviations[0], 0.01 * expected[k].shape.deviations[0]);
    ASSERT_EQ(shapes[k].density, 1) << k;
  }
}

// The index leaves. `late` gets the number of leaves for which something came late.
std::vector<IndexLeaf> leaves_of(std::uint64_t most_open_leaves, std::size_t& late) {
  PieceSource source({scattered(random_points(20'000))});
  WholePoints whole = *read_points(source, false, 1 << 20);
  randomize_material(whole.points);
  format::VolumeInfo info;
  info.attributes.emplace_back();
  AtomicFile finest = *AtomicFile::create(testing::TempDir() + "finest");
  const RowPacker packer(info);
  RowFiles files(testing::TempDir(), finest);
  RowCollector rows(info, {});
  const ReductionSettings settings{whole.summary.cube, leaf_points, true, info.attributes, &packer, GroupSizes().of(0)};
  IndexLeafSpool spool(testing::TempDir());
  ReductionPass pass(
      settings, rows, [&](const OpenIndexLeaf& leaf) { return spool.append(leaf); }, most_open_leaves);
  run(std::move(whole.points), 300, pass, rows, packer, files);
  late = pass.late_leaves().size();
  std::vector<IndexLeaf> leaves;
  EXPECT_TRUE(spool.read(pass.counts().size(), pass.late_leaves(), [&](IndexLeaf leaf) -> Status {
    leaves.push_back(std::move(leaf));
    return {};
  }));
  return leaves;
}

TEST(ReductionPass, LeavesAreTheSameHoweverLateTheirClustersAre) {
  std::size_t late = 0;
  const std::vector<IndexLeaf> whole = leaves_of(1'000'000, late);
  EXPECT_EQ(late, 0u);
  const std::vector<IndexLeaf> parts = leaves_of(1, late);
  EXPECT_GT(late, 0u);
  ASSERT_EQ(parts.size(), whole.size());
  for (std::size_t i = 0; i < whole.size(); ++i) {
    EXPECT_EQ(parts[i].key, whole[i].key);
    EXPECT_EQ(parts[i].counts, whole[i].counts);
    for (std::size_t r = 0; r < whole[i].splats.size(); ++r) {
      EXPECT_EQ(parts[i].splats[r].least_depth, whole[i].splats[r].least_depth);
      EXPECT_EQ(parts[i].splats[r].octant_code, whole[i].splats[r].octant_code);
      EXPECT_EQ(parts[i].splats[r].width, whole[i].splats[r].width);
      EXPECT_EQ(parts[i].splats[r].box.low, whole[i].splats[r].box.low);
      EXPECT_EQ(parts[i].splats[r].box.high, whole[i].splats[r].box.high);
    }
  }
}

}  // namespace
}  // namespace splatvol::test
