#include "splat/ellipsoid.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>

#include "splat/kernel.h"

namespace splatvol {
namespace {

/// A shape with axes of any direction, deviations from 1e-3 to 10, and often a boundary; with or without widening.
struct Sample {
  explicit Sample(int seed) : random(static_cast<std::uint32_t>(seed)) {
    shape.mass = std::exp2(number(-20, 20));
    for (int k = 0; k < 3; ++k) shape.deviations[k] = std::pow(10, number(-3, 1));
    std::ranges::sort(&shape.deviations.x, &shape.deviations.x + 3, std::greater());
    shape.orientation = glm::normalize(glm::dquat(number(-1, 1), number(-1, 1), number(-1, 1), number(-1, 1)));
    if (seed % 3 != 0) shape.boundary = vector(2);
    centroid = vector(5);
    variance = seed % 2 == 0 ? 0 : std::pow(10, number(-6, 1));
    ellipsoid = ellipsoid_of(centroid, shape, variance);
    from = from_ball(shape, variance);
  }

  double number(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random); }
  dvec3 vector(double most) { return {number(-most, most), number(-most, most), number(-most, most)}; }

  std::mt19937 random;
  SplatShape shape;
  dvec3 centroid{0};
  double variance = 0;
  Ellipsoid ellipsoid;
  dmat3 from{0};
};

template <class Check>
void for_samples(const Check& check) {
  for (int seed = 0; seed < 50; ++seed) {
    SCOPED_TRACE(seed);
    Sample sample(seed);
    check(sample);
  }
}

// Shells of the ball: the integral of 4 pi r^2 (1 - r^2)^(3/2) is pi^2 / 8.
TEST(Ellipsoid, HoldsTheMass) {
  for_samples([](Sample& s) {
    const double volume = std::abs(glm::determinant(s.from));
    const double whole = s.ellipsoid.peak * volume * std::numbers::pi * std::numbers::pi / 8;
    EXPECT_NEAR(whole, (s.ellipsoid.has_boundary() ? 2 : 1) * s.shape.mass, 1e-9 * s.shape.mass);
  });
}

TEST(Ellipsoid, HasMapsThatAreInverse) {
  for_samples([](Sample& s) {
    const dmat3 product = s.ellipsoid.to_ball * s.from;
    for (int k = 0; k < 3; ++k)
      for (int j = 0; j < 3; ++j) EXPECT_NEAR(product[k][j], k == j ? 1 : 0, 1e-9);
  });
}

// The boundary plane goes through the foot, across it in units of the deviations. Widening does not move it.
TEST(Ellipsoid, EndsAtTheBoundary) {
  for_samples([](Sample& s) {
    if (!s.ellipsoid.has_boundary()) return;
    const dmat3 axes = glm::mat3_cast(s.shape.orientation);
    const double square = glm::dot(s.shape.boundary, s.shape.boundary);
    for (int i = 0; i < 20; ++i) {
      dvec3 x = s.vector(2);  // in deviations
      x += (1 - glm::dot(x, s.shape.boundary) / square) * s.shape.boundary;
      const dvec3 u = s.ellipsoid.in_ball(s.centroid + axes * (s.shape.deviations * x));
      EXPECT_NEAR(glm::dot(s.ellipsoid.outward, u), 0, 1e-9 * (1 + glm::length(u)));
    }
    EXPECT_FALSE(s.ellipsoid.is_cut_off(s.ellipsoid.in_ball(s.centroid)));
  });
}

TEST(Ellipsoid, LiesInItsBox) {
  for_samples([](Sample& s) {
    dvec3 farthest(0);
    for (int i = 0; i < 1000; ++i) farthest = glm::max(farthest, glm::abs(s.from * glm::normalize(s.vector(1))));
    for (int k = 0; k < 3; ++k) {
      EXPECT_LE(farthest[k], s.ellipsoid.reach[k] * (1 + 1e-12));
      EXPECT_GE(farthest[k], 0.8 * s.ellipsoid.reach[k]);
    }
  });
}

TEST(Ellipsoid, HasChordsWithItsDensity) {
  for_samples([](Sample& s) {
    for (int i = 0; i < 20; ++i) {
      const dvec3 u = s.vector(0.6);
      const dvec3 direction = glm::normalize(s.vector(1)), origin = s.ellipsoid.center + s.from * u - 3.0 * direction;
      const auto chord = chord_of(s.ellipsoid, origin, direction);
      if (!chord) {
        EXPECT_TRUE(s.ellipsoid.is_cut_off(u));
        continue;
      }
      const auto at = [&](double distance) { return s.ellipsoid.in_ball(origin + distance * direction); };
      const double middle = 0.5 * (chord->begin + chord->end);
      EXPECT_NEAR(chord->density(middle), s.ellipsoid.density(at(middle)), 1e-6 * s.ellipsoid.peak);
      EXPECT_FALSE(s.ellipsoid.is_cut_off(at(middle)));
      for (const double outside : {chord->begin - 0.01 * chord->half, chord->end + 0.01 * chord->half})
        EXPECT_TRUE(s.ellipsoid.density(at(outside)) == 0 || s.ellipsoid.is_cut_off(at(outside)));
    }
  });
}

TEST(Ellipsoid, DrawsNothingWithoutMassOrExtent) {
  SplatShape flat{.mass = 1, .deviations = dvec3(1, 1, 0)};
  EXPECT_EQ(ellipsoid_of(dvec3(0), flat).peak, 0);
  EXPECT_GT(ellipsoid_of(dvec3(0), flat, 0.01).peak, 0) << "pixels widen it";
  EXPECT_GT(ellipsoid_of(dvec3(0), with_thickness(flat)).peak, 0);
  flat.mass = 0;
  EXPECT_EQ(ellipsoid_of(dvec3(0), with_thickness(flat)).peak, 0);
  EXPECT_EQ(ellipsoid_of(dvec3(0), with_thickness({.mass = 1})).peak, 0) << "a point";
}

TEST(LinearField, FlattensAsTheMaterialWidens) {
  SplatShape shape{.mass = 1, .deviations = dvec3(3, 2, 1)};
  shape.orientation = glm::angleAxis(0.5, glm::normalize(dvec3(1, 2, 3)));
  const SplatValue value{.mean = 7, .deviation = 2, .correlation = dvec3(0.6, -0.4, 0.2), .coverage = 1};
  const dmat3 axes = glm::mat3_cast(shape.orientation);
  for (const double variance : {0.0, 0.5, 1e9}) {
    const LinearField field = field_of(dvec3(1, 1, 1), shape, value, variance);
    double left = value.deviation * value.deviation;
    for (int k = 0; k < 3; ++k) {
      const double d = shape.deviations[k], covariance = value.deviation * value.correlation[k] * d;
      EXPECT_NEAR(glm::dot(field.slope, axes[k]), covariance / (d * d + variance), 1e-12);
      const double kept = d * d / (d * d + variance);
      left -= std::pow(value.deviation * value.correlation[k], 2) * kept;
    }
    EXPECT_NEAR(field.deviation, std::sqrt(left), 1e-12);
    EXPECT_EQ(field.at(dvec3(1, 1, 1)), 7);
  }
}

TEST(DensitySums, TellWhereMaterialIs) {
  const auto sums = [](double inner, double bounded, double cut_off) {
    DensitySums result;
    result.add(inner, false, false);
    result.add(bounded, true, false);
    result.add(cut_off, true, true);
    return result;
  };
  EXPECT_FALSE(sums(0, 0, 0).is_material());
  EXPECT_FALSE(sums(0.29, 0, 0).is_material());
  EXPECT_TRUE(sums(0.31, 0, 0).is_material()) << "ripple leaves no holes";
  EXPECT_TRUE(sums(0.06, 0, 0).is_material(0.05));
  EXPECT_FALSE(sums(0, 0.45, 0).is_material()) << "near the edge it must be more";
  EXPECT_TRUE(sums(0, 0.55, 0).is_material());
  EXPECT_FALSE(sums(0, 0.25, 0.75).is_material()) << "cut off";
  EXPECT_TRUE(sums(0, 0.35, 0.65).is_material());
  EXPECT_TRUE(sums(0, 0.28, 0.25).is_material()) << "half is left";
}

}  // namespace
}  // namespace splatvol
