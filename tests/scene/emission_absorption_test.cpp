#include "scene/emission_absorption.h"

#include <gtest/gtest.h>

#include <cmath>
#include <tuple>

namespace splatvol {
namespace {

TransferFunction bent_function() {
  return {.lo = -2,
          .hi = 3,
          .colors = {{0, {0.1, 0, 1}}, {0.3, {1, 0.2, 0}}, {0.3, {0, 3, 0.5}}, {0.9, {0.4, 0, 0}}},
          .densities = {{0.1, 0}, {0.4, 2}, {0.6, 0}, {0.8, 0}, {0.8, 5}, {1, 1}}};
}

/// Returns the same integral by a million midpoint samples.
dvec3 by_brute_force(const TransferFunction& function, double front, double back, double length, double& depth) {
  constexpr int samples = 1000000;
  dvec3 color(0);
  depth = 0;
  for (int i = 0; i < samples; ++i) {
    const double value = front + (back - front) * (i + 0.5) / samples;
    const double t = function.extinction(value) * length / samples;
    color += std::exp(-depth) * -std::expm1(-t) * function.color(value);
    depth += t;
  }
  return color;
}

struct Stretch {
  double front, back, length;
};

void expect_brute_force(const TransferFunction& function, const Stretch& stretch, double tolerance) {
  const auto& [front, back, length] = stretch;
  SCOPED_TRACE(testing::Message() << front << " to " << back << ", length " << length);
  RayLight light;
  PiecewiseTransfer(function).add({front, back}, length, light);
  double depth = 0;
  const dvec3 color = by_brute_force(function, front, back, length, depth);
  EXPECT_NEAR(light.depth, depth, tolerance * depth);
  for (int channel = 0; channel < 3; ++channel) EXPECT_NEAR(light.color[channel], color[channel], tolerance) << channel;
  EXPECT_NEAR(light.transmittance, std::exp(-depth), 0.1 * tolerance);
}

TEST(EmissionAbsorption, MatchesBruteForce) {
  for (const Stretch& stretch : {Stretch{-2, 3, 1},
                                 {3, -2, 1},
                                 {-5, 9, 0.1},
                                 {9, -5, 3},
                                 {-0.5, 0.1, 7},
                                 {2, 1.9999, 2},
                                 {-2, 3, 60},
                                 {3, -2, 400}})
    expect_brute_force(bent_function(), stretch, 1e-5);
}

TEST(EmissionAbsorption, BentAxesMatchBruteForce) {
  for (const ValueAxis axis : {ValueAxis::log, ValueAxis::asinh}) {
    TransferFunction function = bent_function();
    function.axis = axis;
    function.lo = axis == ValueAxis::log ? 1e-3 : -300;
    function.hi = 1e3;
    function.linear_width = 0.1;
    SCOPED_TRACE(static_cast<int>(axis));
    for (const Stretch& stretch :
         {Stretch{-2, 3, 1}, {1e-3, 1e-2, 3}, {900, -900, 1}, {0, 0.5, 2}, {20, 21, 4}, {1e-3, 1500, 9}})
      expect_brute_force(function, stretch, 3e-5);
  }
}

TEST(EmissionAbsorption, DoesNotDependOnHowARayIsCut) {
  const PiecewiseTransfer transfer(bent_function());
  RayLight whole;
  transfer.add({-3, 4}, 2, whole);
  RayLight parts;
  for (int part = 0; part < 70; ++part) transfer.add({-3 + 0.1 * part, -3 + 0.1 * (part + 1)}, 2.0 / 70, parts);
  EXPECT_NEAR(whole.depth, parts.depth, 1e-12);
  EXPECT_NEAR(glm::length(whole.color - parts.color), 0, 1e-6);
}

TEST(EmissionAbsorption, ConstantValuesAreExact) {
  const TransferFunction function = bent_function();
  const PiecewiseTransfer transfer(function);
  for (const double value : {-9.0, -2.0, -1.0, -0.5, 0.3, 1.2, 2.0, 2.7, 3.0, 1e300}) {
    RayLight light;
    transfer.add({value, value}, 0.7, light);
    EXPECT_NEAR(light.depth, 0.7 * function.extinction(value), 1e-14) << value;
    EXPECT_NEAR(light.color.g, -std::expm1(-light.depth) * function.color(value).g, 1e-14) << value;
  }
}

/// Thin and thick integration steps have different formulas. At the limit between them the results must agree.
TEST(EmissionAbsorption, LinearColorInConstantExtinctionIsExactAtEveryDepth) {
  TransferFunction function{.colors = {{0, dvec3(0)}, {1, dvec3(1)}}, .densities = {{0, 1}}};
  const PiecewiseTransfer transfer(function);
  for (double depth = 1e-9; depth < 1e4; depth *= 1.3) {
    RayLight light;
    transfer.add({0, 1}, depth, light);
    const double expected = -std::expm1(-depth) / depth - std::exp(-depth);
    EXPECT_NEAR(light.color.r, expected, 1e-11 * expected + 2e-16 / depth) << depth;
    EXPECT_NEAR(light.rgba().a, -std::expm1(-depth), 1e-7 * -std::expm1(-depth)) << depth;
  }
}

/// Alpha of thin media comes from the depth, not from 1 - T.
TEST(EmissionAbsorption, TinyAlphaKeepsItsDigits) {
  TransferFunction function{.colors = {{0, dvec3(1)}}, .densities = {{0, 1e-20}}};
  RayLight light;
  PiecewiseTransfer(function).add({0.2, 0.8}, 1, light);
  EXPECT_NEAR(light.rgba().a, 1e-20, 1e-26);
}

// --- Factors on the extinction.
TEST(EmissionAbsorption, FactorsMatchBruteForce) {
  const TransferFunction function = bent_function();
  const PiecewiseTransfer transfer(function);
  TransferFunction factors{.lo = 1,
                           .hi = 100,
                           .colors = {{0, dvec3(1)}},
                           .densities = {{0, 0}, {0.2, 0.5}, {0.2, 1}, {0.7, 0.1}, {0.8, 0}, {1, 0.4}}};
  for (const ValueAxis axis : {ValueAxis::linear, ValueAxis::log}) {
    factors.axis = axis;
    const PiecewiseTransfer opacity(factors);
    for (const auto& [values, opacity_values, length] : {std::tuple{Ends{-2, 3}, Ends{-20, 130}, 1.0},
                                                         {Ends{3, -2}, Ends{0, 100}, 1.0},
                                                         {Ends{-5, 9}, Ends{90, 2}, 3.0},
                                                         {Ends{0.5, 0.5}, Ends{120, -50}, 2.0},
                                                         {Ends{-2, 3}, Ends{30, 30}, 4.0},
                                                         {Ends{-2, 3}, Ends{1, 100}, 60.0}}) {
      SCOPED_TRACE(testing::Message() << values.front << " to " << values.back << ", " << opacity_values.front << " to "
                                      << opacity_values.back << ", length " << length);
      RayLight light;
      transfer.add(values, opacity, opacity_values, length, light);
      constexpr int samples = 1000000;
      dvec3 color(0);
      double depth = 0;
      for (int i = 0; i < samples; ++i) {
        const double share = (i + 0.5) / samples, value = values.at(share);
        const double t = function.extinction(value) * factors.extinction(opacity_values.at(share)) * length / samples;
        color += std::exp(-depth) * -std::expm1(-t) * function.color(value);
        depth += t;
      }
      EXPECT_NEAR(light.depth, depth, 5e-5 * depth);
      for (int channel = 0; channel < 3; ++channel) EXPECT_NEAR(light.color[channel], color[channel], 3e-5) << channel;
    }
  }
}

}  // namespace
}  // namespace splatvol
