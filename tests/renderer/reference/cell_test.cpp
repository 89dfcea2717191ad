#include "renderer/reference/cell.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace splatvol {
namespace {

View unit_view(bool orthographic) {
  Camera camera{.vertical_fov_degrees = 90, .parallel_height = 2, .position = {0, 0, 0}, .focal_point = {0, 0, -1}};
  if (orthographic) camera.projection = Camera::Projection::orthographic;
  return *make_view(camera, 64, 64);
}

TEST(DeterminantSign, SeesWhatRoundingHides) {
  const double e = std::numeric_limits<double>::epsilon();
  EXPECT_EQ(determinant_sign(1, 2, 3, 6), 0);
  EXPECT_EQ(determinant_sign(2, 1, 1, 1), 1);
  EXPECT_EQ(determinant_sign(1, 1, 2, 1), -1);
  // (1 + e)(1 - e) = 1 - e^2 and (1 + e)^2 = 1 + 2 e + e^2 round to the numbers that they are compared with.
  EXPECT_EQ(determinant_sign(1 + e, 1, 1, 1 - e), -1);
  EXPECT_EQ(determinant_sign(1, 1 + e, 1 - e, 1), 1);
  EXPECT_EQ(determinant_sign(1 + e, 1 + 2 * e, 1, 1 + e), 1);
  EXPECT_EQ(determinant_sign(-1 - e, 1 + 2 * e, -1, 1 + e), -1 * determinant_sign(1 + e, -1 - 2 * e, 1, -1 - e) * -1);
  EXPECT_EQ(determinant_sign(0.0, -0.0, 5, 7), 0);
}

TEST(DeterminantSign, IsAntisymmetric) {
  std::mt19937 random(1);
  std::uniform_int_distribution<int> bits(-3, 3);
  const double e = std::numeric_limits<double>::epsilon();
  const auto near_one = [&] { return 1 + bits(random) * e; };
  for (int trial = 0; trial < 10000; ++trial) {
    const double a = near_one();
    const double b = near_one();
    const double c = near_one();
    const double d = near_one();
    const auto product = [](double x, double y) { return static_cast<__float128>(x) * y; };
    const __float128 exact = product(a, d) - product(b, c);
    EXPECT_EQ(determinant_sign(a, b, c, d), (exact > 0) - (exact < 0));
    EXPECT_EQ(determinant_sign(c, d, a, b), -determinant_sign(a, b, c, d));
  }
}

/// Stands for a ray that misses the cell.
constexpr Crossing missed{0, 0, 0, 0};

Crossing cross(bool orthographic, const CellCorners& corners, const std::array<double, 4>& values, PixelRay ray) {
  CellCrosser crosser(orthographic, corners, values);
  return crosser.select_row(ray.b) ? crosser.cross(ray.a).value_or(missed) : missed;
}

/// Finds the cell's crossing by clipping the ray with the planes of its faces, from barycentric coordinates.
Crossing clip(const View& view, const CellCorners& corners, const std::array<double, 4>& values, PixelRay ray) {
  const dvec3 origin = view.orthographic ? dvec3(ray.a, ray.b, 0) : dvec3(0);
  const dvec3 direction = view.orthographic ? dvec3(0, 0, 1) : dvec3(ray.a, ray.b, 1);
  const dmat3 inverse = glm::inverse(dmat3(corners[1] - corners[0], corners[2] - corners[0], corners[3] - corners[0]));
  const dvec3 at = inverse * (origin - corners[0]);
  const dvec3 slope = inverse * direction;
  const std::array<double, 4> b{1 - at.x - at.y - at.z, at.x, at.y, at.z};
  const std::array<double, 4> g{-slope.x - slope.y - slope.z, slope.x, slope.y, slope.z};
  Crossing crossing{-1e300, 1e300, 0, 0};
  for (int i = 0; i < 4; ++i) {
    if (g[i] > 0) crossing.enter = std::max(crossing.enter, -b[i] / g[i]);
    if (g[i] < 0) crossing.leave = std::min(crossing.leave, -b[i] / g[i]);
  }
  if (crossing.enter >= crossing.leave) return missed;
  for (int i = 0; i < 4; ++i) {
    crossing.value_enter += (b[i] + g[i] * crossing.enter) * values[i];
    crossing.value_leave += (b[i] + g[i] * crossing.leave) * values[i];
  }
  return crossing;
}

/// Random cells around, before and behind the eye: the crossings are right, and none lies outside the bounds.
TEST(CellCrosser, MatchesClippingForRandomCells) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> coordinate(-2, 2);
  int crossings = 0;
  for (int trial = 0; trial < 400; ++trial) {
    const View view = unit_view(trial % 2 == 0);
    CellCorners corners;
    for (dvec3& corner : corners) corner = {coordinate(random), coordinate(random), coordinate(random) + trial % 3};
    const std::array<double, 4> values{1, 2, 4, 8};
    const PixelRectangle bounds = pixel_bounds(view, corners);
    for (int y = 0; y < view.height; ++y)
      for (int x = 0; x < view.width; ++x) {
        const PixelRay ray = pixel_ray(view, x, y);
        const Crossing expected = clip(view, corners, values, ray);
        const Crossing found = cross(view.orthographic, corners, values, ray);
        EXPECT_NEAR(found.leave - found.enter, expected.leave - expected.enter, 1e-8);
        if (expected.leave - expected.enter < 1e-6) continue;
        ++crossings;
        EXPECT_NEAR(found.enter, expected.enter, 1e-9 * (1 + std::abs(expected.enter)));
        EXPECT_NEAR(found.leave, expected.leave, 1e-9 * (1 + std::abs(expected.leave)));
        EXPECT_NEAR(found.value_enter, expected.value_enter, 1e-8);
        EXPECT_NEAR(found.value_leave, expected.value_leave, 1e-8);
        const bool is_bounded = x >= bounds.x0 && x <= bounds.x1 && y >= bounds.y0 && y <= bounds.y1;
        EXPECT_TRUE(is_bounded || found.leave <= 0) << trial << ": " << x << ", " << y;
      }
  }
  EXPECT_GT(crossings, 10000);
}

/// Random cells with small whole coordinates, and rays through them: ties of every kind. Two cells on both sides of a
/// common face must count every ray as often as their union; so must the four cells round a point inside a
/// tetrahedron.
TEST(CellCrosser, SplittingACellChangesNoRay) {
  std::mt19937 random(11);
  std::uniform_int_distribution<int> whole(-2, 2);
  for (int trial = 0; trial < 20000; ++trial) {
    const bool orthographic = trial % 2 == 0;
    CellCorners corners;
    for (dvec3& corner : corners) corner = {4 * whole(random), 4 * whole(random), 4 * whole(random)};
    if (glm::dot(corners[1] - corners[0], glm::cross(corners[2] - corners[0], corners[3] - corners[0])) == 0) continue;
    const dvec3 inside = 0.25 * (corners[0] + corners[1] + corners[2] + corners[3]);
    const PixelRay ray{0.5 * whole(random), 0.5 * whole(random)};
    const auto length = [&](const CellCorners& cell) {
      const Crossing crossing = cross(orthographic, cell, {0, 0, 0, 0}, ray);
      return crossing.leave - crossing.enter;
    };
    double parts = 0;
    for (int i = 0; i < 4; ++i) {
      CellCorners part = corners;
      part[i] = inside;
      parts += length(part);
    }
    EXPECT_NEAR(parts, length(corners), 1e-12) << trial;
  }
}

TEST(PixelBounds, AreTightInFrontOfTheEye) {
  // f = 32: the corners' pixels are 32 + 32 x / z.
  const CellCorners corners{dvec3(-1, -1, 4), dvec3(1, -1, 4), dvec3(0, 2, 4), dvec3(0, 0, 8)};
  const PixelRectangle bounds = pixel_bounds(unit_view(false), corners);
  EXPECT_EQ(bounds.x0, 24);
  EXPECT_EQ(bounds.x1, 39);
  EXPECT_EQ(bounds.y0, 24);
  EXPECT_EQ(bounds.y1, 47);
}

TEST(PixelBounds, AreEmptyBehindTheEyeAndOffTheScreen) {
  for (const bool orthographic : {false, true}) {
    const View view = unit_view(orthographic);
    EXPECT_TRUE(pixel_bounds(view, {dvec3(-1, -1, -4), dvec3(1, -1, -4), dvec3(0, 2, 0), dvec3(0, 0, -8)}).is_empty());
    EXPECT_TRUE(pixel_bounds(view, {dvec3(20, 0, 1), dvec3(21, 0, 1), dvec3(20, 1, 1), dvec3(20, 0, 2)}).is_empty());
  }
}

TEST(PixelBounds, CoverTheScreenFromInside) {
  const CellCorners corners{dvec3(-3, -3, -1), dvec3(3, -3, -1), dvec3(0, 4, -1), dvec3(0, 0, 5)};
  const PixelRectangle bounds = pixel_bounds(unit_view(false), corners);
  EXPECT_EQ(bounds.x0, 0);
  EXPECT_EQ(bounds.x1, 63);
  EXPECT_EQ(bounds.y0, 0);
  EXPECT_EQ(bounds.y1, 63);
}

/// A cell that passes the eye on its right covers nothing left of its corners in front.
TEST(PixelBounds, ExtendToTheSideOnWhichACellPassesTheEye) {
  const CellCorners corners{dvec3(1, -1, 4), dvec3(1, 1, 4), dvec3(2, 0, 4), dvec3(2, 0, -4)};
  const PixelRectangle bounds = pixel_bounds(unit_view(false), corners);
  EXPECT_EQ(bounds.x0, 40);
  EXPECT_EQ(bounds.x1, 63);
}

}  // namespace
}  // namespace splatvol
