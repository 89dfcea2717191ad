#include "renderer/transfer_table.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

namespace splatvol {
namespace {

/// Bends, a jump of colour, a jump of extinction, and a gap in between.
TransferFunction lively() {
  TransferFunction function;
  function.lo = -3;
  function.hi = 5;
  function.colors = {{0, {1, 0, 0.5}}, {0.3, {0, 1, 0}}, {0.6, {0.2, 0.1, 1}}, {0.6, {1, 1, 0}}, {1, {0, 0.5, 0.2}}};
  function.densities = {{0, 2}, {0.2, 0}, {0.41, 0}, {0.43, 9}, {0.45, 0}, {0.7, 0}, {0.7, 4}, {1, 1}};
  return function;
}

/// Returns an entry by its definition: the average over 200,000 values between -9 and 9 spreads.
glm::dvec4 average(const TransferFunction& function, double mean, double spread) {
  glm::dvec4 sum(0);
  double weight = 0;
  constexpr int samples = 200'000;
  for (int i = 0; i < samples; ++i) {
    const double z = -9 + 18 * (i + 0.5) / samples;
    const double value = function.lo + (function.hi - function.lo) * (mean + spread * z);
    const double density = std::exp(-0.5 * z * z);
    const double extinction = function.extinction(value);
    sum += density * extinction * glm::dvec4(function.color(value), 1);
    weight += density;
  }
  return {glm::dvec3(sum) / sum.a, sum.a / weight};
}

TEST(TransferTable, AveragesOverANormalDistribution) {
  const TransferFunction function = lively();
  const TransferTable table = make_transfer_table(function, 97, 16);
  ASSERT_EQ(table.entries.size(), 97U * 16U);
  for (const std::size_t row : {1U, 3U, 8U, 15U}) {
    for (std::size_t column = 0; column < table.columns; column += 4) {
      const glm::dvec4 expected = average(function, table.mean(row, column), table.spread(row));
      const vec4 entry = table.entries[row * table.columns + column];
      // The quadrature misses the jumps by an interval of 18 / 200,000 spreads.
      EXPECT_NEAR(entry.a, expected.a, 1e-3) << row << " " << column;
      if (expected.a > 1e-3) {
        EXPECT_LT(glm::distance(glm::dvec3(entry), glm::dvec3(expected)), 1e-3);
      }
    }
  }
}

// A peak beside which every distribution is wide counts by its area.
TEST(TransferTable, PeaksOfAnyWidthKeepTheirArea) {
  constexpr double area = 0.15, at = 0.4;
  for (const double width : {1e-4, 1e-6, 1e-9, 1e-12}) {
    TransferFunction function;
    function.colors = {{0, {0.2, 0.5, 1}}};
    function.densities = {{0, 0}, {at - width / 2, 0}, {at, 2 * area / width}, {at + width / 2, 0}, {1, 0}};
    const TransferTable table = make_transfer_table(function, 97, 16);
    for (std::size_t row = 3; row < 16; ++row)
      for (std::size_t column = 0; column < table.columns; ++column) {
        const double spread = table.spread(row), z = (table.mean(row, column) - at) / spread;
        const double expected = area / spread * std::exp(-0.5 * z * z) / std::sqrt(2 * std::numbers::pi);
        EXPECT_NEAR(table.entries[row * table.columns + column].a, expected, 1e-4 * area / spread)
            << width << " " << row;
      }
  }
}

TEST(TransferTable, TheFirstRowIsTheFunction) {
  const TransferFunction function = lively();
  const TransferTable table = make_transfer_table(function, 1025 + 2 * TransferTable::margin, 2);
  EXPECT_EQ(table.mean(0, TransferTable::margin), 0);
  EXPECT_EQ(table.mean(0, table.columns - 1 - TransferTable::margin), 1);
  for (std::size_t i = 0; i < table.columns; ++i) {
    const double value = function.lo + table.mean(0, i) * (function.hi - function.lo);
    EXPECT_NEAR(table.entries[i].a, function.extinction(value), 1e-5) << i;
    EXPECT_LT(glm::distance(dvec3(table.entries[i]), function.color(value)), 1e-5) << i;
  }
}

TEST(TransferTable, MayJumpAtTheEnds) {
  TransferFunction function = lively();
  function.colors = {{0, {1, 0, 0}}, {0, {0, 1, 0}}, {1, {0, 1, 0}}, {1, {0, 0, 1}}};
  function.densities = {{0, 7}, {0, 1}, {1, 4}, {1, 9}};
  const TransferTable table = make_transfer_table(function, 97, 64);
  const std::size_t first = TransferTable::margin, last = table.columns - 1 - first;
  EXPECT_EQ(table.entries[first - 1], vec4(1, 0, 0, 7));
  EXPECT_EQ(table.entries[first], vec4(0, 1, 0, 1));
  EXPECT_EQ(table.entries[last], vec4(0, 0, 1, 9));
  for (const std::size_t row : {1U, 20U, 63U})
    for (std::size_t column = 0; column < table.columns; column += 8)
      EXPECT_NEAR(table.entries[row * table.columns + column].a,
                  average(function, table.mean(row, column), table.spread(row)).a, 2e-3)
          << row << " " << column;
  const auto levels = make_peak_levels(function, 64);
  EXPECT_EQ(levels[0].front(), 7);
  EXPECT_EQ(levels[0].back(), 9);
}

TEST(TransferTable, FarOutsideTheEndsHold) {
  // At a mean 4 spreads beyond the domain, all but 3e-5 of the values lie beyond the end.
  const TransferFunction function = lively();
  const TransferTable table = make_transfer_table(function, 65, 64);
  for (std::size_t row = 0; row < table.rows; ++row) {
    EXPECT_NEAR(table.entries[row * 65].a, 2, 1e-3);
    EXPECT_NEAR(table.entries[row * 65 + 64].a, 1, 1e-3);
    EXPECT_LT(glm::distance(vec3(table.entries[row * 65]), vec3(1, 0, 0.5)), 1e-3);
  }
  // Eight domains of spread: half of the values lie on each side.
  EXPECT_NEAR(table.spread(63), 8, 1e-12);
  EXPECT_NEAR(table.entries[63 * 65 + 32].a, 1.5, 0.1);
}

TEST(TransferTable, NarrowDomainsFarFromZero) {
  TransferFunction function = lively();
  const TransferTable expected = make_transfer_table(function, 97, 16);
  function.lo = 1e9;
  function.hi = 1e9 + 1e-4;
  const TransferTable table = make_transfer_table(function, 97, 16);
  for (std::size_t i = 0; i < table.entries.size(); ++i) EXPECT_EQ(table.entries[i], expected.entries[i]);
}

TEST(TransferTable, InvisibleFunctionsKeepTheirColours) {
  TransferFunction function = lively();
  function.densities = {{0, 0}};
  const TransferTable table = make_transfer_table(function, 97, 4);
  for (const vec4& entry : table.entries) {
    EXPECT_EQ(entry.a, 0);
    for (int channel = 0; channel < 3; ++channel) EXPECT_TRUE(entry[channel] >= 0 && entry[channel] <= 1);
  }
  EXPECT_LT(glm::distance(vec3(table.entries[0]), vec3(1, 0, 0.5)), 1e-6);
}

TEST(TransferTable, NoMeanIsBrighterThanAllColours) {
  // Hundreds of steps of colour and extinction in a hundredth of the domain, and nothing beyond.
  std::mt19937 generator(5);
  for (int turn = 0; turn < 200; ++turn) {
    TransferFunction function;
    double t = 0;
    for (int i = 0; i < 1200; ++i, t += (generator() % 8 == 0 ? 1e-4 : 7.6e-6)) {
      function.colors.push_back({t, dvec3(generator() % 16 == 0 ? 1e4 : 562, 0.05, 0.05)});
      function.densities.push_back({t, generator() % 4 == 0 ? 5e28 : generator() % 16 == 0 ? 1e30 : 0});
    }
    function.colors.push_back({t, dvec3(0)});
    function.densities.push_back({t, 0});
    for (const vec4& entry : make_transfer_table(function, 50, 6).entries)
      ASSERT_LE(std::max({entry.r, entry.g, entry.b}), 1e4F) << turn;
  }
}

TEST(TransferTable, RemembersTheLastFunctions) {
  TransferFunction function = lively();
  const TransferTable first = make_transfer_table(function, 97, 16);
  for (int i = 1; i <= 6; ++i) {  // more than are remembered
    function.densities[0].extinction = 2 + i;
    const TransferTable other = make_transfer_table(function, 97, 16);
    EXPECT_NEAR(other.entries[0].a, 2 + i, 1e-6) << "no other function's table";
    EXPECT_EQ(make_transfer_table(function, 97, 16).entries, other.entries);
    EXPECT_EQ(make_transfer_table(function, 65, 16).entries.size(), 65U * 16U);
  }
  EXPECT_EQ(make_transfer_table(lively(), 97, 16).entries, first.entries);
}

TEST(PeakLevels, BoundTheFunction) {
  const TransferFunction function = lively();
  const auto levels = make_peak_levels(function, 256);
  ASSERT_EQ(levels.size(), 9U);
  for (std::size_t level = 0; level < levels.size(); ++level) {
    ASSERT_EQ(levels[level].size(), 256U >> level);
    for (std::size_t i = 0; i < levels[level].size(); ++i) {
      double peak = 0;
      constexpr int samples = 1000;
      for (int sample = 0; sample <= samples; ++sample) {
        const double t =
            (static_cast<double>(i) + sample / double{samples}) / static_cast<double>(levels[level].size());
        peak = std::max(peak, function.extinction(function.lo + (function.hi - function.lo) * t));
      }
      // Never less, except for rounding, and not much more: the steepest slope is 450, samples are 1/256000 apart or
      // more.
      EXPECT_GE(levels[level][i], peak - 1e-5) << level << " " << i;
      if (level < 4) {
        EXPECT_LE(levels[level][i], peak + 0.05) << level << " " << i;
      }
    }
  }
  EXPECT_EQ(levels.back()[0], 9);
}

}  // namespace
}  // namespace splatvol
