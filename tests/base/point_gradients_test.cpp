// Gradients at points: linear values have theirs, spheres their radii.
#include "base/point_gradients.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <numbers>
#include <random>

namespace splatvol {
namespace {

using Corners = std::array<std::uint32_t, 4>;

struct TestMesh {
  std::vector<dvec3> points;
  std::vector<Corners> tetrahedra;
  std::uint32_t side;

  [[nodiscard]] std::vector<double> values(const std::function<double(dvec3)>& field) const {
    std::vector<double> values;
    for (const dvec3& point : points) values.push_back(field(point));
    return values;
  }
  [[nodiscard]] std::vector<dvec3> gradients(const std::vector<double>& values) const {
    std::vector<GradientSum> sums(points.size());
    add_gradients(points, tetrahedra, values, sums);
    return means_of(sums);
  }
};

// The unit cube as n^3 cubes of six tetrahedra, with moved points.
TestMesh jittered(std::uint32_t n, double move = 0.3) {
  TestMesh mesh;
  mesh.side = n + 1;
  std::mt19937 random(3);
  std::uniform_real_distribution<double> moved(-move / n, move / n);
  for (std::uint32_t x = 0; x <= n; ++x)
    for (std::uint32_t y = 0; y <= n; ++y)
      for (std::uint32_t z = 0; z <= n; ++z)
        mesh.points.push_back(dvec3(x, y, z) / static_cast<double>(n) +
                              dvec3(moved(random), moved(random), moved(random)));
  constexpr std::array<Corners, 6> of_cube = {
      {{0, 1, 3, 7}, {0, 3, 2, 7}, {0, 2, 6, 7}, {0, 6, 4, 7}, {0, 4, 5, 7}, {0, 5, 1, 7}}};
  const auto number = [&](std::uint32_t x, std::uint32_t y, std::uint32_t z, std::uint32_t bits) {
    return ((x + (bits >> 2)) * mesh.side + y + (bits >> 1 & 1)) * mesh.side + z + (bits & 1);
  };
  for (std::uint32_t x = 0; x < n; ++x)
    for (std::uint32_t y = 0; y < n; ++y)
      for (std::uint32_t z = 0; z < n; ++z)
        for (const auto& [a, b, c, d] : of_cube)
          mesh.tetrahedra.push_back({number(x, y, z, a), number(x, y, z, b), number(x, y, z, c), number(x, y, z, d)});
  return mesh;
}

double degrees_between(const dvec3& a, const dvec3& b) {
  return std::atan2(glm::length(glm::cross(a, b)), glm::dot(a, b)) * 180 / std::numbers::pi;
}

TEST(PointGradients, AreThatOfALinearFunctionAtEveryPoint) {
  const dvec3 slope(2, -3, 0.5);
  for (const double size : {1e-6, 1.0, 1e6}) {
    TestMesh mesh = jittered(6);
    for (dvec3& point : mesh.points) point *= size;
    // A flat tetrahedron, and one whose corners are one point, change nothing.
    mesh.tetrahedra.push_back({0, 1, 0, 1});
    mesh.tetrahedra.push_back({5, 5, 5, 5});
    std::ranges::swap(mesh.tetrahedra[7][1], mesh.tetrahedra[7][2]);  // turned inside out
    for (const dvec3& gradient : mesh.gradients(mesh.values([&](dvec3 p) { return glm::dot(slope, p) + 4; })))
      EXPECT_LE(glm::distance(gradient, slope), 1e-6 * glm::length(slope)) << size;
  }
}

TEST(PointGradients, AreNearThoseOfASmoothField) {
  const TestMesh mesh = jittered(20, 0.25);
  const auto gradients = mesh.gradients(mesh.values([](dvec3 p) { return glm::distance(p, dvec3(0.5)); }));
  double sum = 0, count = 0;
  for (std::size_t i = 0; i < mesh.points.size(); ++i) {
    const dvec3 radius = mesh.points[i] - 0.5;
    if (glm::length(radius) < 0.25 || glm::length(radius) > 0.4) continue;
    const double angle = degrees_between(gradients[i], radius);
    EXPECT_LT(angle, 3);
    sum += angle, ++count;
  }
  EXPECT_LT(sum / count, 0.7);
}

TEST(PointGradients, LeaveOutMissingValues) {
  const TestMesh mesh = jittered(4);
  std::vector<double> values = mesh.values([](dvec3 p) { return 3 * p.x; });
  values[31] = std::numeric_limits<double>::quiet_NaN();  // at (1, 1, 1): all tetrahedra at point 0 have it
  const auto gradients = mesh.gradients(values);
  for (std::size_t i = 0; i < gradients.size(); ++i)
    EXPECT_LE(glm::distance(gradients[i], i == 31 || i == 0 ? dvec3(0) : dvec3(3, 0, 0)), 1e-9) << i;
}

TEST(PointGradients, OfPartsAddUp) {
  const TestMesh mesh = jittered(5);
  const std::vector<double> values = mesh.values([](dvec3 p) { return std::sin(5 * p.x) * p.y; });
  std::vector<GradientSum> sums(mesh.points.size());
  const auto half = mesh.tetrahedra.size() / 2;
  for (const auto part : {std::span(mesh.tetrahedra).first(half), std::span(mesh.tetrahedra).subspan(half)}) {
    std::vector<GradientSum> of_part(mesh.points.size());
    add_gradients(mesh.points, part, values, of_part);
    for (std::size_t i = 0; i < sums.size(); ++i) sums[i].add(of_part[i]);
  }
  const auto whole = mesh.gradients(values), joined = means_of(sums);
  for (std::size_t i = 0; i < whole.size(); ++i) EXPECT_LE(glm::distance(whole[i], joined[i]), 1e-12);
}

}  // namespace
}  // namespace splatvol
