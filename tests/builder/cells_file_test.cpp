// The cells that a file keeps are those of the mesh.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "base/file.h"
#include "base/interruption.h"
#include "builder/mesh/heights.h"
#include "builder/mesh/tetrahedra.h"
#include "builder/opening/open_source.h"
#include "builder/pipeline/build.h"
#include "format/cell_reader.h"
#include "format/ranked_points.h"
#include "format/volume.h"
#include "tests/builder/support/meshes.h"
#include "tests/builder/support/piece_source.h"
#include "tests/support/long.h"
#include "tests/support/opened_files.h"
#include "tests/support/random.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using format::CellReader;
using format::SectionKind;
using format::Volume;
using testing::HasSubstr;

constexpr double nan = std::numeric_limits<double>::quiet_NaN();
const auto silent = [](const char*, double) {};

// Corners with their values, in ascending order. A missing value is 1e300.
using Corner = std::vector<double>;
using Cell = std::vector<Corner>;
using Cells = std::vector<Cell>;

Corner corner_of(const dvec3& position, const std::vector<double>& values) {
  Corner corner = {position.x, position.y, position.z};
  for (const double value : values) corner.push_back(std::isnan(value) ? 1e300 : value);
  for (double& number : corner) number += 0.0;  // no -0
  return corner;
}

// The cells of the input, without those of which two corners are one point: copies of a vertex.
Cells cells_of(const std::vector<Piece>& pieces) {
  Cells cells;
  for (const Piece& piece : pieces)
    for (const auto& tetrahedron : piece.tetrahedra) {
      Cell cell;
      for (const std::uint32_t point : tetrahedron) {
        std::vector<double> values;
        for (const std::vector<double>& column : piece.values) values.push_back(column[point]);
        cell.push_back(corner_of(piece.points[point], values));
      }
      std::ranges::sort(cell);
      if (std::ranges::adjacent_find(cell) == cell.end()) cells.push_back(std::move(cell));
    }
  std::ranges::sort(cells);
  return cells;
}

// What a file keeps.
struct KeptCells {
  std::vector<std::uint64_t> ranks;         // [cell][corner]
  std::vector<dvec3> positions;             // likewise
  std::vector<std::vector<double>> values;  // [name][cell][corner]
  std::size_t largest_chunk = 0;            // cells
  std::size_t chunks = 0;
  std::size_t most_groups = 0;  // of a chunk
};

KeptCells read_cells(const Volume& volume, const std::vector<std::string>& names) {
  KeptCells kept;
  kept.values.resize(names.size());
  const auto cells = value_of(CellReader::open(volume));
  format::RankedPoints points(*cells, own_room(std::uint64_t{8} << 20));
  for (const auto& chunk : chunks_of(*cells)) {
    const auto& corners = chunk.corners;
    kept.ranks.insert(kept.ranks.end(), corners.begin(), corners.end());
    kept.largest_chunk = std::max(kept.largest_chunk, chunk.size());
    ++kept.chunks;
    std::vector<format::RankedPoints::Place> places;
    std::vector<dvec3> positions;
    std::vector<float> stored;
    EXPECT_TRUE(points.find(corners, places));
    EXPECT_TRUE(points.read_positions(places, positions));
    kept.positions.insert(kept.positions.end(), positions.begin(), positions.end());
    for (std::size_t a = 0; a < names.size(); ++a) {
      const int number = volume.info().find_attribute(names[a]);
      const format::Attribute& attribute = volume.info().attributes[static_cast<std::size_t>(number)];
      EXPECT_TRUE(points.read_values(places, number, stored));
      for (const float value : stored) kept.values[a].push_back(attribute.value(double{value}));
    }
    std::vector<std::uint64_t> groups;
    for (const auto& place : places) groups.push_back(place.group);
    std::ranges::sort(groups);
    const auto rest = std::ranges::unique(groups);
    kept.most_groups = std::max(kept.most_groups, groups.size() - rest.size());
  }
  return kept;
}

Cells cells_of(const KeptCells& kept) {
  Cells cells;
  for (std::size_t i = 0; i < kept.ranks.size(); ++i) {
    if (i % 4 == 0) cells.emplace_back();
    std::vector<double> values;
    for (const std::vector<double>& column : kept.values) values.push_back(column[i]);
    cells.back().push_back(corner_of(kept.positions[i], values));
  }
  for (Cell& cell : cells) std::ranges::sort(cell);
  std::ranges::sort(cells);
  return cells;
}

struct CellsFile : FolderTest {
  [[nodiscard]] Result<BuildReport> try_build(const std::vector<Piece>& pieces, const std::string& name,
                                              BuildOptions options) const {
    PieceSource source(pieces, {.attributes = names_});
    return build_volume(source, path(name), options, silent);
  }

  BuildReport build(const std::vector<Piece>& pieces, const std::string& name, const BuildOptions& options) const {
    return value_of(try_build(pieces, name, options));
  }

  static format::Bytes section_of(const Volume& volume, SectionKind kind) {
    const auto section = std::ranges::find(volume.sections(), kind, &format::SectionEntry::kind);
    return value_of(volume.read_bytes(section->offset, section->packed_bytes));
  }

  // Builds a file exactly, rounded and without cells, and compares cells with the input's. Returns those that are
  // stored exactly.
  KeptCells check(const std::vector<Piece>& pieces, BuildOptions options = {}) {
    options.keep_cells = true;
    options.exact = {};
    rounded_report_ = build(pieces, "rounded.svol", options);
    options.exact = {.positions = true, .values = true};
    report_ = build(pieces, "exact.svol", options);
    options.exact = {};
    options.keep_cells = false;
    build(pieces, "plain.svol", options);

    const auto exact = open_checked(path("exact.svol")), rounded = open_checked(path("rounded.svol")),
               plain = open_checked(path("plain.svol"));
    const KeptCells kept = read_cells(*exact, names_), near = read_cells(*rounded, names_);
    const Cells expected = cells_of(pieces), found = cells_of(kept);
    EXPECT_EQ(found.size(), expected.size());
    EXPECT_TRUE(found == expected) << "cells are those of the mesh";
    std::size_t given = 0;
    for (const Piece& piece : pieces) given += piece.tetrahedra.size();
    EXPECT_EQ(report_.kept_cells->cells, found.size());
    EXPECT_EQ(report_.kept_cells->collapsed, given - found.size());
    EXPECT_EQ(report_.kept_cells->turned, 0u);
    const auto cells = value_of(CellReader::open(*rounded));
    EXPECT_EQ(cells->kinds().size(), found.empty() ? 0u : 1u);
    for (const format::CellKind& kind : cells->kinds()) EXPECT_EQ(kind.turned, rounded_report_.kept_cells->turned);
    EXPECT_LE(kept.most_groups, std::size_t{format::max_chunk_groups});
    EXPECT_LE(kept.largest_chunk, std::size_t{format::max_chunk_cells});

    // Rounding moves points, and no corner of a cell to another point.
    EXPECT_TRUE(near.ranks == kept.ranks);
    double moved = 0;
    for (std::size_t i = 0; i < std::min(near.positions.size(), kept.positions.size()); ++i)
      for (int axis = 0; axis < 3; ++axis)
        moved = std::max(moved, std::abs(near.positions[i][axis] - kept.positions[i][axis]));
    EXPECT_LE(moved, rounded->info().position_error);
    for (const SectionKind kind :
         {SectionKind::rows, SectionKind::index_root, SectionKind::index_pages, SectionKind::histograms})
      EXPECT_TRUE(section_of(*rounded, kind) == section_of(*plain, kind)) << static_cast<int>(kind);
    EXPECT_FALSE(CellReader::has_cells(*plain));
    return kept;
  }

  std::vector<std::string> names_ = {"value"};
  BuildReport report_, rounded_report_;
};

// A number that single precision has.
double field(dvec3 p) { return double{static_cast<float>(p.x + 2 * p.y * p.y - std::sin(5 * p.z))}; }

Piece jittered_piece(std::uint32_t cells) { return mesh_piece(jittered(cells, 0.2), field); }

TEST_F(CellsFile, OneTetrahedron) {
  Piece piece;
  piece.points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  piece.values = {{1, 2, 3, 4}};
  for (const Tetrahedron& corners : {Tetrahedron{0, 1, 2, 3}, Tetrahedron{3, 1, 0, 2}}) {
    piece.tetrahedra = {corners};
    check({piece});
    EXPECT_NEAR(report_.kept_cells->volume, 1.0 / 6, 1e-12);
  }
}

TEST_F(CellsFile, OfPiecesWithCommonVertices) {
  const Piece whole = jittered_piece(12);
  const KeptCells one = check({whole});
  std::vector<Piece> pieces = cut(whole, 9);
  EXPECT_TRUE(check(pieces).ranks == one.ranks) << "however the mesh is cut";
  // Pieces without cells, and without anything.
  pieces.insert(pieces.begin(), scattered(random_points(100, 0.5)));
  pieces.insert(pieces.begin() + 4, scattered({}));
  pieces.insert(pieces.begin() + 5, scattered(random_points(10, 3)));
  pieces.push_back(scattered(random_points(1, 7)));
  check(pieces);
}

TEST_F(CellsFile, OfEachReduction) {
  const std::vector<Piece> pieces = cut(jittered_piece(11), 3);
  for (const Reduction reduction : {Reduction::octree, Reduction::mis, Reduction::kdtree})
    for (const std::uint32_t leaf : {8u, 300u})
      check(pieces, {.reduction = reduction, .leaf_points = leaf, .index_leaf_points = 300});
}

TEST_F(CellsFile, OfTheGenerator) {
  const std::string mesh = "gen:mesh:cells=40000,pieces=5";
  std::vector<Piece> pieces;
  const auto source = value_of(open_source({mesh}, {}));
  names_ = source->attributes();
  while (const auto piece = value_of(source->next())) pieces.push_back(*piece);
  check(pieces);
}

// Points of one position and different values stay apart, and so do the cells of two blocks that touch.
TEST_F(CellsFile, OfBlocksThatTouch) {
  Piece first = jittered_piece(6), second = first;
  for (dvec3& p : second.points) p.x = 2 - p.x;
  for (Piece* piece : {&first, &second})
    for (dvec3& p : piece->points)
      if (std::abs(p.x - 1) < 0.1) p.x = 1;
  for (double& value : second.values[0]) value = double{static_cast<float>(10 + value)};
  check({first, second});
  EXPECT_EQ(report_.kept_cells->cells, 2 * first.tetrahedra.size());
}

TEST_F(CellsFile, OfCoincidentPoints) {
  // All cells at two positions: half of their corners at each. Values tell copies of a vertex from others.
  Piece piece;
  std::mt19937 random(1);
  for (int i = 0; i < 400; ++i) {
    piece.points.push_back(i % 2 == 0 ? dvec3(0.25, 0.5, 0.75) : dvec3(1, 1, 0));
    piece.values.resize(1);
    piece.values[0].push_back(double(random() % 50));
  }
  // Each point is in a cell: a free point is no copy of a vertex.
  for (std::uint32_t i = 0; i < 100; ++i) piece.tetrahedra.push_back({4 * i, 4 * i + 1, 4 * i + 2, 4 * i + 3});
  for (int i = 0; i < 300; ++i) {
    Tetrahedron corners{};
    for (std::uint32_t& corner : corners) corner = random() % 400;
    piece.tetrahedra.push_back(corners);
  }
  check({piece});
  EXPECT_GT(report_.kept_cells->collapsed, 0u);
}

TEST_F(CellsFile, OfFlatAndInvertedCells) {
  Piece piece = jittered_piece(6);
  std::mt19937 random(1);
  for (Tetrahedron& corners : piece.tetrahedra) std::shuffle(corners.begin(), corners.end(), random);
  for (std::size_t i = 0; i < piece.points.size(); ++i)
    if (piece.points[i].z > 0.7) piece.points[i].z = 0.75;  // whole layers are flat
  check({piece});
}

// Cells round one vertex, which has the lowest rank.
Piece star(std::uint32_t points, int cells) {
  std::mt19937_64 random(4);
  std::uniform_real_distribution<double> uniform(0.1, 1);
  Piece piece;
  piece.points.emplace_back(0, 0, 0);
  for (std::uint32_t i = 0; i < points; ++i) piece.points.push_back(random_vector(uniform, random));
  piece.values = {{}};
  for (const dvec3& p : piece.points) piece.values[0].push_back(field(p));
  for (int i = 0; i < cells; ++i) {
    Tetrahedron corners{};
    for (std::size_t k = 1; k < 4; ++k) corners[k] = static_cast<std::uint32_t>(1 + random() % points);
    piece.tetrahedra.push_back(corners);
  }
  return piece;
}

TEST_F(CellsFile, OfAStar) {
  const Piece piece = star(3000, 200'000);
  build({piece}, "star.svol", {.exact = {.positions = true, .values = true}, .keep_cells = true});
  const KeptCells kept = read_cells(*open_checked(path("star.svol")), names_);
  EXPECT_TRUE(cells_of(kept) == cells_of(std::vector{piece}));
  EXPECT_EQ(kept.chunks, 4u);
  EXPECT_EQ(kept.largest_chunk, std::size_t{format::max_chunk_cells});
}

// A chunk of all cells would reach nearly all groups of the file.
TEST_F(CellsFile, AChunkReachesFewGroups) {
  if (!is_long()) GTEST_SKIP() << "a part of ctest -L long";
  constexpr std::uint32_t points = 530'000;
  constexpr int cells = 10'000;
  const Piece piece = star(points, cells);
  BuildOptions options{.points_per_chunk = {.points = {format::min_points_per_chunk}}, .keep_cells = true};
  const BuildReport report = build({piece}, "star.svol", options);
  const KeptCells kept = read_cells(*value_of(Volume::open(*open_file(path("star.svol")))), names_);
  EXPECT_GT(report.kept_cells->cells, cells * 0.99);  // a few have a corner twice
  EXPECT_EQ(kept.ranks.size(), 4 * report.kept_cells->cells);
  EXPECT_GT(points / format::min_points_per_chunk, format::max_chunk_groups);
  EXPECT_GT(kept.chunks, 1u);
  EXPECT_GT(kept.most_groups, std::size_t{format::max_chunk_groups} / 2);
  EXPECT_LE(kept.most_groups, std::size_t{format::max_chunk_groups});
}

TEST_F(CellsFile, OfManyAttributes) {
  std::vector<Piece> pieces = {jittered_piece(6)};
  const std::vector<double> first = pieces[0].values[0];
  names_.clear();
  pieces[0].values.clear();
  for (int a = 0; a < 27; ++a) {
    names_.push_back(fmt::format("a{}", a));
    auto& column = pieces[0].values.emplace_back();
    for (std::size_t i = 0; i < first.size(); ++i)
      column.push_back(
          a > 0 && (i + static_cast<std::size_t>(a)) % 11 == 0 ? nan : double{static_cast<float>(first[i] * (a + 1))});
  }
  check(pieces);
  // A constant, and one without values.
  names_ = {"a0", "constant", "none"};
  pieces[0].values = {first, std::vector<double>(first.size(), 7), std::vector<double>(first.size(), nan)};
  check(pieces);
}

TEST_F(CellsFile, OfAttributesThatAreStoredOnce) {
  Piece piece = jittered_piece(6);
  piece.values.push_back(piece.values[0]);
  piece.values.push_back(piece.values[0]);
  for (double& value : piece.values[1]) value += 1;
  for (double& value : piece.values[1]) value = double{static_cast<float>(value)};
  names_ = {"one", "two", "the same"};
  check({piece});
  const auto volume = open_checked(path("exact.svol"));
  EXPECT_EQ(volume->info().attributes.size(), 2u);
  EXPECT_EQ(volume->info().aliases.size(), 1u);
}

TEST_F(CellsFile, OfMapCoordinates) {
  Piece piece = jittered_piece(8);
  for (dvec3& p : piece.points) p = dvec3(512'345.25, 5'403'210.5, 120) + 30.0 * p;
  check({piece});
}

TEST_F(CellsFile, OfNineDecadesOfSizes) {
  Piece piece = jittered_piece(9);
  for (dvec3& p : piece.points) p = dvec3(std::pow(10, 9 * p.x - 9), std::pow(10, 9 * p.y - 9), p.z);
  check({piece});
}

// Layers of random thickness, down to a 10,000th of their width, askew and bent.
Piece layered_piece(std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> uniform(-1, 1);
  constexpr std::uint32_t layers = 12, width = 9;
  std::vector<double> heights = {0};
  for (std::uint32_t layer = 0; layer < layers; ++layer)
    heights.push_back(heights.back() + std::pow(10, 2 * (uniform(random) - 1)) / width);
  const glm::dquat turn = glm::normalize(random_quaternion(uniform, random));
  const dvec3 slope = random_vector(uniform, random), offset = 100.0 * random_vector(uniform, random);
  const Mesh mesh = lattice({width, width, layers}, [&](dvec3 p) {
    const double z = heights[static_cast<std::size_t>(std::lround(p.z * layers))];
    const dvec3 bent(p.x + slope.x * z, p.y + slope.y * z, z + 0.1 * std::sin(3 * p.x + slope.z) * p.y);
    return turn * bent + offset;
  });
  return mesh_piece(mesh, field);
}

using Corners = std::span<const dvec3, 4>;

// The corners of each cell, with those of another file.
template <class Visit>
void for_each_pair(const KeptCells& a, const KeptCells& b, const Visit& visit) {
  ASSERT_TRUE(a.ranks == b.ranks);
  for (std::size_t i = 0; i < a.ranks.size(); i += 4) visit(Corners(&a.positions[i], 4), Corners(&b.positions[i], 4));
}

double volume_of(Corners p) { return signed_volume_6(p[0], p[1], p[2], p[3]) / 6; }
double height_of(Corners p) { return least_height(p[0], p[1], p[2], p[3]); }

TEST_F(CellsFile, RoundingTurnsNoCellAndTakesLittleOfItsHeight) {
  for (std::uint64_t seed = 0; seed < (is_long() ? 40 : 6); ++seed) {
    const Piece piece = layered_piece(seed);
    std::vector<dvec3> uncut;
    for (const std::size_t pieces : {1u, 4u}) {
      check(pieces == 1 ? std::vector{piece} : cut(piece, pieces));
      EXPECT_EQ(rounded_report_.kept_cells->turned, 0u);
      const KeptCells exact = read_cells(*open_checked(path("exact.svol")), names_);
      const KeptCells rounded = read_cells(*open_checked(path("rounded.svol")), names_);
      double lost = 0, moved = 0;
      for_each_pair(exact, rounded, [&](Corners before, Corners after) {
        EXPECT_GT(volume_of(before) * volume_of(after), 0);
        lost = std::max(lost, 1 - height_of(after) / height_of(before));
        for (std::size_t k = 0; k < 4; ++k)
          moved = std::max(moved, glm::length(after[k] - before[k]) / height_of(before));
      });
      EXPECT_LE(lost, 1.0 / 64);
      EXPECT_LE(moved, 1.0 / 256);
      EXPECT_GT(moved, 1.0 / 3000) << "rounding is not finer than it has to be";
      if (pieces == 1) uncut = rounded.positions;
      EXPECT_TRUE(rounded.positions == uncut) << "the least height of all pieces counts";
    }
  }
}

// Tetrahedra between scattered points ask for nothing. Delaunay joins those of a lattice by slivers, which rounding
// turns.
TEST_F(CellsFile, TurnedCellsAreCounted) {
  const glm::dquat turn = glm::normalize(glm::dquat(0.8, 0.3, 0.4, 0.1));
  std::vector<dvec3> points = jittered(16, 1e-3).points;
  for (dvec3& p : points) p = turn * p;
  const std::vector<Piece> pieces = {scattered(points)};
  BuildOptions options{.connectivity = Connectivity::delaunay, .keep_cells = true};
  const CellReport report = *build(pieces, "rounded.svol", options).kept_cells;
  options.exact.positions = true;
  EXPECT_EQ(build(pieces, "exact.svol", options).kept_cells->turned, 0u);
  const auto volume = open_checked(path("rounded.svol")), exact = open_checked(path("exact.svol"));
  std::uint64_t turned = 0;
  double turned_volume = 0;
  for_each_pair(read_cells(*exact, names_), read_cells(*volume, names_), [&](Corners before, Corners after) {
    if (height_of(before) == 0 || volume_of(before) * volume_of(after) >= 0) return;
    ++turned;
    turned_volume += std::abs(volume_of(after));
  });
  EXPECT_EQ(report.turned, turned) << volume->info().position_error;
  EXPECT_NEAR(report.turned_volume, turned_volume, 1e-9 * report.volume);
  EXPECT_GT(turned, 10u) << "the test has some";
  const auto cells = value_of(CellReader::open(*volume));
  EXPECT_EQ(cells->kinds().at(0).turned, turned);
}

// A layer of a ten-millionth, in which rounding turns cells, between thick ones.
TEST_F(CellsFile, FlatCellsAskForNothingAndAreNotCountedAsTurned) {
  const auto flattened = [](dvec3 p) {
    const double z = p.z < 0.55 ? p.z : p.z - 0.1 * (1 - 1e-7);
    return dvec3(0.8 * p.x - 0.6 * z, p.y + 0.1 * p.x + 0.03 * z, 0.6 * p.x + 0.8 * z);
  };
  std::mt19937_64 random(2);
  std::uniform_real_distribution<double> uniform(-0.02, 0.02);
  Piece piece = mesh_piece(lattice(10), field);
  for (dvec3& p : piece.points) p = flattened(p + dvec3(uniform(random), uniform(random), 0));
  check({piece});
  EXPECT_EQ(rounded_report_.kept_cells->turned, 0u);
  const auto volume = open_checked(path("rounded.svol"));
  EXPECT_GT(volume->info().position_error, 1e-5) << "the others decide";
  std::uint64_t turned = 0;
  for_each_pair(read_cells(*open_checked(path("exact.svol")), names_), read_cells(*volume, names_),
                [&](Corners before, Corners after) {
                  if (!(volume_of(before) * volume_of(after) < 0)) return;
                  EXPECT_EQ(height_of(before), 0);
                  ++turned;
                });
  EXPECT_GT(turned, 10u) << "the test has some";
}

TEST_F(CellsFile, BytesDoNotDependOnMemoryAndThreads) {
  for (const Piece& whole : {jittered_piece(is_long() ? 30 : 16), layered_piece(1)}) {
    const std::vector<Piece> pieces = cut(whole, 5);
    build(pieces, "first.svol", {.memory = std::uint64_t{1} << 30, .keep_cells = true});
    const std::string first = read("first.svol");
    for (const std::uint64_t memory : {std::uint64_t{1}, std::uint64_t{32} << 20, std::uint64_t{1} << 30})
      for (const std::size_t threads : {1u, 2u, 7u}) {
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        build(pieces, "other.svol", {.memory = memory, .keep_cells = true});
        EXPECT_TRUE(read("other.svol") == first) << memory << " bytes, " << threads << " threads";
      }
  }
}

TEST_F(CellsFile, OtherConnectivitiesLeaveThemOut) {
  for (const bool keeps : {true, false}) {
    const BuildReport report = build({jittered_piece(3)}, keeps ? "kept.svol" : "dropped.svol",
                                     {.connectivity = Connectivity::none, .keep_cells = keeps});
    EXPECT_FALSE(report.kept_cells);
  }
  EXPECT_TRUE(read("kept.svol") == read("dropped.svol"));
}

// A stop while cells are written.
TEST_F(CellsFile, CanBeInterrupted) {
  const std::vector<Piece> pieces = {jittered_piece(20)};
  for (const std::string stage : {"sorting cells", "writing cells"}) {
    PieceSource source(pieces);
    std::stop_source stop;
    const Interruptible interruptible(stop.get_token());
    const auto built =
        build_volume(source, path("stopped.svol"), {.keep_cells = true}, [&](const char* present, double) {
          if (present == stage) stop.request_stop();
        });
    ASSERT_FALSE(built) << stage;
    EXPECT_EQ(built.error().code, ErrorCode::cancelled);
    EXPECT_EQ(names(), std::vector<std::string>());
  }
}

}  // namespace
}  // namespace splatvol::test
