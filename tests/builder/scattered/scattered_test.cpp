#include "builder/scattered/scattered.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <stop_token>

#include "base/interruption.h"
#include "builder/scattered/convex_cell.h"
#include "builder/scattered/growing_delaunay.h"
#include "builder/scattered/sampled_cells.h"
#include "tests/builder/support/point_sets.h"
#include "tests/support/results.h"

namespace splatvol::test {
namespace {

using Points = std::vector<dvec3>;

Points lattice(int n, dvec3 spacing, dvec3 origin = dvec3(0)) { return lattice_points(glm::ivec3(n), spacing, origin); }

// Rings of points round a cylinder of radius 1 up to radius 3, with thin layers at the wall.
Points round_cylinder(double first_layer) {
  Points points;
  for (int layer = 0; layer < 24; ++layer) {
    const double radius = layer == 0 ? 1 : 1 + first_layer * std::pow(2 / first_layer, (layer - 1) / 22.0);
    for (int angle = 0; angle < 60; ++angle)
      for (int height = 0; height < 12; ++height) {
        const double turn = angle * std::numbers::pi / 30;
        points.emplace_back(radius * std::cos(turn), radius * std::sin(turn), height * 0.15);
      }
  }
  return points;
}

double polygon_area(int corners, double radius) {
  return corners / 2.0 * radius * radius * std::sin(2 * std::numbers::pi / corners);
}
const double cylinder_volume = (polygon_area(60, 3) - polygon_area(60, 1)) * 11 * 0.15;

double volume(const Points& points, const std::vector<Tetrahedron>& tetrahedra) {
  double sum = 0;
  for (const Tetrahedron& t : tetrahedra) {
    const dvec3& p = points[t[0]];
    sum += std::abs(glm::dot(points[t[1]] - p, glm::cross(points[t[2]] - p, points[t[3]] - p))) / 6;
  }
  return sum;
}

double linear(const dvec3& p) { return 3 + 2 * p.x - p.y + 0.5 * p.z; }

std::vector<double> linear_values(const Points& points) {
  std::vector<double> values;
  for (const dvec3& p : points) values.push_back(linear(p));
  return values;
}

bool inside(const dvec3& p, const dvec3& low, const dvec3& high) {
  return glm::all(glm::greaterThan(p, low)) && glm::all(glm::lessThan(p, high));
}

TEST(ConvexCell, CutsKeepVolumeAndMomentsOfWhatIsLeft) {
  ConvexCell cell;
  cell.reset({-1, -2, -3}, {1, 2, 3});
  EXPECT_DOUBLE_EQ(cell.moments().mass, 48);
  EXPECT_NEAR(cell.moments().covariance.yy, 16.0 / 12, 1e-12);
  EXPECT_FALSE(cell.clip({1, 1, 1}, 6.5, 7));
  // x + y + z > 5 cuts a corner off: a tetrahedron with three edges of length 1.
  EXPECT_TRUE(cell.clip({2, 2, 2}, 10, 7));
  EXPECT_NEAR(cell.moments().mass, 48 - 1.0 / 6, 1e-12);
  EXPECT_NEAR(cell.moments().centroid.x, -0.75 / 6 / (48 - 1.0 / 6), 1e-12);
  EXPECT_EQ(cell.faces().back().label, 7u);
  EXPECT_EQ(cell.loop(cell.faces().back()).size(), 3u);
}

// Distances of 80 decades: cells do not grow without end.
TEST(ConvexCell, StaysSmallWhereSizesAreManyDecadesApart) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> decade(-40, 40), side(-1, 1);
  for (int run = 0; run < 20; ++run) {
    ConvexCell cell;
    cell.reset(dvec3(-1e40), dvec3(1e40));
    for (std::uint32_t cut = 0; cut < 1000; ++cut) {
      const dvec3 d(side(random) * std::pow(10, decade(random)), side(random) * std::pow(10, decade(random)),
                    side(random) * std::pow(10, decade(random)));
      cell.clip(d, squared_length(d) / 2, cut);
    }
    EXPECT_LE(cell.vertices().size(), 8 * 1006u);
    EXPECT_TRUE(std::isfinite(cell.moments().mass) || cell.vertices().empty());
  }
}

TEST(ConvexCell, SurvivesCutsThroughItsOwnVerticesAndIsEmptyAtLast) {
  ConvexCell cell;
  cell.reset(dvec3(-1), dvec3(1));
  cell.clip({1, 1, 0}, 0, 1);
  cell.clip({1, 1, 0}, 0, 2);
  EXPECT_NEAR(cell.moments().mass, 4, 1e-12);
  cell.clip({-1, -1, 0}, -1e-30, 3);
  cell.clip({0, 0, 1}, -5, 4);
  EXPECT_EQ(cell.moments().mass, 0);
  EXPECT_TRUE(cell.vertices().empty());
}

TEST(DelaunayTetrahedra, FillTheHullOfALatticeWhateverItsAspectRatioAndPosition) {
  for (const double thin : {1.0, 1e-2, 1e-4})
    for (const double origin : {0.0, 1e7}) {
      const Points points = lattice(8, {1, 0.5, thin}, dvec3(origin));
      const auto tetrahedra = value_of(delaunay_tetrahedra(points));
      // Positions at 1e7 are rounded to 2e-9: 2e-5 of the thinnest cells, and half of that on average.
      EXPECT_NEAR(volume(points, tetrahedra) / (343 * 0.5 * thin), 1, origin > 0 ? 1e-4 : 1e-9) << thin;
    }
}

TEST(DelaunayTetrahedra, KeepTheInsideOfRandomPoints) {
  const Points points = uniform_points(20'000);
  const auto tetrahedra = value_of(delaunay_tetrahedra(points));
  // Tetrahedra cover the whole inner cube, so those inside have its volume.
  double covered = 0;
  for (const Tetrahedron& t : tetrahedra) {
    const dvec3 center = (points[t[0]] + points[t[1]] + points[t[2]] + points[t[3]]) / 4.0;
    if (inside(center, dvec3(0.2), dvec3(0.8))) covered += volume(points, {t});
  }
  // Tetrahedra of edge 0.05 across the border count by their centres: an error of 1 % at most, of random sign.
  EXPECT_NEAR(covered / (0.6 * 0.6 * 0.6), 1, 0.01);
}

TEST(DelaunayTetrahedra, LeaveHolesEmptyBesideThinLayers) {
  for (const double first_layer : {0.05, 1e-3, 1e-5}) {
    const Points points = round_cylinder(first_layer);
    const auto tetrahedra = value_of(delaunay_tetrahedra(points));
    EXPECT_NEAR(volume(points, tetrahedra) / cylinder_volume, 1, 1e-3) << first_layer;  // the hole holds 0.125
  }
}

TEST(DelaunayTetrahedra, DoNotDependOnThreads) {
  Points points = lattice(12, {1, 1, 1});  // cospherical everywhere
  const auto many = delaunay_tetrahedra(points);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const auto single = delaunay_tetrahedra(points);
  ASSERT_TRUE(many && single);
  EXPECT_EQ(*many, *single);
}

// More points than one round inserts, cospherical everywhere.
TEST(DelaunayTetrahedra, DoNotDependOnRounds) {
  const Points points = lattice(52, {1, 1, 1});
  const std::size_t half = points.size() / 2;
  GrowingDelaunay halves;
  ASSERT_TRUE(halves.insert(std::span(points).first(half)) && halves.insert(std::span(points).subspan(half)));
  std::vector<Tetrahedron> expected;
  for (const GrowingDelaunay::Cell& cell : halves.cells())
    if (cell.is_finite()) std::ranges::sort(expected.emplace_back(cell.corners));
  std::ranges::sort(expected);
  EXPECT_EQ(delaunay_tetrahedra(points).value(), expected);
}

TEST(DelaunayTetrahedra, EndWhenAStopIsRequested) {
  const Points points = lattice(8, {1, 1, 1});
  std::stop_source stop;
  const Interruptible heeds(stop.get_token());
  ASSERT_TRUE(delaunay_tetrahedra(points));
  ASSERT_TRUE(GrowingDelaunay().insert(points));
  stop.request_stop();
  EXPECT_THAT(delaunay_tetrahedra(points), FailsWith(ErrorCode::cancelled));
  EXPECT_FALSE(GrowingDelaunay().insert(points));
}

TEST(DelaunayTetrahedra, DoNotDependOnTheOrderOfCosphericalPoints) {
  Points points = lattice(6, {1, 1, 1}), reversed(points.rbegin(), points.rend());
  auto forwards = *delaunay_tetrahedra(points), backwards = *delaunay_tetrahedra(reversed);
  for (Tetrahedron& t : backwards) {
    for (std::uint32_t& corner : t) corner = static_cast<std::uint32_t>(points.size()) - 1 - corner;
    std::ranges::sort(t);
  }
  std::ranges::sort(backwards);
  EXPECT_EQ(forwards, backwards);
}

TEST(DelaunayTetrahedra, GiveCoincidentPointsVolumeOnce) {
  Points points = lattice(4, {1, 1, 1});
  const auto distinct = points.size();
  points.insert(points.end(), points.begin(), points.begin() + 20);
  const auto tetrahedra = value_of(delaunay_tetrahedra(points));
  EXPECT_NEAR(volume(points, tetrahedra), 27, 1e-9);
  for (const Tetrahedron& t : tetrahedra) EXPECT_LT(t[3], distinct);
}

// Points without a volume, and the volume that the estimate may give them.
struct Flat {
  const char* name;
  Points points;
  double low, high;
};

std::vector<Flat> flat_cases() {
  std::vector<Flat> cases = {
      {"none", {}, 0, 0}, {"one", {{5, 5, 5}}, 1, 1}, {"coincident", Points(500, dvec3(1e7, -3, 2)), 1, 1}};
  // A unit square or line of spacing 0.1. Its thickness lies between half the spacing and twice the diagonal.
  Points plane, tilted, line, diagonal;
  for (int i = 0; i <= 10; ++i) {
    line.emplace_back(0.1 * i, 2, 3);
    diagonal.push_back(0.1 * i * glm::normalize(dvec3(1, 2, 3)));
    for (int j = 0; j <= 10; ++j) {
      plane.emplace_back(0.1 * i, 7, 0.1 * j);
      tilted.push_back(0.1 * i * glm::normalize(dvec3(1, 2, 3)) + 0.1 * j * glm::normalize(dvec3(3, 0, -1)));
    }
  }
  cases.push_back({"plane", plane, 0.05, 0.3});
  cases.push_back({"tilted plane", tilted, 0.05, 0.3});
  cases.push_back({"line", line, 0.0025, 0.08});
  cases.push_back({"tilted line", diagonal, 0.0025, 0.08});
  return cases;
}

// The cells of all points.
struct Cells {
  explicit Cells(const Points& points) : size(points.size()) { found.find(points, size, 0); }

  [[nodiscard]] std::vector<SpatialMoments> spatial() const {
    std::vector<SpatialMoments> moments;
    for (std::size_t i = 0; i < size; ++i) moments.push_back(found.moments(i));
    return moments;
  }

  std::size_t size;
  SampledCells found;
};

TEST(SampledCells, PointsWithoutAVolumeGetTheThicknessOfTheirSpacing) {
  for (const Flat& flat : flat_cases()) {
    const auto tetrahedra = delaunay_tetrahedra(flat.points);
    ASSERT_TRUE(tetrahedra) << flat.name;
    EXPECT_TRUE(tetrahedra->empty()) << flat.name;
    const double mass = total_mass(Cells(flat.points).spatial());
    EXPECT_GE(mass, flat.low * (1 - 1e-9)) << flat.name;
    EXPECT_LE(mass, flat.high * (1 + 1e-9)) << flat.name;
  }
}

TEST(SampledCells, OfALatticeAreItsBoxes) {
  for (const double origin : {0.0, 1e7}) {
    const dvec3 spacing{1, 0.5, 1};
    const Points points = lattice(8, spacing, dvec3(origin));
    const std::vector<SpatialMoments> cells = Cells(points).spatial();
    const double tolerance = origin > 0 ? 1e-3 : 1e-9;  // rounding of the positions, as above; squared in covariances
    // The domain ends at the outer points, so it has only a half, a quarter or an eighth of their cells.
    EXPECT_NEAR(total_mass(cells) / (343 * 0.5), 1, tolerance) << origin;
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (!inside(points[i], dvec3(origin) + 0.5 * spacing, dvec3(origin) + 6.5 * spacing)) continue;
      ASSERT_NEAR(cells[i].mass / 0.5, 1, tolerance);
      ASSERT_NEAR(cells[i].covariance.xx, 1.0 / 12, tolerance);
      ASSERT_NEAR(cells[i].covariance.yy, 0.25 / 12, tolerance);
      ASSERT_NEAR(cells[i].centroid.z, 0, tolerance);
    }
  }
}

TEST(SampledCells, LeaveHolesEmptyBesideThinLayers) {
  for (const double first_layer : {0.05, 1e-3, 1e-5}) {
    // The hole has 0.125 of the volume. Cuts are planes through the outer points, so a cell keeps the arc between two
    // of them, 0.006 of the radius.
    EXPECT_NEAR(total_mass(Cells(round_cylinder(first_layer)).spatial()) / cylinder_volume, 1, 0.01) << first_layer;
  }
}

TEST(SampledCells, ALinearFieldKeepsItsGradient) {
  for (const Points& points : {uniform_points(3000), lattice(8, {1, 0.5, 1e-4}, dvec3(100)), round_cylinder(1e-3)}) {
    const auto values = linear_values(points);
    const Cells cells(points);
    for (std::size_t i = 0; i < points.size(); ++i) {
      // Values near 300 are rounded to 6e-14, over a spacing of 1e-4 in the thinnest layers.
      ASSERT_LT(glm::length(cells.found.gradient(i, values) - dvec3(2, -1, 0.5)), 1e-5) << i;
      const SpatialMoments space = cells.found.moments(i);
      if (space.mass == 0) continue;
      const ValueMoments moments = cells.found.value(i, values);
      const SymmetricMatrix& s = space.covariance;
      ASSERT_NEAR(moments.covariance.x, 2 * s.xx - s.xy + 0.5 * s.xz, 1e-5 * (s.xx + s.yy + s.zz));
      ASSERT_EQ(moments.mass, space.mass);
      ASSERT_LE(moments.min, moments.mean);
      ASSERT_GE(moments.max, moments.mean);
    }
  }
}

TEST(SampledCells, MeansFollowALinearFieldInsideALattice) {
  const Points points = lattice(6, {1, 1, 1});
  const auto values = linear_values(points);
  const Cells cells(points);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const ValueMoments moments = cells.found.value(i, values);
    ASSERT_NEAR(moments.mean, linear(points[i] + moments.centroid), 1e-9);  // at the border too
  }
}

TEST(SampledCells, CoverNineDecadesOfCellVolume) {
  Points points;
  for (int i = -12; i <= 12; ++i)
    for (int j = -12; j <= 12; ++j)
      for (int k = -12; k <= 12; ++k) {
        const auto graded = [](int n) { return n == 0 ? 0.0 : std::copysign(std::pow(10.0, 0.25 * std::abs(n)), n); };
        points.emplace_back(graded(i), graded(j), graded(k));
      }
  // Spacings that grow by a factor of 1.8 look like the border of the domain here and there, and small faces are
  // missed.
  EXPECT_NEAR(total_mass(Cells(points).spatial()) / 8e9, 1, 0.03);
}

}  // namespace
}  // namespace splatvol::test
