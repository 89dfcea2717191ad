#include "streamer/visibility.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "format/columns.h"
#include "tests/streamer/fixture.h"

namespace splatvol {
namespace {

format::Attribute attribute(double min, double max, double offset = 0) {
  format::Attribute a;
  a.min = min;
  a.max = max;
  a.offset = offset;
  return a;
}

// Zero in parts of a random domain, with jumps.
TransferFunction random_function(std::mt19937& random) {
  std::uniform_real_distribution<double> uniform(0, 1);
  TransferFunction function = test::opaque();
  function.lo = -1 + 2 * uniform(random);
  function.hi = function.lo + 0.1 + 2 * uniform(random);
  function.densities.clear();
  double t = uniform(random) < 0.5 ? 0 : 0.2;
  for (int i = 0; i < 6; ++i) {
    function.densities.push_back({t, uniform(random) < 0.6 ? 0 : uniform(random)});
    if (uniform(random) < 0.7) t = std::min(1.0, t + 0.3 * uniform(random));
  }
  return function;
}

TEST(ExtinctionWithin, SeesSpikesBetweenTwoInvisibleValues) {
  TransferFunction function = test::opaque();
  function.lo = 10;
  function.hi = 20;
  function.densities = {{0, 0}, {0.5, 0}, {0.51, 3}, {0.52, 0}, {1, 0}};
  EXPECT_TRUE(extinction_within(function, 11, 19));
  EXPECT_TRUE(extinction_within(function, 15.1, 15.1));
  EXPECT_FALSE(extinction_within(function, 11, 15));
  EXPECT_FALSE(extinction_within(function, 15.21, 100));
  EXPECT_FALSE(extinction_within(function, -100, 15));
}

TEST(ExtinctionWithin, IsClampedOutsideOfTheDomain) {
  TransferFunction function = test::opaque();
  function.densities = {{0, 2}, {0.5, 0}, {1, 0}};
  EXPECT_TRUE(extinction_within(function, -7, -5));
  EXPECT_FALSE(extinction_within(function, 5, 7));
}

TEST(ExtinctionWithin, FollowsTheAxis) {
  TransferFunction function = test::opaque();
  function.axis = ValueAxis::log;
  function.lo = 1e-6;
  function.hi = 1e3;
  const double t = function.t_of(0.1);
  function.densities = {{0, 0}, {t - 0.01, 0}, {t, 3}, {t + 0.01, 0}, {1, 0}};
  EXPECT_TRUE(extinction_within(function, -5, 1e3));
  EXPECT_TRUE(extinction_within(function, 0.05, 0.2));
  EXPECT_FALSE(extinction_within(function, -5, 0.05));
  EXPECT_FALSE(extinction_within(function, 0.2, 1e9));
  const ValueVisibility visibility(function, attribute(0, 64));
  EXPECT_EQ(visibility.bins(), 1u);
  EXPECT_FALSE(visibility.shows(0.2f, 0.9f, 1));
  EXPECT_EQ(visibility.extinctions(0.05f, 0.9f).most, 3);
  function.axis = ValueAxis::linear;
  EXPECT_NE(visibility, ValueVisibility(function, attribute(0, 64)));
}

TEST(ValueVisibility, BinsAreThoseOfVisibleValues) {
  const auto a = attribute(0, 64);
  const ValueVisibility visibility(test::window(10.25, 12.5), a);
  EXPECT_EQ(visibility.bins(), std::uint64_t{0b111} << 10);
  const ValueVisibility at_border(test::window(10, 10.5), a);
  EXPECT_EQ(at_border.bins(), std::uint64_t{0b11} << 9) << "value 10 may have been rounded into bin 9";
  EXPECT_EQ(ValueVisibility(test::opaque(), a).bins(), ~std::uint64_t{0});
}

TEST(ValueVisibility, NeverHidesAVisibleValue) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(0, 1);
  int hidden = 0;
  for (int trial = 0; trial < 300; ++trial) {
    const TransferFunction function = random_function(random);
    const double offset = trial % 3 == 0 ? 1e6 : 0;
    auto a = attribute(offset - 1.5, offset + 1.5, offset);
    TransferFunction shifted = function;
    shifted.lo += offset;
    shifted.hi += offset;
    const ValueVisibility visibility(shifted, a);
    const format::ValueBins bins{-1.5, 1.5};
    for (int sample = 0; sample < 300; ++sample) {
      const auto stored = static_cast<float>(-1.5 + 3 * uniform(random));
      const format::ValueSummary summary = bins.summarize(std::vector<float>{stored});
      const bool visible = shifted.extinction(offset + static_cast<double>(stored)) > 0;
      const bool shown = visibility.shows(summary.min, summary.max, summary.occupancy);
      ASSERT_TRUE(shown || !visible) << "trial " << trial << ", value " << stored;
      ASSERT_TRUE(!shown || visible) << "a single value is told exactly: trial " << trial << ", value " << stored;
      if (!shown) ++hidden;
    }
  }
  EXPECT_GT(hidden, 10000);
}

TEST(ValueVisibility, MissingValuesShowNothing) {
  const format::ValueSummary none;
  EXPECT_FALSE(ValueVisibility(test::opaque(), attribute(0, 1)).shows(none.min, none.max, none.occupancy));
  EXPECT_FALSE(ValueVisibility(test::opaque(), attribute(0, 1)).shows(NAN, NAN, 1));
  EXPECT_EQ(ValueVisibility(test::opaque(), attribute(NAN, NAN)).bins(), 0u);
}

TEST(ValueVisibility, AConstantAttributeHasOneBin) {
  const ValueVisibility visible(test::window(4, 6), attribute(5, 5));
  EXPECT_TRUE(visible.shows(5, 5, 1));
  const ValueVisibility invisible(test::window(4, 4.5), attribute(5, 5));
  EXPECT_FALSE(invisible.shows(5, 5, 1));
}

TEST(ValueVisibility, EqualityIsThatOfExtinction) {
  const auto a = attribute(0, 1);
  TransferFunction recoloured = test::window(0.2, 0.4);
  recoloured.colors = {{0, dvec3(0.5)}};
  EXPECT_TRUE(ValueVisibility(recoloured, a) == ValueVisibility(test::window(0.2, 0.4), a));
  EXPECT_FALSE(ValueVisibility(test::window(0.2, 0.41), a) == ValueVisibility(test::window(0.2, 0.4), a));
}

TEST(ValueContrast, IsTheVarianceAmongNeighbouringValues) {
  // Colour rises from 0 to 1 over the range, and extinction is 1. A uniform window of width w has the variance w^2 / 12
  // in each of three channels.
  TransferFunction function = test::opaque();
  function.lo = 0;
  function.hi = 64;
  function.colors = {{0, dvec3(0)}, {1, dvec3(1)}};
  const ValueContrast contrast(function, attribute(0, 64));
  format::ValueSummary summary;
  summary.min = 24;
  summary.max = 40;
  summary.occupancy = std::uint64_t{0xFFFF} << 24;
  const ValueContrast::Node node = contrast.of(summary);
  EXPECT_EQ(node.range, 16);
  EXPECT_NEAR(node.extinction, 1, 1e-6);
  for (const double width : {0.25, 1.0, 4.0, 16.0})
    EXPECT_NEAR(node.variance(width / 16) / (3 * std::pow(width / 64, 2) / 12), 1, 0.05) << width;

  const ValueContrast alike(test::opaque(), attribute(0, 64));
  EXPECT_EQ(alike.of(summary).variance(1), 0);
  EXPECT_EQ(contrast.of({}).variance(1), 0);
  EXPECT_EQ(ValueContrast(function, attribute(7, 7)).of({7, 7, 1}).variance(1), 0);
}

}  // namespace
}  // namespace splatvol
