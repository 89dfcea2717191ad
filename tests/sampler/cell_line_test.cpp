// Values along a line through the cells of a file.
#include "sampler/cell_line.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <set>

#include "tests/sampler/sampled_cells.h"

namespace splatvol::test {
namespace {

using ::testing::HasSubstr;

struct LineOfCells : SampledCells {
  [[nodiscard]] LineRows follow(const dvec3& start, const dvec3& end) const {
    LineRows rows = value_of(follow_line(*cells(), start, end));
    check(rows, start, end);
    return rows;
  }

  // Rows go from the start to the end. Where values do not jump, a position has one row.
  static void check(const LineRows& rows, const dvec3& start, const dvec3& end) {
    EXPECT_EQ(rows.positions.front(), start);
    EXPECT_EQ(rows.positions.back(), end);
    for (std::size_t row = 1; row < rows.arc_lengths.size(); ++row) {
      EXPECT_GE(rows.arc_lengths[row], rows.arc_lengths[row - 1]);
      EXPECT_NEAR(glm::length(rows.positions[row] - start), rows.arc_lengths[row], 1e-14 * glm::length(end - start));
      if (rows.arc_lengths[row] > rows.arc_lengths[row - 1]) continue;
      EXPECT_FALSE(rows.values[0][row] == rows.values[0][row - 1]);
    }
  }

  // Between rows, values are those of sample_cells().
  void expect_samples(const LineRows& rows) const {
    std::vector<dvec3> positions;
    std::vector<double> values;
    for (std::size_t row = 1; row < rows.arc_lengths.size(); ++row) {
      if (rows.arc_lengths[row] - rows.arc_lengths[row - 1] < 1e-9) continue;
      for (const double way : {0.1, 0.5, 0.8}) {
        positions.push_back((1 - way) * rows.positions[row - 1] + way * rows.positions[row]);
        values.push_back((1 - way) * rows.values[0][row - 1] + way * rows.values[0][row]);
      }
    }
    const std::vector<double> expected = sample(positions);
    for (std::size_t i = 0; i < values.size(); ++i) {
      EXPECT_EQ(std::isnan(values[i]), std::isnan(expected[i])) << i;
      EXPECT_TRUE(std::isnan(values[i]) || std::abs(values[i] - expected[i]) < 1e-9) << i;
    }
  }
};

TEST_F(LineOfCells, IsTheMeshsOwn) {
  build(mesh_piece(jittered(12, 0.2), field));
  const std::vector<dvec3> ends = random_positions(40, -0.2, 1.2);
  for (std::size_t i = 0; i < ends.size(); i += 2) expect_samples(follow(ends[i], ends[i + 1]));
  const LineRows inside = follow({0.1, 0.2, 0.3}, {0.9, 0.7, 0.6});
  EXPECT_GT(inside.arc_lengths.size(), 20);
  const std::set<double> positions(inside.arc_lengths.begin(), inside.arc_lengths.end());
  EXPECT_EQ(positions.size(), inside.arc_lengths.size()) << "nothing jumps";
}

// On faces and edges of all cells: each cube gives one row at each of its ends, and none between.
TEST_F(LineOfCells, OnFacesAndEdgesLeavesNoGap) {
  build(mesh_piece(lattice(8), [](dvec3 p) { return 8 * p.x * p.x; }));
  for (const auto& [y, z] : {std::pair{0.5, 0.5}, {0.25, 0.3}, {0.0, 0.0}, {1.0, 0.6}, {0.3, 0.3}}) {
    const LineRows rows = follow({0, y, z}, {1, y, z});
    for (std::size_t row = 0; row < rows.arc_lengths.size(); ++row) EXPECT_FALSE(std::isnan(rows.values[0][row])) << y;
    expect_samples(rows);
  }
  const LineRows on_edges = follow({0, 0.5, 0.5}, {1, 0.5, 0.5});
  ASSERT_EQ(on_edges.arc_lengths.size(), 9);
  for (std::size_t row = 0; row < 9; ++row)
    EXPECT_DOUBLE_EQ(on_edges.values[0][row], static_cast<double>(row * row) / 8) << row;
  const LineRows diagonal = follow(dvec3(0), dvec3(1));
  EXPECT_EQ(diagonal.arc_lengths.size(), 9);
  EXPECT_EQ(follow({0, 0.5, 0.5}, {0.9, 0.5, 0.5}).arc_lengths.size(), 9) << "ends in a cell";
}

TEST_F(LineOfCells, GapsAreRowsWithoutValues) {
  Mesh mesh = lattice(2), other = lattice(2, [](dvec3 p) { return p + dvec3(3, 0, 0); });
  for (auto corners : other.tetrahedra) {
    for (std::uint32_t& corner : corners) corner += static_cast<std::uint32_t>(mesh.points.size());
    mesh.tetrahedra.push_back(corners);
  }
  mesh.points.insert(mesh.points.end(), other.points.begin(), other.points.end());
  build(mesh_piece(mesh, [](dvec3 p) { return p.x; }));
  const LineRows rows = follow({-1, 0.3, 0.4}, {5, 0.3, 0.4});
  std::vector<double> gaps;  // begin and end of each
  for (std::size_t row = 1; row < rows.arc_lengths.size(); ++row)
    if (std::isnan(rows.values[0][row - 1]) && std::isnan(rows.values[0][row]))
      gaps.insert(gaps.end(), {rows.positions[row - 1].x, rows.positions[row].x});
  EXPECT_THAT(gaps, testing::Pointwise(testing::DoubleNear(1e-12), {-1.0, 0.0, 1.0, 3.0, 4.0, 5.0}));
  const LineRows nowhere = follow({-1, 7, 0}, {5, 7, 0});
  EXPECT_EQ(nowhere.arc_lengths.size(), 2);
  EXPECT_TRUE(std::isnan(nowhere.values[0][0]) && std::isnan(nowhere.values[0][1]));

  const LineRows even = in_equal_steps(rows, {-1, 0.3, 0.4}, {5, 0.3, 0.4}, 13);
  ASSERT_EQ(even.arc_lengths.size(), 13);
  for (std::size_t k = 0; k < 13; ++k) {
    const double x = -1 + 0.5 * static_cast<double>(k);
    EXPECT_EQ(even.positions[k].x, x);
    if ((x >= 0 && x <= 1) || (x >= 3 && x <= 4))
      EXPECT_NEAR(even.values[0][k], x, 1e-12);
    else
      EXPECT_TRUE(std::isnan(even.values[0][k])) << x;
  }
}

TEST_F(LineOfCells, ValuesOfCellsJump) {
  std::ofstream(path("shapes.vtk")) << mesh_of_shapes();
  build_input(path("shapes.vtk"), path("own.svol"), exact(), {.selection = {"number"}, .cells = CellValues::own});
  open("own.svol");
  const LineRows rows = follow({0.5, 0.4, -1}, {0.5, 0.4, 1.5});  // a hexahedron, and a pyramid on it
  const std::vector<double> expected = {none, none, 0, 0, 1, 1}, at = {0, 1, 1, 2, 2, 2.5};
  ASSERT_EQ(rows.arc_lengths.size(), expected.size());
  for (std::size_t row = 0; row < expected.size(); ++row) {
    EXPECT_NEAR(rows.arc_lengths[row], at[row], 1e-12);
    EXPECT_TRUE(rows.values[0][row] == expected[row] || std::isnan(rows.values[0][row] + expected[row]));
  }
}

TEST_F(LineOfCells, RoundingOpensNoGap) {
  build(mesh_piece(jittered(12, 0.2), field), {.keep_cells = true});
  const std::vector<dvec3> ends = random_positions(40, 0.1, 0.9);
  for (std::size_t i = 0; i < ends.size(); i += 2) {
    const LineRows rows = follow(ends[i], ends[i + 1]);
    for (const double value : rows.values[0]) EXPECT_FALSE(std::isnan(value));
  }
}

TEST_F(LineOfCells, NeedsALength) {
  build(mesh_piece(lattice(2), field));
  for (const dvec3& end : {dvec3(0.5), dvec3(none), dvec3(1e308), dvec3(std::numeric_limits<double>::infinity())})
    EXPECT_THAT(message_of(follow_line(*cells(), dvec3(0.5), end)), HasSubstr("length"));
  EXPECT_THAT(message_of(follow_line(*cells(), dvec3(0.5), dvec3(1e12))), HasSubstr("too long"));
  const LineRows far = follow({-1e6, 0.4, 0.3}, {1e6, 0.5, 0.6});
  EXPECT_EQ(std::ranges::count_if(far.values[0], [](double value) { return std::isnan(value); }), 4)
      << "no gap between";
}

}  // namespace
}  // namespace splatvol::test
