#include "builder/output/density.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <random>

#include "builder/mesh/moments.h"
#include "splat/kernel.h"

namespace splatvol {
namespace {

FittedSplat box(const dvec3& center, const dvec3& size) {
  return {.centroid = center, .shape = {.mass = size.x * size.y * size.z, .deviations = size / std::sqrt(12.0)}};
}

// n^3 cubes of edge 1. Small and large splats take turns, as at the corners of hexahedra that are split into five
// tetrahedra. A small and a large one together have the mass of two cubes.
std::vector<FittedSplat> checkerboard(int n, double small) {
  std::vector<FittedSplat> splats;
  for (int z = 0; z < n; ++z)
    for (int y = 0; y < n; ++y)
      for (int x = 0; x < n; ++x)
        splats.push_back(box(dvec3(x, y, z), dvec3(std::cbrt((x + y + z) % 2 == 0 ? small : 2 - small))));
  return splats;
}

double density_at(const std::vector<FittedSplat>& splats, const dvec3& position) {
  double density = 0;
  for (const FittedSplat& s : splats) {
    const dvec3 half = moments_half_width * s.shape.deviations;
    const dvec3 p = (position - s.centroid) / half;
    const double rest = 1 - glm::dot(p, p);
    if (rest > 0)
      density += s.shape.density * s.shape.mass * moments_peak / (half.x * half.y * half.z) * rest * std::sqrt(rest);
  }
  return density;
}

// Root mean square of density - 1 over the middle of n^3 cubes.
double ripple(const std::vector<FittedSplat>& splats, int n) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> coordinate(n / 2.0 - 1.5, n / 2.0 + 0.5);  // two periods
  double sum = 0;
  constexpr int count = 4000;
  for (int i = 0; i < count; ++i)
    sum += std::pow(density_at(splats, {coordinate(random), coordinate(random), coordinate(random)}) - 1, 2);
  return std::sqrt(sum / count);
}

double mass(const std::vector<FittedSplat>& splats) {
  double sum = 0;
  for (const FittedSplat& s : splats) sum += s.shape.mass * s.shape.density;
  return sum;
}

TEST(Density, TakesMostOfACheckerboardsRippleAway) {
  std::vector<FittedSplat> splats = checkerboard(10, 1.0 / 3);
  const double before = ripple(splats, 10);
  fit_densities(splats);
  EXPECT_GT(before, 0.15) << "or there is nothing to take away";
  EXPECT_LT(ripple(splats, 10), 0.5 * before);
}

TEST(Density, EqualCubesKeepTheirs) {
  std::vector<FittedSplat> splats = checkerboard(9, 1);
  fit_densities(splats);
  // The splat in the middle does not see the surface.
  EXPECT_NEAR(splats[splats.size() / 2].shape.density, 1, 0.03);
}

TEST(Density, KeepsTheMass) {
  for (const double small : {1.0, 0.5, 1.0 / 3, 0.1}) {
    std::vector<FittedSplat> splats = checkerboard(12, small);
    fit_densities(splats);
    EXPECT_NEAR(mass(splats) / (12 * 12 * 12), 1, 0.04)
        << small;  // the fit keeps the mass of neighbourhoods, and so roughly that of all
  }
}

TEST(Density, AHalfCellAtABoundaryIsAsDenseAsTheRest) {
  // Cubes whose first layer has only half cubes, which end at the plane x = 0.
  std::vector<FittedSplat> splats;
  for (int z = 0; z < 9; ++z)
    for (int y = 0; y < 9; ++y)
      for (int x = 0; x < 9; ++x) {
        splats.push_back(box({x == 0 ? 0.25 : x, y, z}, {x == 0 ? 0.5 : 1, 1, 1}));
        if (x > 0) continue;
        // Principal axes in descending order: x, the shortest, comes last.
        SplatShape& shape = splats.back().shape;
        shape.deviations = dvec3(1, 1, 0.5) / std::sqrt(12.0);
        shape.orientation = glm::dquat(std::sqrt(0.5), 0, std::sqrt(0.5), 0);
        const double toward_outside = (glm::mat3_cast(shape.orientation) * dvec3(0, 0, 1)).x > 0 ? -1 : 1;
        shape.boundary = dvec3(0, 0, toward_outside * std::sqrt(3.0));
      }
  fit_densities(splats);
  const auto at = [&](int x) { return splats[static_cast<std::size_t>((4 * 9 + 4) * 9 + x)].shape.density; };
  EXPECT_NEAR(at(0), at(4), 0.05);
  EXPECT_NEAR(at(4), 1, 0.05);
}

// Thousands of cells round one vertex all see each other. Those are left as they are; the rest is fitted as without
// them.
TEST(Density, ACrowdIsLeftAsItIs) {
  std::vector<FittedSplat> splats = checkerboard(10, 1.0 / 3);
  const std::size_t rest = splats.size();
  std::vector<FittedSplat> alone = splats;
  fit_densities(alone);
  for (int i = 0; i < 3000; ++i) splats.push_back(box({100 + 1e-5 * i, 100, 100}, dvec3(1)));
  fit_densities(splats);
  for (std::size_t i = 0; i < rest; ++i) EXPECT_EQ(splats[i].shape.density, alone[i].shape.density);
  for (std::size_t i = rest; i < splats.size(); ++i) EXPECT_EQ(splats[i].shape.density, 1);
}

TEST(Density, HardCases) {
  std::vector<FittedSplat> none;
  fit_densities(none);

  for (const double scale : {1e-30, 1e-6, 1.0, 1e6, 1e30})
    for (const double shift : {0.0, 1e7}) {
      std::vector<FittedSplat> splats;
      for (int i = 0; i < 40; ++i)
        splats.push_back(box(scale * (dvec3(i % 4, i / 4 % 4, i / 16) + shift), dvec3(scale)));
      splats[0].shape.mass = 0;                                   // no material
      splats[1].shape.deviations = scale * dvec3(1, 1e-4, 1e-8);  // nearly flat
      splats[2].shape.deviations = scale * dvec3(1, 1, 0);        // flat
      splats[3].shape.deviations = dvec3(0);                      // a point
      splats[4].centroid = splats[5].centroid;                    // at one position
      splats[6].shape.mass *= 1e9;
      splats[7].shape.deviations *= 1e3;  // nine decades of volume
      fit_densities(splats);
      for (const FittedSplat& s : splats) {
        ASSERT_TRUE(std::isfinite(s.shape.density));
        ASSERT_GT(s.shape.density, 0);
      }
      EXPECT_EQ(splats[0].shape.density, 1);
      EXPECT_EQ(splats[3].shape.density, 1);
    }
}

TEST(Density, DoesNotDependOnThreads) {
  const auto fit = [](int threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(threads));
    std::vector<FittedSplat> splats = checkerboard(14, 0.4);
    fit_densities(splats);
    return splats;
  };
  const auto one = fit(1), three = fit(3);
  for (std::size_t i = 0; i < one.size(); ++i) ASSERT_EQ(one[i].shape.density, three[i].shape.density);
}

}  // namespace
}  // namespace splatvol
