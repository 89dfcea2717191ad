// Values between the corners of a file's cells.
#include "sampler/cell_sampler.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

#include "sampler/tetrahedron.h"
#include "tests/sampler/sampled_cells.h"

namespace splatvol::test {
namespace {

using SampledCells = test::SampledCells;

TEST_F(SampledCells, AreTheMeshs) {
  const Mesh mesh = jittered(20, 0.2);
  build(mesh_piece(mesh, field));
  const std::vector<double> at_points = sample(mesh.points);
  for (std::size_t i = 0; i < mesh.points.size(); ++i) EXPECT_EQ(at_points[i], field(mesh.points[i])) << i;

  const std::vector<dvec3> positions = random_positions(500, -0.1, 1.1);
  const std::vector<double> found = sample(positions), values = test::sample(mesh, field);
  std::size_t outside = 0;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    const double expected = value_in(mesh, values, positions[i]);
    EXPECT_EQ(std::isnan(found[i]), std::isnan(expected)) << i;
    if (std::isnan(expected))
      ++outside;
    else
      EXPECT_NEAR(found[i], expected, 1e-12) << i;
  }
  EXPECT_GT(outside, 100);
  EXPECT_EQ(sample({dvec3(none), dvec3(1e300), dvec3(0, 0, std::numeric_limits<double>::infinity())}).size(), 3);
  EXPECT_TRUE(sample({}).empty());
}

// Positions are read from a lattice as exactly as it was given, and the file rounds it: those at the boundary come to
// lie outside, and others on faces.
TEST_F(SampledCells, RoundingOpensNoGap) {
  const Mesh mesh = jittered(20, 0.2);
  build(mesh_piece(mesh, [](dvec3 p) { return p.x + 2 * p.y; }), {.keep_cells = true});
  const double error = volume_->info().position_error;
  ASSERT_GT(error, 0);
  std::vector<dvec3> positions = mesh.points;
  for (const auto& [a, b, c, d] : mesh.tetrahedra) {
    positions.push_back((mesh.points[a] + mesh.points[b]) * 0.5);
    positions.push_back((mesh.points[b] + mesh.points[c] + mesh.points[d]) / 3.0);
  }
  const std::vector<double> found = sample(positions);
  const double bound = 1.01 * (3 * 2 * error + volume_->info().attributes[0].error) + 1e-6;
  for (std::size_t i = 0; i < positions.size(); ++i)
    EXPECT_NEAR(found[i], positions[i].x + 2 * positions[i].y, bound) << i;
  const double far = 3 * error;
  for (const double value : sample({dvec3(-far, 0.5, 0.5) - 0.01, dvec3(0.5, 1.01 + far, 0.5)}))
    EXPECT_TRUE(std::isnan(value));
}

TEST_F(SampledCells, OfSeveralTheFirstCounts) {
  Piece piece = mesh_piece(random_tetrahedra(200), field);
  build(piece);
  const std::vector<dvec3> positions = random_positions(300, 0.2, 0.8);
  const std::vector<double> found = sample(positions, 1 << 24), again = sample(positions, 1 << 16);
  const auto all = cells();
  const auto entries = value_of(all->chunks([](const Box&) { return true; }));
  std::vector<double> expected(positions.size(), none);
  for (const format::CellChunkEntry& entry : entries) {
    const Tetrahedra tetrahedra = value_of(all->read(entry));
    for (std::size_t t = 0; t < tetrahedra.size(); ++t)
      for (std::size_t i = 0; i < positions.size(); ++i)
        if (const auto weights = weights_in(tetrahedra.corners_of(t), positions[i]);
            weights && std::isnan(expected[i])) {
          expected[i] = 0;
          for (std::size_t k = 0; k < 4; ++k) expected[i] += (*weights)[k] * tetrahedra.values_of(t, 0)[k];
        }
  }
  std::size_t inside = 0;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    EXPECT_EQ(std::isnan(found[i]), std::isnan(expected[i]));
    if (std::isnan(found[i])) continue;
    ++inside;
    EXPECT_NEAR(found[i], expected[i], 1e-12);
    EXPECT_EQ(found[i], again[i]);
  }
  EXPECT_GT(inside, 50);
}

TEST_F(SampledCells, ACellWithAMissingValueHasNone) {
  const Mesh mesh = lattice(4);
  Piece piece = mesh_piece(mesh, [](dvec3 p) { return p.x < 0.4 ? none : p.x; });
  build(piece);
  const std::vector<double> found = sample({{0.2, 0.5, 0.5}, {0.4, 0.6, 0.6}, {0.5, 0.6, 0.7}, {0.7, 0.6, 0.6}});
  EXPECT_TRUE(std::isnan(found[0]));
  EXPECT_TRUE(std::isnan(found[1]));
  EXPECT_EQ(found[2], 0.5);  // on a face between a cell without a value and another
  EXPECT_NEAR(found[3], 0.7, 1e-6);
}

// A linear function is itself in cells of all shapes.
TEST_F(SampledCells, EveryShape) {
  std::ofstream(path("shapes.vtk")) << mesh_of_shapes();
  build_input(path("shapes.vtk"), path("points.svol"), exact(), {.selection = {"value"}});
  build_input(path("shapes.vtk"), path("own.svol"), exact(), {.selection = {"number"}, .cells = CellValues::own});
  const std::vector<dvec3> inside = {
      {0.3, 0.6, 0.8}, {0.5, 0.6, 1.5}, {2.5, 0.5, 0.3}, {5.2, 5.2, 5.2}, {8.3, 0.2, 0.9}};
  open("points.svol");
  const std::vector<double> of_points = sample(inside);
  open("own.svol");
  const std::vector<double> of_cells = sample(inside);
  for (std::size_t cell = 0; cell < inside.size(); ++cell) {
    const dvec3& p = inside[cell];
    EXPECT_NEAR(of_points[cell], p.x + 2 * p.y + 4 * p.z, 1e-12);
    EXPECT_EQ(of_cells[cell], static_cast<double>(cell));
  }
}

}  // namespace
}  // namespace splatvol::test
