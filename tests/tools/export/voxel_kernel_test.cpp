#include "tools/export/voxel_kernel.h"
#include "tests/support/random.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <random>

namespace splatvol::test {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
const Box everywhere{dvec3(-infinity), dvec3(infinity)};

struct Voxel {
  dvec3 center;
  double share;
};

std::vector<Voxel> voxels_of(const VoxelKernel& kernel, const Box& box = everywhere) {
  std::vector<VoxelKernel::Run> runs;
  std::vector<double> shares;
  EXPECT_TRUE(kernel.append(box, std::size_t{1} << 30, runs, shares));
  std::vector<Voxel> voxels;
  for (const VoxelKernel::Run& run : runs)
    for (std::uint32_t i = 0; i < run.count; ++i)
      voxels.push_back({dvec3(run.x + static_cast<int>(i), run.y, run.z), shares[voxels.size()]});
  EXPECT_EQ(voxels.size(), shares.size());
  return voxels;
}

double sum_of(const std::vector<Voxel>& voxels) {
  return std::accumulate(voxels.begin(), voxels.end(), 0.0, [](double sum, const Voxel& v) { return sum + v.share; });
}

dvec3 mean_of(const std::vector<Voxel>& voxels) {
  dvec3 mean(0);
  for (const Voxel& voxel : voxels) mean += voxel.share * voxel.center;
  return mean;
}

SplatShape shape_of(const dvec3& deviations, const glm::dquat& turn) {
  SplatShape shape{.mass = 1, .deviations = deviations, .orientation = glm::normalize(turn)};
  return shape;
}

TEST(VoxelKernel, SharesAddUpToOneForAnyShape) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> coordinate(-1e4, 1e4), exponent(-4, 1.3), part(-1, 1);
  for (int i = 0; i < 500; ++i) {
    std::array<double, 3> d = {std::pow(10, exponent(random)), std::pow(10, exponent(random)),
                               std::pow(10, exponent(random))};
    std::sort(d.rbegin(), d.rend());
    SplatShape shape = shape_of({d[0], d[1], d[2]}, {part(random), part(random), part(random), part(random)});
    if (i % 2 == 1) shape.boundary = random_vector(part, random) + dvec3(0, 0, 1);
    const dvec3 centroid = random_vector(coordinate, random);
    const auto voxels = voxels_of(VoxelKernel(centroid, shape));
    ASSERT_FALSE(voxels.empty());
    EXPECT_NEAR(sum_of(voxels), 1, 1e-12);
    for (const Voxel& voxel : voxels) EXPECT_GE(voxel.share, 0);
  }
}

// A kernel many voxels wide has many samples: the error of the mean is far below a voxel.
TEST(VoxelKernel, KeepsTheMeanAndTurnsTheEllipsoid) {
  const dvec3 centroid(3.3, -7.1, 0.4);
  const auto shape = shape_of({6, 3, 1}, {0.8, 0.1, 0.5, -0.3});
  const auto voxels = voxels_of(VoxelKernel(centroid, shape));
  EXPECT_LT(glm::length(mean_of(voxels) - centroid), 0.01);
  // Variances of the kernel are L^2 / 8, L^2 = (0.95^2) 12 (d^2 + 1/12).
  const dmat3 axes = glm::mat3_cast(shape.orientation);
  for (int k = 0; k < 3; ++k) {
    double variance = 0;
    for (const Voxel& voxel : voxels) variance += voxel.share * std::pow(glm::dot(axes[k], voxel.center - centroid), 2);
    const double expected = 0.95 * 0.95 * 12 / 8 * (std::pow(shape.deviations[k], 2) + 1.0 / 12);
    EXPECT_NEAR(variance, expected, 0.02 * expected);
  }
}

TEST(VoxelKernel, WithoutExtentItIsAtMostTheNearestVoxels) {
  for (const dvec3 centroid : {dvec3(0), dvec3(0.5), dvec3(0.5, 0, 0), dvec3(1e7 + 0.3, -1e7, 0.1)}) {
    const auto voxels = voxels_of(VoxelKernel(centroid, shape_of(dvec3(0), {1, 0, 0, 0})));
    ASSERT_LE(voxels.size(), 8u);
    EXPECT_NEAR(sum_of(voxels), 1, 1e-12);
    for (const Voxel& voxel : voxels) EXPECT_LT(glm::length(voxel.center - centroid), 0.951);
  }
}

TEST(VoxelKernel, NothingLiesBeyondTheBoundary) {
  auto shape = shape_of({4, 4, 4}, {1, 0, 0, 0});
  shape.boundary = dvec3(1.5, 0, 0);  // a plane 6 voxels along x
  const auto voxels = voxels_of(VoxelKernel(dvec3(0), shape));
  double at_plane = 0;
  for (const Voxel& voxel : voxels) {
    EXPECT_TRUE(voxel.share == 0 || voxel.center.x <= 6);
    if (voxel.center.x == 6) at_plane += voxel.share;
  }
  EXPECT_GT(at_plane, 0) << "it is cut, not faded, there";
}

TEST(VoxelKernel, PartOfALargeOneHasItsPart) {
  const auto shape = shape_of({30, 20, 10}, {0.9, 0.1, 0.2, 0.3});
  const Box box{dvec3(-5, -5, -5), dvec3(20, 5, 5)};
  const VoxelKernel kernel(dvec3(0.2), shape);
  EXPECT_TRUE(kernel.reaches(box));
  EXPECT_FALSE(kernel.reaches({dvec3(500), dvec3(600)}));
  const auto part = voxels_of(kernel, box);
  double expected = 0;
  for (const Voxel& voxel : voxels_of(kernel))
    if (glm::all(glm::lessThanEqual(box.low, voxel.center)) && glm::all(glm::lessThanEqual(voxel.center, box.high)))
      expected += voxel.share;
  EXPECT_EQ(part.size(), 26u * 11 * 11);
  EXPECT_NEAR(sum_of(part), expected, 1e-3 * expected);
  std::vector<VoxelKernel::Run> runs;
  std::vector<double> shares;
  EXPECT_FALSE(kernel.append(everywhere, 1000, runs, shares));
}

// A sheet of 1e5 by 1e5 voxels, and a box that holds the centres of none or of few of them.
TEST(VoxelKernel, RowsWithoutVoxelsTakeNoTime) {
  const auto shape = shape_of(dvec3(1e5), {1, 0, 0, 0});
  const VoxelKernel kernel(dvec3(0.5), shape);
  std::vector<VoxelKernel::Run> runs;
  std::vector<double> shares;
  EXPECT_TRUE(kernel.append({dvec3(0.5, -1e5, -1e5), dvec3(0.5, 1e5, 1e5)}, 1000, runs, shares));
  EXPECT_TRUE(runs.empty());
  const VoxelKernel slanted(dvec3(0.5), shape_of({1e5, 1e5, 1}, glm::angleAxis(0.7, dvec3(0, 1, 0))));
  EXPECT_FALSE(slanted.append({dvec3(1e5, -1e5, -1e5), dvec3(1e5 + 1, 1e5, 1e5)}, 1000, runs, shares));
}

// The slope is the regression of the value on the position in the material after the blur of a voxel.
TEST(VoxelKernel, SlopeIsTheFieldsWhereItIsResolved) {
  const dvec3 slope(1, -2, 0.5);
  const auto slope_in = [&](const dvec3& deviations) {
    const SplatShape shape = shape_of(deviations, {1, 0, 0, 0});
    const double deviation = glm::length(deviations * slope);
    const SplatValue value{.deviation = deviation, .correlation = deviations * slope / deviation, .coverage = 1};
    return VoxelKernel(dvec3(0), shape).field(shape, value).slope;
  };
  const dvec3 deviations(10, 8, 6);
  EXPECT_LT(glm::length(slope_in(deviations) - slope), 0.01);
  EXPECT_LT(glm::length(slope_in(0.01 * deviations)), 0.3) << "not extrapolated";
}

}  // namespace
}  // namespace splatvol::test
