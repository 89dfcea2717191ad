#include "builder/output/row_streams.h"
#include "builder/output/index_leaf_spool.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <tuple>

#include "builder/output/index_leaf_spool.h"
#include "builder/points/batches.h"
#include "builder/reduction/reduction_pass.h"
#include "tests/builder/support/piece_source.h"
#include "tests/builder/support/random_material.h"
#include "tests/support/whole_material.h"

namespace splatvol {
namespace {

using format::ColumnKind;
using format::ColumnScope;

constexpr std::uint32_t chunk_points = 64, leaf_points = 8;

void run(Batches& batches, ReductionPass& pass, RowStreams& rows) {
  PointBatch batch;
  ReducedBatch reduced(1);
  std::vector<RowStreams::Chunk> chunks;
  while (*batches.next(batch)) {
    pass.prepare(batch, reduced);
    pass.reduce(batch, reduced);
    EXPECT_TRUE(pass.take(batch, reduced));
    rows.take_complete(chunks);
    for (RowStreams::Chunk& chunk : chunks) {
      rows.pack(chunk);
      EXPECT_TRUE(rows.write(chunk));
    }
  }
}

// Rows of a pass over points with random material, unpacked. Points are named by their place in Morton order, which is
// also their value.
struct Rows {
  PointBatch points;
  std::vector<test::Resolution> resolutions;
  std::vector<std::vector<format::PackedChunk>> packed;  // [row][column]
  std::vector<std::vector<format::SplatShape>> shapes;   // [row]
  std::vector<std::vector<float>> values;                // [row]; empty where the row's segment is not its resolution's
  std::vector<std::vector<std::uint8_t>> depths, counts;  // [row]

  explicit Rows(bool fits) {
    constexpr std::size_t count = 6000;
    test::PieceSource source({test::scattered(test::random_points(count))});
    PointStream stream = *PointStream::create(source, false, 1 << 20, testing::TempDir(), [](double) {});
    const Cube cube = stream.summary().cube;
    Batches batches(stream, 100);
    EXPECT_TRUE(batches.hold_all([&](PointBatch& all) -> Status {
      test::randomize_material(all);
      // Some that overlap.
      for (std::size_t i = 0; i < all.size(); i += 2) {
        const double edge = i % 4 == 0 ? 0.03 : 0.1, variance = edge * edge / 12;
        all.moments[i] = {edge * edge * edge, dvec3(0), {variance, variance, variance, 0, 0, 0}};
      }
      std::iota(all.values[0].begin(), all.values[0].end(), 0.0);
      points = all;
      return {};
    }));
    resolutions = test::reduce_by_octree(points.keys, points.positions, cube, leaf_points);

    format::VolumeInfo info;
    info.points_per_chunk = chunk_points;
    format::Attribute& attribute = info.attributes.emplace_back();
    attribute.min = 0;
    attribute.max = static_cast<double>(count);
    info.columns = {{ColumnKind::position, ColumnScope::segment, -1},
                    {ColumnKind::octant, ColumnScope::resolution, -1},
                    {ColumnKind::moments, ColumnScope::resolution, -1},
                    {ColumnKind::value, ColumnScope::segment, 0}};
    AtomicFile finest = *AtomicFile::create(testing::TempDir() + "finest");
    RowStreams rows(info, fits, testing::TempDir(), finest);
    const double offset = 0;
    const ReductionSettings settings{cube, leaf_points, true, true, info.attributes, std::span(&offset, 1)};
    ReductionPass pass(settings, rows, [](const OpenIndexLeaf&) -> Status { return {}; });
    run(batches, pass, rows);
    EXPECT_TRUE(pass.finish());
    EXPECT_TRUE(rows.finish(pass.counts().size()));
    const auto written = *open_file(finest.path_to_write());
    std::uint64_t coarse_bytes = 0, finest_bytes = 0;
    EXPECT_TRUE(rows.read([&](std::span<const format::ChunkEntry> entries, std::span<const std::byte> bytes) -> Status {
      coarse_bytes += bytes.size();
      if (!bytes.empty()) {
        take(entries, bytes);
        return {};
      }
      format::Bytes row(
          std::accumulate(entries.begin(), entries.end(), std::size_t{0},
                          [](std::size_t sum, const format::ChunkEntry& entry) { return sum + entry.packed_bytes; }));
      EXPECT_TRUE(written->read(finest_bytes, row));
      finest_bytes += row.size();
      take(entries, row);
      return {};
    }));
    EXPECT_EQ(coarse_bytes, rows.coarse_bytes());
    EXPECT_EQ(finest_bytes, finest.position());
  }

 private:
  void take(std::span<const format::ChunkEntry> entries, std::span<const std::byte> bytes) {
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
    const std::size_t size = next_rows();
    shapes.emplace_back(size);
    depths.emplace_back(size);
    counts.emplace_back(size);
    EXPECT_TRUE(format::unpack_moments(moments.entry, moments.bytes, shapes.back(), "").has_value());
    EXPECT_TRUE(format::unpack_octants(octants.entry, octants.bytes, depths.back(), counts.back(), "").has_value());
    values.emplace_back(own ? size : 0);
    if (own) {
      EXPECT_TRUE(format::unpack_values(chunks[3].entry, chunks[3].bytes, values.back(), "").has_value());
    }
  }

  // Points of the next row: resolutions from coarse to fine, in each the segments, chunk by chunk.
  std::size_t next_rows() {
    while (begin_ == segment_points()) {
      begin_ = 0;
      if (++segment_ > resolution_) ++resolution_, segment_ = 0;
    }
    const std::size_t size = std::min<std::size_t>(chunk_points, segment_points() - begin_);
    begin_ += size;
    return size;
  }
  [[nodiscard]] std::size_t segment_points() const {
    return resolutions.at(segment_).size() - (segment_ > 0 ? resolutions[segment_ - 1].size() : 0);
  }

  std::size_t resolution_ = 0, segment_ = 0, begin_ = 0;
};

// All rows of the splats of each resolution, in file order, as the oracle has them.
std::vector<StoredSplat> splats_in_file_order(const Rows& rows) {
  const auto materials = test::merge_clusters(rows.points.positions, rows.resolutions, test::material_of(rows.points));
  std::vector<std::vector<StoredSplat>> splats;
  for (std::size_t r = 0; r < rows.resolutions.size(); ++r)
    splats.push_back(test::splats_of(rows.points.positions, rows.resolutions[r], materials[r]));
  test::fit_finest_densities(splats.back());
  const std::vector<std::uint64_t> order = test::file_order(rows.resolutions);
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

TEST(RowStreams, RowsComeInFileOrderEachOnce) {
  for (const bool fits : {false, true}) {
    const Rows rows(fits);
    ASSERT_GE(rows.resolutions.size(), 3u);
    std::vector<float> order;
    for (const std::uint64_t i : test::file_order(rows.resolutions)) order.push_back(static_cast<float>(i));
    EXPECT_EQ(flat(rows.values), order);

    const std::vector<StoredSplat> expected = splats_in_file_order(rows);
    const auto shapes = flat(rows.shapes);
    const auto depths = flat(rows.depths), counts = flat(rows.counts);
    ASSERT_EQ(shapes.size(), expected.size());
    for (std::size_t k = 0; k < expected.size(); ++k) {
      ASSERT_EQ(depths[k], expected[k].depth) << k;
      ASSERT_EQ(counts[k], expected[k].count) << k;
      // One level of the log code, 2^(1/128).
      ASSERT_NEAR(shapes[k].mass, expected[k].shape.mass, 0.01 * expected[k].shape.mass) << k;
      ASSERT_NEAR(shapes[k].deviations[0], expected[k].shape.deviations[0], 0.01 * expected[k].shape.deviations[0]);
    }
  }
}

// What is fitted is what the oracle fits, and the rest of the file does not depend on it.
TEST(RowStreams, DensitiesOfTheFinestAreFitted) {
  const Rows fitted(true), none(false);
  const std::vector<StoredSplat> expected = splats_in_file_order(fitted);
  const std::size_t finest = fitted.resolutions.back().size();
  const auto shapes = flat(fitted.shapes), none_shapes = flat(none.shapes);
  std::size_t differ = 0;
  for (std::size_t k = 0; k < expected.size(); ++k) {
    const format::SplatShape &a = shapes[k], &b = none_shapes[k];
    const auto rest = [](const format::SplatShape& shape) {
      return std::tuple(shape.mass, shape.deviations, shape.orientation, shape.boundary);
    };
    ASSERT_EQ(rest(a), rest(b));
    ASSERT_EQ(b.density, 1);
    if (k < expected.size() - finest) {
      ASSERT_EQ(a.density, 1);
    }
    if (a.mass == 0) continue;
    const double density = std::clamp(expected[k].shape.density, 1.0 / 16, 15.0);  // as far as the file goes
    ASSERT_NEAR(a.density / density, 1, 0.05) << k;                                // a level of its code
    differ += std::abs(a.density - 1) > 0.1;
  }
  EXPECT_GT(differ, 100u);
}

TEST(RowStreams, ColumnsOtherThanMomentsAreTheSameBytes) {
  const Rows all(true), none(false);
  ASSERT_EQ(all.packed.size(), none.packed.size());
  for (std::size_t row = 0; row < all.packed.size(); ++row) {
    ASSERT_EQ(all.packed[row].size(), none.packed[row].size());
    const std::size_t moments = all.packed[row].size() == 4 ? 2 : 1;
    for (std::size_t c = 0; c < all.packed[row].size(); ++c)
      if (c != moments) {
        ASSERT_EQ(all.packed[row][c].bytes, none.packed[row][c].bytes) << row << " " << c;
      }
  }
}

// The index's leaves, and for how many of them something came late.
std::vector<IndexLeaf> leaves_of(std::uint64_t most_open_leaves, std::size_t& late) {
  test::PieceSource source({test::scattered(test::random_points(20'000))});
  PointStream stream = *PointStream::create(source, false, 1 << 20, testing::TempDir(), [](double) {});
  Batches batches(stream, 300);
  EXPECT_TRUE(batches.hold_all([](PointBatch& all) -> Status {
    test::randomize_material(all);
    return {};
  }));
  format::VolumeInfo info;
  info.attributes.emplace_back();
  AtomicFile finest = *AtomicFile::create(testing::TempDir() + "finest");
  RowStreams rows(info, false, testing::TempDir(), finest);
  const double offset = 0;
  const ReductionSettings settings{stream.summary().cube, leaf_points,          true, true,
                                   info.attributes,       std::span(&offset, 1)};
  IndexLeafSpool spool(*TempFile::create(testing::TempDir()));
  ReductionPass pass(
      settings, rows, [&](const OpenIndexLeaf& leaf) { return spool.append(leaf); }, most_open_leaves);
  run(batches, pass, rows);
  EXPECT_TRUE(pass.finish());
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
}  // namespace splatvol
