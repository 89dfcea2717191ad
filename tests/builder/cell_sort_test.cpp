#include "builder/cells/cell_sort.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <tuple>
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
  std::vector<std::uint64_t> sorted, corners;
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
    cell.sign = static_cast<int>(random() % 3) - 1;
  }
  return cells;
}

std::vector<Cell> cells_of(const SortedCells& sorted) {
  std::vector<Cell> cells(sorted.chunk.size());
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const auto corners = sorted.chunk.corners_at(i);
    cells[i].corners.assign(corners.begin(), corners.end());
    cells[i].sorted = cells[i].corners;
    std::ranges::sort(cells[i].sorted);
    if (!sorted.chunk.points.empty()) cells[i].point = sorted.chunk.points[i];
    cells[i].sign = sorted.signs[i];
  }
  return cells;
}

struct CellSorts : FolderTest {
  // Sorts, and takes the cells of ranks below a border, which moves on.
  std::vector<Cell> sort(CellShape shape, CellField field, std::span<const Cell> cells, std::uint64_t rank_end,
                         std::uint64_t memory) const {
    CellSort sort = value_of(CellSort::create(shape, field, rank_end, memory, path("")));
    for (const Cell& cell : cells) {
      RankedCell ranked{.point = cell.point, .sign = cell.sign};
      std::ranges::copy(cell.corners, ranked.corners.begin());
      const CellSort::Record record = CellSort::record_of(shape, ranked);
      EXPECT_TRUE(sort.add(std::span(record).first(CellSort::words_of(shape, field))));
    }
    EXPECT_TRUE(sort.finish());
    SortedCells sorted;
    sorted.chunk.shape = shape;
    sorted.chunk.field = field;
    while (const auto rank = value_of(sort.next_rank())) {
      const std::size_t had = sorted.chunk.size();
      sort.take(*rank + 3, 100, sorted);
      EXPECT_GT(sorted.chunk.size(), had);
      EXPECT_LE(sorted.chunk.size(), had + 100);
      const std::vector<Cell> all = cells_of(sorted);
      EXPECT_EQ(field == CellField::constant ? all[had].point : all[had].sorted[0], *rank);
      EXPECT_LT(field == CellField::constant ? all.back().point : all.back().sorted[0], *rank + 3);
    }
    return cells_of(sorted);
  }
};

TEST_F(CellSorts, OrderIsThatOfAllCornersForAnyRanksAndMemory) {
  for (const CellField field : {CellField::corners, CellField::constant})
    for (const CellShape shape : {CellShape::tetrahedron, CellShape::wedge, CellShape::hexahedron})
      for (const std::uint64_t first :
           {std::uint64_t{0}, (std::uint64_t{1} << 31) - 20, (std::uint64_t{1} << 48) - 50}) {
        std::vector<Cell> cells = random_cells(shape, field, first);
        const std::vector<Cell> sorted = sort(shape, field, cells, first + 40, std::uint64_t{1} << 24);
        const auto key = [](const Cell& cell) { return std::tie(cell.point, cell.sorted); };
        EXPECT_TRUE(std::ranges::is_sorted(sorted, {}, key));
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
