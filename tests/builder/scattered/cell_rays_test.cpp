// Cells measured by rays, beside closed forms.
#include "builder/scattered/cell_rays.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace splatvol {
namespace {

// A box from `low` to `high` round the point, turned by `turn`.
void add_box(CellRays& rays, const dvec3& low, const dvec3& high, const dmat3& turn = dmat3(1)) {
  for (int axis = 0; axis < 3; ++axis) {
    rays.add(turn[axis] / high[axis], static_cast<std::uint32_t>(2 * axis));
    rays.add(turn[axis] / low[axis], static_cast<std::uint32_t>(2 * axis + 1));
  }
  rays.update();
}

SpatialMoments measure(CellRays& rays, const dvec3& low, const dvec3& high, const dmat3& turn = dmat3(1)) {
  SpatialMoments moments;
  dmat3 shape(1);
  for (int attempt = 0; attempt < 12; ++attempt) {
    rays.reset(shape);
    add_box(rays, low, high, turn);
    rays.cast();
    moments = rays.moments();
    if (rays.fits()) break;
    shape = rays.better_shape();
  }
  EXPECT_TRUE(rays.fits());
  return moments;
}

dmat3 slanted() {
  const dvec3 a = glm::normalize(dvec3(1, 2, 3)), b = glm::normalize(glm::cross(a, dvec3(0, 0, 1)));
  return {a, b, glm::cross(a, b)};
}

TEST(CellRays, BoxesOfAnyAspectRatioHaveTheirMoments) {
  CellRays rays;
  for (const dvec3& size : {dvec3(1), dvec3(1, 0.5, 2), dvec3(1, 1, 1e-4), dvec3(1e-4, 1, 1e-2), dvec3(1e6)})
    for (const dmat3& turn : {dmat3(1), slanted()}) {
      const dvec3 low = -0.4 * size, high = 0.6 * size;
      const SpatialMoments box = measure(rays, low, high, turn);
      EXPECT_NEAR(box.mass / (size.x * size.y * size.z), 1, 0.04) << size.z;
      for (int axis = 0; axis < 3; ++axis) {
        EXPECT_NEAR(glm::dot(box.centroid, turn[axis]) / size[axis], 0.1, 0.02);
        const SymmetricMatrix& c = box.covariance;
        const dvec3& d = turn[axis];
        const double variance = c.xx * d.x * d.x + c.yy * d.y * d.y + c.zz * d.z * d.z +
                                2 * (c.xy * d.x * d.y + c.xz * d.x * d.z + c.yz * d.y * d.z);
        EXPECT_NEAR(variance / (size[axis] * size[axis] / 12), 1, 0.1) << axis << " " << size[axis];
      }
    }
}

TEST(CellRays, VerticesLieAtTheCornersOfABox) {
  CellRays rays;
  measure(rays, dvec3(-1), dvec3(1));
  std::vector<CellRays::Vertex> vertices;
  std::vector<std::uint32_t> labels;
  rays.find_vertices(vertices, labels);
  EXPECT_EQ(labels, (std::vector<std::uint32_t>{0, 1, 2, 3, 4, 5}));
  ASSERT_GE(vertices.size(), 8u);
  for (const CellRays::Vertex& vertex : vertices) {
    EXPECT_GT(vertex.square, 2);
    EXPECT_LE(vertex.square, 3.0001F);
    EXPECT_NEAR(glm::dot(rays.end(vertex), rays.end(vertex)), static_cast<double>(vertex.square), 1e-4);
  }
}

TEST(CellRays, OnlyWhatIsNearerToAnEndShortensARay) {
  CellRays rays;
  rays.reset(dmat3(1));
  add_box(rays, dvec3(-1), dvec3(1));
  EXPECT_GT(rays.reach(), 8);  // at most twice the distance to a corner, squared
  EXPECT_LE(rays.reach(), 12.01F);
  EXPECT_FALSE(rays.may_shorten(dvec3(5), dvec3(6)));
  EXPECT_TRUE(rays.may_shorten(dvec3(-0.5), dvec3(0.5)));
  EXPECT_TRUE(rays.may_shorten(dvec3(1.2, -0.1, -0.1), dvec3(1.3, 0.1, 0.1)));
}

}  // namespace
}  // namespace splatvol
