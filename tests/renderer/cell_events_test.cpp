// Contours and slices in pictures of cells, against the exact ones and closed forms.
#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "tests/renderer/drawn_cells.h"
#include "tests/renderer/targets.h"

namespace splatvol::test {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

SceneColoring coloring() {
  return {"other", function_of_other({{0, {1, 0, 0.2}}, {0.4, {0, 1, 0}}, {0.7, {0.2, 0.3, 1}}, {1, {1, 1, 0}}}, {})};
}

// One opaque contour, and several translucent ones with all ways to colour them.
std::vector<std::vector<SceneContour>> contours() {
  return {{{.values = {0.55}, .color = dvec3(1, 0.8, 0.3)}},
          {{.values = {0.3, 0.62}, .opacity = 0.4},
           {.values = {0.45}, .color_by = coloring(), .opacity = 0.7},
           {.values = {0.75, -3, 1.4}, .color = dvec3(1), .opacity = 0.2}}};
}

TEST(Contours, AreExactWithAndWithoutMatter) {
  const Mesh mesh = bent_box(7);
  for (const auto& all : contours())
    for (const double extinction : {0.0, 3.0})
      for (const dvec3 eye : {dvec3(2.3, 1.9, 3.1), dvec3(0.41, 0.63, 0.57)})
        for (const bool orthographic : {false, true}) {
          SCOPED_TRACE(testing::Message() << all.size() << " " << extinction << " from " << eye.x
                                          << (orthographic ? " orthographic" : ""));
          Drawn drawn{mesh, wide_scene(extinction, eye, orthographic)};
          drawn.scene.contours = all;
          drawn.color_values = other_values(mesh);
          expect_exact(drawn, 1e-5, 1e-3);
        }
}

TEST(Contours, AreExactBesideAllElse) {
  for (const auto& all : contours())
    for (const bool orthographic : {false, true}) {
      Drawn drawn{bent_box(6), colored_scene(4)};
      drawn.scene.contours = all;
      drawn.color_values = other_values(drawn.mesh);
      if (orthographic) make_orthographic(drawn.scene, 1.5);
      drawn.scene.lighting = Lighting{0.2, 0.7};
      drawn.scene.opacity =
          SceneOpacity{"other", function_of_other({{0, dvec3(1)}}, {{0, 0}, {0.3, 0}, {0.6, 1}, {0.8, 0.1}})};
      drawn.opacity_values = other_values(drawn.mesh);
      drawn.scene.clip_box = Box{{0.15, 0.2, 0.1}, {0.83, 0.77, 0.9}};
      drawn.scene.clip_planes = {{{0.5, 0.5, 0.5}, {1, -0.6, 0.3}, true}};
      drawn.mesh.values[100] = nan;
      drawn.color_values[150] = nan;
      expect_exact(drawn, 1e-5, 1e-3);
      drawn.surfaces = SurfaceDepths{drawn.scene.width, drawn.scene.height, {}};
      for (int i = 0; i < drawn.scene.width * drawn.scene.height; ++i)
        drawn.surfaces->depths.push_back(3.0F + 0.01F * static_cast<float>(i % 97));
      expect_exact(drawn, 1e-5, 1e-3);
    }
}

TEST(Contours, OnBentAxesAndFarFromTheDomain) {
  Drawn drawn{bent_box(6), colored_scene(4)};
  auto& function = drawn.scene.transfer_function;
  function.lo = 0.4, function.hi = 0.4001;
  drawn.scene.contours = {{.values = {0.2, 0.7}, .opacity = 0.6}};
  expect_exact(drawn, 1e-4, 5e-3);
  function.hi = 1;
  function.axis = ValueAxis::log;
  expect_exact(drawn, 2e-5, 1e-3);
}

// The alpha of pixels whose rays meet a plane once.
void expect_plane(const Drawn& drawn, double x, double opacity) {
  int way_of_drawing = 0;
  for (const Image& image : {truth(drawn), draw(MeshSource(drawn.view(), 100000), drawn.drawing()),
                             draw(MeshSource(drawn.view(), 60), drawn.drawing())}) {
    SCOPED_TRACE(way_of_drawing++);
    for_each_ray(drawn.scene, image, [&](const WorldRay& ray, const vec4& pixel) {
      const dvec3 place = ray.origin + (x - ray.origin.x) / ray.direction.x * ray.direction;
      const double margin = std::min({place.y, place.z, 1 - place.y, 1 - place.z});
      if (std::abs(margin) < 1e-6) return;
      EXPECT_NEAR(pixel.a, margin > 0 ? opacity : 0, 1e-6);
    });
  }
}

// Rays run along faces and edges, and the contour is made of faces: each of them has two cells.
TEST(Contours, OnFacesCountOnce) {
  for (const bool orthographic : {false, true})
    for (const dvec3 eye : {dvec3(4, 0.5, 0.5), dvec3(-3, 0.5, 0.5), dvec3(2.5, 2.5, 2.5), dvec3(2.3, 1.9, 3.1)})
      for (const double size : {1.0, 1e6}) {
        SCOPED_TRACE(testing::Message() << eye.x << " " << eye.y << (orthographic ? " orthographic" : ""));
        Drawn drawn{make_box(8, [&](dvec3 p) { return size * p.x; }), make_scene(0, 33, 33)};
        drawn.scene.transfer_function.hi = 2 * size;
        look(drawn.scene, eye, dvec3(0.5));
        if (orthographic) make_orthographic(drawn.scene, 1.1);
        for (const double x : {0.5, 0.25, 0.3}) {
          drawn.scene.contours = {{.values = {size * x}, .opacity = 0.5}};
          expect_plane(drawn, x, 0.5);
        }
      }
}

// It is the border of what is at least as high.
TEST(Contours, OfTheValueOfARegionAreItsBorder) {
  const auto drawn_of = [](const Field& field) {
    Drawn drawn{make_box(8, field), make_scene(0, 32, 32)};
    look(drawn.scene, {4, 0.45, 0.55}, dvec3(0.5));
    drawn.scene.contours = {{.values = {0.6}, .opacity = 0.5}};
    return drawn;
  };
  expect_plane(drawn_of([](dvec3 p) { return p.x <= 0.5 ? 0.6 : 1.1 - p.x; }), 0.5, 0.5);
  expect_plane(drawn_of([](dvec3 p) { return p.x <= 0.5 ? 0.6 : 0.1 + p.x; }), 0.5, 0);
  expect_plane(drawn_of([](dvec3) { return 0.6; }), 0.5, 0);
  expect_plane(drawn_of([](dvec3 p) { return p.x <= 0.5 ? 0.6 - 1e-12 : 0.1 + p.x; }), 0.5, 0.5);
}

// A mesh of moved points, with values of a field there.
Mesh moved_box(std::uint32_t n, const Field& field) {
  Mesh mesh = bent_box(n);
  for (std::size_t i = 0; i < mesh.points.size(); ++i) mesh.values[i] = field(mesh.points[i]);
  return mesh;
}

TEST(Contours, AreLitByTheirGradients) {
  for (const bool is_lit : {false, true}) {
    Drawn drawn{moved_box(4, [](dvec3 p) { return p.x; }), make_scene(0, 32, 32)};
    look(drawn.scene, {4, 1.5, 2.5}, dvec3(0.5));
    if (is_lit) drawn.scene.lighting = Lighting{0.1, 0.6};
    const Lighting lighting = drawn.scene.lighting.value_or(Lighting());
    drawn.scene.contours = {{.values = {0.4}, .color = dvec3(1, 0.5, 0.25)}};
    int met = 0;
    for (const Image& image : {truth(drawn), draw(MeshSource(drawn.view(), 100), drawn.drawing())})
      for_each_ray(drawn.scene, image, [&](const WorldRay& ray, const vec4& pixel) {
        if (pixel.a == 0) return;
        ++met;
        const double light = lighting.factor(ray.direction, {1, 0, 0});
        EXPECT_LE(glm::distance(pixel, vec4(vec3(light * dvec3(1, 0.5, 0.25)), 1)), 1e-6);
      });
    EXPECT_GT(met, 100);
  }
}

// The light of a sphere's normals, but for the error of the mesh. By each tetrahedron's own gradient it would be .03.
TEST(Contours, AreLitSmoothly) {
  for (const bool orthographic : {false, true}) {
    Drawn drawn{moved_box(20, [](dvec3 p) { return glm::distance(p, dvec3(0.5)); }), make_scene(0, 64, 64)};
    look(drawn.scene, {1.6, 1.3, 1.9}, dvec3(0.5));
    if (orthographic) make_orthographic(drawn.scene, 0.8);
    drawn.scene.contours = {{.values = {0.3}, .color = dvec3(1)}};
    double squares = 0, met = 0;
    for_each_ray(drawn.scene, draw(MeshSource(drawn.view(), 100), drawn.drawing()),
                 [&](const WorldRay& ray, const vec4& pixel) {
                   const double middle = glm::dot(dvec3(0.5) - ray.origin, ray.direction);
                   const double square = 0.09 - squared_length(ray.origin + middle * ray.direction - dvec3(0.5));
                   if (square < 0.01) return;  // the sphere's edge
                   const dvec3 place = ray.origin + (middle - std::sqrt(square)) * ray.direction;
                   const double light = Lighting().factor(ray.direction, glm::normalize(place - dvec3(0.5)));
                   squares += (light - double{pixel.r}) * (light - double{pixel.r}), ++met;
                 });
    EXPECT_GT(met, 200);
    EXPECT_LT(std::sqrt(squares / met), 0.01) << (orthographic ? "orthographic" : "");
  }
}

TEST(Contours, InCellsOfOneValueShowNothing) {
  Drawn drawn{bent_box(3), colored_scene(0)};
  drawn.constant = true;
  drawn.mesh.values.assign(drawn.mesh.tetrahedra.size(), 0.5);
  drawn.mesh.values[0] = 0.9;
  drawn.scene.contours = {{.values = {0.5, 0.7}}};
  for (const vec4& pixel : draw(MeshSource(drawn.view(), 1000), drawn.drawing()).pixels) EXPECT_EQ(pixel, vec4(0));
  EXPECT_FALSE(render_reference(drawn.view(), drawn.scene));
}

TEST(Contours, ThatAreOpaqueHideChunks) {
  Drawn drawn{make_box(12, [](dvec3 p) { return p.z; }), colored_scene(0.5)};
  look(drawn.scene, {0.5, 0.5, 4}, dvec3(0.5));
  drawn.scene.camera.vertical_fov_degrees = 8;  // all rays meet the contour
  const auto reads = [&](double opacity) {
    drawn.scene.contours = {{.values = {0.9}, .opacity = opacity}};
    const CountingSource source(drawn.view(), 100);
    CellDrawing drawing = drawn.drawing();
    drawing.memory = 1 << 18;  // small batches
    draw(source, drawing);
    return source.reads.load();
  };
  EXPECT_LT(reads(1), reads(0.5) / 2);
}

TEST(Slices, HaveTheValuesOfTheirCells) {
  const Mesh mesh = bent_box(7);
  for (const double extinction : {0.0, 3.0})
    for (const double opacity : {1.0, 0.4})
      for (const dvec3 eye : {dvec3(2.3, 1.9, 3.1), dvec3(0.41, 0.63, 0.57)})
        for (const bool orthographic : {false, true}) {
          Drawn drawn{mesh, wide_scene(extinction, eye, orthographic)};
          SCOPED_TRACE(testing::Message()
                       << extinction << " " << opacity << " from " << eye.x << (orthographic ? " orthographic" : ""));
          drawn.mesh.values[100] = nan;
          drawn.scene.slices = {{.point = dvec3(0.4), .normal = {1, 0.3, -0.2}, .opacity = opacity},
                                {.point = dvec3(0.5), .normal = {-0.2, 0.9, 0.3}, .opacity = opacity},
                                {.point = dvec3(0.6), .normal = {0.2, 0.1, 0.9}, .opacity = opacity}};
          expect_exact(drawn, 1e-5, 2e-3);
          drawn.scene.contours = contours()[1];
          drawn.color_values = other_values(mesh);
          drawn.scene.clip_planes = {{{0.5, 0.5, 0.5}, {1, -0.6, 0.3}, true}};
          expect_exact(drawn, 1e-5, 2e-3);
          SceneOpacity by_other{"other", coloring().function};  // hides neither a slice nor a contour
          by_other.function.densities = {{0, 0}, {0.5, 0}, {1, 1}};
          drawn.scene.opacity = by_other;
          drawn.opacity_values = other_values(mesh);
          drawn.opacity_values[200] = drawn.opacity_values[300] = nan;  // but the matter
          expect_exact(drawn, 1e-5, 2e-3);
        }
}

// A place on a face belongs to two cells: a slice that all of it lies on is drawn once, and whole.
TEST(Slices, InFacesOfCells) {
  for (const bool orthographic : {false, true})
    for (const double y : {0.0, 0.25, 1.0}) {
      Drawn drawn{make_box(8, curved), make_scene(0, 40, 40)};
      look(drawn.scene, {2.3, 2.9, 3.1}, dvec3(0.5));
      if (orthographic) make_orthographic(drawn.scene, 1.8);
      drawn.scene.slices = {{.point = {0, y, 0}, .normal = {0, 1, 0}, .opacity = 0.5}};
      for (const std::size_t cells : {100000, 60})
        for_each_ray(drawn.scene, draw(MeshSource(drawn.view(), cells), drawn.drawing()),
                     [&](const WorldRay& ray, const vec4& pixel) {
                       const double way = (y - ray.origin.y) / ray.direction.y;
                       const dvec3 place = ray.origin + way * ray.direction;
                       const double margin = std::min({place.x, place.z, 1 - place.x, 1 - place.z});
                       if (std::abs(margin) < 1e-4) return;
                       EXPECT_NEAR(pixel.a, margin > 0 ? 0.5 : 0, 1e-6);
                     });
    }
}

TEST(Slices, OfCellsOfOneValueEach) {
  Drawn drawn = with_values_of_cells({bent_box(5), colored_scene(4)});
  drawn.scene.slices = {{.point = dvec3(0.4), .normal = {1, 0.3, -0.2}, .opacity = 0.7}};
  expect_exact(drawn, 1e-5, 2e-3);
}

Drawn with_all() {
  Drawn drawn{bent_box(8), wide_scene(4, {0.5, 0.31, -0.3}, false)};
  drawn.scene.contours = contours()[1];
  drawn.color_values = other_values(drawn.mesh);
  drawn.scene.slices = {{.point = dvec3(0.4), .normal = {1, 0.3, -0.2}, .opacity = 0.6}};
  return drawn;
}

TEST(CellEvents, AreTheSameBitsForAnyThreadsMemoryAndOrder) { expect_same_bits(with_all()); }

TEST(CellEvents, AreAlikeForAllInstructionSets) {
  const Drawn drawn = with_all();
  const MeshSource source(drawn.view(), 1000);
  const Image first = draw(source, drawn.drawing());
  for_each_target([&] { EXPECT_LE(difference(draw(source, drawn.drawing()), first).rmse, 1e-6); });
}

}  // namespace
}  // namespace splatvol::test
