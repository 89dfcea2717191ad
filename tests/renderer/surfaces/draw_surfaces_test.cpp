// Depths and light of surfaces against closed forms.
#include "renderer/surfaces/draw_surfaces.h"

#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "tests/renderer/surfaces/shapes.h"

namespace splatvol::test {
namespace {

constexpr float infinity = std::numeric_limits<float>::infinity();

View view_from(dvec3 eye, dvec3 focus, bool orthographic, int width = 131, int height = 97) {
  Camera camera{.projection = orthographic ? Camera::Projection::orthographic : Camera::Projection::perspective,
                .vertical_fov_degrees = 40,
                .parallel_height = 3,
                .position = eye,
                .focal_point = focus};
  return make_view(camera, width, height).value();
}

Surface surface_of(TriangleMesh mesh, double opacity = 1, dvec3 color = dvec3(1)) {
  return {{.file = "f", .color = color, .opacity = opacity}, std::make_shared<const TriangleMesh>(std::move(mesh))};
}

SurfaceLayers draw(const std::vector<Surface>& surfaces, const View& view,
                   std::size_t most_layers = most_surface_layers) {
  return draw_surfaces(surfaces, {}, view, most_layers);
}

// A pixel's ray in world coordinates; `direction` has length 1 along the view's axis.
struct Ray {
  dvec3 origin, direction;
};

Ray ray_of(const View& view, int x, int row) {
  const double a = (x + 0.5 - 0.5 * view.width) / view.focal;
  const double b = (view.height - row - 0.5 - 0.5 * view.height) / view.focal;
  const dvec3 aside = a * view.right + b * view.up;
  return view.orthographic ? Ray{view.eye + aside, view.forward} : Ray{view.eye, view.forward + aside};
}

// Calls `check` with each pixel's ray, depth and light.
template <class Check>
void for_each_pixel(const View& view, const SurfaceLayer& layer, const Check& check) {
  for (int row = 0; row < view.height; ++row)
    for (int x = 0; x < view.width; ++x)
      check(ray_of(view, x, row), layer.depths.depths[static_cast<std::size_t>(row) * view.width + x],
            layer.light.at(x, row));
}

// Values at the corners are linear in a triangle, in space and not in the picture.
TEST(DrawSurfaces, ValuesColorAPlate) {
  const auto value_at = [](const dvec3& p) { return 2 + p.x - 0.5 * p.y + 0.25 * p.z; };
  TransferFunction function{.colors = {{0, dvec3(1, 0, 0)}, {1, dvec3(0, 0, 1)}}, .densities = {{0, 1}}};
  function.lo = -1, function.hi = 5;
  for (const bool orthographic : {false, true}) {
    const View view = view_from({0.3, 0.5, 4}, {0, 0, 0}, orthographic);
    Surface surface = surface_of(test::plate({-1.2, -0.8, -1}, {2.4, 0.2, 0.5}, {0, 1.8, 1.4}, 3), 0.5);
    surface.style.color_by = SceneColoring{"v", function};
    SurfaceValues values{"v", "f", 0, {}};
    for (const dvec3& point : surface.mesh->points) values.values.push_back(value_at(point));
    surface.values = std::make_shared<const SurfaceValues>(values);
    Surface plain = surface_of(*surface.mesh, 0.5);
    const SurfaceLayer colored = draw({surface}, view).layers.at(0), white = draw({plain}, view).layers.at(0);
    int hit = 0;
    for (int row = 0; row < view.height; ++row)
      for (int x = 0; x < view.width; ++x) {
        const float depth = colored.depths.depths[static_cast<std::size_t>(row) * view.width + x];
        if (depth == infinity) continue;
        ++hit;
        const Ray ray = ray_of(view, x, row);
        const vec4 shade = white.light.at(x, row);
        const dvec3 exact = double{shade.r} * function.color(value_at(ray.origin + double{depth} * ray.direction));
        EXPECT_LT(glm::length(dvec3(colored.light.at(x, row)) - exact), 1e-5);
        EXPECT_EQ(colored.light.at(x, row).a, 0.5F);
      }
    EXPECT_GT(hit, 1000);
    surface.values = std::make_shared<const SurfaceValues>(
        SurfaceValues{"v", "f", 0, std::vector<double>(surface.mesh->triangles.size(), 2), true});
    const Image constant = draw({surface}, view).layers.at(0).light;
    for (std::size_t i = 0; i < constant.pixels.size(); ++i)
      EXPECT_LT(glm::length(dvec3(constant.pixels[i]) - double{white.light.pixels[i].r} * function.color(2)), 1e-5);
    values.values[0] = std::numeric_limits<double>::quiet_NaN();  // its triangles have the surface's own colour
    surface.values = std::make_shared<const SurfaceValues>(values);
    const Image some = draw({surface}, view).layers.at(0).light;
    EXPECT_GT(std::ranges::count_if(some.pixels, [](const vec4& p) { return p.a > 0 && p.r == p.g; }), 20);
  }
}

TEST(DrawSurfaces, APlateHasThePlanesDepthAndLight) {
  for (const bool orthographic : {false, true}) {
    const View view = view_from({0.3, 0.5, 4}, {0, 0, 0}, orthographic);
    // Larger than the picture, also behind the eye.
    const dvec3 normal = glm::normalize(dvec3(0.1, 1, 0.2)), u = glm::normalize(glm::cross(normal, dvec3(0, 0, 1)));
    const dvec3 v = glm::cross(normal, u), point(0, -0.4, 0);
    for (const std::uint32_t parts : {1u, 37u}) {
      const auto drawn = draw({surface_of(test::plate(point - 50.0 * (u + v), 100.0 * u, 100.0 * v, parts))}, view);
      ASSERT_EQ(drawn.layers.size(), 1u);
      int hit = 0;
      for_each_pixel(view, drawn.layers[0], [&](const Ray& ray, float depth, const vec4& light) {
        const double exact = glm::dot(point - ray.origin, normal) / glm::dot(ray.direction, normal);
        const dvec3 place = ray.origin + exact * ray.direction - point;
        if (exact <= 0 || std::max(std::abs(glm::dot(place, u)), std::abs(glm::dot(place, v))) > 50) {
          EXPECT_EQ(depth, infinity);
          EXPECT_EQ(light, vec4(0));
          return;
        }
        ++hit;
        EXPECT_NEAR(depth / exact, 1, 1e-6);
        const double brightness = 0.3 + 0.7 * std::abs(glm::dot(glm::normalize(ray.direction), normal));
        EXPECT_NEAR(light.r, brightness, 1e-5);
        EXPECT_EQ(light.a, 1);
      });
      EXPECT_GT(hit, view.width * view.height / 4) << orthographic;
    }
  }
}

TEST(DrawSurfaces, ABallIsRound) {
  constexpr std::uint32_t rings = 300;
  const dvec3 center(0.1, 0.05, -0.2);
  for (const bool orthographic : {false, true}) {
    const View view = view_from({0.3, 0.5, 4}, {0, 0, 0}, orthographic);
    const auto drawn = draw({surface_of(ball(center, 1, rings))}, view);
    ASSERT_EQ(drawn.layers.size(), 1u);
    for_each_pixel(view, drawn.layers[0], [&](const Ray& ray, float depth, const vec4&) {
      const dvec3 direction = glm::normalize(ray.direction);
      const double along = glm::dot(center - ray.origin, direction);
      const double rest = 1 - squared_length(center - ray.origin) + along * along;
      if (std::abs(rest) < 1e-3) return;  // at the outline
      if (rest < 0) {
        EXPECT_EQ(depth, infinity);
        return;
      }
      const double exact = (along - std::sqrt(rest)) * glm::dot(direction, view.forward);
      EXPECT_NEAR(depth, exact, 1e-4 / std::sqrt(rest));
    });
  }
}

// The hull of the cube from -1 to 1; its triangles run counterclockwise from outside.
TriangleMesh cube(std::uint32_t parts) {
  TriangleMesh mesh;
  for (int axis = 0; axis < 3; ++axis)
    for (const double sign : {-1.0, 1.0}) {
      dvec3 u(0), v(0), corner(0);
      u[(axis + 1) % 3] = v[(axis + 2) % 3] = 2;
      corner[axis] = sign;
      corner -= 0.5 * (u + v);
      const TriangleMesh side = sign > 0 ? test::plate(corner, u, v, parts) : test::plate(corner, v, u, parts);
      const auto first = static_cast<std::uint32_t>(mesh.points.size());
      mesh.points.insert(mesh.points.end(), side.points.begin(), side.points.end());
      for (const auto& [a, b, c] : side.triangles) mesh.triangles.push_back({first + a, first + b, first + c});
    }
  return mesh;
}

TriangleMesh turned(TriangleMesh mesh) {
  for (auto& [a, b, c] : mesh.triangles) std::swap(b, c);
  return mesh;
}

Surface patch_of(TriangleMesh mesh, NearSide near_side, double opacity = 1) {
  return {{.opacity = opacity, .boundary = "p", .near_side = near_side},
          std::make_shared<const TriangleMesh>(std::move(mesh))};
}

// Where a ray enters the cube and leaves it; infinity: nowhere in front of the eye.
std::array<double, 2> depths_of_cube(const Ray& ray) {
  double enter = -infinity, leave = infinity;
  for (int axis = 0; axis < 3; ++axis) {
    const double a = (-1 - ray.origin[axis]) / ray.direction[axis], b = (1 - ray.origin[axis]) / ray.direction[axis];
    enter = std::max(enter, std::min(a, b)), leave = std::min(leave, std::max(a, b));
  }
  if (leave < std::max(enter, 0.0)) return {infinity, infinity};
  return {enter > 0 ? enter : infinity, leave};
}

// Views from outside, along an axis too, and from inside.
std::vector<View> views_of_cube() {
  std::vector<View> views;
  for (const bool orthographic : {false, true})
    for (const dvec3 eye : {dvec3(1.7, 2.1, -2.9), dvec3(0, 0, 4), dvec3(0.3, 0.2, 0.4)})
      views.push_back(view_from(eye, {0, 0, -0.1}, orthographic));
  return views;
}

// Calls check(enter, leave, pixel) for each pixel that is not at the cube's outline.
template <class Check>
void for_each_pixel_of_cube(const View& view, const Check& check) {
  int hit = 0;
  for (int row = 0; row < view.height; ++row)
    for (int x = 0; x < view.width; ++x) {
      const Ray ray = ray_of(view, x, row);
      const auto [enter, leave] = depths_of_cube(ray);
      if (enter < infinity && leave - enter < 0.01) continue;
      if (leave < infinity) ++hit;
      check(enter, leave, static_cast<std::size_t>(row) * view.width + x);
    }
  EXPECT_GT(hit, 500);
}

void expect_depth(const SurfaceLayer& layer, std::size_t pixel, double depth) {
  const double drawn = layer.depths.depths[pixel];
  EXPECT_TRUE(depth == infinity ? drawn == depth : std::abs(drawn / depth - 1) < 1e-6) << drawn << ", not " << depth;
}

TEST(NearSides, AHullOpensTowardsTheEye) {
  for (const View& view : views_of_cube()) {
    const auto hidden = draw({patch_of(cube(3), NearSide::hidden)}, view);
    const auto translucent = draw({patch_of(cube(3), NearSide::translucent)}, view);
    const auto shown = draw({patch_of(cube(3), NearSide::shown)}, view);
    ASSERT_EQ(hidden.layers.size(), 1U);
    ASSERT_EQ(shown.layers.size(), 1U);
    int near = 0;
    for_each_pixel_of_cube(view, [&](double enter, double, std::size_t) { near += enter < infinity ? 1 : 0; });
    ASSERT_EQ(translucent.layers.size(), near > 0 ? 2U : 1U);
    for_each_pixel_of_cube(view, [&](double enter, double leave, std::size_t pixel) {
      expect_depth(hidden.layers[0], pixel, leave);
      expect_depth(shown.layers[0], pixel, std::min(enter, leave));
      expect_depth(translucent.layers[0], pixel, std::min(enter, leave));
      expect_depth(translucent.layers.back(), pixel, leave);
      EXPECT_EQ(hidden.layers[0].light.pixels[pixel].a, leave < infinity ? 1 : 0);
      EXPECT_EQ(translucent.layers.back().light.pixels[pixel], hidden.layers[0].light.pixels[pixel]);
      if (enter == infinity) return;
      EXPECT_EQ(translucent.layers[0].light.pixels[pixel], 0.25F * shown.layers[0].light.pixels[pixel]);
    });
  }
}

TEST(NearSides, TakeAQuarterOfTheOpacity) {
  const View view = view_from({1.7, 2.1, -2.9}, dvec3(0), false);
  const auto drawn = draw({patch_of(cube(2), NearSide::translucent, 0.5)}, view);
  ASSERT_GE(drawn.layers.size(), 2U);
  for_each_pixel_of_cube(view, [&](double enter, double, std::size_t pixel) {
    EXPECT_EQ(drawn.layers[0].light.pixels[pixel].a, enter < infinity ? 0.125F : 0.0F);
    EXPECT_EQ(drawn.layers[1].light.pixels[pixel].a, enter < infinity ? 0.5F : 0.0F);
  });
}

// Outside of a flow is inside of the body in it.
TEST(NearSides, ABodyInAFlowStaysWhole) {
  for (const View& view : views_of_cube()) {
    if (depths_of_cube(ray_of(view, view.width / 2, view.height / 2))[0] == infinity) continue;  // inside
    const auto shown = draw({patch_of(turned(cube(3)), NearSide::shown)}, view);
    for (const NearSide near_side : {NearSide::translucent, NearSide::hidden}) {
      const auto drawn = draw({patch_of(turned(cube(3)), near_side)}, view);
      ASSERT_GE(drawn.layers.size(), 1U);
      for_each_pixel_of_cube(view, [&](double enter, double, std::size_t pixel) {
        expect_depth(drawn.layers[0], pixel, enter);
        EXPECT_EQ(drawn.layers[0].light.pixels[pixel], shown.layers[0].light.pixels[pixel]);
      });
    }
  }
}

// Cells are on both sides of a baffle: which way round its triangles run means nothing.
TEST(NearSides, TwoSidedTrianglesAndFilesAreAlwaysShown) {
  const View view = view_from({1.7, 2.1, -2.9}, dvec3(0), false);
  const auto shown = draw({patch_of(cube(3), NearSide::shown)}, view).layers.at(0).depths.depths;
  TriangleMesh baffles = cube(3);
  baffles.two_sided.assign(baffles.triangles.size(), true);
  EXPECT_EQ(draw({patch_of(baffles, NearSide::hidden)}, view).layers.at(0).depths.depths, shown);
  Surface file = patch_of(cube(3), NearSide::hidden);
  file.style.file = "f", file.style.boundary.clear();
  EXPECT_EQ(draw({file}, view).layers.at(0).depths.depths, shown);
  // The side at x = 1 alone is two-sided: it is what is seen there.
  for (std::size_t i = 0; i < baffles.triangles.size(); ++i) baffles.two_sided[i] = middle_of(baffles, i).x > 0.999;
  const auto some = draw({patch_of(baffles, NearSide::hidden)}, view).layers.at(0);
  int at_side = 0;
  for_each_pixel_of_cube(view, [&](double enter, double leave, std::size_t pixel) {
    const Ray ray = ray_of(view, static_cast<int>(pixel) % view.width, static_cast<int>(pixel) / view.width);
    const bool is_side = enter < infinity && std::abs((ray.origin + enter * ray.direction).x - 1) < 1e-9;
    expect_depth(some, pixel, is_side ? enter : leave);
    if (is_side) ++at_side;
  });
  EXPECT_GT(at_side, 100);
}

// A closed surface has no holes, and no ray meets two triangles at a common edge or vertex: each ray passes it twice.
// Pixel centres lie on edges and vertices: the eye is on the axis of the ball, and sizes are odd.
TEST(DrawSurfaces, EachRayMeetsOneTriangleOfAnEdge) {
  for (const bool orthographic : {false, true})
    for (const dvec3 eye : {dvec3(0, 0, 4), dvec3(4, 0, 0), dvec3(0.01, 4, 0), dvec3(1.7, 2.1, -2.9)})
      for (const std::uint32_t rings : {4u, 32u, 500u}) {
        View view = view_from(eye, dvec3(0), orthographic);
        if (orthographic) view.focal = 32;  // pixels for a unit: vertices at pixel centres
        const auto drawn = draw({surface_of(ball(dvec3(0), 1, rings), 0.5)}, view);
        ASSERT_EQ(drawn.layers.size(), 3u) << "front, back, and what is behind";
        int hit = 0;
        for (std::size_t i = 0; i < drawn.layers[0].depths.depths.size(); ++i) {
          const float front = drawn.layers[0].depths.depths[i], back = drawn.layers[1].depths.depths[i];
          EXPECT_EQ(front < infinity, back < infinity) << i;
          EXPECT_LE(front, back);
          hit += front < infinity ? 1 : 0;
        }
        EXPECT_GT(hit, 1000);
      }
}

TEST(DrawSurfaces, FromInsideThereIsNoHole) {
  for (const bool orthographic : {false, true})
    for (const dvec3 eye : {dvec3(0, 0, 0.5), dvec3(0.3, -0.2, 0.4)}) {
      View view = view_from(eye, {0.1, 0.05, -1}, orthographic);
      if (orthographic) view.focal = 300;
      for (const std::uint32_t rings : {3u, 64u}) {
        const auto drawn = draw({surface_of(ball(dvec3(0), 2, rings))}, view);
        ASSERT_EQ(drawn.layers.size(), 1u);
        for (const float depth : drawn.layers[0].depths.depths) EXPECT_LT(depth, 4);
      }
    }
}

TEST(DrawSurfaces, NothingIsBehindTheEyeOrHidden) {
  const View view = view_from({0, 0, 4}, dvec3(0), false);
  const TriangleMesh behind = test::plate({-9, -9, 5}, {18, 0, 0}, {0, 18, 0});
  EXPECT_TRUE(draw({surface_of(behind)}, view).layers.empty());
  EXPECT_TRUE(draw({}, view).layers.empty());
  Surface off = surface_of(ball(dvec3(0), 1, 8));
  off.style.shown = false;
  EXPECT_TRUE(draw({off}, view).layers.empty());
  Surface clear = surface_of(ball(dvec3(0), 1, 8), 0);
  EXPECT_TRUE(draw({clear}, view).layers.empty());
}

TEST(DrawSurfaces, AClipBoxCutsThem) {
  View view = view_from({0, 0, 4}, dvec3(0), false);
  view.clip.box = Box{{0, -5, -5}, {5, 5, 0}};
  const TriangleMesh mesh = test::plate({-1, -1, 0}, {2, 0, 0}, {0, 2, 0});  // in a face of the box
  const auto drawn = draw({surface_of(mesh)}, view);
  ASSERT_EQ(drawn.layers.size(), 1u);
  int hit = 0;
  for_each_pixel(view, drawn.layers[0], [&](const Ray& ray, float depth, const vec4&) {
    EXPECT_TRUE(depth == infinity || ray.direction.x >= 0);
    hit += depth < infinity ? 1 : 0;
  });
  EXPECT_GT(hit, 500);
}

// A slice with one value everywhere, of a grey function.
SlicePicture slice_of(const View& view, const Plane& plane, double opacity, double value) {
  TransferFunction function{.colors = {{0, dvec3(0)}, {1, dvec3(1)}}, .densities = {{0, 0}}};
  std::vector<double> depths = slice_depths(view, plane);
  const std::vector<double> values(depths.size(), value);
  return color_slice(view, {plane, opacity}, std::move(depths), values, function);
}

TEST(Slices, DepthsAreThoseOfThePlane) {
  for (const bool orthographic : {false, true})
    for (const dvec3 center : {dvec3(0), dvec3(1e7, -1e7, 1e6)}) {
      const View view = view_from(center + dvec3(0.3, 0.5, 4), center, orthographic);
      const Plane plane = make_plane(center + dvec3(0.1, 0, 0), {0.3, -5, 1});
      const std::vector<double> depths = slice_depths(view, plane);
      int met = 0;
      for (int row = 0; row < view.height; ++row)
        for (int x = 0; x < view.width; ++x) {
          const Ray ray = ray_of(view, x, row);
          const double depth = depths[static_cast<std::size_t>(row) * view.width + x];
          const bool before = plane.distance(ray.origin) * glm::dot(plane.normal, ray.direction) < 0;
          ASSERT_EQ(std::isfinite(depth), before);
          if (!before) continue;
          ++met;
          // Rounding of the eye's coordinates, over the sine of the angle between ray and plane.
          EXPECT_NEAR(plane.distance(ray.origin + depth * ray.direction), 0, 1e-8 * (1 + std::abs(depth)));
        }
      EXPECT_GT(met, 3000);
    }
}

TEST(Slices, APlaneThroughTheEyeOrBehindItShowsNothing) {
  const View view = view_from({0, 0, 4}, dvec3(0), false), parallel = view_from({0, 0, 4}, dvec3(0), true);
  const auto shows = [](const View& from, const Plane& plane) {
    const std::vector<double> depths = slice_depths(from, plane);
    return std::ranges::any_of(depths, [](double depth) { return std::isfinite(depth); });
  };
  EXPECT_FALSE(shows(view, make_plane({0, 0, 4}, {1, 2, 3})));
  EXPECT_FALSE(shows(view, make_plane({0, 0, 4.5}, {0, 0, 1})));
  EXPECT_FALSE(shows(parallel, make_plane({0, 0.2, 0}, {0, 1, 0}))) << "edge on";
  EXPECT_FALSE(shows(parallel, make_plane({0, 0, 4.5}, {0, 0, 1})));
  EXPECT_TRUE(shows(view, make_plane({0, 0.2, 0}, {0, 1, 0})));
  EXPECT_TRUE(shows(parallel, make_plane({0, 0, 4.5}, {0, 1, 1}))) << "a part in front of the eye";
}

TEST(Slices, AreCutByTheClipRegionAndShowInItsFaces) {
  View view = view_from({0, 0, 4}, dvec3(0), false);
  const Plane face = make_plane({0.2, 0.1, 0}, {0.1, -0.2, -1});
  view.clip.planes = {face, make_plane({0, 0, 0}, {1, 0, 0})};
  const SlicePicture slice = slice_of(view, face, 1, 0.5);
  const auto drawn = draw_surfaces({}, std::span(&slice, 1), view);
  ASSERT_EQ(drawn.layers.size(), 1u);
  for_each_pixel(view, drawn.layers[0], [&](const Ray& ray, float depth, const vec4& light) {
    if (std::abs(ray.direction.x) < 1e-9) return;  // in the other plane
    const double x = (ray.origin + static_cast<double>(depth) * ray.direction).x;
    EXPECT_EQ(std::isfinite(depth), ray.direction.x > 0) << "the other plane cuts it";
    EXPECT_TRUE(depth == infinity || x > -1e-6);
    EXPECT_EQ(light.r, ray.direction.x > 0 ? 0.5F : 0);
  });
}

TEST(Slices, TheyAndSurfacesAreSortedByDepth) {
  const View view = view_from({0, 0, 4}, dvec3(0), true);
  // Two slices that cross each other, one translucent, with a translucent plate behind both and an opaque one between.
  const std::vector<SlicePicture> slices{slice_of(view, make_plane(dvec3(0), {1, 0, 1}), 0.5, 1),
                                         slice_of(view, make_plane(dvec3(0), {-1, 0, 1}), 1, 0.25)};
  const Surface plate = surface_of(test::plate({-9, -9, 0.5}, {18, 0, 0}, {0, 18, 0}), 0.5, {0, 1, 0});
  const auto drawn = draw_surfaces(std::span(&plate, 1), slices, view);
  ASSERT_GE(drawn.layers.size(), 2u);
  for (int row = 5; row < view.height; row += 11)
    for (int x = 0; x < view.width; x += 7) {
      const double at = ray_of(view, x, row).origin.x;  // depths: 4 + at, 4 - at, 3.5
      std::vector<std::pair<double, float>> expected{{4 + at, 0.5F}, {3.5, 0.5F}};
      if (at < 0) expected = {{4 + at, 0.5F}, {3.5, 0.5F}};
      std::ranges::sort(expected);
      std::erase_if(expected, [&](const auto& hit) { return hit.first > 4 - at; });  // behind the opaque one
      expected.emplace_back(4 - at, 1.0F);
      ASSERT_GE(drawn.layers.size(), expected.size());
      for (std::size_t i = 0; i < expected.size(); ++i) {
        const auto pixel = static_cast<std::size_t>(row) * view.width + x;
        EXPECT_NEAR(static_cast<double>(drawn.layers[i].depths.depths[pixel]), expected[i].first, 1e-5);
        EXPECT_EQ(drawn.layers[i].light.at(x, row).a, expected[i].second);
      }
    }
}

TEST(Slices, ColoursAreThoseOfTheFunctionTimesTheOpacity) {
  const View view = view_from({0, 0, 4}, dvec3(0), false, 4, 1);
  TransferFunction function;
  function.lo = 10, function.hi = 20;
  function.colors = {{0, {1, 0, 0}}, {1, {0, 0, 1}}};
  function.densities = {{0, 0}, {1, 0}};
  const Plane plane = make_plane(dvec3(0), {0, 0, 1});
  const std::vector<double> values{5, 15, std::numeric_limits<double>::quiet_NaN(), 20};
  const SlicePicture slice = color_slice(view, {plane, 0.5}, slice_depths(view, plane), values, function);
  EXPECT_EQ(slice.light.at(0, 0), vec4(0.5F, 0, 0, 0.5F));
  EXPECT_EQ(slice.light.at(1, 0), vec4(0.25F, 0, 0.25F, 0.5F));
  EXPECT_EQ(slice.light.at(2, 0), vec4(0));
  EXPECT_TRUE(std::isinf(slice.depths[2]));
  EXPECT_EQ(slice.light.at(3, 0), vec4(0, 0, 0.5F, 0.5F));
}

TEST(DrawSurfaces, EdgesAreDarkLines) {
  const View view = view_from({0.1, 0.2, 4}, dvec3(0), false, 200, 200);
  Surface surface = surface_of(test::plate({-1, -1, 0}, {2, 0, 0}, {0, 2, 0}, 4));
  const auto plain = draw({surface}, view);
  surface.style.edges = true;
  const auto lined = draw({surface}, view);
  int same = 0, dark = 0;
  for (std::size_t i = 0; i < plain.layers[0].light.pixels.size(); ++i) {
    if (plain.layers[0].light.pixels[i].a == 0) continue;
    const float share = lined.layers[0].light.pixels[i].r / plain.layers[0].light.pixels[i].r;
    same += share == 1 ? 1 : 0;
    dark += share < 0.5F ? 1 : 0;
  }
  EXPECT_GT(same, 5 * dark);
  EXPECT_GT(dark, 400) << "12 lines of about 60 pixels";
}

TEST(DrawSurfaces, ThreadsChangeNothing) {
  std::vector<Surface> surfaces;
  for (int i = 0; i < 3; ++i) surfaces.push_back(surface_of(ball(dvec3(0.2 * i), 1, 150), i == 1 ? 0.5 : 1));
  surfaces.push_back(surfaces[0]);  // the same places again
  surfaces.back().style.color = {1, 0, 0};
  const View view = view_from({1, 2, 4}, dvec3(0), false);
  const SurfaceLayers many = draw(surfaces, view);
  const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
  const SurfaceLayers single = draw(surfaces, view);
  ASSERT_EQ(many.layers.size(), single.layers.size());
  for (std::size_t i = 0; i < many.layers.size(); ++i) {
    EXPECT_EQ(many.layers[i].depths.depths, single.layers[i].depths.depths);
    EXPECT_EQ(many.layers[i].light.pixels, single.layers[i].light.pixels);
  }
}

// Plates one behind the other, in a uniform fog: the picture is a product.
struct Plates : testing::Test {
  static constexpr double extinction = 0.4, fog_end = 10;
  const View view = view_from({0, 0, 5}, dvec3(0), true, 9, 9);

  // The fog from the eye to these depths, white.
  [[nodiscard]] Image fog(const SurfaceDepths& depths) const {
    Image image{view.width, view.height, {}};
    for (const float depth : depths.depths) {
      const auto alpha = static_cast<float>(-std::expm1(-extinction * std::min(double(depth), fog_end)));
      image.pixels.emplace_back(alpha);
    }
    return image;
  }

  [[nodiscard]] vec4 middle(const SurfaceLayers& drawn) const {
    SurfaceComposite composite;
    for (const SurfaceLayer& layer : drawn.layers) composite.add(fog(layer.depths), layer);
    return composite.finish().at(4, 4);
  }

  // A plate across the view, at this distance from the eye.
  static Surface plate_at(double depth, double opacity, dvec3 color = dvec3(0.25)) {
    return surface_of(test::plate({-9, -9, 5 - depth}, {18, 0, 0}, {0, 18, 0}), opacity, color);
  }
};

TEST_F(Plates, AreSortedIntoTheVolume) {
  for (const double last : {1.0, 0.7}) {
    // Not in their order.
    const auto drawn = draw({plate_at(4, last), plate_at(1, 0.5), plate_at(6, 0.9), plate_at(2, 0.25)}, view);
    EXPECT_EQ(drawn.layers.size(), last == 1 ? 3u : 5u);
    double light = 0, passes = 1, depth = 0;
    const auto add_fog = [&](double to) {
      const double kept = std::exp(-extinction * (to - depth));
      light += passes * (1 - kept), passes *= kept, depth = to;
    };
    const auto add_plate = [&](double at, double opacity) {
      add_fog(at);
      light += passes * opacity * 0.25, passes *= 1 - opacity;
    };
    add_plate(1, 0.5), add_plate(2, 0.25), add_plate(4, last), add_plate(6, 0.9), add_fog(fog_end);
    const vec4 pixel = middle(drawn);
    EXPECT_NEAR(pixel.r, light, 1e-6);
    EXPECT_NEAR(pixel.a, 1 - passes, 1e-6);
    EXPECT_EQ(pixel.a == 1, last == 1) << "exactly";
  }
}

TEST_F(Plates, TooManyLayersAreJoined) {
  std::vector<Surface> plates;
  for (int i = 1; i <= 6; ++i) plates.push_back(plate_at(i, 0.3, {0.1 * i, 0, 0}));
  plates.push_back(plate_at(7, 1, {0, 1, 0}));
  EXPECT_FALSE(draw(plates, view, 6).is_joined);
  const auto drawn = draw(plates, view, 2);
  EXPECT_TRUE(drawn.is_joined);
  ASSERT_EQ(drawn.layers.size(), 3u);
  // Without fog all is in its order.
  SurfaceComposite composite;
  for (const SurfaceLayer& layer : drawn.layers) composite.add({9, 9, std::vector<vec4>(81, vec4(0))}, layer);
  double red = 0, passes = 1;
  for (int i = 1; i <= 6; ++i) red += passes * 0.3 * 0.1 * i, passes *= 0.7;
  const vec4 pixel = composite.finish().at(4, 4);
  EXPECT_NEAR(pixel.r, red, 1e-6);
  EXPECT_NEAR(pixel.g, passes, 1e-6);
  EXPECT_EQ(pixel.a, 1);
}

}  // namespace
}  // namespace splatvol::test
