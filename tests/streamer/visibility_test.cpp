#include "streamer/splats/visibility.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "format/columns.h"
#include "tests/streamer/fixture.h"

namespace splatvol::test {
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
  TransferFunction function = opaque();
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
  TransferFunction function = opaque();
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
  TransferFunction function = opaque();
  function.densities = {{0, 2}, {0.5, 0}, {1, 0}};
  EXPECT_TRUE(extinction_within(function, -7, -5));
  EXPECT_FALSE(extinction_within(function, 5, 7));
}

TEST(ExtinctionWithin, FollowsTheAxis) {
  TransferFunction function = opaque();
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
  const ValueVisibility visibility(window(10.25, 12.5), a);
  EXPECT_EQ(visibility.bins(), std::uint64_t{0b111} << 10);
  const ValueVisibility at_border(window(10, 10.5), a);
  EXPECT_EQ(at_border.bins(), std::uint64_t{0b11} << 9) << "value 10 may have been rounded into bin 9";
  EXPECT_EQ(ValueVisibility(opaque(), a).bins(), ~std::uint64_t{0});
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
  EXPECT_FALSE(ValueVisibility(opaque(), attribute(0, 1)).shows(none.min, none.max, none.occupancy));
  EXPECT_FALSE(ValueVisibility(opaque(), attribute(0, 1)).shows(NAN, NAN, 1));
  EXPECT_EQ(ValueVisibility(opaque(), attribute(NAN, NAN)).bins(), 0u);
}

TEST(ValueVisibility, AConstantAttributeHasOneBin) {
  const ValueVisibility visible(window(4, 6), attribute(5, 5));
  EXPECT_TRUE(visible.shows(5, 5, 1));
  const ValueVisibility invisible(window(4, 4.5), attribute(5, 5));
  EXPECT_FALSE(invisible.shows(5, 5, 1));
}

TEST(ValueVisibility, EqualityIsThatOfExtinction) {
  const auto a = attribute(0, 1);
  TransferFunction recoloured = window(0.2, 0.4);
  recoloured.colors = {{0, dvec3(0.5)}};
  EXPECT_TRUE(ValueVisibility(recoloured, a) == ValueVisibility(window(0.2, 0.4), a));
  EXPECT_FALSE(ValueVisibility(window(0.2, 0.41), a) == ValueVisibility(window(0.2, 0.4), a));
}

TEST(ValueContrast, IsTheVarianceAmongNeighbouringValues) {
  // Colour rises from 0 to 1 over the range, and extinction is 1. A uniform window of width w has the variance w^2 / 12
  // in each of three channels.
  TransferFunction function = opaque();
  function.lo = 0;
  function.hi = 64;
  function.colors = {{0, dvec3(0)}, {1, dvec3(1)}};
  const ValueContrast contrast(function, attribute(0, 64));
  format::ValueSummary summary{.min = 24, .max = 40, .occupancy = std::uint64_t{0xFFFF} << 24};
  const ValueContrast::Node node = contrast.of(summary);
  EXPECT_EQ(node.range, 16);
  EXPECT_NEAR(node.extinction, 1, 1e-6);
  for (const double width : {0.25, 1.0, 4.0, 16.0})
    EXPECT_NEAR(node.variance(width / 16) / (3 * std::pow(width / 64, 2) / 12), 1, 0.05) << width;

  const ValueContrast alike(opaque(), attribute(0, 64));
  EXPECT_EQ(alike.of(summary).variance(1), 0);
  EXPECT_EQ(contrast.of({}).variance(1), 0);
  EXPECT_EQ(ValueContrast(function, attribute(7, 7)).of({7, 7, 1}).variance(1), 0);
}

// --- An opacity by another attribute.
TransferFunction factor_window(double low, double high) {
  TransferFunction factors = window(low, high);
  factors.colors = {{0, dvec3(1)}};
  return factors;
}

TEST(ValueVisibility, AnOpacityHidesToo) {
  const format::Attribute shown = attribute(0, 64), other = attribute(-10, 10);
  const TransferFunction function = opaque(), factors = factor_window(2, 3);
  const ValueVisibility visibility({function, &factors}, {shown, &other});
  const format::ValueSummary values{0, 64, ~std::uint64_t{0}};
  const auto shows = [&](float low, float high) {
    const format::ValueSummary opacity{low, high, ~std::uint64_t{0}};
    return visibility.shows({values, &opacity});
  };
  EXPECT_TRUE(shows(-10, 10));
  EXPECT_TRUE(shows(2.9F, 10));
  EXPECT_FALSE(shows(3.1F, 10));
  EXPECT_FALSE(shows(-10, 1.9F));
  EXPECT_TRUE(visibility.shows({values})) << "without values, the factor counts as 1";
  const format::ValueSummary none;
  EXPECT_FALSE(visibility.shows({values, &none}));
  EXPECT_FALSE(visibility.shows({none, &values}));

  // Slices show values of any factor.
  const ValueVisibility sliced({function, &factors}, {shown, &other}, 1, true);
  const format::ValueSummary hidden{5, 6, ~std::uint64_t{0}};
  EXPECT_FALSE(sliced.shows({values, &hidden}));
  EXPECT_TRUE(sliced.shows_row({values, &hidden}));
}

TEST(ValueVisibility, ExtinctionsAreMultipliedByFactors) {
  const format::Attribute shown = attribute(0, 1), other = attribute(0, 1);
  TransferFunction function = opaque(), factors = opaque();
  function.densities = {{0, 2}, {1, 6}};
  factors.densities = {{0, 0.25}, {1, 0.75}};
  const ValueVisibility visibility({function, &factors}, {shown, &other});
  const format::ValueSummary values{0.25F, 0.5F, 1}, opacity{0.5F, 1, 1};
  const auto [least, most] = visibility.extinctions({values, &opacity});
  EXPECT_NEAR(least, 3 * 0.5, 1e-6);
  EXPECT_NEAR(most, 4 * 0.75, 1e-6);
}

// Of independent values, the mean and the variance of products are known.
TEST(ValueVisibility, ContrastIsThatOfTheProduct) {
  const format::Attribute shown = attribute(0, 64), other = attribute(0, 64);
  TransferFunction function = opaque(), factors = opaque();
  function.lo = factors.lo = 0;
  function.hi = factors.hi = 64;
  function.densities = {{0, 1}, {1, 3}};
  factors.densities = {{0, 0}, {1, 1}};
  const ValueVisibility visibility({function, &factors}, {shown, &other});
  const format::ValueSummary all{0, 64, ~std::uint64_t{0}};
  const ShownContrast plain = visibility.contrast({all}), product = visibility.contrast({all, &all});
  EXPECT_NEAR(product.extinction(), plain.extinction() * 0.5, 0.01);
  EXPECT_NEAR(product.squares(), plain.squares() / 3, 0.01 * plain.squares());
  for (const double share : {0.01, 0.1, 0.5}) {
    const double of_factors = product.opacity->variance(share) * 2;
    EXPECT_NEAR(product.variance(share), plain.variance(share) / 3 + plain.squares() * of_factors,
                0.01 * product.variance(share));
    EXPECT_NEAR(of_factors, share * share / 12, 0.25 * share * share / 12 + 1e-6) << share;
  }
}

TEST(ValueVisibility, EqualityIsThatOfFactorsToo) {
  const format::Attribute a = attribute(0, 1);
  const TransferFunction function = opaque(), some = factor_window(0.2, 0.4), others = factor_window(0.2, 0.5);
  const ValueVisibility with({function, &some}, {a, &a});
  EXPECT_EQ(with, ValueVisibility({function, &some}, {a, &a}));
  EXPECT_NE(with, ValueVisibility({function, &others}, {a, &a}));
  EXPECT_NE(with, ValueVisibility(function, a));
  EXPECT_EQ(ValueVisibility({function, &some}, a), ValueVisibility(function, a));
}

}  // namespace
}  // namespace splatvol::test
