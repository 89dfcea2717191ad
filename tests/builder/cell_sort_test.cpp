#include "builder/cells/cell_sort.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <vector>

#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using format::CellField;
using format::CellShape;

// A cell in the order of CellSort, and its corners as they were given.
struct Cell {
  std::uint64_t point = 0;
  std::vector<std::uint64_t> sorted;
  format::CellSplit split = 0;
  std::vector<std::uint64_t> corners;
  int sign = 0;
  auto operator<=>(const Cell&) const = default;
};

// Few different points, so that cells have corners in common.
std::vector<Cell> random_cells(CellShape shape, CellField field, std::uint64_t first) {
  std::mt19937_64 random(3);
  std::vector<Cell> cells(5000);
  for (Cell& cell : cells) {
    if (field == CellField::constant) cell.point = first + random() % 40;
    while (cell.corners.size() < format::corners_of(shape)) {
      const std::uint64_t corner = first + random() % 40;
      if (std::ranges::find(cell.corners, corner) == cell.corners.end()) cell.corners.push_back(corner);
    }
    cell.sorted = cell.corners;
    std::ranges::sort(cell.sorted);
    cell.split = static_cast<format::CellSplit>(random() % format::split_end(shape));
    cell.sign = static_cast<int>(random() % 3) - 1;
  }
  return cells;
}

std::vector<Cell> cells_of(const CellForm& form, const SortedCells& sorted) {
  const RankedCells ranked = form.read(sorted.records);
  EXPECT_EQ(ranked.chunk.size(), sorted.cells);
  EXPECT_EQ(ranked.chunk.corners.size(), sorted.corners);
  std::vector<Cell> cells(sorted.cells);
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const auto corners = ranked.chunk.corners_at(i);
    cells[i].sorted.assign(corners.begin(), corners.end());
    for (std::size_t k = 0; k < corners.size(); ++k)
      cells[i].corners.push_back(corners[format::permutations_of(form.shape())[ranked.permutations[i]][k]]);
    if (!ranked.chunk.points.empty()) cells[i].point = ranked.chunk.points[i];
    cells[i].split = ranked.chunk.split_at(i);
    cells[i].sign = ranked.signs[i];
  }
  return cells;
}

struct CellSorts : FolderTest {
  // Sorts, and takes the cells of ranks below a border, which moves on.
  std::vector<Cell> sort(CellShape shape, CellField field, std::span<const Cell> cells, std::uint64_t rank_end,
                         std::uint64_t memory) const {
    const CellForm form(shape, field, rank_end);
    CellSort sort = value_of(CellSort::create(form, memory, path("")));
    for (const Cell& cell : cells) {
      RankedCell ranked{.point = cell.point, .split = cell.split, .sign = cell.sign};
      std::ranges::copy(cell.sorted, ranked.ranks.begin());
      ranked.permutation = format::permutation_of(std::span(cell.corners));
      std::vector<CellWord> record;
      form.append(ranked, record);
      EXPECT_EQ(record.size(), form.words());
      EXPECT_TRUE(sort.add(record));
    }
    EXPECT_TRUE(sort.finish());
    SortedCells sorted;
    while (const auto rank = value_of(sort.next_rank())) {
      const std::size_t had = sorted.cells;
      sort.take(*rank + 3, sorted);
      EXPECT_GT(sorted.cells, had);
      const std::vector<Cell> all = cells_of(form, sorted);
      EXPECT_EQ(field == CellField::constant ? all[had].point : all[had].sorted[0], *rank);
      EXPECT_LT(field == CellField::constant ? all.back().point : all.back().sorted[0], *rank + 3);
    }
    EXPECT_EQ(sort.count(), cells.size());
    return cells_of(form, sorted);
  }
};

TEST_F(CellSorts, OrderIsThatOfAllCornersForAnyRanksAndMemory) {
  for (const CellField field : {CellField::corners, CellField::constant})
    for (const CellShape shape : {CellShape::tetrahedron, CellShape::wedge, CellShape::hexahedron})
      for (const std::uint64_t first :
           {std::uint64_t{0}, (std::uint64_t{1} << 31) - 20, (std::uint64_t{1} << 48) - 50}) {
        std::vector<Cell> cells = random_cells(shape, field, first);
        const std::vector<Cell> sorted = sort(shape, field, cells, first + 40, std::uint64_t{1} << 24);
        EXPECT_TRUE(std::ranges::is_sorted(sorted));
        EXPECT_EQ(sort(shape, field, cells, first + 40, 1), sorted);
        EXPECT_EQ(sort(shape, field, cells, std::uint64_t{1} << 48, 1), sorted);
        std::ranges::reverse(cells);
        EXPECT_EQ(sort(shape, field, cells, first + 40, 1), sorted);
        std::vector<Cell> same = sorted;
        std::ranges::sort(same);
        std::ranges::sort(cells);
        EXPECT_EQ(same, cells);
      }
}

}  // namespace
}  // namespace splatvol::test
