// Meshes drawn by CellRasterizer, and exactly.
#pragma once

#include <gtest/gtest.h>
#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <functional>
#include <limits>
#include <optional>
#include <random>
#include <utility>
#include <vector>

#include "renderer/cpu/cells.h"
#include "renderer/reference/slice.h"
#include "renderer/surfaces/draw_surfaces.h"
#include "tests/renderer/mesh_source.h"
#include "tests/renderer/reference/meshes.h"

namespace splatvol::test {

struct Drawn {
  Mesh mesh;
  Scene scene;
  std::vector<double> opacity_values = {};
  std::vector<double> color_values = {};
  bool constant = false;
  std::optional<SurfaceDepths> surfaces = {};

  [[nodiscard]] TetMesh view() const {
    TetMesh view = mesh.view();
    view.constant = constant;
    view.opacity_values = opacity_values;
    view.color_values = color_values;
    return view;
  }
  [[nodiscard]] CellDrawing drawing() const {
    auto view = make_view(scene);
    EXPECT_TRUE(view);
    CellDrawing drawing{
        .view = *view, .transfer = transfer_of(scene), .lighting = scene.lighting, .contours = contours_of(scene)};
    if (surfaces) drawing.layers.push_back({&*surfaces});
    return drawing;
  }
};

inline Image draw(const MeshSource& source, const CellDrawing& drawing) {
  const auto picture = CellRasterizer().draw(source, drawing);
  EXPECT_TRUE(picture) << picture.error().message;
  return picture ? picture->image : Image{};
}

struct Difference {
  double rmse = 0, most = 0;
};
inline Difference difference(const Image& a, const Image& b) {
  EXPECT_EQ(a.pixels.size(), b.pixels.size());
  Difference result;
  for (std::size_t i = 0; i < a.pixels.size() && i < b.pixels.size(); ++i)
    for (int c = 0; c < 4; ++c) {
      const double error = std::abs(double{a.pixels[i][c]} - double{b.pixels[i][c]});
      EXPECT_FALSE(std::isnan(error)) << "pixel " << i;
      result.rmse += error * error / (4.0 * static_cast<double>(a.pixels.size()));
      result.most = std::max(result.most, error);
    }
  result.rmse = std::sqrt(result.rmse);
  return result;
}

/// The exact picture, with the scene's slices.
inline Image truth(const Drawn& drawn) {
  const auto render = [&](const SurfaceDepths* depths) {
    auto exact = render_reference(drawn.view(), drawn.scene, {.surface_depths = depths});
    EXPECT_TRUE(exact) << exact.error().message;
    return exact ? std::move(exact->image) : Image{};
  };
  const auto view = make_view(drawn.scene);
  EXPECT_TRUE(view);
  if (view->slices.empty()) return render(drawn.surfaces ? &*drawn.surfaces : nullptr);
  std::vector<SlicePicture> slices;
  for (const Slice& slice : view->slices) {
    std::vector<double> depths = slice_depths(*view, slice.plane);
    const auto values = exact_slice(drawn.view(), *view, slice.plane, depths);
    EXPECT_TRUE(values);
    slices.push_back(color_slice(*view, slice, std::move(depths), *values, drawn.scene.transfer_function));
  }
  SurfaceComposite composite;
  for (const SurfaceLayer& layer : draw_surfaces({}, slices, *view, 64).layers)
    composite.add(render(&layer.depths), layer);
  return composite.finish();
}

/// Pictures in chunks of a few sizes against the exact one.
inline void expect_exact(const Drawn& drawn, double rmse, double most) {
  const Image exact = truth(drawn);
  double alpha = 0;
  for (const vec4& pixel : exact.pixels) alpha = std::max<double>(alpha, pixel.a);
  EXPECT_GT(alpha, 0.01) << "an empty picture tells nothing";
  for (const std::size_t cells : {std::size_t{100000}, std::size_t{300}}) {
    const Difference error = difference(draw(MeshSource(drawn.view(), cells), drawn.drawing()), exact);
    EXPECT_LE(error.rmse, rmse) << "chunks of " << cells;
    EXPECT_LE(error.most, most) << "chunks of " << cells;
  }
}

/// Pictures for any threads, memory and order of chunks.
inline void expect_same_bits(const Drawn& drawn) {
  MeshSource source(drawn.view(), 200);
  CellDrawing drawing = drawn.drawing();
  const Image first = draw(source, drawing);
  const auto expect_same = [&](const Image& image) {
    ASSERT_EQ(image.pixels.size(), first.pixels.size());
    EXPECT_EQ(std::memcmp(image.pixels.data(), first.pixels.data(), first.pixels.size() * sizeof(vec4)), 0);
  };
  for (const std::uint64_t memory : {std::uint64_t{1} << 12, std::uint64_t{1} << 18, std::uint64_t{1} << 34}) {
    drawing.memory = memory;
    expect_same(draw(source, drawing));
  }
  tbb::task_arena(1).execute([&] { expect_same(draw(source, drawing)); });
  source.reverse();
  expect_same(draw(source, drawing));
}

inline double curved(dvec3 p) { return 0.5 + 0.4 * std::sin(5 * p.x + 2 * p.y) * std::cos(4 * p.z - p.y); }

/// Points move, so that no ray runs along a face.
inline Mesh bent_box(std::uint32_t n, const Field& field = curved) {
  Mesh mesh = make_box(n, field);
  std::mt19937 random(7);
  std::uniform_real_distribution<double> move(-0.2 / n, 0.2 / n);
  for (dvec3& point : mesh.points) point += dvec3(move(random), move(random), move(random));
  return mesh;
}

/// Adds the points and cells of another mesh, moved.
inline void add_mesh(Mesh& mesh, const Mesh& other, const std::function<dvec3(dvec3)>& move) {
  const auto begin = static_cast<std::uint32_t>(mesh.points.size());
  for (const dvec3& point : other.points) mesh.points.push_back(move(point));
  mesh.values.insert(mesh.values.end(), other.values.begin(), other.values.end());
  for (const auto& [a, b, c, d] : other.tetrahedra)
    mesh.tetrahedra.push_back({begin + a, begin + b, begin + c, begin + d});
}

/// A mesh whose cells have a random value each. One of them has none.
inline Drawn with_values_of_cells(Drawn drawn) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> any(0, 1);
  drawn.constant = true;
  drawn.mesh.values.resize(drawn.mesh.tetrahedra.size());
  for (double& value : drawn.mesh.values) value = any(random);
  drawn.mesh.values[17] = std::numeric_limits<double>::quiet_NaN();
  return drawn;
}

struct CountingSource final : MeshSource {
  using MeshSource::MeshSource;
  [[nodiscard]] Result<const Tetrahedra*> read(const Chunk& chunk, Tetrahedra& scratch) const override {
    ++reads;
    return MeshSource::read(chunk, scratch);
  }
  mutable std::atomic<std::size_t> reads = 0;
};

inline Scene colored_scene(double extinction, dvec3 eye = {2.3, 1.9, 3.1}) {
  Scene scene = make_scene(extinction, 70, 61);
  scene.transfer_function.colors = {{0, {0.1, 0.2, 0.9}}, {0.3, {0.9, 0.1, 0}}, {0.6, {0, 1, 0.3}}, {1, {1, 1, 0.5}}};
  scene.transfer_function.densities = {{0, 0}, {0.2, extinction}, {0.5, 0.1 * extinction}, {1, 2 * extinction}};
  look(scene, eye, {0.53, 0.31, 0.2});
  return scene;
}

/// A wide view, also from inside.
inline Scene wide_scene(double extinction, dvec3 eye, bool orthographic) {
  Scene scene = colored_scene(extinction, eye);
  scene.camera.vertical_fov_degrees = 60;
  if (orthographic) make_orthographic(scene, 1.5);
  return scene;
}

/// A function of the attribute "other", with values from 2 to 4.
inline TransferFunction function_of_other(std::vector<TransferFunction::Color> colors,
                                          std::vector<TransferFunction::Density> densities) {
  return {.lo = 2, .hi = 4, .colors = std::move(colors), .densities = std::move(densities)};
}

inline std::vector<double> other_values(const Mesh& mesh) {
  std::vector<double> values;
  for (const dvec3& p : mesh.points) values.push_back(3 + std::cos(7 * p.x + 3 * p.z));
  return values;
}

}  // namespace splatvol::test
