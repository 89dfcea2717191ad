#include <gtest/gtest.h>
#include <hwy/highway.h>

#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "renderer/cpu/vector-inl.h"

HWY_BEFORE_NAMESPACE();
namespace splatvol::tiles::HWY_NAMESPACE {
namespace {

struct Rows {
  int rows;
  const float* row_spreads;
  [[nodiscard]] static float inner_columns() { return 1; }
};

// Lanes that are not drawn may have any spread.
TEST(TableRow, LiesInTheTable) {
  std::vector<float> spreads(64);
  for (std::size_t row = 0; row < spreads.size(); ++row) spreads[row] = static_cast<float>(row);
  const Rows table{static_cast<int>(spreads.size()), spreads.data()};
  constexpr float infinity = std::numeric_limits<float>::infinity(), nan = std::numeric_limits<float>::quiet_NaN();
  for (const float spread :
       {0.0F, 0.1F, 8.0F, 1e30F, infinity, -0.01F, -1.0F, -infinity, nan, std::copysign(nan, -1.0F)}) {
    std::array<std::int32_t, HWY_MAX_BYTES / 4> rows{};
    store(table_row(table, Float(spread)).row, rows.data());
    EXPECT_GE(rows[0], 0) << spread;
    EXPECT_LT(rows[0], table.rows) << spread;
  }
}

}  // namespace
}  // namespace splatvol::tiles::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
