// Values on planes through meshes.
#include "renderer/reference/slice.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "tests/renderer/reference/meshes.h"
#include "tests/support/results.h"

namespace splatvol {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

View view_from(dvec3 eye, dvec3 focus, bool orthographic = false) {
  Camera camera{.projection = orthographic ? Camera::Projection::orthographic : Camera::Projection::perspective,
                .vertical_fov_degrees = 40,
                .parallel_height = 1.8,
                .position = eye,
                .focal_point = focus,
                .up = {0.1, 1, 0}};
  return make_view(camera, 90, 70).value();
}

// A plane's places in the pixels.
struct Places {
  std::vector<dvec3> positions;
  std::vector<double> depths;
};

Places places_of(const View& view, const Plane& plane) {
  Places places;
  for (int row = 0; row < view.height; ++row)
    for (int x = 0; x < view.width; ++x) {
      const auto [a, b] = pixel_ray(view, x, view.height - 1 - row);
      const dvec3 aside = a * view.right + b * view.up;
      const dvec3 origin = view.orthographic ? view.eye + aside : view.eye;
      const dvec3 along = view.orthographic ? view.forward : view.forward + aside;
      const double depth = -plane.distance(origin) / glm::dot(plane.normal, along);
      places.depths.push_back(depth > 0 ? depth : std::numeric_limits<double>::infinity());
      places.positions.push_back(origin + depth * along);
    }
  return places;
}

bool is_in_cube(const dvec3& p, double margin) { return std::min({p.x, p.y, p.z, 1 - p.x, 1 - p.y, 1 - p.z}) > margin; }

// A linear field is exact on every plane: along faces of cells, through vertices, with the eye inside, and far from the
// origin.
TEST(ExactSlice, ALinearFieldIsExact) {
  const auto field = [](const dvec3& p) { return 3 + p.x - 2 * p.y + 0.5 * p.z; };
  for (const dvec3 move : {dvec3(0), dvec3(1e6, -2e6, 5e5)}) {
    Mesh mesh = make_box(4, field);
    for (dvec3& p : mesh.points) p += move;
    for (const bool orthographic : {false, true})
      for (const dvec3 eye : {dvec3(1.7, 2.1, 2.9), dvec3(0.4, 0.6, 0.9)})
        for (const dvec3 normal : {dvec3(0, 0, 1), dvec3(1, 1, 1), dvec3(0.3, -0.2, 0.7), dvec3(1, -1, 0)}) {
          const View view = view_from(move + eye, move + dvec3(0.5), orthographic);
          const Plane plane = make_plane(move + dvec3(0.5), normal);
          const Places places = places_of(view, plane);
          const auto values = test::value_of(exact_slice(mesh.view(), view, plane, places.depths));
          int inside = 0;
          for (std::size_t i = 0; i < values.size(); ++i) {
            const bool hit = std::isfinite(places.depths[i]);
            const dvec3 at = places.positions[i] - move;
            if (hit && is_in_cube(at, 1e-6)) {
              ++inside;
              EXPECT_NEAR((values)[i], field(at), 1e-7);
            } else if (!hit || !is_in_cube(at, -1e-6)) {
              EXPECT_TRUE(std::isnan((values)[i]));
            }
          }
          EXPECT_GT(inside, 100);
        }
  }
}

TEST(ExactSlice, ConstantCellsAndMissingValues) {
  const Mesh mesh = make_box(2, [](const dvec3&) { return 1.0; });
  std::vector<double> of_cells(mesh.tetrahedra.size());
  for (std::size_t i = 0; i < of_cells.size(); ++i) of_cells[i] = i % 3 == 0 ? nan : static_cast<double>(i);
  const View view = view_from({1.7, 2.1, 2.9}, dvec3(0.5));
  const Plane plane = make_plane(dvec3(0.45), {0.3, -0.2, 0.7});
  const Places places = places_of(view, plane);
  const auto values = exact_slice({mesh.points, of_cells, mesh.tetrahedra, true}, view, plane, places.depths).value();
  int holes = 0, whole = 0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!std::isfinite(places.depths[i]) || !is_in_cube(places.positions[i], 1e-6)) continue;
    if (std::isnan(values[i])) {
      ++holes;
      continue;
    }
    ++whole;
    EXPECT_NEAR(values[i], std::round(values[i]), 1e-9);
    EXPECT_NE(std::lround(values[i]) % 3, 0);
  }
  EXPECT_GT(holes, 200);
  EXPECT_GT(whole, 400);

  // A vertex without a value leaves its cells out.
  std::vector<double> lacking = mesh.values;
  lacking[13] = nan;  // the middle
  const auto around = exact_slice({mesh.points, lacking, mesh.tetrahedra}, view, plane, places.depths).value();
  EXPECT_GT(std::ranges::count_if(around, [](double v) { return v == 1; }), 100);
  for (std::size_t i = 0; i < around.size(); ++i)
    if (std::isfinite(places.depths[i]) && glm::length(places.positions[i] - dvec3(0.5)) < 0.1) {
      EXPECT_TRUE(std::isnan(around[i]));
    }
}

TEST(ExactSlice, ChecksItsInput) {
  Mesh mesh = make_box(1, [](const dvec3&) { return 1.0; });
  const View view = view_from({1.7, 2.1, 2.9}, dvec3(0.5));
  const Plane plane = make_plane(dvec3(0.5), {0, 0, 1}), outside = make_plane(dvec3(9), {0, 0, 1});
  const Places places = places_of(view, plane), far = places_of(view, outside);
  EXPECT_THAT(exact_slice(mesh.view(), view, outside, far.depths).value(), ::testing::Each(::testing::IsNan()));
  EXPECT_FALSE(exact_slice(mesh.view(), view, plane, std::span(places.depths).first(9)));
  mesh.values.pop_back();
  EXPECT_FALSE(exact_slice(mesh.view(), view, plane, places.depths));
  mesh.values.push_back(1);
  mesh.tetrahedra[0][0] = 99;
  EXPECT_FALSE(exact_slice(mesh.view(), view, plane, places.depths));
}

}  // namespace
}  // namespace splatvol
