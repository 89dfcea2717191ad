// Shares of an estimate node's volume by a k-d tree over its points.
#include "builder/scattered/box_estimate.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <tbb/parallel_for.h>

#include <cmath>
#include <limits>

#include "tests/builder/support/point_sets.h"

namespace splatvol::test {
namespace {

using Points = std::vector<dvec3>;

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

// The centres of n^3 cells that fill a box from the origin on.
Points lattice(int n, dvec3 spacing) { return lattice_points(glm::ivec3(n), spacing, 0.5 * spacing); }

double linear(const dvec3& p) { return 3 + 2 * p.x - p.y + 0.5 * p.z; }
const dvec3 slope(2, -1, 0.5);

struct Material {
  std::vector<SpatialMoments> moments;                   // [point]
  std::vector<std::vector<ValueMoments>> value_moments;  // [attribute][point]
  std::vector<std::vector<dvec3>> gradients;             // [attribute][point]
};

Material estimate(BoxEstimate& estimate, const Points& points, const Box& bounds, const std::vector<double>& values) {
  const std::size_t n = points.size();
  Material material{std::vector<SpatialMoments>(n), {std::vector<ValueMoments>(n)}, {std::vector<dvec3>(n)}};
  const std::span<const double> attribute = values;
  estimate.estimate(points, {&attribute, 1}, bounds,
                    {material.moments, {material.value_moments[0]}, {material.gradients[0]}});
  return material;
}

Material estimate(const Points& points, const Box& bounds, const std::vector<double>& values) {
  BoxEstimate fresh;
  return estimate(fresh, points, bounds, values);
}

Material estimate(const Points& points, const Box& bounds) {
  std::vector<double> values;
  for (const dvec3& p : points) values.push_back(linear(p));
  return estimate(points, bounds, values);
}

TEST(BoxEstimate, MassesAddUpToTheNode) {
  // All cells are full: no side is three times as long as the usual one.
  for (const int n : {1, 2, 3, 5, 7, 12, 16}) {
    const Points points = lattice(n, dvec3(1.0 / n));
    EXPECT_NEAR(total_mass(estimate(points, {dvec3(0), dvec3(1)}).moments), 1, 1e-12) << n;
  }
}

TEST(BoxEstimate, RandomPointsLoseLittle) {
  for (const int count : {64, 500, 4096}) {
    double sum = 0;
    for (unsigned seed = 1; seed <= 8; ++seed)
      sum += total_mass(estimate(uniform_points(count, seed), {dvec3(0), dvec3(1)}).moments) / 8;
    // Measured: under 0.1 % with thousands of points. With 64, each box borders on the node's border.
    EXPECT_GE(sum, count > 64 ? 0.995 : 0.98) << count;
    EXPECT_LE(sum, 1 + 1e-12) << count;
  }
}

TEST(BoxEstimate, CellsOfALatticeAreItsBoxesWhateverItsAspectRatio) {
  for (const int n : {4, 5, 11})
    for (const double thin : {1.0, 1e-4, 1e-8}) {
      const dvec3 spacing(1, 0.5, thin);
      const Points points = lattice(n, spacing);
      const Material material = estimate(points, {dvec3(0), static_cast<double>(n) * spacing});
      for (std::size_t i = 0; i < points.size(); ++i) {
        // Coordinates up to 11 are rounded to 1e-15 of them.
        ASSERT_NEAR(material.moments[i].mass / (0.5 * thin), 1, 1e-12);
        ASSERT_NEAR(material.moments[i].covariance.zz / (thin * thin / 12), 1, 1e-12);
        ASSERT_NEAR(material.moments[i].covariance.xx * 12, 1, 1e-12);
        ASSERT_NEAR(glm::length(material.moments[i].centroid / spacing), 0, 1e-12);
      }
    }
}

TEST(BoxEstimate, ALinearFieldKeepsItsGradient) {
  for (const Points& points : {uniform_points(3000), lattice(9, {1, 0.5, 1e-4})}) {
    dvec3 high(0);
    for (const dvec3& p : points) high = glm::max(high, p);
    const Material material = estimate(points, {dvec3(0), high});
    for (std::size_t i = 0; i < points.size(); ++i) {
      // Values near 20 are rounded to 2e-15, over a spacing of 1e-4; the term that keeps the matrix regular is 1e-12.
      ASSERT_LT(glm::length(material.gradients[0][i] - slope), 1e-6) << i;
      const SpatialMoments& own = material.moments[i];
      const ValueMoments& value = material.value_moments[0][i];
      const double variance =
          4 * own.covariance.xx + own.covariance.yy + 0.25 * own.covariance.zz;  // of slope . x in a box
      ASSERT_NEAR(value.variance / variance, 1, 1e-6);
      ASSERT_NEAR(value.covariance.x, 2 * own.covariance.xx, 1e-6 * own.covariance.xx);
      ASSERT_EQ(value.mass, own.mass);
      ASSERT_LE(value.min, value.mean);
      ASSERT_GE(value.max, value.mean);
    }
  }
}

TEST(BoxEstimate, DoesNotDependOnPositionOrScale) {
  const Points points = uniform_points(2000);
  const Material here = estimate(points, {dvec3(0), dvec3(1)});
  struct Change {
    double scale;
    dvec3 shift;
    double tolerance;
  };
  // Coordinates of 1e7 are rounded to 1e-9. That is 1e-7 of a width of 0.01, and more of the thinnest widths.
  for (const Change& change : {Change{1, dvec3(1e7, -1e7, 1e7), 1e-4}, Change{0x1p-20, dvec3(0), 1e-12},
                               Change{0x1p20, dvec3(0), 1e-12}, Change{1e-6, dvec3(0), 1e-9}}) {
    Points moved;
    for (const dvec3& p : points) moved.push_back(change.shift + change.scale * p);
    const Material there = estimate(moved, {change.shift, change.shift + change.scale});
    const double volume = std::pow(change.scale, 3);
    for (std::size_t i = 0; i < points.size(); ++i)
      ASSERT_NEAR(there.moments[i].mass / volume / here.moments[i].mass, 1, change.tolerance) << change.scale;
  }
}

TEST(BoxEstimate, PointsWithoutAVolumeGetTheThicknessOfTheirSpacing) {
  const Box bounds{dvec3(-10), dvec3(10)};
  // A unit square of spacing 0.05. Its material reaches up to half a spacing beyond, and is thinner than 4 spacings.
  Points plane, tilted;
  for (int i = 0; i <= 20; ++i)
    for (int j = 0; j <= 20; ++j) {
      plane.emplace_back(0.05 * i, 7, 0.05 * j);
      tilted.push_back(0.05 * i * glm::normalize(dvec3(1, 2, 3)) + 0.05 * j * glm::normalize(dvec3(3, 0, -1)));
    }
  for (const Points& points : {plane, tilted}) {
    const double mass = total_mass(estimate(points, bounds).moments);
    EXPECT_GT(mass, 0.02);
    EXPECT_LT(mass, 1.1 * 1.1 * 0.2);
  }
  // Points at one position have the whole node, once.
  EXPECT_DOUBLE_EQ(total_mass(estimate({dvec3(5)}, bounds).moments), 8000);
  const Material coincident = estimate(Points(500, dvec3(1, 2, 3)), bounds);
  EXPECT_DOUBLE_EQ(coincident.moments[0].mass, 8000);
  EXPECT_DOUBLE_EQ(total_mass(coincident.moments), 8000);
  EXPECT_TRUE(estimate({}, bounds).moments.empty());
}

TEST(BoxEstimate, LeavesVoidsEmpty) {
  // Half a lattice; and a lattice with a hole of 6^3 of its 16^3 cells, of which half a cell on each side remains
  // filled.
  Points half, holed;
  for (const dvec3& p : lattice(16, dvec3(1))) {
    if (p.x < 8) half.push_back(p);
    if (glm::any(glm::lessThan(p, dvec3(5))) || glm::any(glm::greaterThan(p, dvec3(11)))) holed.push_back(p);
  }
  const Box bounds{dvec3(0), dvec3(16)};
  EXPECT_NEAR(total_mass(estimate(half, bounds).moments), 2048, 1e-9);
  EXPECT_LT(total_mass(estimate(holed, bounds).moments), 4096 - 0.5 * 216);
  EXPECT_GE(total_mass(estimate(holed, bounds).moments), 4096 - 216);
}

TEST(BoxEstimate, CoincidentPointsShareNothing) {
  Points points = lattice(5, dvec3(1));
  const std::size_t distinct = points.size();
  points.insert(points.end(), points.begin(), points.begin() + 40);
  const Material material = estimate(points, {dvec3(0), dvec3(5)});
  for (std::size_t i = 0; i < points.size(); ++i) {
    ASSERT_NEAR(material.moments[i].mass, i < distinct ? 1 : 0, 1e-12);
    ASSERT_EQ(material.value_moments[0][i].mass, material.moments[i].mass);
  }
}

TEST(BoxEstimate, SurvivesHardDistributions) {
  Points crowded = uniform_points(1000), column, graded;
  for (int i = 0; i < 1000; ++i) crowded.push_back(dvec3(0.5) + 1e-3 * crowded[static_cast<std::size_t>(i)]);
  for (int i = 0; i < 500; ++i) column.push_back({0.5, 0.5, i / 500.0}), column.push_back({i / 500.0, 0.5, 0.5});
  for (int i = 0; i < 600; ++i)
    graded.push_back(std::pow(0.9, i) * uniform_points(1, static_cast<unsigned>(i)).front());
  for (const Points& points : {crowded, column, graded}) {
    const Material material = estimate(points, {dvec3(0), dvec3(1)});
    EXPECT_GT(total_mass(material.moments), 0);
    EXPECT_LE(total_mass(material.moments), 1 + 1e-12);
    for (std::size_t i = 0; i < points.size(); ++i) {
      const ValueMoments& value = material.value_moments[0][i];
      ASSERT_TRUE(std::isfinite(material.moments[i].mass) && material.moments[i].mass >= 0);
      ASSERT_TRUE(std::isfinite(value.mean) && std::isfinite(value.variance));
    }
  }
}

TEST(BoxEstimate, MissingValuesHaveNoMassAndDoNotSpread) {
  const Points points = lattice(6, dvec3(1));
  std::vector<double> values;
  for (const dvec3& p : points) values.push_back(linear(p));
  for (std::size_t i = 0; i < points.size(); i += 7) values[i] = nan;
  const Material material = estimate(points, {dvec3(0), dvec3(6)}, values);
  for (std::size_t i = 0; i < points.size(); ++i) {
    ASSERT_NEAR(material.moments[i].mass, 1, 1e-12);
    ASSERT_EQ(material.value_moments[0][i].mass, i % 7 == 0 ? 0 : material.moments[i].mass);
    if (i % 7 == 0) continue;
    ASSERT_NEAR(material.value_moments[0][i].mean, linear(points[i]), 1e-9);
    ASSERT_LT(glm::length(material.gradients[0][i] - slope), 1e-6);
  }
  const Material nothing = estimate(points, {dvec3(0), dvec3(6)}, std::vector<double>(points.size(), nan));
  for (const ValueMoments& value : nothing.value_moments[0]) ASSERT_EQ(value.mass, 0);
}

TEST(BoxEstimate, DoesNotDependOnThreadsOrOnWhatCameBefore) {
  const auto all_nodes = [] {
    std::vector<Material> materials(32);
    tbb::parallel_for(std::size_t{0}, materials.size(), [&](std::size_t b) {
      thread_local BoxEstimate kept;
      const Points points = uniform_points(100 + 50 * static_cast<int>(b), static_cast<unsigned>(b));
      std::vector<double> values;
      for (const dvec3& p : points) values.push_back(linear(p));
      materials[b] = estimate(kept, points, {dvec3(0), dvec3(1)}, values);
    });
    return materials;
  };
  const auto many = all_nodes();
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const auto single = all_nodes();
  for (std::size_t b = 0; b < many.size(); ++b)
    for (std::size_t i = 0; i < many[b].moments.size(); ++i) {
      ASSERT_EQ(many[b].moments[i].mass, single[b].moments[i].mass);
      ASSERT_EQ(many[b].value_moments[0][i].variance, single[b].value_moments[0][i].variance);
    }
}

}  // namespace
}  // namespace splatvol::test
