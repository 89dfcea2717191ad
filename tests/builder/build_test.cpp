#include "builder/build.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <random>

#include "base/file.h"
#include "builder/index_builder.h"
#include "builder/reduction.h"
#include "format/volume.h"

namespace splatvol {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

// Pieces held in memory.
class PieceSource final : public Source {
 public:
  explicit PieceSource(std::vector<Piece> pieces, std::vector<std::string> attributes = {"value"})
      : pieces_(std::move(pieces)), attributes_(std::move(attributes)) {}
  const std::vector<std::string>& attributes() const override { return attributes_; }
  std::size_t piece_count() const override { return pieces_.size(); }
  Result<std::unique_ptr<Piece>> next() override {
    if (next_ == pieces_.size()) return nullptr;
    return std::make_unique<Piece>(pieces_[next_++]);
  }

 private:
  std::vector<Piece> pieces_;
  std::vector<std::string> attributes_;
  std::size_t next_ = 0;
};

Piece scattered(std::vector<dvec3> points) {
  Piece piece;
  piece.points = std::move(points);
  piece.values.resize(1);
  for (const dvec3& p : piece.points) piece.values[0].push_back(p.x + 2 * p.y);
  return piece;
}

std::vector<dvec3> random_points(std::size_t count, double scale = 1, dvec3 offset = dvec3(0)) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<dvec3> points(count);
  for (dvec3& p : points) p = offset + scale * dvec3(uniform(random), uniform(random), uniform(random));
  return points;
}

std::string temporary_path(const std::string& name) {
  return (std::filesystem::path(testing::TempDir()) / name).string();
}

// What a file holds, decoded whole.
struct Contents {
  std::shared_ptr<const format::Volume> volume;
  std::vector<dvec3> positions;
  std::vector<float> values;
};

Contents read_all(const std::string& path) {
  Contents contents;
  contents.volume = *format::Volume::open(*open_file(path));
  const format::VolumeInfo& info = contents.volume->info();
  EXPECT_TRUE(contents.volume->verify([](double) {}).has_value());
  const format::RowLayout& rows = contents.volume->rows();
  for (std::uint64_t g = 0; g < rows.group_count(); ++g) {
    const format::Group group = rows.group(g);
    const std::uint64_t row = rows.row(group.segment, g);
    const auto page = *contents.volume->read_directory_page(contents.volume->directory_page_of_row(row));
    const auto chunk = [&](format::ColumnKind kind, int attribute) {
      const auto& place = contents.volume->find_chunk(page, row, info.find_column(kind, attribute));
      return std::pair(place.entry, *contents.volume->read_bytes(place.offset, place.entry.packed_bytes));
    };
    std::vector<dvec3> positions(group.count);
    const auto [position_entry, position_bytes] = chunk(format::ColumnKind::position, -1);
    EXPECT_TRUE(format::unpack_positions(position_entry, position_bytes, positions, "").has_value());
    contents.positions.insert(contents.positions.end(), positions.begin(), positions.end());
    std::vector<float> values(group.count);
    const auto [value_entry, value_bytes] = chunk(format::ColumnKind::value, 0);
    EXPECT_TRUE(format::unpack_values(value_entry, value_bytes, values, "").has_value());
    contents.values.insert(contents.values.end(), values.begin(), values.end());
  }
  return contents;
}

Result<BuildReport> build(std::vector<Piece> pieces, const std::string& path, BuildOptions options = {}) {
  PieceSource source(std::move(pieces));
  return build_volume(source, path, options, [](const char*, double) {});
}

TEST(Build, EveryPointOnceAtEveryScaleAndPlace) {
  for (const double scale : {1e-6, 1.0, 1e6})
    for (const double offset : {0.0, 1e7}) {
      const std::string path = temporary_path("scales.svol");
      auto points = random_points(9000, scale, dvec3(offset * scale));
      ASSERT_TRUE(build({scattered(points)}, path));
      const Contents contents = read_all(path);
      ASSERT_EQ(contents.positions.size(), points.size());
      // Match by order along x: far closer than the spacing, and the value (x + 2 y) goes along.
      auto stored = contents.positions;
      std::ranges::sort(points, {}, &dvec3::x);
      std::ranges::sort(stored, {}, &dvec3::x);
      for (std::size_t i = 0; i < points.size(); ++i) ASSERT_NEAR(stored[i].x, points[i].x, scale * 1e-3);
    }
}

TEST(Build, PositionsStayWithinTheirStatedShareOfTheSpacing) {
  const std::string path = temporary_path("lattice.svol");
  std::vector<dvec3> points;
  for (int x = 0; x < 20; ++x)
    for (int y = 0; y < 20; ++y)
      for (int z = 0; z < 20; ++z) points.emplace_back(x * 0.1, y * 0.1, z * 0.01);
  ASSERT_TRUE(build({scattered(points)}, path));
  for (const dvec3& p : read_all(path).positions) {
    const dvec3 nearest{std::round(p.x / 0.1) * 0.1, std::round(p.y / 0.1) * 0.1, std::round(p.z / 0.01) * 0.01};
    EXPECT_LE(glm::length(p - nearest), 0.01 / 64);
  }
}

TEST(Build, DegenerateSetsWork) {
  std::map<std::string, std::vector<dvec3>> cases;
  cases["one"] = {{3, 4, 5}};
  cases["equal"] = std::vector<dvec3>(10'000, dvec3(1, 2, 3));
  cases["two"] = {{0, 0, 0}, {1e9, 0, 0}};
  for (int i = 0; i < 5000; ++i) cases["line"].emplace_back(std::pow(1.004, i), 0, 0);
  for (int i = 0; i < 5000; ++i) cases["plane"].emplace_back(i % 70, i / 70, 7);
  cases["tiny extent"] = {{1, 1, 1}, {1 + 1e-15, 1, 1}};
  for (const auto& [name, points] : cases) {
    const std::string path = temporary_path("degenerate.svol");
    const auto report = build({scattered(points)}, path);
    ASSERT_TRUE(report) << name << ": " << report.error().message;
    EXPECT_EQ(read_all(path).positions.size(), points.size()) << name;
  }
  EXPECT_EQ(build({scattered(cases["equal"])}, temporary_path("equal.svol"))->points.coincident, 9999u);
}

TEST(Build, RefusesWhatHoldsNoPoint) {
  const std::string path = temporary_path("none.svol");
  EXPECT_FALSE(build({}, path));
  EXPECT_FALSE(build({scattered({{nan, 0, 0}})}, path));
  EXPECT_FALSE(build({scattered({{-1e308, 0, 0}, {1.7e308, 0, 0}})}, path));
  BuildOptions options;
  options.leaf_points = 7;
  EXPECT_FALSE(build({scattered(random_points(100))}, path, options));
  EXPECT_FALSE(std::filesystem::exists(path));
}

TEST(Build, MissingValuesAndPointsAreCounted) {
  const std::string path = temporary_path("missing.svol");
  Piece piece = scattered(random_points(1000));
  piece.points[5].y = nan;
  piece.points[6].z = INFINITY;
  for (std::size_t i = 10; i < 108; ++i) piece.values[0][i] = nan;
  piece.values[0][108] = -INFINITY;
  piece.values[0][109] = 1e300;
  const auto report = build({piece}, path);
  ASSERT_TRUE(report);
  EXPECT_EQ(report->points.not_finite, 2u);
  EXPECT_EQ(report->missing[0].second, 100u);
  const Contents contents = read_all(path);
  EXPECT_EQ(contents.positions.size(), 998u);
  EXPECT_EQ(std::ranges::count_if(contents.values, [](float v) { return std::isnan(v); }), 100);
  EXPECT_EQ(contents.volume->info().attributes[0].missing, 100u);
  EXPECT_LE(contents.volume->info().attributes[0].max, 3);
}

TEST(Build, AttributeWithoutAnyValueWorks) {
  const std::string path = temporary_path("all_missing.svol");
  Piece piece = scattered(random_points(100));
  std::ranges::fill(piece.values[0], nan);
  ASSERT_TRUE(build({piece}, path));
  EXPECT_TRUE(std::isnan(read_all(path).volume->info().attributes[0].min));
}

TEST(Build, NarrowRangesFarFromZeroKeepTheirDetail) {
  const std::string path = temporary_path("offset.svol");
  Piece piece = scattered(random_points(2000));
  for (std::size_t i = 0; i < 2000; ++i) piece.values[0][i] = 101325 + 1e-4 * std::sin(static_cast<double>(i));
  ASSERT_TRUE(build({piece}, path));
  const Contents contents = read_all(path);
  const double offset = contents.volume->info().attributes[0].offset;
  std::vector<double> stored;
  for (const float v : contents.values) stored.push_back(offset + v);
  std::ranges::sort(stored);
  std::ranges::sort(piece.values[0]);
  for (std::size_t i = 0; i < stored.size(); ++i) EXPECT_NEAR(stored[i], piece.values[0][i], 1e-10);
}

TEST(Build, VerticesThatPiecesShareAreMergedScatteredPointsAreNot) {
  Piece left = scattered({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}});
  left.tetrahedra = {{0, 1, 2, 3}};
  left.census.tetrahedra = 1;
  Piece right = scattered({{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 1, 1}});
  right.tetrahedra = {{0, 1, 2, 3}};
  right.census.tetrahedra = 1;
  const std::string path = temporary_path("pieces.svol");
  auto report = build({left, right}, path);
  ASSERT_TRUE(report);
  EXPECT_EQ(report->points.merged, 3u);
  EXPECT_EQ(report->resolution_counts.back(), 5u);

  // Two values at one place are two samples.
  right.values[0][0] += 1;
  report = build({left, right}, path);
  EXPECT_EQ(report->points.merged, 2u);
  EXPECT_EQ(report->points.coincident, 1u);

  left.tetrahedra.clear();
  right.tetrahedra.clear();
  report = build({left, right}, path);
  EXPECT_EQ(report->points.merged, 0u);
  EXPECT_EQ(report->resolution_counts.back(), 8u);
}

TEST(Build, BytesDoNotDependOnThreads) {
  const std::string one = temporary_path("one_thread.svol"), many = temporary_path("many_threads.svol");
  const Piece piece = scattered(random_points(30'000));
  {
    tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 1);
    ASSERT_TRUE(build({piece}, one));
  }
  tbb::global_control limit(tbb::global_control::max_allowed_parallelism, 7);
  ASSERT_TRUE(build({piece}, many));
  EXPECT_EQ(*read_text_file(one), *read_text_file(many));
}

TEST(Build, AFailureLeavesTheOldFile) {
  const std::string path = temporary_path("old.svol");
  ASSERT_TRUE(build({scattered(random_points(100))}, path));
  const std::string before = *read_text_file(path);
  EXPECT_FALSE(build({}, path));
  EXPECT_EQ(*read_text_file(path), before);
  EXPECT_FALSE(build({scattered(random_points(100))}, temporary_path("no/such/folder.svol")));
}

// Brute force over nodes: counts, size bounds and first_resolution against their definitions.
TEST(BuildIndex, EveryNodeTellsTheTruth) {
  auto positions = random_points(6000);
  for (std::size_t i = 0; i < 3000; ++i) positions[i] = dvec3(0.7) + 1e-4 * positions[i];
  PieceSource source({scattered(positions)});
  const PointSet points = *gather_points(source, [](double) {});
  const auto resolutions = reduce_by_octree(points.keys, points.positions, points.cube, 8);
  const auto segments = find_segments(resolutions);
  const format::NodeArrays tree = build_index({points.keys, segments, resolutions, {}, {}}, 100);

  struct Cell {
    std::size_t begin, end;
    int depth;
  };
  std::size_t next_node = 0;
  const auto check = [&](const auto& self, Cell cell) -> void {
    const std::size_t node = next_node++;
    const std::size_t last = resolutions.size() - 1;
    for (std::size_t r = 0; r <= last; ++r) {
      std::uint64_t count = 0;
      double largest = 0;
      bool crosses = false;
      for (std::size_t i = cell.begin; i < cell.end; ++i) count += segments[i] == r;
      ASSERT_EQ(tree.counts_of(node)[r], count);
      for (std::size_t m = 0; m < resolutions[r].size(); ++m) {
        const std::uint64_t i = resolutions[r].members[m];
        const bool inside = i >= cell.begin && i < cell.end;
        if (inside)
          largest = std::max(largest, std::ldexp(1.0, -resolutions[r].depths[m]) / std::cbrt(resolutions[r].counts[m]));
        // Cluster of resolution r - 1: the leaf over resolution r; it crosses the border if it is larger than the cell
        // and has a point in common with it.
        if (r > 0 && resolutions[r].depths[m] < cell.depth &&
            common_depth(points.keys[i], points.keys[cell.begin]) >= resolutions[r].depths[m])
          crosses = true;
      }
      if (largest > 0) {
        EXPECT_GE(format::size_bound(tree.size_code_at(node, 0, r), 1.0), largest * (1 - 1e-12));
        EXPECT_LE(format::size_bound(tree.size_code_at(node, 0, r), 1.0), largest * 1.1);
      }
      if (r > 0) {
        EXPECT_EQ(crosses, tree.first_resolutions[node] >= r) << "resolution " << r << " depth " << cell.depth;
      }
    }
    for (std::size_t begin = cell.begin; tree.child_masks[node] != 0 && begin < cell.end;) {
      std::size_t end = begin;
      while (end < cell.end && octant_at(points.keys[end], cell.depth) == octant_at(points.keys[begin], cell.depth))
        ++end;
      ASSERT_NE(tree.child_masks[node] & 1 << octant_at(points.keys[begin], cell.depth), 0);
      self(self, {begin, end, cell.depth + 1});
      begin = end;
    }
    if (tree.child_masks[node] == 0) {
      EXPECT_LE(cell.end - cell.begin, 100u);
    }
  };
  check(check, {0, points.size(), 0});
  EXPECT_EQ(next_node, tree.size());
}

}  // namespace
}  // namespace splatvol
