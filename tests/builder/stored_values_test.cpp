// What a file keeps of the input's numbers: exactly, within the error that it states, or once for several names.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <random>

#include "base/file.h"
#include "builder/pipeline/build.h"
#include "builder/series/series_build.h"
#include "format/volume.h"
#include "tests/builder/support/meshes.h"
#include "tests/builder/support/series_check.h"
#include "tests/support/opened_files.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using format::ColumnKind;

constexpr double nan = std::numeric_limits<double>::quiet_NaN();
const auto silent = [](const char*, double) {};

struct StoredValuesTest : FolderTest {
  std::shared_ptr<const format::Volume> build(std::vector<Piece> pieces, std::vector<std::string> names,
                                              const BuildOptions& options = {}) {
    PieceSource source(std::move(pieces), {.attributes = std::move(names)});
    report_ = value_of(build_volume(source, path("out.svol"), options, silent));
    return open_checked(path("out.svol"));
  }

  BuildReport report_;
};

// A column of all points of a file, in its order.
template <class T, class Unpack>
std::vector<T> read_column(const format::Volume& volume, ColumnKind kind, int attribute, const Unpack& unpack) {
  std::vector<T> all;
  const format::RowLayout& rows = volume.rows();
  for (std::uint64_t g = 0; g < rows.group_count(); ++g) {
    const format::Group group = rows.group(g);
    const std::uint64_t row = rows.row(group.segment, g);
    const auto page = *volume.read_directory_page(volume.directory_page_of_row(row));
    const auto& chunk = volume.find_chunk(page, row, volume.info().find_column(kind, attribute));
    std::vector<T> part(group.count);
    EXPECT_TRUE(unpack(chunk.entry, *volume.read_bytes(chunk.offset, chunk.entry.packed_bytes), std::span<T>(part)));
    all.insert(all.end(), part.begin(), part.end());
  }
  return all;
}

std::vector<dvec3> positions_of(const format::Volume& volume) {
  return read_column<dvec3>(volume, ColumnKind::position, -1, [&](const auto& entry, const auto& bytes, auto out) {
    return format::unpack_positions(entry, bytes, out, volume.info().cube, "test");
  });
}

std::vector<double> values_of(const format::Volume& volume, int attribute) {
  const auto stored = read_column<float>(
      volume, ColumnKind::value, attribute,
      [](const auto& entry, const auto& bytes, auto out) { return format::unpack_values(entry, bytes, out, "test"); });
  std::vector<double> values;
  for (const float value : stored)
    values.push_back(volume.info().attributes[static_cast<std::size_t>(attribute)].value(double{value}));
  return values;
}

// Values of single precision: round 0, in a narrow range far from 0, small, large.
Piece points_with_values() {
  Piece piece = scattered(random_points(3000, 7, dvec3(100, -5, 1e-3)));
  std::mt19937 random(1);
  std::normal_distribution<float> normal;
  piece.values.assign(4, {});
  for (std::size_t i = 0; i < piece.points.size(); ++i) {
    piece.values[0].push_back(i % 17 == 3 ? nan : double{normal(random)});
    piece.values[1].push_back(double{101325.0F + 0.1F * normal(random)});
    piece.values[2].push_back(double{1e-30F * normal(random)});
    piece.values[3].push_back(double{1e37F * normal(random)});
  }
  return piece;
}

const std::vector<std::string> four_names = {"normal", "narrow", "small", "large"};

// Indices of the input's points, in the file's order. Positions tell them apart.
std::vector<std::size_t> order_of(const std::vector<dvec3>& stored, const Piece& piece) {
  std::vector<std::size_t> order;
  for (const dvec3& p : stored)
    order.push_back(static_cast<std::size_t>(
        std::ranges::min_element(piece.points, {}, [&](const dvec3& q) { return squared_length(p - q); }) -
        piece.points.begin()));
  return order;
}

TEST_F(StoredValuesTest, ExactNumbersComeBackBitByBit) {
  const Piece piece = points_with_values();
  const auto volume = build({piece}, four_names, {.exact = {.positions = true, .values = true}});
  EXPECT_EQ(volume->info().position_error, 0);
  const std::vector<dvec3> stored = positions_of(*volume);
  ASSERT_EQ(stored.size(), piece.points.size());
  const std::vector<std::size_t> order = order_of(stored, piece);
  for (std::size_t i = 0; i < order.size(); ++i) ASSERT_EQ(stored[i], piece.points[order[i]]);
  for (int a = 0; a < 4; ++a) {
    EXPECT_EQ(volume->info().attributes[static_cast<std::size_t>(a)].error, 0);
    const std::vector<double> values = values_of(*volume, a);
    for (std::size_t i = 0; i < order.size(); ++i) {
      const double expected = piece.values[static_cast<std::size_t>(a)][order[i]];
      ASSERT_TRUE(std::isnan(expected)
                      ? std::isnan(values[i])
                      : std::bit_cast<std::uint64_t>(values[i]) == std::bit_cast<std::uint64_t>(expected))
          << four_names[static_cast<std::size_t>(a)] << " " << values[i] << " " << expected;
    }
  }
}

TEST_F(StoredValuesTest, TheStatedErrorsAreKept) {
  const Piece piece = points_with_values();
  const auto volume = build({piece}, four_names);
  const std::vector<dvec3> stored = positions_of(*volume);
  const std::vector<std::size_t> order = order_of(stored, piece);
  EXPECT_GT(volume->info().position_error, 0);
  for (std::size_t i = 0; i < order.size(); ++i)
    for (int axis = 0; axis < 3; ++axis)
      EXPECT_LE(std::abs(stored[i][axis] - piece.points[order[i]][axis]), volume->info().position_error);
  for (int a = 0; a < 4; ++a) {
    const format::Attribute& attribute = volume->info().attributes[static_cast<std::size_t>(a)];
    EXPECT_GT(attribute.error, 0) << attribute.name;
    EXPECT_LT(attribute.error, 0.1 * (attribute.max - attribute.min)) << attribute.name;
    const std::vector<double> values = values_of(*volume, a);
    double largest = 0;
    for (std::size_t i = 0; i < order.size(); ++i) {
      const double expected = piece.values[static_cast<std::size_t>(a)][order[i]];
      if (!std::isnan(expected)) largest = std::max(largest, std::abs(values[i] - expected));
    }
    EXPECT_LE(largest, attribute.error) << attribute.name;
    // In the narrow range, numbers of single precision happen to be on the grid.
    if (attribute.name != "narrow") {
      EXPECT_GT(largest, 0.1 * attribute.error) << attribute.name;
    }
  }
}

// A mesh in pieces with "p", the same again, and a third that differs in one bit of one value.
std::vector<Piece> pieces_with_equal_attributes() {
  const Mesh mesh = lattice(6, [](dvec3 p) { return dvec3(p.x * p.x, p.y, 0.3 * p.z); });
  Piece whole = mesh_piece(mesh, [](dvec3 p) { return std::sin(6 * p.x) + p.y * p.z; });
  whole.values[0][5] = nan;
  whole.values.push_back(whole.values[0]);
  whole.values.push_back(whole.values[0]);
  whole.values[2][100] = std::nextafter(whole.values[2][100], 10.0);
  return cut(whole, 3);
}

const std::vector<std::string> three_names = {"p", "p again", "q"};

SeriesStep step(int number) {
  return step_of(fmt::format("step {}", number), number, pieces_with_equal_attributes(), {.attributes = three_names});
}

// Hashes of the chunks of the file's material.
std::vector<std::uint64_t> material_of(const format::Volume& volume) {
  std::vector<std::uint64_t> hashes;
  for (std::uint64_t row = 0; row < volume.rows().row_count(); ++row) {
    const auto page = *volume.read_directory_page(volume.directory_page_of_row(row));
    for (const ColumnKind kind : {ColumnKind::centroid, ColumnKind::moments})
      hashes.push_back(volume.find_chunk(page, row, volume.info().find_column(kind)).entry.hash);
  }
  return hashes;
}

// A check of a file looks for occupied bins near the mean of each splat (spec R22).
TEST_F(StoredValuesTest, MaterialIsOccupiedNearItsMean) {
  Piece piece = scattered(random_points(600));
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform(-30, 30);
  piece.values.assign(6, {});
  for (std::size_t i = 0; i < piece.points.size(); ++i) {
    piece.values[0].push_back(piece.points[i].x > 0.5 ? 1 : -1);
    piece.values[1].push_back(std::pow(10, uniform(random)));
    piece.values[2].push_back(i % 3 == 0 ? nan : normal(random));
    piece.values[3].push_back(i % 50 == 7 ? 1e30 : normal(random));
    piece.values[4].push_back(1e10 + 1e-3 * normal(random));
    piece.values[5].push_back(1e-300 * normal(random));  // its variance is 0 in double precision
  }
  const std::vector<std::string> names = {"bodies", "wide", "missing", "far", "narrow", "small"};
  for (const Reduction reduction : {Reduction::octree, Reduction::mis, Reduction::kdtree})
    for (const Connectivity connectivity : {Connectivity::delaunay, Connectivity::none, Connectivity::boxes})
      for (const bool exact : {false, true}) {
        ASSERT_TRUE(build(
            {piece}, names,
            {.reduction = reduction, .exact = {.positions = exact, .values = exact}, .connectivity = connectivity}))
            << reduction_name(reduction) << connectivity_name(connectivity);
      }
}

TEST_F(StoredValuesTest, AttributesWithTheSameValuesAreStoredOnce) {
  const auto volume = build(pieces_with_equal_attributes(), three_names);
  const format::VolumeInfo& info = volume->info();
  ASSERT_EQ(info.attributes.size(), 2u);
  EXPECT_EQ(info.attributes[0].name, "p");
  EXPECT_EQ(info.attributes[1].name, "q");
  EXPECT_EQ(info.aliases, (std::vector<format::Alias>{{"p again", 0}}));
  EXPECT_EQ(info.find_attribute("p again"), 0);
  EXPECT_EQ(info.find_attribute("q"), 1);
  EXPECT_EQ(report_.aliases, (std::vector<std::pair<std::string, std::string>>{{"p again", "p"}}));

  const auto twice = build(pieces_with_equal_attributes(), three_names, {.join_attributes = false});
  ASSERT_EQ(twice->info().attributes.size(), 3u);
  EXPECT_TRUE(twice->info().aliases.empty());
  EXPECT_TRUE(report_.aliases.empty());
  const auto same = [](const std::vector<double>& a, const std::vector<double>& b) {
    return std::ranges::equal(a, b, [](double x, double y) { return x == y || (std::isnan(x) && std::isnan(y)); });
  };
  EXPECT_TRUE(same(values_of(*volume, 0), values_of(*twice, 1)));
  EXPECT_TRUE(same(values_of(*volume, 1), values_of(*twice, 2)));
  EXPECT_EQ(material_of(*volume), material_of(*twice));  // with its boundaries
}

TEST_F(StoredValuesTest, AUnitOfItsOwnKeepsAnAttributeApart) {
  const auto volume = build(pieces_with_equal_attributes(), three_names, {.units = {{"p again", "Pa"}}});
  EXPECT_EQ(volume->info().attributes.size(), 3u);
  EXPECT_TRUE(volume->info().aliases.empty());
}

TEST_F(StoredValuesTest, StepsOfAnExactSeriesAreExact) {
  for (const bool exact : {false, true}) {
    ASSERT_TRUE(build_series({step(0)}, path("series.svol"), {.exact = {.positions = exact, .values = exact}}, silent));
    ASSERT_TRUE(append_to_series({step(1)}, path("series.svol"), {}, silent));
    const auto volume = open_checked(path("series.svol"));
    EXPECT_EQ(volume->info().position_error == 0, exact);
    for (const format::Attribute& attribute : volume->info().attributes) EXPECT_EQ(attribute.error == 0, exact);
  }
}

TEST_F(StoredValuesTest, StepsShareNothingThatLaterStepsMayNotShare) {
  ASSERT_TRUE(build_series({step(0), step(1)}, path("series.svol"), {}, silent));
  const auto volume = open_checked(path("series.svol"));
  EXPECT_EQ(volume->info().attributes.size(), 3u);
  EXPECT_TRUE(volume->info().aliases.empty());
}

// Material that is larger than the box round its points: the cube grows until it is within the bounds of a file.
TEST_F(StoredValuesTest, TheCubeIsLargeEnoughForTheMaterialOfFewPoints) {
  for (const std::size_t count : {1, 2, 5}) {
    Piece piece;
    PointMaterial material;
    for (std::size_t i = 0; i < count; ++i) {
      piece.points.push_back(dvec3(0, 0, 1e-3 * static_cast<double>(i)));
      SpatialMoments moments{.mass = 1e-3 * 100 * 100, .covariance = {1e4 / 12, 1e4 / 12, 1e-6 / 12, 0, 0, 0}};
      material.moments.push_back(moments);
    }
    piece.values = {std::vector<double>(count, 1.0)};
    material.value_moments = {std::vector<ValueMoments>(count)};
    material.gradients = {std::vector<dvec3>(count, dvec3(0))};
    piece.material = material;

    PieceSource source({piece}, {.brings_material = true});
    ASSERT_TRUE(build_volume(source, path("large.svol"), {}, silent));
    const auto volume = open_checked(path("large.svol"));
    EXPECT_GE(volume->info().cube.edge, 40);
  }
}

}  // namespace
}  // namespace splatvol::test
