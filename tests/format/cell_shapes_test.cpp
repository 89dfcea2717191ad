#include "format/cell_shapes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>
#include <random>
#include <set>

#include "format/cells.h"
#include "tests/support/results.h"

namespace splatvol::format {
namespace {

constexpr std::array all_shapes = {CellShape::tetrahedron, CellShape::pyramid, CellShape::wedge, CellShape::hexahedron};

using Tetrahedra = std::multiset<std::array<std::uint64_t, 4>>;

// The tetrahedra of all cells, with sorted corners.
Tetrahedra tetrahedra_in(const CellChunk& cells) {
  Tetrahedra tetrahedra;
  for (std::size_t i = 0; i < cells.size(); ++i)
    for (const auto& corners : tetrahedra_of(cells.shape, cells.split_at(i))) {
      std::array<std::uint64_t, 4> ranks{};
      std::ranges::transform(corners, ranks.begin(), [&](std::uint8_t k) { return cells.corners_at(i)[k]; });
      std::ranges::sort(ranks);
      tetrahedra.insert(ranks);
    }
  return tetrahedra;
}

TEST(CellShapes, HaveAsManyOrdersAsThereAreWaysToNumberThem) {
  EXPECT_EQ(orders_of(CellShape::tetrahedron).size(), 1u);
  EXPECT_EQ(orders_of(CellShape::pyramid).size(), 120u / 8);
  EXPECT_EQ(orders_of(CellShape::wedge).size(), 720u / 12);
  EXPECT_EQ(orders_of(CellShape::hexahedron).size(), 40320u / 48);
}

// The apex of a convex cell is in no tetrahedron's opposite face, and each tetrahedron has four corners.
TEST(CellShapes, SplitIntoTetrahedraRoundTheApex) {
  for (const CellShape shape : all_shapes)
    for (unsigned split = 0; split < split_end(shape); ++split) {
      if (!is_split(shape, static_cast<CellSplit>(split))) continue;
      const auto tetrahedra = tetrahedra_of(shape, static_cast<CellSplit>(split));
      EXPECT_FALSE(tetrahedra.empty());
      for (const auto& corners : tetrahedra) {
        EXPECT_EQ(std::set<std::uint8_t>(corners.begin(), corners.end()).size(), 4u);
        EXPECT_LT(std::ranges::max(corners), corners_of(shape));
        EXPECT_TRUE(shape == CellShape::tetrahedron || corners[3] == (split & 7u));
      }
    }
}

// A cell is the same however its corners are numbered: it has the same order, and the same tetrahedra.
TEST(CellShapes, ComeBackWithTheSameTetrahedra) {
  std::mt19937 random(3);
  for (const CellShape shape : all_shapes) {
    CellChunk cells;
    cells.shape = shape;
    std::uint64_t first = 0;
    for (int cell = 0; cell < 500; ++cell) {
      first += random() % 3;
      std::set<std::uint64_t> ranks{first};
      while (ranks.size() < corners_of(shape)) ranks.insert(first + 1 + random() % (cell % 2 == 0 ? 20 : 1000000));
      std::vector<std::uint64_t> corners(ranks.begin(), ranks.end());
      std::ranges::shuffle(corners, random);
      cells.corners.insert(cells.corners.end(), corners.begin(), corners.end());
      if (shape == CellShape::tetrahedron) continue;
      do cells.splits.push_back(static_cast<CellSplit>(random() % split_end(shape)));
      while (!is_split(shape, cells.splits.back()) && (cells.splits.pop_back(), true));
    }
    const PackedCells packed = pack_cells(cells, number_corners(cells.corners).ranks.size());
    const CellChunk back = test::value_of(unpack_cells(packed.entry, packed.bytes, first + 2000000, 0, "cells"));
    EXPECT_EQ(back.size(), cells.size());
    EXPECT_EQ(tetrahedra_in(back), tetrahedra_in(cells)) << corners_of(shape);
    // What has come back is packed into the same bytes.
    EXPECT_EQ(pack_cells(back, packed.entry.points).bytes, packed.bytes);
  }
}

}  // namespace
}  // namespace splatvol::format
