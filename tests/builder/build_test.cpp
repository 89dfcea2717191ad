#include "builder/pipeline/build.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <numeric>
#include <random>
#include <set>
#include <span>
#include <string_view>
#include <tuple>

#include "base/file.h"
#include "builder/sources/generator.h"
#include "format/volume.h"
#include "tests/builder/support/meshes.h"
#include "tests/builder/support/piece_source.h"
#include "tests/support/bad_disk.h"
#include "tests/support/long.h"
#include "tests/support/packed_tree.h"
#include "tests/support/require.h"
#include "tests/support/results.h"
#include "tests/support/sanitizers.h"
#include "tests/support/whole_material.h"
#include "tests/support/whole_points.h"
#include "tests/support/whole_reduction.h"

namespace splatvol::test {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

// Cells from 1 to 1/1000 of the domain, stretched along one axis and turned.
Mesh graded_mesh(std::uint32_t cells) {
  const glm::dquat turn = glm::normalize(glm::dquat(1, 0.2, -0.3, 0.4));
  const auto grade = [](double x) { return (std::exp(5 * x) - 1) / (std::exp(5.0) - 1); };
  return lattice(cells, [&](dvec3 p) { return turn * dvec3(grade(p.x), p.y, 0.05 * grade(p.z)); });
}

double wave(dvec3 p) { return std::sin(6 * p.x) + p.y * p.z; }

// A path in a folder of this process, because tests run beside each other. The folder is removed at the end.
std::string temporary_path(const std::string& name) {
  struct Folder {
    std::string path = (std::filesystem::path(testing::TempDir()) / "splatvol-build-XXXXXX").string();
    Folder() { require(::mkdtemp(path.data()) != nullptr, path); }
    ~Folder() { std::filesystem::remove_all(path); }
  };
  static const Folder folder;
  return folder.path + "/" + name;
}

struct Splat {
  dvec3 centroid;
  SplatShape shape;
  SplatValue value;
};

// A file, decoded whole.
struct Contents {
  std::shared_ptr<const format::Volume> volume;
  std::vector<dvec3> positions;
  std::vector<float> values;
  std::vector<vec3> gradients;
  std::vector<std::vector<Splat>> splats;  // [resolution][point], in file order
};

struct Chunk {
  format::ChunkEntry entry;
  format::Bytes bytes;
};

Chunk read_chunk(const format::Volume& volume, std::uint64_t row, format::ColumnKind kind, int attribute) {
  const auto page = *volume.read_directory_page(volume.directory_page_of_row(row));
  const auto& location = volume.find_chunk(page, row, volume.info().find_column(kind, attribute));
  return {location.entry, *volume.read_bytes(location.offset, location.entry.packed_bytes)};
}

template <class T, class Unpack>
std::vector<T> decode(const Chunk& chunk, std::size_t count, Unpack unpack) {
  std::vector<T> items(count);
  EXPECT_TRUE(unpack(chunk.entry, chunk.bytes, items, "").has_value());
  return items;
}

// Unpacks lengths, which are checked against the cube, or its edge.
template <class Unpack, class Bound>
auto within(const Bound& bound, Unpack unpack) {
  return [bound, unpack](const format::ChunkEntry& entry, const format::Bytes& bytes, auto& items,
                         const std::string& what) { return unpack(entry, bytes, items, bound, what); };
}

std::vector<Splat> read_splats(const format::Volume& volume, std::size_t resolution) {
  using format::ColumnKind;
  std::vector<Splat> splats;
  const format::RowLayout& rows = volume.rows();
  for (std::uint64_t row = rows.first_row(resolution); row < rows.first_row(resolution + 1); ++row) {
    const std::uint32_t count = rows.group(rows.group_of_row(row)).count;
    const auto chunk = [&](ColumnKind kind, int attribute) { return read_chunk(volume, row, kind, attribute); };
    const auto centroids =
        decode<dvec3>(chunk(ColumnKind::centroid, -1), count, within(volume.info().cube, format::unpack_centroids));
    const auto shapes = decode<SplatShape>(chunk(ColumnKind::moments, -1), count,
                                           within(volume.info().cube.edge, format::unpack_moments));
    const Chunk value_chunk = chunk(ColumnKind::value_moments, 0);
    const auto values = decode<SplatValue>(value_chunk, count, format::unpack_value_moments);
    for (std::size_t i = 0; i < count; ++i) splats.push_back({centroids[i], shapes[i], values[i]});
  }
  return splats;
}

Contents read_all(const std::string& path) {
  using format::ColumnKind;
  Contents contents;
  contents.volume = *format::Volume::open(*open_file(path));
  const format::Volume& volume = *contents.volume;
  EXPECT_EQ(message_of(volume.verify([](double) {})), "");
  const format::RowLayout& rows = volume.rows();
  const auto append = [](auto& all, const auto& items) { all.insert(all.end(), items.begin(), items.end()); };
  for (std::uint64_t g = 0; g < rows.group_count(); ++g) {
    const format::Group group = rows.group(g);
    const std::uint64_t row = rows.row(group.segment, g);
    const auto chunk = [&](ColumnKind kind, int attribute) { return read_chunk(volume, row, kind, attribute); };
    append(contents.positions, decode<dvec3>(chunk(ColumnKind::position, -1), group.count,
                                             within(volume.info().cube, format::unpack_positions)));
    append(contents.values, decode<float>(chunk(ColumnKind::value, 0), group.count, format::unpack_values));
    if (volume.info().find_column(ColumnKind::gradient, 0) >= 0)
      append(contents.gradients, decode<vec3>(chunk(ColumnKind::gradient, 0), group.count, format::unpack_gradients));
  }
  for (std::size_t r = 0; r < volume.info().resolutions(); ++r) contents.splats.push_back(read_splats(volume, r));
  return contents;
}

Result<BuildReport> build(std::vector<Piece> pieces, const std::string& path, BuildOptions options = {}) {
  PieceSource source(std::move(pieces));
  return build_volume(source, path, options, [](const char*, double) {});
}

TEST(Build, EveryPointOnceAtEveryScaleAndOffset) {
  for (const double scale : {1e-6, 1.0, 1e6})
    for (const double offset : {0.0, 1e7}) {
      const std::string path = temporary_path("scales.svol");
      auto points = random_points(9000, scale, dvec3(offset * scale));
      ASSERT_TRUE(build({scattered(points)}, path));
      const Contents contents = read_all(path);
      ASSERT_EQ(contents.positions.size(), points.size());
      // Points match by their order along x.
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

TEST(Build, GradientsAreKeptIfAskedFor) {
  const std::string path = temporary_path("gradients.svol");
  for (const bool kept : {false, true}) {
    ASSERT_TRUE(build({mesh_piece(jittered(5, 0.2), wave)}, path, {.gradients = kept}));
    const Contents contents = read_all(path);
    EXPECT_EQ(contents.volume->info().find_column(format::ColumnKind::gradient, 0) >= 0, kept);
    EXPECT_EQ(contents.gradients.size(), kept ? contents.positions.size() : 0);
    for (const vec3& gradient : contents.gradients) EXPECT_NEAR(glm::length(gradient), 1, 0.01);
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
    ASSERT_EQ(message_of(build({scattered(points)}, path)), "") << name;
    EXPECT_EQ(read_all(path).positions.size(), points.size()) << name;
  }
  const std::vector<dvec3> equal(cases["equal"].begin(), cases["equal"].begin() + 4000);
  EXPECT_EQ(build({scattered(equal)}, temporary_path("equal.svol"))->points.coincident, 3999u);
}

TEST(Build, RefusesInputsWithoutPoints) {
  const std::string path = temporary_path("none.svol");
  EXPECT_FALSE(build({}, path));
  EXPECT_FALSE(build({scattered({{nan, 0, 0}})}, path));
  EXPECT_FALSE(build({scattered({{-1e308, 0, 0}, {1.7e308, 0, 0}})}, path));
  EXPECT_FALSE(build({scattered(random_points(100))}, path, {.leaf_points = 7}));
  EXPECT_FALSE(std::filesystem::exists(path));
}

TEST(Build, CoarserSegmentsMayHaveSmallerGroups) {
  const std::string path = temporary_path("groups.svol");
  BuildOptions options;
  ASSERT_TRUE(build({scattered(random_points(20'000))}, path, options));
  Contents contents = read_all(path);
  const std::size_t resolutions = contents.volume->info().resolutions();
  ASSERT_GE(resolutions, 4u);
  std::vector<std::uint32_t> expected(resolutions, 512);
  expected.back() = 1024;
  EXPECT_EQ(contents.volume->info().points_per_chunk, expected);
  const std::vector<dvec3> positions = contents.positions;

  options.points_per_chunk.points = {100, 2000, 64};
  ASSERT_TRUE(build({scattered(random_points(20'000))}, path, options));
  contents = read_all(path);
  expected.assign(resolutions, 64);
  expected[resolutions - 2] = 2000;
  expected.back() = 100;
  EXPECT_EQ(contents.volume->info().points_per_chunk, expected);
  EXPECT_TRUE(contents.volume->verify([](double) {}));
  ASSERT_EQ(contents.positions.size(), positions.size());
  for (std::size_t i = 0; i < positions.size(); ++i)
    ASSERT_LT(glm::length(contents.positions[i] - positions[i]), 0.005) << i;

  for (const auto& points : {std::vector<std::uint32_t>{}, {0}, {63}, {1024, 63}, {65537}}) {
    options.points_per_chunk.points = points;
    EXPECT_FALSE(build({scattered(random_points(100))}, temporary_path("none.svol"), options));
  }
  EXPECT_FALSE(std::filesystem::exists(temporary_path("none.svol")));
}

TEST(Build, MissingValuesAndPointsAreCounted) {
  const std::string path = temporary_path("missing.svol");
  Piece piece = scattered(random_points(1000));
  piece.points[5].y = nan;
  piece.points[6].z = INFINITY;
  for (std::size_t i = 10; i < 108; ++i) piece.values[0][i] = nan;
  piece.values[0][108] = -INFINITY;
  piece.values[0][109] = 1e300;
  const auto report = value_of(build({piece}, path));
  EXPECT_EQ(report.points.not_finite, 2u);
  EXPECT_EQ(report.missing[0].second, 100u);
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
  for (std::size_t i = 0; i < stored.size(); ++i) EXPECT_NEAR(stored[i], piece.values[0][i], 1e-4 / 16);
}

TEST(Build, VerticesThatPiecesShareAreMergedScatteredPointsAreNot) {
  Piece left = scattered({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}});
  left.tetrahedra = {{0, 1, 2, 3}};
  left.census.tetrahedra = 1;
  Piece right = scattered({{1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 1, 1}});
  right.tetrahedra = {{0, 1, 2, 3}};
  right.census.tetrahedra = 1;
  const std::string path = temporary_path("pieces.svol");
  auto report = value_of(build({left, right}, path));
  EXPECT_EQ(report.points.merged, 3u);
  EXPECT_EQ(report.resolution_counts.back(), 5u);

  // Two values at one position are two samples.
  right.values[0][0] += 1;
  report = value_of(build({left, right}, path));
  EXPECT_EQ(report.points.merged, 2u);
  EXPECT_EQ(report.points.coincident, 1u);

  left.tetrahedra.clear();
  right.tetrahedra.clear();
  report = value_of(build({left, right}, path));
  EXPECT_EQ(report.points.merged, 0u);
  EXPECT_EQ(report.resolution_counts.back(), 8u);
}

TEST(Build, BytesDoNotDependOnMemoryAndThreads) {
  const std::string first = temporary_path("first.svol"), other = temporary_path("other.svol");
  const Piece mesh = mesh_piece(graded_mesh(is_sanitized ? 12 : 20), wave);
  const std::size_t points = is_sanitized ? 8'000 : 30'000;
  for (const auto& pieces : {std::vector{scattered(random_points(points))}, test::cut(mesh, 7)})
    for (const std::uint32_t leaf_points : sample_of<std::uint32_t>({20, 8})) {
      BuildOptions options{.leaf_points = leaf_points, .memory = std::uint64_t{8} << 30};
      ASSERT_TRUE(build(pieces, first, options));
      const std::string expected = *read_text_file(first);
      // With the least memory, points, faces and corners are sorted on the disk.
      for (const std::uint64_t memory :
           sample_of<std::uint64_t>({1, std::uint64_t{64} << 20, std::uint64_t{1} << 30}, 2))
        for (const std::size_t threads : sample_of<std::size_t>({7, 1, 2})) {
          const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
          options.memory = memory;
          ASSERT_TRUE(build(pieces, other, options));
          EXPECT_TRUE(*read_text_file(other) == expected) << memory << " bytes, " << threads << " threads";
        }
    }
}

// The mesh is too small to be reduced once the vertices that pieces share are merged.
TEST(Build, PiecesHaveTheResolutionsOfTheWholeMesh) {
  const Piece whole = mesh_piece(jittered(7, 0.2), wave);
  const std::string path = temporary_path("resolutions.svol");
  const std::vector<std::uint64_t> expected = {512};
  EXPECT_EQ(build({whole}, path)->resolution_counts, expected);
  EXPECT_EQ(build(test::cut(whole, 4), path)->resolution_counts, expected);
}

// The same points as BatchCutter.BatchesMayEndWithAFewPointsOfALargeNode.
TEST(Build, BatchesMayEndAnywhere) {
  std::vector<dvec3> points = random_points(65'530, 0.49);
  for (const dvec3& p : random_points(10, 0.25, dvec3(0.5))) points.push_back(p);
  for (const dvec3& p : random_points(20'000, 0.25, dvec3(0.75))) points.push_back(p);
  points.insert(points.end(), {{0, 0, 0}, {1, 1, 1}});
  EXPECT_EQ(
      message_of(build({scattered(points)}, temporary_path("batches.svol"), {.connectivity = Connectivity::none})), "");
}

// At each call of the progress in turn, a byte of every temporary file and of the unfinished output changes.
TEST(Build, ABadDiskIsSeenOrDoesNoHarm) {
  const std::string path = temporary_path("bad_disk.svol");
  const Piece mesh = mesh_piece(graded_mesh(is_sanitized ? 8 : 14), wave);
  for (const auto& pieces : {std::vector{scattered(random_points(is_sanitized ? 2'000 : 6'000))}, test::cut(mesh, 3)}) {
    const BuildOptions options{.memory = 1, .held_points = 100};  // all is on the disk
    std::size_t calls = 0, refused = 0;
    const auto build_with = [&](const BuildProgress& progress) {
      PieceSource source(pieces);
      std::filesystem::remove(path);
      return build_volume(source, path, options, progress);
    };
    // The finished file may change behind the check that reads it: such calls do not count.
    ASSERT_TRUE(build_with([&](std::string_view stage, double) { calls += stage == "checking" ? 0 : 1; }));
    const std::string expected = *read_text_file(path);
    const std::size_t step = std::max<std::size_t>(calls / (is_long() ? 16 : 5), 1);
    for (std::size_t bad = 0; bad < calls; bad += step)
      for (const double part : sample_of<double>({0.5, 0.01, 0.97})) {
        std::atomic<std::size_t> call = 0;
        std::string at;
        const auto report = build_with([&](const char* stage, double fraction) {
          if (call++ != bad) return;
          at = fmt::format("{} {}", stage, fraction);
          (void)damage_temporary_files(part);
        });
        refused += report ? 0 : 1;
        if (report)
          EXPECT_TRUE(*read_text_file(path) == expected) << at << ", " << part;
        else
          EXPECT_FALSE(std::filesystem::exists(path));
      }
    EXPECT_GT(refused, 0u);
  }
}

TEST(Build, AFailureLeavesTheOldFile) {
  const std::string path = temporary_path("old.svol");
  ASSERT_TRUE(build({scattered(random_points(100))}, path));
  const std::string before = *read_text_file(path);
  EXPECT_FALSE(build({}, path));
  EXPECT_EQ(*read_text_file(path), before);
  EXPECT_FALSE(build({scattered(random_points(100))}, temporary_path("no/such/folder.svol")));
}

// Mass, mean and covariance of (x, v) of all material together.
struct Total {
  double mass = 0;
  glm::dvec4 mean{0};
  glm::dmat4 second{0};  // raw, about the origin

  void add(double splat_mass, const dvec3& centroid, const dmat3& covariance, const SplatValue& value,
           const dvec3& value_covariance) {
    const glm::dvec4 y(centroid, value.mean);
    glm::dmat4 within(covariance);
    for (int i = 0; i < 3; ++i) within[i][3] = within[3][i] = value_covariance[i];
    within[3][3] = value.deviation * value.deviation;
    mass += splat_mass;
    mean += splat_mass * y;
    second += splat_mass * (within + glm::outerProduct(y, y));
  }
  // Entry of the covariance, over the product of the two deviations.
  [[nodiscard]] double correlation(int i, int j, const glm::dvec4& deviations) const {
    return (second[i][j] / mass - mean[i] / mass * (mean[j] / mass)) / (deviations[i] * deviations[j]);
  }
  [[nodiscard]] glm::dvec4 deviations() const {
    const glm::dvec4 one(1);
    return glm::sqrt(
        glm::dvec4(correlation(0, 0, one), correlation(1, 1, one), correlation(2, 2, one), correlation(3, 3, one)));
  }
};

void expect_same(const Total& a, const Total& b, double tolerance) {
  const glm::dvec4 deviations = b.deviations();
  EXPECT_NEAR(a.mass / b.mass, 1, tolerance);
  for (int i = 0; i < 4; ++i) {
    EXPECT_NEAR(a.mean[i] / a.mass, b.mean[i] / b.mass, tolerance * deviations[i]);
    for (int j = 0; j < 4; ++j)
      EXPECT_NEAR(a.correlation(i, j, deviations), b.correlation(i, j, deviations), tolerance) << i << " " << j;
  }
}

dmat3 dense(const SymmetricMatrix& s) { return {s.xx, s.xy, s.xz, s.xy, s.yy, s.yz, s.xz, s.yz, s.zz}; }

// The index that a build makes, with leaves of at most 300 points.
Tree build_index(const Piece& piece) {
  const std::string path = temporary_path("index.svol");
  EXPECT_TRUE(build({piece}, path, {.index_leaf_points = 300}));
  return *read_tree(**format::Volume::open(*open_file(path)), 0);
}

// An input, reduced and merged all in memory, and the index that a build makes of it.
struct Merged {
  PointBatch points;
  Cube cube;
  std::vector<Resolution> resolutions;
  std::vector<std::uint8_t> segments;
  std::vector<Material> materials;
  format::ValueBins bins;
  Tree tree;

  explicit Merged(const Piece& piece) {
    PieceSource source({piece});
    WholePoints whole = *read_points(source);
    points = std::move(whole.points);
    cube = whole.summary.cube;
    bins = format::bins_of(whole.summary.attributes[0]);
    resolutions = reduce_by_octree(points.keys, points.positions, cube, 8);
    segments = find_segments(resolutions);
    materials = merge_clusters(points.positions, resolutions, material_of(points));
    tree = build_index(piece);
  }

  [[nodiscard]] Total total(std::size_t r) const {
    Total total;
    for (std::size_t m = 0; m < resolutions[r].size(); ++m) {
      const SpatialMoments& moments = materials[r].moments[m];
      const ValueMoments& value = materials[r].value_moments[0][m];
      const dvec3 centroid = points.positions[resolutions[r].members[m]] + moments.centroid;
      total.add(moments.mass, centroid, dense(moments.covariance),
                {.mean = value.mean, .deviation = std::sqrt(value.variance)}, value.covariance);
    }
    return total;
  }
};

TEST(BuildMoments, TheWholeIsTheSameAtEveryResolution) {
  for (const Mesh& mesh : {jittered(16, 0.3), graded_mesh(16)}) {
    const Merged merged(mesh_piece(mesh, wave));
    ASSERT_GE(merged.resolutions.size(), 3u);
    const Total finest = merged.total(merged.resolutions.size() - 1);
    EXPECT_NEAR(finest.mass / test::volume(mesh), 1, 1e-12);
    for (std::size_t r = 0; r + 1 < merged.resolutions.size(); ++r) expect_same(merged.total(r), finest, 1e-11);

    // The file keeps masses and deviations within 2^(1/256), which is 0.3 %, and tilts an axis by up to 1/16 of a
    // shorter one. If the errors of thousands of splats do not average out, that makes 1 %.
    const std::string path = temporary_path("whole.svol");
    ASSERT_TRUE(build({mesh_piece(mesh, wave)}, path));
    for (const std::vector<Splat>& splats : read_all(path).splats) {
      Total total;
      for (const auto& [centroid, shape, value] : splats) {
        const dmat3 axes = glm::mat3_cast(shape.orientation);
        dmat3 covariance(0);
        for (int k = 0; k < 3; ++k)
          covariance += shape.deviations[k] * shape.deviations[k] * glm::outerProduct(axes[k], axes[k]);
        total.add(shape.mass, centroid, covariance, value,
                  axes * (value.correlation * shape.deviations * value.deviation));
      }
      expect_same(total, finest, 0.02);
    }
  }
}

TEST(BuildMoments, EveryValidCutHasTheSameMass) {
  const Mesh mesh = graded_mesh(18);
  const Merged merged(mesh_piece(mesh, wave));
  std::mt19937 random(1);
  const std::size_t last = merged.resolutions.size() - 1;
  std::size_t node = 0;
  double mass = 0;
  std::set<std::size_t> used;
  const auto skip = [&](const auto& self) -> void {
    const std::uint8_t mask = merged.tree.child_masks[node++];
    for (int i = 0; i < std::popcount(mask); ++i) self(self);
  };
  const auto cut = [&](const auto& self, std::size_t begin, std::size_t end, int depth) -> void {
    const std::uint8_t mask = merged.tree.child_masks[node];
    const std::size_t first = merged.tree.first_resolutions[node];
    if (mask == 0 || random() % 3 == 0) {
      const std::size_t r = first + random() % (last + 1 - first);
      used.insert(r);
      const auto& members = merged.resolutions[r].members;
      for (std::size_t m = 0; m < members.size(); ++m)
        if (members[m] >= begin && members[m] < end) mass += merged.materials[r].moments[m].mass;
      return skip(skip);
    }
    ++node;
    for (std::size_t child = begin; child < end;) {
      std::size_t child_end = child;
      while (child_end < end &&
             octant_at(merged.points.keys[child_end], depth) == octant_at(merged.points.keys[child], depth))
        ++child_end;
      self(self, child, child_end, depth + 1);
      child = child_end;
    }
  };
  const double volume = test::volume(mesh);
  for (int round = 0; round < 200; ++round) {
    node = 0;
    mass = 0;
    cut(cut, 0, merged.points.size(), 0);
    EXPECT_NEAR(mass / volume, 1, 1e-12);
  }
  EXPECT_EQ(used.size(), last + 1);
}

TEST(BuildMoments, FarFromTheOriginTheyAreTheSame) {
  // Coordinates are multiples of 2^-20: moving them by 10^7 is exact.
  Mesh mesh = jittered(8, 0.3);
  for (dvec3& p : mesh.points) p = glm::round(p * 0x1p20) * 0x1p-20;
  Mesh moved = mesh;
  const dvec3 shift(1e7, -1e7, 1e7);
  for (dvec3& p : moved.points) p += shift;
  Piece here = mesh_piece(mesh, wave), there = here;
  there.points = moved.points;
  const std::string path = temporary_path("far.svol");
  ASSERT_TRUE(build({here}, path));
  const Contents near = read_all(path);
  ASSERT_TRUE(build({there}, path));
  const Contents far = read_all(path);
  for (std::size_t r = 0; r < near.splats.size(); ++r)
    for (std::size_t i = 0; i < near.splats[r].size(); ++i) {
      const Splat &a = near.splats[r][i], &b = far.splats[r][i];
      EXPECT_NEAR(b.shape.mass / a.shape.mass, 1, 1.0 / 100);  // a quantisation step of the log code, 2^(1/128)
      EXPECT_NEAR(b.shape.deviations[2] / a.shape.deviations[2], 1, 1.0 / 100);
      // Both centroids are within 1/64 of the smallest deviation of their chunk.
      EXPECT_LT(glm::length(b.centroid - shift - a.centroid), a.shape.deviations[2] * std::sqrt(3.0) / 32);
    }
}

TEST(BuildMoments, PositionsAndMeansStayWithinTheirShareOfTheDeviations) {
  const Mesh mesh = graded_mesh(12);
  const Piece piece = mesh_piece(mesh, wave);
  const std::string path = temporary_path("shares.svol");
  ASSERT_TRUE(build({piece}, path));
  const Contents contents = read_all(path);
  const Merged merged(piece);
  const std::size_t last = merged.resolutions.size() - 1;
  const double range = merged.bins.max - merged.bins.min;
  const std::vector<std::uint64_t> order = file_order(merged.resolutions);
  for (std::size_t k = 0; k < order.size(); ++k) {
    const std::size_t i = order[k];
    const SpatialMoments& moments = merged.materials[last].moments[i];
    const double shortest = shortest_deviation(shape_of(moments));
    const Splat& splat = contents.splats[last][k];
    const dvec3 error = contents.positions[k] - merged.points.positions[i];
    const dvec3 centroid_error = splat.centroid - merged.points.positions[i] - moments.centroid;
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_LE(std::abs(error[axis]), shortest / 64);
      EXPECT_LE(std::abs(centroid_error[axis]), shortest / 64);
    }
    const ValueMoments& value = merged.materials[last].value_moments[0][i];
    const double mean = contents.volume->info().attributes[0].offset + splat.value.mean;
    EXPECT_LE(std::abs(mean - value.mean), std::max(std::sqrt(value.variance) * 0.07, range * 0x1p-20));
  }
}

TEST(BuildMoments, MissingValuesLowerTheCoverage) {
  const Mesh mesh = jittered(12, 0.2);
  Piece piece = mesh_piece(mesh, wave);
  std::mt19937 random(8);
  for (double& value : piece.values[0])
    if (random() % 4 == 0) value = random() % 2 == 0 ? nan : 1e300;
  const Merged merged(piece);
  double with_value = 0;
  for (const Tetrahedron& t : mesh.tetrahedra)
    if (std::ranges::all_of(t, [&](std::uint32_t v) { return std::abs(piece.values[0][v]) < 1e30; }))
      with_value += test::volume({mesh.points, {t}});
  ASSERT_GT(with_value, 0.2);
  for (const Material& material : merged.materials) {
    double mass = 0;
    for (const ValueMoments& value : material.value_moments[0]) mass += value.mass;
    EXPECT_NEAR(mass / with_value, 1, 1e-12);
  }
  const std::string path = temporary_path("coverage.svol");
  ASSERT_TRUE(build({piece}, path));
  for (const auto& splats : read_all(path).splats) {
    double mass = 0;
    for (const Splat& splat : splats) mass += splat.shape.mass * splat.value.coverage;
    EXPECT_NEAR(mass / with_value, 1, 0.005);  // 0.3 % of a mass, 1/510 of a coverage
  }
}

TEST(BuildMoments, PointsWithoutMaterialStayWhereTheyAre) {
  // Two cubes of cells, so that the points between them lie in the box round all cells.
  Mesh mesh = lattice(8);
  const Mesh one = mesh;
  for (const dvec3& p : one.points) mesh.points.push_back(p + dvec3(4, 0, 0));
  for (auto corners : one.tetrahedra) {
    for (std::uint32_t& corner : corners) corner += static_cast<std::uint32_t>(one.points.size());
    mesh.tetrahedra.push_back(corners);
  }
  const std::size_t in_cells = mesh.points.size();
  for (const dvec3& p : random_points(700)) mesh.points.push_back(p + dvec3(2, 0, 0));
  mesh.tetrahedra.push_back({0, 1, 2, 3});  // flat: a row of the lattice
  const Piece piece = mesh_piece(mesh, [](dvec3 p) { return p.x; });
  const std::string path = temporary_path("no_cell.svol");
  const auto report = value_of(build({piece}, path, {.gradients = true}));
  EXPECT_EQ(report.connectivity, Connectivity::mesh);
  EXPECT_EQ(report.points.in_no_cell, 700u);
  const Contents contents = read_all(path);
  ASSERT_EQ(contents.gradients.size(), contents.positions.size());
  std::size_t empty = 0;
  for (std::size_t i = 0; i < contents.positions.size(); ++i) {
    const Splat& splat = contents.splats.back()[i];
    if (splat.shape.mass > 0) continue;
    ++empty;
    EXPECT_GE(contents.positions[i].x, 1.99);
    EXPECT_LE(contents.positions[i].x, 3.01);
    EXPECT_NEAR(glm::length(splat.centroid - contents.positions[i]), 0, 1e-3);  // of a spacing of 0.1
    EXPECT_EQ(splat.shape.deviations, dvec3(0));
    EXPECT_EQ(splat.value.coverage, 0);
    EXPECT_EQ(contents.gradients[i], vec3(0));
  }
  EXPECT_EQ(empty, mesh.points.size() - in_cells);
  for (const auto& splats : contents.splats) {
    double mass = 0;
    for (const Splat& splat : splats) mass += splat.shape.mass;
    EXPECT_NEAR(mass, 2, 0.006);
  }
}

TEST(BuildMoments, OneTetrahedronAndOnlyFlatOnesWork) {
  const std::string path = temporary_path("one_cell.svol");
  const Mesh one{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}}, {{0, 1, 2, 3}}};
  ASSERT_TRUE(build({mesh_piece(one, wave)}, path));
  const Contents contents = read_all(path);
  for (const Splat& splat : contents.splats[0]) EXPECT_NEAR(splat.shape.mass * 24, 1, 0.003);
  const Mesh flat{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}}, {{0, 1, 2, 3}}};
  ASSERT_TRUE(build({mesh_piece(flat, wave)}, path));
  const Contents nothing = read_all(path);
  for (const Splat& splat : nothing.splats[0]) EXPECT_EQ(splat.shape.mass, 0);
}

BuildOptions connected(Connectivity connectivity) { return {.connectivity = connectivity}; }

TEST(BuildConnectivity, IsAsAskedForAndSaidInTheReportAndTheFile) {
  const std::string path = temporary_path("connectivity.svol");
  const Piece mesh = mesh_piece(jittered(8, 0.2), wave);
  Piece points = mesh;
  points.tetrahedra.clear();
  points.census.tetrahedra = 0;
  const auto used = [&](const Piece& piece, Connectivity wanted) -> std::string {
    const auto report = build({piece}, path, connected(wanted));
    if (!report) return report.error().message;
    const std::string name = connectivity_name(report->connectivity);
    EXPECT_NE((*format::Volume::open(*open_file(path)))->info().provenance.find("\"connectivity\":\"" + name + "\""),
              std::string::npos);
    return name;
  };
  EXPECT_EQ(used(mesh, Connectivity::automatic), "mesh");
  EXPECT_EQ(used(mesh, Connectivity::mesh), "mesh");
  EXPECT_EQ(used(mesh, Connectivity::delaunay), "delaunay");
  EXPECT_EQ(used(mesh, Connectivity::none), "none");
  EXPECT_EQ(used(points, Connectivity::automatic), "delaunay");
  EXPECT_EQ(used(points, Connectivity::none), "none");
  EXPECT_EQ(used(points, Connectivity::boxes), "boxes");
  EXPECT_NE(used(points, Connectivity::mesh).find("no cells"), std::string::npos);
  // No four points span a volume.
  EXPECT_EQ(used(scattered({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}}), Connectivity::automatic), "boxes");
}

TEST(BuildConnectivity, SurfacesAreJoinedOnRequestOnly) {
  const std::string path = temporary_path("surface.svol");
  Piece surface = scattered(random_points(100));
  surface.census.cells = {{"polygon", 40}, {"vertex", 3}};
  surface.census.without_volume = 43;
  surface.census.surfaces = 40;
  const std::string refused = message_of(build({surface}, path));
  EXPECT_EQ(
      refused,
      "only surface cells (40 polygons); splatvol draws volumes; --connectivity delaunay joins the points anyway");
  EXPECT_FALSE(std::filesystem::exists(path));
  for (const Connectivity wanted : {Connectivity::delaunay, Connectivity::none})
    EXPECT_TRUE(build({surface}, path, connected(wanted)));
  EXPECT_TRUE(build({surface, mesh_piece(jittered(4, 0.2), wave)}, path)) << "a volume beside it";
  Piece edges = scattered(random_points(100));
  edges.census.cells = {{"line", 3}};
  edges.census.without_volume = edges.census.lines = 3;
  edges.census.left_out = 7;
  EXPECT_EQ(message_of(build({edges}, path)), "only lines (3 lines), and 7 cells of surfaces; splatvol draws volumes");
}

TEST(BuildConnectivity, CellsWithoutVolumeAreRefused) {
  const std::string path = temporary_path("flat.svol");
  Piece flat = mesh_piece({{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}}, {{0, 1, 2, 3}}}, wave);
  flat.census.cells = {{"hexahedron", 1}};
  flat.census.tetrahedra = flat.census.flat = 1;
  EXPECT_THAT(message_of(build({flat}, path)), testing::StartsWith("no cell fills a volume (1 hexahedron)"));
  EXPECT_TRUE(build({flat, mesh_piece(jittered(4, 0.2), wave)}, path)) << "a volume beside it";

  flat.census.flat = flat.census.tetrahedra = 0;
  flat.census.non_finite = 1;
  flat.tetrahedra.clear();
  EXPECT_THAT(message_of(build({flat}, path)), testing::StartsWith("every cell has coordinates beyond 1e50"));
}

TEST(BuildConnectivity, PointsInAPlaneHaveNoTetrahedra) {
  const std::string path = temporary_path("plane.svol");
  std::vector<dvec3> points = random_points(100);
  for (dvec3& point : points) point.z = 0;
  EXPECT_THAT(message_of(build({scattered(points)}, path, connected(Connectivity::delaunay))),
              testing::HasSubstr("in a plane"));
  const auto report = value_of(build({scattered(points)}, path));
  EXPECT_EQ(report.connectivity, Connectivity::boxes);
}

TEST(BuildConnectivity, PointsWithoutAVolumeAreDrawn) {
  const std::string path = temporary_path("flat_points.svol");
  std::vector<std::vector<dvec3>> inputs;
  for (int count = 1; count <= 5; ++count) inputs.push_back(random_points(count));
  inputs.emplace_back(30, dvec3(1, -2, 3));
  inputs.push_back(random_points(300));
  for (dvec3& point : inputs.back()) point.z = 1e3;  // on a plane
  inputs.push_back(random_points(300));
  for (dvec3& point : inputs.back()) point = {point.x, point.x, -point.x};  // on a line
  for (const std::vector<dvec3>& points : inputs)
    for (const Connectivity wanted : {Connectivity::automatic, Connectivity::none, Connectivity::boxes}) {
      ASSERT_TRUE(build({scattered(points)}, path, connected(wanted))) << points.size();
      const auto splats = read_all(path).splats.back();
      double mass = 0;
      for (const Splat& splat : splats) {
        ASSERT_TRUE(std::isfinite(splat.shape.mass) && splat.shape.mass >= 0) << points.size();
        mass += splat.shape.mass * splat.value.coverage;
      }
      EXPECT_EQ(splats.size(), points.size());
      EXPECT_GT(mass, 0) << points.size();
    }
}

TEST(BuildConnectivity, WithoutCellsMassesStillFillTheDomain) {
  const std::string path = temporary_path("filled.svol");
  Piece mesh = mesh_piece(jittered(12, 0.2), wave), points = mesh;
  points.tetrahedra.clear();
  points.census.tetrahedra = 0;
  for (const auto& [piece, wanted] : {std::pair(mesh, Connectivity::delaunay), std::pair(mesh, Connectivity::none),
                                      std::pair(points, Connectivity::automatic)}) {
    ASSERT_TRUE(build({piece}, path, connected(wanted)));
    for (const auto& splats : read_all(path).splats) {
      double mass = 0;
      for (const Splat& splat : splats) mass += splat.shape.mass * splat.value.coverage;
      EXPECT_NEAR(mass, 1, 0.06);  // the jitter at the boundary
    }
  }
}

// A file's provenance does not tell the number of subdomains.
TEST(BuildConnectivity, DelaunayInSubdomainsGivesTheSameFileWithAnyMemory) {
  const Piece points = scattered(random_points(80'000));  // two subdomains
  const auto bytes = [&](std::uint64_t held_points, std::uint64_t memory) {
    BuildOptions options = connected(Connectivity::delaunay);
    options.held_points = held_points;
    options.memory = memory;
    const std::string path = temporary_path("subdomains.svol");
    EXPECT_TRUE(build({points}, path, options));
    return *read_text_file(path);
  };
  const std::string whole = bytes(100'000, std::uint64_t{1} << 30);
  if (is_long()) {
    EXPECT_TRUE(bytes(1000, std::uint64_t{1} << 30) == whole);
  }
  EXPECT_TRUE(bytes(1000, std::uint64_t{1} << 25) == whole);
}

// Walks the tree and calls visit(node, begin, end, depth): points [begin, end) in Morton order lie in the node.
template <class Visit>
void walk(const Tree& tree, std::span<const MortonKey> keys, const Visit& visit) {
  std::size_t next_node = 0;
  const auto descend = [&](const auto& self, std::size_t begin, std::size_t end, int depth) -> void {
    const std::size_t node = next_node++;
    visit(node, begin, end, depth);
    for (std::size_t child = begin; tree.child_masks[node] != 0 && child < end;) {
      const unsigned octant = octant_at(keys[child], depth);
      ASSERT_NE(tree.child_masks[node] & 1u << octant, 0u);
      std::size_t child_end = child;
      while (child_end < end && octant_at(keys[child_end], depth) == octant) ++child_end;
      self(self, child, child_end, depth + 1);
      child = child_end;
    }
  };
  descend(descend, 0, keys.size(), 0);
  EXPECT_EQ(next_node, tree.size());
}

// Size of a `moments` splat in a node: its width, or half of its reach out of the node if that is more.
double moments_size(const Splat& splat, const dvec3& node_center, double half) {
  const dmat3 axes = glm::mat3_cast(splat.shape.orientation);
  double size = std::sqrt(12.0) * splat.shape.deviations[0];
  for (int axis = 0; axis < 3; ++axis) {
    double reach = 0;
    for (int k = 0; k < 3; ++k) reach += std::pow(axes[k][axis] * splat.shape.deviations[k], 2);
    size = std::max(size, (std::abs(splat.centroid[axis] - node_center[axis]) + std::sqrt(12 * reach) - half) / 2);
  }
  return size;
}

TEST(BuildIndex, BoundsTheSplatsThatComeOutOfTheFile) {
  const Piece piece = mesh_piece(graded_mesh(20), wave);
  const std::string path = temporary_path("bounds.svol");
  ASSERT_TRUE(build({piece}, path, {.index_leaf_points = 300}));
  const Contents contents = read_all(path);
  const Merged merged(piece);  // the same tree: bytes do not depend on threads
  const Cube& cube = merged.cube;
  const std::vector<std::uint64_t> order = file_order(merged.resolutions);
  std::vector<std::size_t> index_in_file(merged.points.size());  // [point in Morton order]
  for (std::size_t k = 0; k < order.size(); ++k) index_in_file[order[k]] = k;

  double tightest = 0;
  walk(merged.tree, merged.points.keys, [&](std::size_t node, std::size_t begin, std::size_t end, int depth) {
    const double half = std::ldexp(cube.edge, -depth - 1);
    const dvec3 center = node_center(merged.points.positions[begin], cube, depth);
    const format::ValueSummary& summary = merged.tree.summaries[node];
    for (std::size_t r = merged.tree.first_resolutions[node]; r < merged.resolutions.size(); ++r) {
      double largest = 0;
      for (std::size_t i = begin; i < end; ++i) {
        if (merged.segments[i] > r) continue;
        const Splat& splat = contents.splats[r][index_in_file[i]];
        const double mean = splat.value.mean + contents.volume->info().attributes[0].offset;
        const double error = 0.07 * splat.value.deviation + 1e-5;
        EXPECT_GE(mean, summary.min - error);
        EXPECT_LE(mean, summary.max + error);
        largest = std::max(largest, moments_size(splat, center, half));
      }
      if (largest == 0) continue;
      const double bound = format::size_bound(merged.tree.size_code_at(node, 1, r), cube.edge);
      EXPECT_GE(bound, largest) << "resolution " << r << " depth " << depth;
      EXPECT_LE(bound, largest * 1.25) << "resolution " << r << " depth " << depth;
      tightest = std::max(tightest, largest / bound);
    }
  });
  EXPECT_GT(tightest, 0.95);
}

TEST(BuildIndex, SummariesCoverTheValuesOfTheMaterial) {
  const Mesh mesh = jittered(12, 0.3);
  const Merged merged(mesh_piece(mesh, [](dvec3 p) { return p.x > 0.5 ? 10 : std::floor(4 * p.y); }));
  // Values at random positions in the cells, by the vertex that owns the position.
  std::map<std::tuple<double, double, double>, std::size_t> index_of;
  for (std::size_t i = 0; i < merged.points.size(); ++i) {
    const dvec3& p = merged.points.positions[i];
    index_of[{p.x, p.y, p.z}] = i;
  }
  std::vector<std::vector<double>> taken(merged.points.size());
  std::mt19937_64 random(6);
  std::exponential_distribution<double> part(1);
  for (const Tetrahedron& t : mesh.tetrahedra)
    for (int round = 0; round < 20; ++round) {
      std::array<double, 4> share;
      for (double& s : share) s = part(random);
      const double all = std::accumulate(share.begin(), share.end(), 0.0);
      double value = 0;
      std::array<std::size_t, 4> corners;
      for (std::size_t k = 0; k < 4; ++k) {
        const dvec3& p = mesh.points[t[k]];
        corners[k] = index_of[{p.x, p.y, p.z}];
        value += share[k] / all * merged.points.values[0][corners[k]];
      }
      taken[corners[static_cast<std::size_t>(std::ranges::max_element(share) - share.begin())]].push_back(value);
    }
  walk(merged.tree, merged.points.keys, [&](std::size_t node, std::size_t begin, std::size_t end, int) {
    const format::ValueSummary& summary = merged.tree.summaries[node];
    for (std::size_t i = begin; i < end; ++i)
      for (const double value : taken[i]) {
        EXPECT_GE(value, summary.min - 1e-6);
        EXPECT_LE(value, summary.max + 1e-6);
        EXPECT_NE(summary.occupancy >> merged.bins.bin(value) & 1, 0u);
      }
  });
}

// The points of a node, in Morton order.
struct NodePoints {
  std::size_t begin, end;
  int depth;
};

// A point set and its resolutions. Counts, size bounds and first_resolution follow by brute force.
struct BruteForce {
  WholePoints whole;
  std::vector<Resolution> resolutions;
  std::vector<std::uint8_t> segments;

  explicit BruteForce(const std::vector<dvec3>& positions) {
    PieceSource source({scattered(positions)});
    whole = *read_points(source);
    resolutions = reduce_by_octree(whole.points.keys, whole.points.positions, whole.summary.cube, 8);
    segments = find_segments(resolutions);
  }

  [[nodiscard]] auto count(const NodePoints& node, std::size_t r) const {
    const auto at = [&](std::size_t i) { return segments.begin() + static_cast<std::ptrdiff_t>(i); };
    return static_cast<std::uint64_t>(std::count(at(node.begin), at(node.end), static_cast<std::uint8_t>(r)));
  }

  // Size of the largest octant splat whose point lies in the node.
  [[nodiscard]] double largest_size(const NodePoints& node, std::size_t r) const {
    const Resolution& resolution = resolutions[r];
    double largest = 0;
    for (std::size_t m = 0; m < resolution.size(); ++m)
      if (resolution.members[m] >= node.begin && resolution.members[m] < node.end)
        largest = std::max(largest, std::ldexp(1.0, -resolution.depths[m]) / std::cbrt(resolution.counts[m]));
    return largest;
  }

  // Whether a cluster of resolution r - 1, which is a leaf over resolution r, crosses the node's border: it is larger
  // than the node and has a point in common with it.
  [[nodiscard]] bool is_crossed(const NodePoints& node, std::size_t r) const {
    const std::vector<MortonKey>& keys = whole.points.keys;
    const Resolution& resolution = resolutions[r];
    for (std::size_t m = 0; m < resolution.size(); ++m)
      if (resolution.depths[m] < node.depth &&
          common_depth(keys[resolution.members[m]], keys[node.begin]) >= resolution.depths[m])
        return true;
    return false;
  }
};

TEST(BuildIndex, EveryNodeTellsTheTruth) {
  auto positions = random_points(6000);
  for (std::size_t i = 0; i < 3000; ++i) positions[i] = dvec3(0.7) + 1e-4 * positions[i];
  const BruteForce expected(positions);
  const Tree tree = build_index(scattered(positions));
  walk(tree, expected.whole.points.keys, [&](std::size_t node, std::size_t begin, std::size_t end, int depth) {
    const NodePoints points{begin, end, depth};
    for (std::size_t r = 0; r < expected.resolutions.size(); ++r) {
      ASSERT_EQ(tree.counts_of(node)[r], expected.count(points, r));
      const double largest = expected.largest_size(points, r);
      if (largest > 0 && r >= tree.first_resolutions[node]) {
        EXPECT_GE(format::size_bound(tree.size_code_at(node, 0, r), 1.0), largest * (1 - 1e-12));
        EXPECT_LE(format::size_bound(tree.size_code_at(node, 0, r), 1.0), largest * 1.1);
      }
      if (r > 0) {
        EXPECT_EQ(expected.is_crossed(points, r), tree.first_resolutions[node] >= r)
            << "resolution " << r << " depth " << depth;
      }
    }
    if (tree.child_masks[node] == 0) {
      EXPECT_LE(end - begin, 300u);
    }
  });
}

constexpr std::array all_reductions = {Reduction::octree, Reduction::mis, Reduction::kdtree};

BuildOptions reduced_by(Reduction method) { return {.reduction = method, .index_leaf_points = 255}; }

// A node's splats have the same mass at each resolution at which it may be drawn: no cluster crosses its border, and
// any valid cut has the mass of the whole. Masses in the file are within 2^(1/256), which is 0.28 %. Returns the number
// of nodes that may be drawn at more than one resolution.
std::size_t expect_nodes_keep_their_mass(const Contents& contents) {
  const Tree tree = *read_tree(*contents.volume, 0);
  const std::size_t resolutions = contents.splats.size();
  std::size_t node = 0, with_choice = 0;
  const auto descend = [&](const auto& self, std::vector<std::uint64_t> begins) -> void {
    const auto counts = tree.counts_of(node);
    const std::size_t first = tree.first_resolutions[node];
    const int children = std::popcount(tree.child_masks[node]);
    ++node;
    std::vector<double> masses(resolutions);
    for (std::size_t r = first; r < resolutions; ++r)
      for (std::size_t s = 0; s <= r; ++s)
        for (std::uint64_t i = begins[s]; i < begins[s] + counts[s]; ++i) masses[r] += contents.splats[r][i].shape.mass;
    for (std::size_t r = first; r < resolutions; ++r)
      ASSERT_NEAR(masses[r], masses.back(), 0.0056 * masses.back()) << "node " << node - 1 << ", resolution " << r;
    with_choice += first + 1 < resolutions;
    for (int c = 0; c < children; ++c) {
      const std::vector<std::uint64_t> at = begins;
      for (std::size_t s = 0; s < resolutions; ++s) begins[s] += tree.counts_of(node)[s];
      self(self, at);
      if (testing::Test::HasFatalFailure()) return;
    }
  };
  std::vector<std::uint64_t> begins = {0};
  for (std::size_t r = 0; r + 1 < resolutions; ++r) begins.push_back(contents.splats[r].size());
  descend(descend, begins);
  return with_choice;
}

TEST(BuildReductions, NodesKeepTheirMassAtEveryResolution) {
  const Mesh mesh = graded_mesh(28);
  for (const Reduction method : all_reductions) {
    SCOPED_TRACE(reduction_name(method));
    const std::string path = temporary_path("reductions.svol");
    ASSERT_TRUE(build({mesh_piece(mesh, wave)}, path, reduced_by(method)));
    const Contents contents = read_all(path);
    EXPECT_EQ(contents.volume->info().reduction_method, reduction_name(method));
    EXPECT_GE(contents.splats.size(), 3u);
    double mass = 0;
    for (const Splat& splat : contents.splats[0]) mass += splat.shape.mass;
    EXPECT_NEAR(mass / test::volume(mesh), 1, 0.0028);
    EXPECT_GT(expect_nodes_keep_their_mass(contents), 8u);
    if (HasFatalFailure()) return;
  }
}

TEST(BuildReductions, HardDistributionsWork) {
  constexpr std::uint64_t count = 6000;
  for (const Distribution distribution : {Distribution::half_tiny, Distribution::equal, Distribution::two_clusters,
                                          Distribution::line, Distribution::layer})
    for (const Reduction method : all_reductions) {
      SCOPED_TRACE(distribution_names()[static_cast<std::size_t>(distribution)] + ", " + reduction_name(method));
      const std::string path = temporary_path("hard.svol");
      const auto source = generate_points({count, distribution});
      const auto report = value_of(build_volume(*source, path, reduced_by(method), [](const char*, double) {}));
      const Contents contents = read_all(path);
      EXPECT_EQ(contents.positions.size(), count);
      const std::vector<std::uint64_t>& counts = report.resolution_counts;
      EXPECT_LE(counts.front(), 512u);
      // An independent set of 2 k + 1 points on a line may have k + 1 points.
      for (std::size_t r = 0; r + 1 < counts.size(); ++r) EXPECT_LT(19 * counts[r], 10 * counts[r + 1]);
      expect_nodes_keep_their_mass(contents);
      if (HasFatalFailure()) return;
    }
}

TEST(BuildReductions, BytesDoNotDependOnMemoryAndThreads) {
  const std::string first = temporary_path("first.svol"), other = temporary_path("other.svol");
  const Piece mesh = mesh_piece(graded_mesh(is_long() ? 20 : 12), wave);
  const std::size_t points = is_long() ? 30'000 : 8'000;
  for (const Reduction method : {Reduction::mis, Reduction::kdtree})
    for (const auto& pieces : {std::vector{scattered(random_points(points))}, test::cut(mesh, 7)}) {
      BuildOptions options = reduced_by(method);
      options.memory = std::uint64_t{8} << 30;
      ASSERT_TRUE(build(pieces, first, options));
      const std::string expected = *read_text_file(first);
      for (const auto& [memory, threads] : {std::pair{std::uint64_t{1}, 7}, {std::uint64_t{64} << 20, 1}}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                        static_cast<std::size_t>(threads));
        options.memory = memory;
        ASSERT_TRUE(build(pieces, other, options));
        EXPECT_TRUE(*read_text_file(other) == expected) << memory << " bytes, " << threads << " threads";
      }
    }
}

}  // namespace
}  // namespace splatvol::test
