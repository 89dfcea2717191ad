// Kept cells of points that Delaunay tetrahedra join.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <filesystem>
#include <random>
#include <string>
#include <vector>

#include "base/file.h"
#include "builder/pipeline/build.h"
#include "builder/points/point_stream.h"
#include "builder/scattered/scattered.h"
#include "format/cell_reader.h"
#include "format/volume.h"
#include "tests/builder/support/piece_source.h"
#include "tests/support/opened_files.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using testing::HasSubstr;

using Points = std::vector<dvec3>;
using Ranks = std::array<std::uint64_t, 4>;

struct DelaunayCells : FolderTest {
  Result<BuildReport> build(const Points& points, BuildOptions options, const std::string& name = "cells.svol",
                            bool keeps = true) {
    PieceSource source({scattered(points)});
    options.keep_cells = keeps;
    return build_volume(source, path(name), options, [](const char*, double) {});
  }

  void expect_none(const Points& points, const BuildOptions& options) {
    const auto kept = build(points, options), dropped = build(points, options, "dropped.svol", false);
    EXPECT_EQ(message_of(kept), message_of(dropped));
    if (!kept || !dropped) return;
    EXPECT_FALSE(kept->kept_cells);
    EXPECT_TRUE(read_text_file(path("cells.svol")).value() == read_text_file(path("dropped.svol")).value());
  }
};

// The points as the file has them: by ranks.
Points in_order(const Points& points) {
  PieceSource source({scattered(points)});
  PointStream stream =
      value_of(PointStream::create(source, false, 1 << 26, std::filesystem::temp_directory_path(), [](double) {}));
  PointBatch all;
  all.resize_attributes(1);
  while (value_of(stream.next(all))) {
  }
  return all.positions;
}

std::vector<Ranks> kept_cells(const std::string& path) {
  const auto volume = open_checked(path);
  const auto reader = value_of(format::CellReader::open(*volume));
  EXPECT_TRUE(reader);
  std::vector<Ranks> cells;
  for (const format::CellChunk& chunk : chunks_of(*reader)) {
    EXPECT_EQ(chunk.shape, format::CellShape::tetrahedron);
    for (std::size_t i = 0; i < chunk.size(); ++i) {
      std::ranges::copy(chunk.corners_at(i), cells.emplace_back().begin());
      std::ranges::sort(cells.back());
    }
  }
  std::ranges::sort(cells);
  return cells;
}

std::vector<Ranks> reference(const Points& points) {
  std::vector<Ranks> cells;
  for (const Tetrahedron& corners : value_of(delaunay_tetrahedra(in_order(points))))
    std::ranges::copy(corners, cells.emplace_back().begin());
  return cells;
}

// A box of n x n x n points. They are moved a little, but stay in the box's faces and edges. If they were moved
// farther, tetrahedra at the hull would be left out as too large.
Points shaken_box(int n, const dvec3& extent) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> shift(-0.1, 0.1);
  Points points;
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j)
      for (int k = 0; k < n; ++k) {
        const auto moved = [&](int at) { return at == 0 || at == n - 1 ? at : at + shift(random); };
        points.push_back(dvec3(moved(i), moved(j), moved(k)) / static_cast<double>(n - 1) * extent);
      }
  return points;
}

TEST_F(DelaunayCells, AreThoseOfTheReference) {
  const Points points = random_points(6000);
  for (const Connectivity connectivity : {Connectivity::automatic, Connectivity::delaunay}) {
    const BuildReport report = value_of(build(points, {.connectivity = connectivity}));
    EXPECT_EQ(report.connectivity, Connectivity::delaunay);
    const std::vector<Ranks> expected = reference(points);
    EXPECT_EQ(report.kept_cells->cells, expected.size());
    EXPECT_EQ(report.kept_cells->collapsed, 0u);
    EXPECT_TRUE(kept_cells(path("cells.svol")) == expected);
  }
}

TEST_F(DelaunayCells, FillTheHull) {
  const BuildReport report = value_of(build(shaken_box(16, {1, 2, 3}), {}));
  // Positions are rounded.
  EXPECT_NEAR(report.kept_cells->volume / 6, 1, 1e-4);
  EXPECT_LT(report.kept_cells->turned_volume, 1e-4);
}

// The points of a file do not depend on how they are joined, and neither do the cells.
TEST_F(DelaunayCells, AreTheSameForThreadsMemoryAndSubdomains) {
  const Points points = random_points(75'000);
  BuildOptions options{.connectivity = Connectivity::delaunay};
  EXPECT_TRUE(build(points, options, "held").has_value());
  options.held_points = 1000;  // beyond: two subdomains
  const BuildReport report = value_of(build(points, options, "subdomains"));
  EXPECT_EQ(report.uncertain, 0u);
  EXPECT_EQ(report.disputed, 0u);
  EXPECT_TRUE(read("held") == read("subdomains"));
  options.memory = 1 << 20;
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  EXPECT_TRUE(build(points, options, "little").has_value());
  EXPECT_TRUE(read("held") == read("little"));
}

TEST_F(DelaunayCells, CopiesOfAPointHaveNone) {
  Points points = random_points(2000);
  Piece piece = scattered(points);
  for (std::size_t i = 0; i < 500; ++i) {
    piece.points.push_back(points[i]);
    piece.values[0].push_back(5);  // so that they are not merged
  }
  PieceSource source({piece});
  const BuildReport report =
      value_of(build_volume(source, path("cells.svol"), {.keep_cells = true}, [](const char*, double) {}));
  EXPECT_EQ(report.resolution_counts.back(), 2500u);
  EXPECT_EQ(report.points.coincident, 500u);
  const std::vector<Ranks> cells = kept_cells(path("cells.svol"));
  EXPECT_EQ(cells.size(), reference(points).size());
  std::vector<bool> used(2500);
  for (const Ranks& cell : cells)
    for (const std::uint64_t rank : cell) used[rank] = true;
  EXPECT_EQ(std::ranges::count(used, true), 2000);
}

// The same file, or the same error, as without the wish to keep cells.
TEST_F(DelaunayCells, AreLeftOutWhereNoTetrahedronIs) {
  const auto lattice = [](int nx, int ny) {
    Points points;
    for (int i = 0; i < nx; ++i)
      for (int j = 0; j < ny; ++j) points.emplace_back(i, j, 0);
    return points;
  };
  const Points plane = lattice(20, 20), line = lattice(50, 1), coincident(30, dvec3(1, 2, 3)), one(1, dvec3(1));
  for (const Points& points : {plane, line, coincident, one})
    for (const Connectivity connectivity : {Connectivity::automatic, Connectivity::delaunay})
      for (const std::uint64_t held : {std::uint64_t{1} << 20, std::uint64_t{0}})
        expect_none(points, {.held_points = held, .connectivity = connectivity});
}

TEST_F(DelaunayCells, AreLeftOutWhereOthersJoinThePoints) {
  const Points points = random_points(100);
  for (const Connectivity connectivity : {Connectivity::none, Connectivity::boxes})
    expect_none(points, {.connectivity = connectivity});
  expect_none(points, {.held_points = 50});
  EXPECT_TRUE(build(points, {.held_points = 50, .connectivity = Connectivity::delaunay})->kept_cells);
}

}  // namespace
}  // namespace splatvol::test
