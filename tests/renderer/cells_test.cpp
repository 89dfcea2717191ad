// Pictures of cells against the exact ones, in double precision (renderer/reference).
#include "renderer/cpu/cells.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <random>

#include "renderer/cpu/cell_function.h"
#include "renderer/surfaces/draw_surfaces.h"
#include "tests/renderer/drawn_cells.h"
#include "tests/renderer/targets.h"
#include "tests/support/results.h"

namespace splatvol::test {
namespace {

TEST(Cells, AreExactFromOutsideAndInside) {
  const Mesh mesh = bent_box(8);
  for (const double extinction : {0.5, 20.0, 1e3, 1e6, 1e12, 1e39})
    for (const dvec3 eye : {dvec3(2.3, 1.9, 3.1), dvec3(0.41, 0.63, 0.57), dvec3(0.5, 0.31, -0.01)})
      for (const bool orthographic : {false, true}) {
        SCOPED_TRACE(testing::Message() << extinction << " from " << eye.x << (orthographic ? " orthographic" : ""));
        expect_exact({mesh, wide_scene(extinction, eye, orthographic)}, 1e-5, 1e-3);
      }
}

TEST(Cells, RoundAnEyeOnTheirBoundary) {
  const Mesh mesh = make_box(8, curved);
  for (const dvec3 eye : {dvec3(0.5, 0.5, 0.5), dvec3(0.53, 0.5, 0.5), dvec3(0.53, 0.52, 0.5)})
    for (const bool orthographic : {false, true}) {
      SCOPED_TRACE(testing::Message() << eye.x << " " << eye.y << (orthographic ? " orthographic" : ""));
      Drawn drawn{mesh, wide_scene(3, eye, orthographic)};
      look(drawn.scene, eye, eye + dvec3(1.5, 1, 2));
      expect_exact(drawn, 1e-5, 1e-3);
    }
}

TEST(Cells, OfALatticeCountOnce) {  // rays run along faces and edges, values of knots lie on faces
  for (const double size : {1.0, 1e6})
    for (const bool orthographic : {false, true}) {
      SCOPED_TRACE(testing::Message() << "size " << size << (orthographic ? " orthographic" : ""));
      Drawn drawn{make_box(8, [](dvec3 p) { return p.x; }), colored_scene(3 / size)};
      for (dvec3& point : drawn.mesh.points) point *= size;
      drawn.scene.width = drawn.scene.height = 64;
      look(drawn.scene, size * dvec3(0.5, 0.5, 4), dvec3(0.5 * size));
      if (orthographic) make_orthographic(drawn.scene, size);
      expect_exact(drawn, 1e-5, 1e-4);
      look(drawn.scene, size * dvec3(4, 0.5, 0.5), dvec3(0.5 * size));
      expect_exact(drawn, 1e-5, 1e-4);
    }
}

// Pixels lie 1/16 apart from the centre of a box with vertices 1/4 apart.
TEST(Cells, OnRaysAlongTheirEdgesCountOnce) {
  for (const bool orthographic : {false, true})
    for (const dvec3 direction : {dvec3(0, 0, 1), dvec3(0, 0, -1), dvec3(0, 1, 0), dvec3(0, -1, 0), dvec3(1, 0, 0),
                                  dvec3(-1, 0, 0), dvec3(1, 1, 1), dvec3(-1, -1, -1), dvec3(1, -1, 0)}) {
      SCOPED_TRACE(testing::Message() << direction.x << direction.y << direction.z << orthographic);
      Drawn drawn{make_box(4, [](dvec3 p) { return p.x; }), make_scene(3, 15, 15)};
      drawn.scene.camera.vertical_fov_degrees = 13;
      if (orthographic) make_orthographic(drawn.scene, 15.0 / 16);
      look(drawn.scene, dvec3(0.5) - 4.0 * direction, dvec3(0.5), direction.y == 0 ? dvec3(0, 1, 0) : dvec3(0, 0, 1));
      expect_exact(drawn, 1e-6, 1e-5);
    }
}

TEST(Cells, ShowNarrowPeaks) {
  const Mesh mesh = bent_box(6);
  for (const double width : {1e-2, 1e-3, 1e-4, 1e-6, 1e-7, 1e-9}) {
    SCOPED_TRACE(width);
    Drawn drawn{mesh, colored_scene(1)};
    drawn.scene.transfer_function.densities = {{0, 0}, {0.6 - width, 0}, {0.6, 0.4 / width}, {0.6 + width, 0}, {1, 0}};
    expect_exact(drawn, 1e-4, 5e-3);
  }
}

TEST(Cells, ShowNarrowPeaksAtTheValueOfARegion) {
  for (const double width : {1e-2, 1e-5, 1e-7, 2e-7, 1e-9}) {
    SCOPED_TRACE(width);
    const double value = 0.6 + 0.4 * width;
    Drawn drawn{bent_box(6, [&](dvec3 p) { return p.x < 0.4 ? value : curved(p); }), colored_scene(1)};
    drawn.scene.transfer_function.densities = {{0, 0}, {0.6 - width, 0}, {0.6, 0.4 / width}, {0.6 + width, 0}, {1, 0}};
    expect_exact(drawn, 1e-4, 5e-3);
  }
}

TEST(Cells, ShowFunctionsOfManyPiecesAndBentAxes) {
  Drawn drawn{bent_box(6), colored_scene(4)};
  std::mt19937 random(5);
  std::uniform_real_distribution<double> any(0, 1);
  auto& function = drawn.scene.transfer_function;
  function.colors.clear();
  function.densities.clear();
  for (int i = 0; i <= 60; ++i) {
    function.colors.push_back({i / 60.0, {any(random), any(random), any(random)}});
    function.densities.push_back({i / 60.0, 10 * any(random)});
  }
  function.densities.insert(function.densities.begin() + 30, function.densities[30]);  // a jump
  function.densities[30].extinction = 40;
  expect_exact(drawn, 1e-5, 1e-3);
  function.lo = 0.1;
  function.axis = ValueAxis::log;
  expect_exact(drawn, 2e-5, 1e-3);
  function.axis = ValueAxis::asinh;
  function.linear_width = 0.05;
  expect_exact(drawn, 2e-5, 1e-3);
}

// Few pieces are kept in registers. Values lie on both sides of the domain.
TEST(Cells, ShowFunctionsOfAnyNumberOfPieces) {
  Drawn drawn{bent_box(4), colored_scene(4)};
  drawn.scene.width = drawn.scene.height = 32;
  auto& function = drawn.scene.transfer_function;
  function.lo = 0.2, function.hi = 0.6;
  for (int points = 1; points <= 40; ++points) {
    SCOPED_TRACE(points);
    function.densities.clear();
    for (int i = 0; i < points; ++i) function.densities.push_back({i / 50.0, 10.0 * ((7 * i + 3) % 11)});
    expect_exact(drawn, 2e-5, 1e-3);
  }
}

// Each piece that a ray crosses costs time.
TEST(Cells, TakeFewPiecesOfABentAxis) {
  TransferFunction function = wide_scene(4, {2.3, 1.9, 3.1}, false).transfer_function;
  function.densities = {{0, 0}, {0.5, 0}, {1, 1}};
  for (const ValueAxis axis : {ValueAxis::log, ValueAxis::asinh}) {
    function.axis = axis, function.lo = axis == ValueAxis::log ? 1 : -1e9, function.hi = 1e9, function.linear_width = 1;
    const tiles::FunctionPieces pieces(function);
    EXPECT_LE(pieces.count, 512u);
    double worst = 0;
    for (double t = 0.5; t < 1; t += 1e-4) {
      const double u = (function.value_at(t) - function.lo) / (function.hi - function.lo) - pieces.origin;
      const auto behind = std::ranges::upper_bound(pieces.starts, static_cast<float>(u));
      const auto piece = static_cast<std::size_t>(behind - pieces.starts.begin()) - 1;
      const double extinction = pieces.values[3][piece] + pieces.slopes[3][piece] * (u - pieces.starts[piece]);
      worst = std::max(worst, std::abs(extinction - function.extinction_at(t)));
    }
    EXPECT_LT(worst, 1e-4);
  }
}

TEST(Cells, AreLitByTheirGradients) {
  for (const dvec3 eye : {dvec3(2.3, 1.9, 3.1), dvec3(0.41, 0.63, 0.57)})
    for (const bool orthographic : {false, true}) {
      Drawn drawn{bent_box(6), wide_scene(4, eye, orthographic)};
      drawn.scene.lighting = Lighting{0.2, 0.7};
      expect_exact(drawn, 1e-5, 1e-3);
    }
}

TEST(Cells, HaveAnOpacityByAnotherAttribute) {
  for (const double extinction : {4.0, 1e4})
    for (const dvec3 eye : {dvec3(2.3, 1.9, 3.1), dvec3(0.41, 0.63, 0.57)})
      for (const bool orthographic : {false, true}) {
        Drawn drawn{bent_box(6), wide_scene(extinction, eye, orthographic)};
        drawn.scene.lighting = Lighting{0.2, 0.7};
        drawn.opacity_values = other_values(drawn.mesh);
        drawn.scene.opacity =
            SceneOpacity{"other", function_of_other({{0, dvec3(1)}}, {{0, 0}, {0.3, 0.2}, {0.6, 1}, {0.8, 0.1}})};
        expect_exact(drawn, 2e-5, 2e-3);
      }
}

TEST(Cells, AreCutByBoxesPlanesAndSurfaces) {
  for (const bool orthographic : {false, true}) {
    Drawn drawn{bent_box(6), colored_scene(4)};
    if (orthographic) make_orthographic(drawn.scene, 1.5);
    drawn.scene.clip_box = Box{{0.15, 0.2, 0.1}, {0.83, 0.77, 0.9}};
    drawn.scene.clip_planes = {{{0.5, 0.5, 0.5}, {1, -0.6, 0.3}, true}};
    expect_exact(drawn, 1e-5, 1e-3);
    drawn.surfaces = SurfaceDepths{drawn.scene.width, drawn.scene.height, {}};
    for (int i = 0; i < drawn.scene.width * drawn.scene.height; ++i)
      drawn.surfaces->depths.push_back(i % 5 == 0 ? std::numeric_limits<float>::infinity()
                                                  : 3.0F + 0.01F * static_cast<float>(i % 97));
    drawn.surfaces->depths[7] = std::numeric_limits<float>::quiet_NaN();
    drawn.surfaces->depths[8] = 0;
    expect_exact(drawn, 1e-5, 1e-3);
  }
}

// Layers of surfaces in each pixel: translucent ones, and an opaque one in a part of the picture.
struct Layers {
  std::vector<SurfaceLayer> all;

  Layers(int width, int height, std::size_t translucent) {
    std::mt19937 random(11);
    std::uniform_real_distribution<float> any(0, 1);
    for (std::size_t i = 0; i <= translucent; ++i) all.push_back({{width, height, {}}, {width, height, {}}});
    for (int pixel = 0; pixel < width * height; ++pixel) {
      const bool has_opaque = pixel % 3 == 0;
      const auto count = static_cast<std::size_t>(any(random) * static_cast<float>(translucent + 1));
      float depth = 2.6F + any(random);
      for (std::size_t i = 0; i <= translucent; ++i) {
        const bool is_one = i < count, is_opaque = !is_one && has_opaque;
        if (is_one || i == count) depth += 0.5F * any(random);
        const float opacity = is_one ? any(random) : is_opaque ? 1.0F : 0.0F;
        all[i].depths.depths.push_back(is_one || is_opaque ? depth : std::numeric_limits<float>::infinity());
        all[i].light.pixels.emplace_back(opacity * vec3(0.9F, 0.3F * static_cast<float>(pixel % 2), 0.5F), opacity);
      }
    }
  }
  [[nodiscard]] std::vector<CellLayer> drawn() const {
    std::vector<CellLayer> layers;
    for (const SurfaceLayer& layer : all) layers.push_back({&layer.depths, &layer.light});
    return layers;
  }
};

TEST(Cells, ShowSurfacesInTheirPlace) {
  for (const double extinction : {0.3, 4.0})
    for (const bool orthographic : {false, true}) {
      SCOPED_TRACE(testing::Message() << extinction << (orthographic ? " orthographic" : ""));
      Drawn drawn{bent_box(6), colored_scene(extinction)};
      drawn.scene.lighting = Lighting{0.2, 0.7};
      if (orthographic) make_orthographic(drawn.scene, 1.5);
      drawn.scene.clip_planes = {{{0.5, 0.5, 0.5}, {1, -0.6, 0.3}, true}};
      const Layers layers(drawn.scene.width, drawn.scene.height, 3);
      SurfaceComposite composite;
      for (const SurfaceLayer& layer : layers.all) {
        const auto in_front = value_of(render_reference(drawn.view(), drawn.scene, {.surface_depths = &layer.depths}));
        composite.add(in_front.image, layer);
      }
      CellDrawing drawing = drawn.drawing();
      drawing.layers = layers.drawn();
      const Image image = draw(MeshSource(drawn.view(), 100), drawing);
      const Difference error = difference(image, composite.finish());
      EXPECT_LE(error.rmse, 1e-5);
      EXPECT_LE(error.most, 1e-3);
      drawing.memory = 1 << 12;
      EXPECT_EQ(difference(draw(MeshSource(drawn.view(), 100), drawing), image).most, 0);
    }
}

TEST(Cells, BehindOpaqueSurfacesAreNotRead) {
  Drawn drawn{bent_box(8), colored_scene(0.5, {0.5, 0.5, 4})};
  look(drawn.scene, {0.5, 0.5, 4}, {0.5, 0.5, 0.5});
  const int width = drawn.scene.width, height = drawn.scene.height;
  const auto pixels = static_cast<std::size_t>(width * height);
  const SurfaceDepths middle{width, height, std::vector<float>(pixels, 3.2F)};
  const Image light{width, height, std::vector<vec4>(pixels, vec4(0, 1, 0, 1))};
  const CountingSource all(drawn.view(), 50), in_front(drawn.view(), 50), of_host(drawn.view(), 50);
  CellDrawing drawing = drawn.drawing();
  const Image without = draw(all, drawing);
  drawing.layers = {{&middle, &light}};
  const Image picture = draw(in_front, drawing);
  EXPECT_LT(in_front.reads, 0.7 * static_cast<double>(all.reads));
  for (const vec4& pixel : picture.pixels) EXPECT_EQ(pixel.a, 1.0F);
  drawing.layers = {{&middle}};
  const Image ended = draw(of_host, drawing);
  EXPECT_EQ(of_host.reads, in_front.reads);
  for (std::size_t i = 0; i < pixels; ++i) {
    EXPECT_LE(ended.pixels[i].a, without.pixels[i].a + 1e-5F);
    EXPECT_NEAR(picture.pixels[i].g, ended.pixels[i].g + 1 - ended.pixels[i].a, 1e-5F);
  }
}

// Nearly the same tetrahedron many times.
Drawn heap_of_cells(std::size_t count, int pixels) {
  Drawn drawn{{}, colored_scene(4.0 / static_cast<double>(count))};
  drawn.scene.width = drawn.scene.height = pixels;
  std::mt19937 random(3);
  std::uniform_real_distribution<double> any(0, 1);
  for (std::uint32_t i = 0; i < count; ++i) {
    for (const dvec3& corner : {dvec3(0), dvec3(1, 0, 0), dvec3(0, 1, 0), dvec3(0, 0, 1)}) {
      drawn.mesh.points.push_back(corner + 0.1 * dvec3(any(random), any(random), any(random)));
      drawn.mesh.values.push_back(any(random));
    }
    drawn.mesh.tetrahedra.push_back({4 * i, 4 * i + 1, 4 * i + 2, 4 * i + 3});
  }
  return drawn;
}

TEST(Cells, ThatOverlapByThousandsNeedLittleMemory) {
  const Drawn drawn = heap_of_cells(800, 16);
  expect_exact(drawn, 1e-5, 1e-3);
  const MeshSource source(drawn.view(), 500);
  CellDrawing drawing = drawn.drawing();
  const Image image = draw(source, drawing);
  drawing.memory = 1 << 12;
  EXPECT_EQ(difference(draw(source, drawing), image).most, 0);
}

TEST(Cells, ThatOverlapBeyondMemoryAreAnError) {
  const Drawn drawn = heap_of_cells(25000, 4);
  const MeshSource source(drawn.view(), 25000);
  CellDrawing drawing = drawn.drawing();
  drawing.memory = 1 << 12;
  CellRasterizer rasterizer;
  EXPECT_THAT(rasterizer.draw(source, drawing), FailsWith(ErrorCode::out_of_budget));
  drawing.memory = std::uint64_t{1} << 32;
  EXPECT_TRUE(rasterizer.draw(source, drawing));
}

TEST(Cells, OfOneValueEach) {
  Drawn drawn = with_values_of_cells({bent_box(5), colored_scene(4)});
  expect_exact(drawn, 1e-5, 1e-3);
  drawn.scene.lighting = Lighting{0.2, 0.7};
  expect_exact(drawn, 1e-5, 1e-3);
}

TEST(Cells, WithMissingFlatTurnedAndOverlappingOnes) {
  Drawn drawn{make_box(2, curved), colored_scene(4)};
  add_flat_cells(drawn.mesh);
  drawn.mesh.values[4] = std::numeric_limits<double>::quiet_NaN();
  for (std::size_t i = 0; i < drawn.mesh.tetrahedra.size(); i += 3)
    std::swap(drawn.mesh.tetrahedra[i][0], drawn.mesh.tetrahedra[i][1]);
  add_mesh(drawn.mesh, bent_box(3, [](dvec3 p) { return p.y; }), [](dvec3 p) { return p + dvec3(0.4, 0.1, 0.3); });
  expect_exact(drawn, 1e-5, 1e-3);
}

TEST(Cells, FarAwaySmallAndThin) {
  const auto with = [](const auto& move, double extinction, dvec3 eye, dvec3 at, double degrees) {
    Drawn drawn{bent_box(8), colored_scene(extinction)};
    for (dvec3& point : drawn.mesh.points) point = move(point);
    look(drawn.scene, eye, at);
    drawn.scene.camera.vertical_fov_degrees = degrees;
    return drawn;
  };
  // UTM coordinates in metres, a body of 100 m.
  const dvec3 utm(5e5, 5.4e6, 300);
  expect_exact(with([&](dvec3 p) { return utm + 100.0 * p; }, 0.05, utm + dvec3(230, 190, 310), utm + dvec3(50), 30),
               1e-5, 1e-3);
  // A million sizes away.
  expect_exact(with([](dvec3 p) { return p; }, 4, {1e6, 2e5, 3e5}, {0.5, 0.5, 0.5}, 8e-5), 1e-5, 1e-3);
  // Layers: aspects of 1e4.
  expect_exact(with([](dvec3 p) { return dvec3(p.x, p.y, 1e-3 * p.z); }, 100, {2.3, 1.9, 0.3}, {0.5, 0.5, 0}, 30), 1e-4,
               2e-2);
  // Nine decades of sizes.
  expect_exact(
      with([](dvec3 p) { return dvec3(std::pow(10, 9 * p.x - 9), p.y, p.z); }, 4, {2.3, 1.9, 3.1}, {0.5, 0.5, 0.5}, 30),
      1e-4, 2e-2);
}

// A plate from (0, 0, 0) to (1, 1, thickness), which lets some of the light through.
Drawn plate(double thickness, const Field& field) {
  Drawn drawn{bent_box(8, field), colored_scene(2 / thickness)};
  for (std::size_t i = 0; i < drawn.mesh.points.size(); ++i) {
    drawn.mesh.values[i] = field(drawn.mesh.points[i]);
    drawn.mesh.points[i].z *= thickness;
  }
  look(drawn.scene, {2.3, 1.9, 0.7}, {0.5, 0.5, 0});
  drawn.scene.camera.parallel_height = 1.2;
  return drawn;
}

TEST(Cells, InThinPlates) {
  for (const auto projection : {Camera::Projection::perspective, Camera::Projection::orthographic}) {
    Drawn layers = plate(1e-4, [](dvec3 p) { return 0.2 * p.x + 0.8 * p.z; });
    layers.scene.camera.projection = projection;
    expect_exact(layers, 1e-4, 1e-2);
    // Single precision has no order of such layers.
    for (const double thickness : {1e-8, 1e-12}) {
      Drawn drawn = plate(thickness, [](dvec3 p) { return 0.7 * p.x + 0.3 * p.y; });
      drawn.scene.camera.projection = projection;
      expect_exact(drawn, 1e-4, 1e-2);
      drawn.scene.lighting = Lighting{0.2, 0.7};
      drawn.scene.clip_planes = {{{0.5, 0.5, 0}, {1, -0.6, 0}, true}};
      expect_exact(drawn, 1e-4, 1e-2);
    }
  }
}

// Depths count from one plane in a chunk.
TEST(Cells, InTwoPlatesThinnerThanSinglePrecision) {
  for (const double thickness : {1e-4, 1e-8, 1e-11}) {
    SCOPED_TRACE(thickness);
    Drawn drawn = plate(thickness, [](dvec3 p) { return 0.7 * p.x + 0.3 * p.y; });
    add_mesh(drawn.mesh, Mesh(drawn.mesh), [](dvec3 p) { return dvec3(p.z, p.x, p.y); });
    expect_exact(drawn, 1e-4, 1e-2);
    drawn.scene.clip_planes = {{{0.5, 0.5, 0}, {1, -0.6, 0}, true}};
    expect_exact(drawn, 1e-4, 1e-2);
    drawn.opacity_values = other_values(drawn.mesh);
    drawn.scene.opacity = SceneOpacity{"other", function_of_other({{0, dvec3(1)}}, {{0, 0}, {0.6, 1}, {0.8, 0.1}})};
    expect_exact(drawn, 1e-4, 1e-2);
  }
}

// Cells of a few shapes, edges along the axes, on a grid of pixels: rays along an axis run in their faces, but for a
// move of their points.
Mesh cells_along_axes(std::mt19937& random, double move) {
  using Cells = std::vector<std::array<std::uint32_t, 4>>;
  std::array<Cells, 3> shapes = {{{{0, 1, 3, 7}, {0, 3, 2, 7}, {0, 2, 6, 7}, {0, 6, 4, 7}, {0, 4, 5, 7}, {0, 5, 1, 7}},
                                  {{0, 1, 2, 6}, {0, 1, 6, 5}, {0, 4, 5, 6}},
                                  {}}};
  constexpr std::array<std::array<std::uint32_t, 3>, 12> triangles = {{{0, 1, 3},
                                                                       {0, 3, 2},
                                                                       {4, 5, 7},
                                                                       {4, 7, 6},
                                                                       {0, 1, 5},
                                                                       {0, 5, 4},
                                                                       {2, 3, 7},
                                                                       {2, 7, 6},
                                                                       {0, 2, 6},
                                                                       {0, 6, 4},
                                                                       {1, 3, 7},
                                                                       {1, 7, 5}}};
  for (const auto& [a, b, c] : triangles) shapes[2].push_back({a, b, c, 8});  // a polyhedron from a point within
  std::uniform_int_distribution<int> length(1, 9), shape(0, 2);
  std::uniform_real_distribution<double> any(-1, 1);
  Mesh mesh;
  for (int cell = 0; cell < 20; ++cell) {
    const auto begin = static_cast<std::uint32_t>(mesh.points.size());
    const dvec3 corner = 9.0 * dvec3(cell % 3, cell / 3 % 3, cell / 9);
    const dvec3 size(length(random), length(random), length(random));
    for (int i = 0; i < 9; ++i) {
      const dvec3 share = i < 8 ? dvec3(i & 1, i >> 1 & 1, i >> 2) : dvec3(0.5, 0.5, 0.25);
      mesh.points.push_back(corner + (share + move * dvec3(any(random), any(random), any(random))) * size);
      mesh.values.push_back(0.5 + 0.5 * any(random));
    }
    for (Tetrahedron tetrahedron : shapes[static_cast<std::size_t>(shape(random))]) {
      for (std::uint32_t& point : tetrahedron) point += begin;
      std::ranges::sort(tetrahedron);
      mesh.tetrahedra.push_back(tetrahedron);
    }
  }
  return mesh;
}

TEST(Cells, AlongWhichRaysGraze) {
  std::mt19937 random(3);
  for (int trial = 0; trial < 100; ++trial) {
    const double move = std::pow(10, -4 - trial % 5);
    Drawn drawn{cells_along_axes(random, move), colored_scene(0.3)};
    drawn.scene.width = drawn.scene.height = 27;
    const int axis = trial % 3;
    dvec3 direction(0);
    direction[axis] = trial % 2 == 0 ? 1 : -1;
    const dvec3 middle(13.5), up = axis == 1 ? dvec3(0, 0, 1) : dvec3(0, 1, 0);
    const bool orthographic = trial % 4 < 2;
    SCOPED_TRACE(testing::Message() << trial << ": moved by " << move << (orthographic ? " orthographic" : ""));
    drawn.scene.camera.vertical_fov_degrees = 20;
    if (orthographic) make_orthographic(drawn.scene, 27);
    const auto look_from = [&](dvec3 shift) {
      look(drawn.scene, middle + shift - 90.0 * direction, middle + shift, up);
    };
    // Rays moved by a thousandth of a pixel tell what rounding may do.
    look_from(dvec3(0));
    const Image picture = draw(MeshSource(drawn.view(), 50), drawn.drawing());
    std::vector<Image> truths = {truth(drawn)};
    dvec3 across(0.001);
    across[axis] = 0;
    for (const dvec3 sign : {dvec3(1), dvec3(-1), dvec3(1, -1, 1), dvec3(-1, 1, 1), dvec3(1, 1, -1)}) {
      look_from(sign * across);
      truths.push_back(truth(drawn));
    }
    for (std::size_t i = 0; i < picture.pixels.size(); ++i)
      for (int c = 0; c < 4; ++c) {
        const auto [low, high] =
            std::ranges::minmax(truths, {}, [&](const Image& image) { return image.pixels[i][c]; });
        ASSERT_GE(picture.pixels[i][c], low.pixels[i][c] - 0.02) << i % 27 << " " << i / 27;
        ASSERT_LE(picture.pixels[i][c], high.pixels[i][c] + 0.02) << i % 27 << " " << i / 27;
      }
  }
}

// Needles and slivers whose outline and thickness single precision does not know, beside a block and alone.
TEST(Cells, AsThinAsNeedles) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> any(0, 1);
  for (const double width : {1e-5, 1e-7, 1e-9})
    for (const int far_corners : {1, 2})  // of a needle; of a sliver
      for (const bool beside_block : {true, false})
        for (const bool orthographic : {true, false}) {
          SCOPED_TRACE(testing::Message() << width << ", " << far_corners << " far, beside " << beside_block
                                          << (orthographic ? " orthographic" : ""));
          Drawn drawn{beside_block ? make_box(3, curved) : Mesh(), colored_scene(beside_block ? 2 : 0.3 / width)};
          for (int needle = 0; needle < 40; ++needle) {
            const auto begin = static_cast<std::uint32_t>(drawn.mesh.points.size());
            const auto place = [&] { return dvec3(any(random), any(random), any(random)); };
            const dvec3 from = place(), to = place(), beside = far_corners == 1 ? to : place();
            for (const dvec3& point : {from, to, beside + width * place(), from + width * place()})
              drawn.mesh.points.push_back(point), drawn.mesh.values.push_back(any(random));
            drawn.mesh.tetrahedra.push_back({begin, begin + 1, begin + 2, begin + 3});
          }
          if (orthographic) make_orthographic(drawn.scene, 1.8);
          const Image exact = truth(drawn);
          EXPECT_LE(difference(draw(MeshSource(drawn.view(), 1000), drawn.drawing()), exact).most, 1e-3);
        }
}

TEST(Cells, OfAnySize) {
  const Drawn drawn{bent_box(5), colored_scene(4)};
  const Image picture = draw(MeshSource(drawn.view(), 300), drawn.drawing());
  for (const double size : {1e-60, 1e-30, 1e-12, 1e12, 1e30, 1e45, 1e60}) {
    SCOPED_TRACE(size);
    Drawn scaled = drawn;
    for (dvec3& point : scaled.mesh.points) point *= size;
    for (TransferFunction::Density& density : scaled.scene.transfer_function.densities) density.extinction /= size;
    scaled.scene.camera.position *= size, scaled.scene.camera.focal_point *= size;
    EXPECT_LE(difference(draw(MeshSource(scaled.view(), 300), scaled.drawing()), picture).most, 1e-5);
  }
}

TEST(Cells, ThatAreLongRoundADenseCorner) {
  Drawn drawn{make_ball(2), colored_scene(1, {2.2, 1.5, 0.8})};
  std::mt19937 random(9);
  std::uniform_real_distribution<double> any(0, 0.05);
  for (dvec3& point : drawn.mesh.points) point.x *= 20;
  drawn.mesh.values.assign(drawn.mesh.points.size(), 1);
  for (std::size_t i = 1; i < drawn.mesh.values.size(); ++i) drawn.mesh.values[i] = any(random);
  drawn.scene.transfer_function.densities = {{0, 0}, {0.1, 0.01}, {0.5, 0.2}, {0.9, 40}, {1, 1000}};
  look(drawn.scene, {2.2, 1.5, 0.8}, {0, 0, 0});
  expect_exact(drawn, 1e-4, 2e-3);
  look(drawn.scene, {30, 25, 8}, {0, 0, 0});
  expect_exact(drawn, 1e-4, 2e-3);
}

TEST(Cells, WithARampOverTenOfThemInDenseMatter) {
  for (const double extinction : {1e3, 1e6, 1e9}) {
    Drawn drawn{bent_box(10, [](dvec3 p) { return p.x; }), colored_scene(1, {-2.3, 1.9, 3.1})};
    drawn.scene.transfer_function.densities = {{0, 0}, {1, extinction}};
    expect_exact(drawn, 1e-4, 2e-3);
  }
}

TEST(Cells, AreTheSameBitsForAnyThreadsMemoryAndOrder) {
  Drawn drawn{bent_box(10), colored_scene(4, {0.5, 0.31, -0.3})};
  drawn.scene.camera.vertical_fov_degrees = 60;
  const std::size_t copies = drawn.mesh.tetrahedra.size() / 2;  // ties
  for (std::size_t i = 0; i < copies; ++i) drawn.mesh.tetrahedra.push_back(drawn.mesh.tetrahedra[i]);
  expect_same_bits(drawn);
}

TEST(Cells, AreTheSameBitsWithTheMemoryOfOtherPictures) {
  Drawn drawn{bent_box(8), colored_scene(4, {0.5, 0.31, -0.3})};
  const Drawn plain = drawn;
  drawn.scene.lighting = Lighting{0.2, 0.7};
  drawn.scene.clip_planes = {{{0.5, 0.5, 0.5}, {1, -0.6, 0.3}, true}};
  drawn.scene.width = 130;
  const MeshSource source(drawn.view(), 300);
  CellRasterizer rasterizer;
  for (const Drawn* next : std::initializer_list<const Drawn*>{&drawn, &plain, &drawn}) {
    const Image fresh = draw(source, next->drawing());
    const auto again = value_of(rasterizer.draw(source, next->drawing()));
    ASSERT_EQ(again.image.pixels.size(), fresh.pixels.size());
    EXPECT_EQ(std::memcmp(again.image.pixels.data(), fresh.pixels.data(), fresh.pixels.size() * sizeof(vec4)), 0);
  }
}

TEST(Cells, AreAlikeForAllInstructionSets) {
  Drawn drawn{bent_box(6), colored_scene(4)};
  drawn.scene.lighting = Lighting{0.2, 0.7};
  const MeshSource source(drawn.view(), 1000);
  const Image first = draw(source, drawn.drawing());
  for_each_target([&] { EXPECT_LE(difference(draw(source, drawn.drawing()), first).most, 1e-6); });
}

TEST(Cells, AreInterpolatedBetweenSamples) {
  Drawn drawn{bent_box(8), colored_scene(4)};
  drawn.scene.width = 256, drawn.scene.height = 231;
  const MeshSource source(drawn.view(), 1000);
  CellDrawing drawing = drawn.drawing();
  const Image exact = draw(source, drawing);
  double before = 1;
  for (const int spacing : {8, 4, 2}) {
    drawing.sample_spacing = spacing;
    const double rmse = difference(draw(source, drawing), exact).rmse;
    EXPECT_LT(rmse, before);
    before = rmse;
  }
  EXPECT_LT(before, 0.005);
}

TEST(Cells, KeepTheirLightBetweenSamples) {
  Drawn drawn{bent_box(8), colored_scene(4)};
  drawn.scene.width = 256, drawn.scene.height = 231;
  drawn.scene.transfer_function.densities = {{0, 0}, {0.59, 0}, {0.6, 40}, {0.61, 0}, {1, 0}};  // thin bright lines
  const MeshSource source(drawn.view(), 1000);
  CellDrawing drawing = drawn.drawing();
  const auto light_of = [](const Image& image) {
    double sum = 0;
    for (const vec4& pixel : image.pixels) {
      EXPECT_GE(std::min({pixel.r, pixel.g, pixel.b}), 0.0F);
      sum += double{pixel.r} + double{pixel.g} + double{pixel.b};
    }
    return sum;
  };
  const double light = light_of(draw(source, drawing));
  for (const int spacing : {2, 4}) {
    drawing.sample_spacing = spacing;
    EXPECT_NEAR(light_of(draw(source, drawing)) / light, 1, 0.01);
  }
}

TEST(Cells, OfNoSource) {
  const Mesh empty;
  const MeshSource source(empty.view(), 100);
  const Drawn drawn{empty, colored_scene(1)};
  for (const vec4& pixel : draw(source, drawn.drawing()).pixels) EXPECT_EQ(pixel, vec4(0));
}

}  // namespace
}  // namespace splatvol::test
