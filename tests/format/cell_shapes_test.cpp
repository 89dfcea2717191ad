#include "format/cell_shapes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <random>
#include <set>

#include "format/cells.h"
#include "tests/support/results.h"
#include "tests/support/test_cells.h"

namespace splatvol::test {
namespace {

using namespace format;

constexpr std::array all_shapes = {CellShape::tetrahedron, CellShape::pyramid, CellShape::wedge, CellShape::hexahedron};

using Tetrahedra = std::multiset<std::array<std::uint64_t, 4>>;

// The tetrahedra of all cells, with sorted corners.
Tetrahedra tetrahedra_in(const CellChunk& cells) {
  Tetrahedra tetrahedra;
  for (std::size_t i = 0; i < cells.size(); ++i)
    for_each_tetrahedron(cells, i, [&](const std::array<std::uint8_t, 4>& corners) {
      std::array<std::uint64_t, 4> ranks{};
      std::ranges::transform(corners, ranks.begin(), [&](std::uint8_t k) { return cells.corners_at(i)[k]; });
      std::ranges::sort(ranks);
      tetrahedra.insert(ranks);
    });
  return tetrahedra;
}

// Packs cells whose corners come in any order.
PackedCells packed_of(CellChunk cells) {
  std::vector<Permutation> permutations;
  for (std::size_t i = 0; i < cells.size(); ++i) {
    permutations.push_back(permutation_of(cells.corners_at(i)));
    std::ranges::sort(std::span(cells.corners).subspan(cells.begin_of(i), cells.corners_at(i).size()));
  }
  return pack_cells(cells, number_corners(cells.corners).ranks.size(), permutations);
}

TEST(CellShapes, HaveAsManyOrdersAsThereAreWaysToNumberThem) {
  EXPECT_EQ(orders_of(CellShape::tetrahedron).size(), 1u);
  EXPECT_EQ(orders_of(CellShape::pyramid).size(), 120u / 8);
  EXPECT_EQ(orders_of(CellShape::wedge).size(), 720u / 12);
  EXPECT_EQ(orders_of(CellShape::hexahedron).size(), 40320u / 48);
}

TEST(CellShapes, PermutationsAreNumberedInOrder) {
  for (const CellShape shape : all_shapes) {
    const auto permutations = permutations_of(shape);
    EXPECT_TRUE(std::ranges::is_sorted(permutations));
    for (std::size_t p = 0; p < permutations.size(); ++p)
      ASSERT_EQ(permutation_of(std::span(permutations[p]).first(corners_of(shape))), p);
  }
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
    const PackedCells packed = packed_of(cells);
    const CellChunk back = value_of(unpack_cells(packed.entry, packed.bytes, first + 2000000, 0, "cells"));
    EXPECT_EQ(back.size(), cells.size());
    EXPECT_EQ(tetrahedra_in(back), tetrahedra_in(cells)) << corners_of(shape);
    // What has come back is packed into the same bytes.
    EXPECT_EQ(packed_of(back).bytes, packed.bytes);
  }
}

// --- Polyhedra.

// Some with few corners, some with all.
CellChunk random_polyhedra(CellField field, std::size_t count, std::uint32_t seed) {
  std::mt19937 random(seed);
  CellChunk cells{CellShape::polyhedron, field, {}, {}, {}};
  std::uint64_t first = 70'000, point = 5;
  for (std::size_t cell = 0; cell < count; ++cell) {
    const std::size_t corners = cell == 7 ? max_polyhedron_corners : 4 + random() % (cell % 3 == 0 ? 8 : 40);
    if (field == CellField::constant)
      cells.points.push_back(point += random() % 3), first = random() % 80'000;
    else
      first += random() % 5;
    std::set<std::uint64_t> ranks{first};
    while (ranks.size() < corners) ranks.insert(first + 1 + random() % (cell % 2 == 0 ? 300 : 1'000'000));
    cells.corners.insert(cells.corners.end(), ranks.begin(), ranks.end());
    cells.ends.push_back(static_cast<std::uint32_t>(cells.corners.size()));
    cells.splits.push_back(static_cast<CellSplit>(random() % corners));
    const auto surface = random_surface(corners, random);
    cells.triangles.insert(cells.triangles.end(), surface.begin(), surface.end());
  }
  return cells;
}

constexpr std::uint64_t many = 2'000'000;  // points, and vertices

TEST(Polyhedra, ComeBackWithTheSameTetrahedra) {
  for (const CellField field : {CellField::corners, CellField::constant})
    for (const std::size_t count : {std::size_t{1}, std::size_t{300}}) {
      const CellChunk cells = random_polyhedra(field, count, 3);
      const PackedCells packed = packed_of(cells);
      EXPECT_EQ(packed.entry.shape, CellShape::polyhedron);
      EXPECT_EQ(packed.entry.cells, count);
      EXPECT_LE(packed.entry.unpacked_bytes, most_unpacked_bytes(packed.entry));
      const CellChunk back = value_of(unpack_cells(packed.entry, packed.bytes, many, many, "cells"));
      ASSERT_EQ(back.size(), count);
      EXPECT_EQ(back.corners, cells.corners);
      EXPECT_EQ(back.ends, cells.ends);
      EXPECT_EQ(back.splits, cells.splits);
      EXPECT_EQ(back.points, cells.points);
      EXPECT_EQ(tetrahedra_in(back), tetrahedra_in(cells));
      EXPECT_EQ(packed_of(back).bytes, packed.bytes);
    }
}

// As many corners as a chunk may have, and one more.
TEST(Polyhedra, OfAChunkHaveABoundOfCorners) {
  CellChunk cells{CellShape::polyhedron, CellField::corners, {}, {}, {}};
  std::mt19937 random(9);
  const auto surface = random_surface(64, random);
  for (std::size_t cell = 0; cell < max_chunk_corners / 64; ++cell) {
    for (std::size_t k = 0; k < 64; ++k) cells.corners.push_back(cell + k);
    cells.ends.push_back(static_cast<std::uint32_t>(cells.corners.size()));
    cells.splits.push_back(3);
    cells.triangles.insert(cells.triangles.end(), surface.begin(), surface.end());
  }
  const PackedCells most = packed_of(cells);
  EXPECT_EQ(value_of(unpack_cells(most.entry, most.bytes, many, 0, "cells")).corners, cells.corners);
  const CellChunk again = cells;
  append_cells(cells, again, again.size() - 1, again.size());
  const PackedCells more = packed_of(cells);
  EXPECT_NE(message_of(unpack_cells(more.entry, more.bytes, many, 0, "cells")), "");
}

TEST(Polyhedra, OfHostileBytesAreWholeOrRefused) {
  std::mt19937 random(5);
  for (const CellField field : {CellField::corners, CellField::constant}) {
    const PackedCells packed = packed_of(random_polyhedra(field, 12, 5));
    const Bytes payload = value_of(unpack(packed.bytes, packed.entry.unpacked_bytes, "cells"));
    std::size_t refused = 0, taken = 0;
    const auto take = [&](const Bytes& changed, std::uint32_t cells) {
      const PackedCells with = repacked(packed, changed, cells);
      const auto back = unpack_cells(with.entry, with.bytes, many, many, "cells");
      if (!back) {
        ++refused;
        EXPECT_TRUE(back.error().message.ends_with("[R24]")) << back.error().message;
        return;
      }
      ++taken;
      ASSERT_EQ(back->size(), cells);
      for (std::size_t cell = 0; cell < back->size(); ++cell) {
        const auto corners = back->corners_at(cell);
        EXPECT_LT(back->splits[cell], corners.size());
        EXPECT_LT(corners.back(), many);
        EXPECT_EQ(std::ranges::adjacent_find(corners, std::greater_equal<>()), corners.end());
        for (const SurfaceTriangle& triangle : back->triangles_at(cell))
          EXPECT_LT(std::ranges::max(triangle), corners.size());
      }
    };
    take(payload, 12);
    EXPECT_EQ(taken, 1u);
    for (const std::uint32_t cells : {1u, 11u, 13u, 65536u}) take(payload, cells);
    for (std::size_t bytes = 0; bytes < payload.size(); bytes += bytes < 40 ? 1 : 7)
      take(Bytes(payload.begin(), payload.begin() + static_cast<std::ptrdiff_t>(bytes)), 12);
    Bytes longer = payload;
    longer.push_back({});
    take(longer, 12);
    EXPECT_EQ(taken, 1u) << "a length has one number of cells";
    for (std::size_t at = 0; at < payload.size(); ++at)
      for (const std::byte value : {std::byte{0}, std::byte{3}, std::byte{255}, static_cast<std::byte>(random())}) {
        Bytes changed = payload;
        changed[at] = value;
        take(changed, 12);
      }
    EXPECT_GT(refused, payload.size());
    EXPECT_GT(taken, 100u);
  }
}

}  // namespace
}  // namespace splatvol::test
