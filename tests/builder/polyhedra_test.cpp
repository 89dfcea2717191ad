#include "builder/cells/polyhedra.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <numeric>
#include <random>
#include <set>

#include "builder/cells/cell_sort.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"
#include "tests/support/test_cells.h"

namespace splatvol::test {
namespace {

using Part = std::array<std::uint64_t, 4>;

// The tetrahedra of a polyhedron, each in ascending order of its corners.
std::multiset<Part> parts_of(const Polyhedron& polyhedron) {
  std::multiset<Part> parts;
  format::for_each_tetrahedron(polyhedron.triangles, polyhedron.apex, [&](const auto& corners) {
    Part part{};
    std::ranges::transform(corners, part.begin(), [&](std::uint8_t k) { return polyhedron.corners[k]; });
    std::ranges::sort(part);
    parts.insert(part);
  });
  return parts;
}

Polyhedron random_polyhedron(std::size_t corners, std::mt19937& random, std::uint64_t first = 0) {
  std::set<std::uint64_t> ranks{first};
  while (ranks.size() < corners) ranks.insert(first + 1 + random() % (corners % 2 == 0 ? 400 : 100'000));
  return {.corners = {ranks.begin(), ranks.end()},
          .triangles = random_surface(corners, random),
          .point = random() % 50,
          .apex = static_cast<std::uint8_t>(random() % corners),
          .sign = static_cast<int>(random() % 3) - 1};
}

std::vector<Tetrahedron> tetrahedra_of(const Polyhedron& polyhedron) {
  std::vector<Tetrahedron> tetrahedra;
  format::for_each_tetrahedron(polyhedron.triangles, polyhedron.apex, [&](const auto& corners) {
    std::ranges::transform(corners, tetrahedra.emplace_back().begin(),
                           [&](std::uint8_t k) { return static_cast<std::uint32_t>(polyhedron.corners[k]); });
  });
  return tetrahedra;
}

TEST(Polyhedra, AreJoinedFromTheirTetrahedra) {
  std::mt19937 random(3);
  std::size_t joined = 0;
  for (int i = 0; i < 400; ++i) {
    const Polyhedron given = random_polyhedron(i == 0 ? 255 : 5 + random() % 40, random);
    std::vector<Tetrahedron> tetrahedra = tetrahedra_of(given);
    std::ranges::shuffle(tetrahedra, random);
    Polyhedron found;
    if (tetrahedra.size() < 2) {
      EXPECT_FALSE(join_tetrahedra(tetrahedra, found));
      continue;
    }
    ASSERT_TRUE(join_tetrahedra(tetrahedra, found));
    ++joined;
    EXPECT_EQ(found.corners, given.corners);
    EXPECT_EQ(found.apex, given.apex);
    EXPECT_EQ(parts_of(found), parts_of(given));

    // The bytes are the same for all orders, and bring all of it back.
    found.point = given.point;
    found.sign = given.sign;
    std::vector<std::byte> bytes, same;
    ASSERT_TRUE(put_polyhedron(found, bytes));
    ASSERT_TRUE(put_polyhedron(given, same));
    EXPECT_EQ(bytes, same);
    Polyhedron back;
    std::span<const std::byte> left = bytes;
    get_polyhedron(left, back);
    EXPECT_TRUE(left.empty());
    EXPECT_EQ(back.corners, given.corners);
    EXPECT_EQ(back.point, given.point);
    EXPECT_EQ(parts_of(back), parts_of(given));
    std::vector<std::byte> again;
    ASSERT_TRUE(put_polyhedron(back, again));
    EXPECT_EQ(again, bytes);
  }
  EXPECT_GT(joined, 300u);
}

TEST(Polyhedra, AreNotJoinedFromOthers) {
  Polyhedron found;
  const auto joins = [&](std::vector<Tetrahedron> tetrahedra) {
    std::vector<std::byte> bytes;
    return join_tetrahedra(tetrahedra, found) && put_polyhedron(found, bytes);
  };
  EXPECT_TRUE(joins({{0, 1, 2, 9}, {0, 2, 3, 9}}));
  EXPECT_FALSE(joins({{0, 1, 2, 9}}));
  EXPECT_FALSE(joins({{0, 1, 2, 9}, {0, 2, 3, 8}}));                // no apex
  EXPECT_FALSE(joins({{0, 1, 2, 9}, {9, 2, 3, 9}}));                // the apex twice
  EXPECT_FALSE(joins({{0, 1, 2, 9}, {0, 3, 2, 9}}));                // against each other
  EXPECT_FALSE(joins({{0, 1, 2, 9}, {0, 1, 2, 9}}));                // the same
  EXPECT_FALSE(joins({{0, 1, 2, 9}, {3, 4, 5, 9}}));                // no face in common
  EXPECT_FALSE(joins({{0, 1, 2, 9}, {0, 2, 3, 9}, {4, 5, 6, 9}}));  // two parts
  EXPECT_FALSE(joins({{0, 0, 2, 9}, {0, 2, 3, 9}}));
  std::vector<Tetrahedron> fan;  // of as many corners as there may be
  for (std::uint32_t i = 1; i < 253; ++i) fan.push_back({0, i, i + 1, 999});
  EXPECT_TRUE(joins(fan));
  fan.push_back({0, 253, 254, 999});
  EXPECT_FALSE(joins(fan));
}

TEST(Polyhedra, GetOtherNumbers) {
  std::mt19937 random(4);
  Polyhedron polyhedron = random_polyhedron(30, random);
  std::vector<std::uint64_t> numbers(30);
  std::iota(numbers.begin(), numbers.end(), 1000);
  std::ranges::shuffle(numbers, random);
  Polyhedron expected = polyhedron;
  expected.corners = numbers;  // in the order of the old ones
  ASSERT_TRUE(renumber(numbers, polyhedron));
  EXPECT_TRUE(std::ranges::is_sorted(polyhedron.corners));
  EXPECT_EQ(parts_of(polyhedron), parts_of(expected));
  numbers[7] = numbers[3];
  const Polyhedron before = polyhedron;
  EXPECT_FALSE(renumber(numbers, polyhedron));
  EXPECT_EQ(polyhedron.corners, before.corners);
  EXPECT_EQ(polyhedron.triangles, before.triangles);
}

struct PolyhedronSort : FolderTest {
  std::vector<std::byte> sort(format::CellField field, std::span<const Polyhedron> cells, std::uint64_t memory) const {
    const CellForm form(format::CellShape::polyhedron, field, 200'000);
    CellSort sort = value_of(CellSort::create(form, memory, path("")));
    for (const Polyhedron& cell : cells) {
      std::vector<CellWord> records;
      form.append(cell, records);
      EXPECT_EQ(records.size(), form.records_of(records.data()) * form.words());
      EXPECT_EQ(form.corners_of(records.data()), cell.corners.size());
      EXPECT_TRUE(sort.add(records));
    }
    EXPECT_TRUE(sort.finish());
    EXPECT_EQ(sort.count(), cells.size());
    SortedCells sorted;
    std::uint64_t before = 0;
    while (const auto rank = value_of(sort.next_rank())) {
      EXPECT_GE(*rank, before);
      before = *rank;
      const std::size_t had = sorted.records.size();
      sort.take(*rank + 3, sorted);
      EXPECT_EQ(form.rank_of(&sorted.records[had]), *rank);
      EXPECT_LT(form.rank_of(&sorted.records[sorted.records.size() - form.words()]), *rank + 3);
    }
    const auto [chunk, permutations, signs] = form.read(sorted.records);
    EXPECT_EQ(chunk.size(), sorted.cells);
    EXPECT_EQ(chunk.corners.size(), sorted.corners);
    std::vector<std::byte> bytes;
    for (std::size_t i = 0; i < chunk.size(); ++i) {
      const auto corners = chunk.corners_at(i);
      const auto triangles = chunk.triangles_at(i);
      const Polyhedron cell{.corners = {corners.begin(), corners.end()},
                            .triangles = {triangles.begin(), triangles.end()},
                            .point = field == format::CellField::constant ? chunk.points[i] : 0,
                            .apex = static_cast<std::uint8_t>(chunk.splits[i]),
                            .sign = signs[i]};
      EXPECT_TRUE(put_polyhedron(cell, bytes));
    }
    return bytes;
  }
};

TEST_F(PolyhedronSort, OrderDoesNotDependOnTheInputsAndMemory) {
  for (const auto field : {format::CellField::corners, format::CellField::constant}) {
    std::mt19937 random(5);
    std::vector<Polyhedron> cells;
    for (int i = 0; i < 600; ++i) {
      cells.push_back(random_polyhedron(i % 50 == 0 ? 255 : 5 + random() % 40, random, random() % 60));
      if (field == format::CellField::corners) cells.back().point = 0;
      for (int copies = i % 7 == 0 ? 3 : 0; copies > 0; --copies) {
        cells.push_back(cells.back());
        cells.back().sign = static_cast<int>(random() % 3) - 1;
      }
    }
    const std::vector<std::byte> sorted = sort(field, cells, std::uint64_t{1} << 24);
    std::size_t bytes = 0;
    for (const Polyhedron& cell : cells) {
      std::vector<std::byte> of_cell;
      EXPECT_TRUE(put_polyhedron(cell, of_cell));
      bytes += of_cell.size();
    }
    EXPECT_EQ(sorted.size(), bytes);
    for (const std::uint64_t memory : {std::uint64_t{1}, std::uint64_t{1} << 24}) {
      std::ranges::shuffle(cells, random);
      EXPECT_TRUE(sort(field, cells, memory) == sorted);
    }
  }
}

}  // namespace
}  // namespace splatvol::test
