// Lit pictures against closed forms: the factor of each ray, and the parts that must not change.
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "tests/renderer/reference/meshes.h"
#include "tests/support/random.h"

namespace splatvol::test {
namespace {

constexpr Lighting light{0.25, 0.6};
constexpr double exact = 1e-6;  // pictures are 32-bit floats

double curved(dvec3 p) { return p.x * p.y + 0.2 * std::sin(9 * p.z); }

Scene lit_scene(dvec3 eye = {2.3, 1.9, 3.1}) {
  Scene scene = make_scene(2, 33, 29);
  look(scene, eye, {0.53, 0.31, 0.2});
  scene.lighting = light;
  return scene;
}

/// The colour is white and the factor is the same all along a ray: red = factor times alpha.
void expect_factor(const WorldRay& ray, dvec3 gradient, const vec4& pixel) {
  const double cosine = glm::dot(ray.direction, gradient) / glm::length(gradient);
  EXPECT_NEAR(pixel.r, (light.ambient + light.diffuse * std::abs(cosine)) * pixel.a, exact);
}

TEST(Lighting, IsTheFactorOfEachRay) {
  for (const dvec3 gradient : {dvec3(0, 0, 1), dvec3(-0.3, 0.5, 0.2), dvec3(1e-3, -2e-3, 5e-4)}) {
    const Mesh mesh = make_box(4, [&](dvec3 p) { return 0.4 + glm::dot(gradient, p); });
    for (const dvec3 eye : {dvec3(2.3, 1.9, 3.1), dvec3(0.41, 0.63, 0.57)}) {
      Scene scene = lit_scene(eye);
      scene.camera.vertical_fov_degrees = 70;
      for (const bool orthographic : {false, true}) {
        if (orthographic) make_orthographic(scene, 2);
        double brightest = 0;
        for_each_ray(scene, render(mesh, scene).image, [&](const WorldRay& ray, const vec4& pixel) {
          expect_alpha(pixel.a, 2, box_length(ray), exact);
          expect_factor(ray, gradient, pixel);
          brightest = std::max<double>(brightest, pixel.r);
        });
        EXPECT_GT(brightest, 0.1);
      }
    }
  }
}

TEST(Lighting, WithoutGradientIsAmbientAndDiffuse) {
  const Mesh mesh = make_box(4, [](dvec3) { return 0.1; });
  for (const vec4& pixel : render(mesh, lit_scene()).image.pixels)
    EXPECT_NEAR(pixel.r, (light.ambient + light.diffuse) * pixel.a, exact);
}

/// Halving is exact in binary, so the pictures must agree in every bit. With other factors they agree up to rounding.
TEST(Lighting, AmbientAloneDimsTheUnlitPicture) {
  const Mesh mesh = make_box(4, curved);
  Scene scene = lit_scene();
  scene.transfer_function.colors = {{0, {0, 0.2, 1}}, {0.4, {1, 1, 0}}, {0.4, {0.3, 0, 0}}, {1, {1, 1, 1}}};
  scene.lighting.reset();
  const Image unlit = render(mesh, scene).image;
  for (const double ambient : {1.0, 0.5, 0.0, 0.3}) {
    scene.lighting = Lighting{ambient, 0};
    const Image dimmed = render(mesh, scene).image;
    for (std::size_t i = 0; i < unlit.pixels.size(); ++i) {
      EXPECT_EQ(dimmed.pixels[i].a, unlit.pixels[i].a);
      for (int channel = 0; channel < 3; ++channel) {
        const double expected = ambient * unlit.pixels[i][channel];
        EXPECT_NEAR(dimmed.pixels[i][channel], expected, ambient == 0.3 ? 1e-6 * expected : 0);
      }
    }
  }
}

TEST(Lighting, LeavesAlphaAsItIs) {
  const Mesh mesh = make_box(5, curved);
  Scene scene = lit_scene();
  scene.transfer_function.densities = {{0, 0.5}, {1, 8}};
  const Image lit = render(mesh, scene).image;
  scene.lighting.reset();
  const Image unlit = render(mesh, scene).image;
  ASSERT_EQ(lit.pixels.size(), unlit.pixels.size());
  for (std::size_t i = 0; i < lit.pixels.size(); ++i) {
    EXPECT_EQ(lit.pixels[i].a, unlit.pixels[i].a);
    // Every factor lies between ambient and ambient + diffuse.
    EXPECT_GE(lit.pixels[i].r, (light.ambient - exact) * unlit.pixels[i].r);
    EXPECT_LE(lit.pixels[i].r, (light.ambient + light.diffuse + exact) * unlit.pixels[i].r);
  }
}

/// The box in front has its gradient along the rays, the box behind it has its gradient across them.
TEST(Lighting, EachCellHasItsOwn) {
  Mesh mesh = make_box(3, [](dvec3 p) { return p.z; });
  const Mesh behind = make_box(3, [](dvec3 p) { return p.x; });
  const auto offset = static_cast<std::uint32_t>(mesh.points.size());
  for (const dvec3& point : behind.points) mesh.points.push_back(point - dvec3(0, 0, 1));
  mesh.values.insert(mesh.values.end(), behind.values.begin(), behind.values.end());
  for (const auto& [a, b, c, d] : behind.tetrahedra)
    mesh.tetrahedra.push_back({a + offset, b + offset, c + offset, d + offset});

  Scene scene = lit_scene();
  scene.transfer_function.densities = {{0, 1}};
  make_orthographic(scene, 0.9);
  look(scene, {0.5, 0.5, 4}, dvec3(0.5));
  scene.width = scene.height = 17;
  const double once = -std::expm1(-1.0);
  const double expected = (light.ambient + light.diffuse) * once + light.ambient * (1 - once) * once;
  for (const vec4& pixel : render(mesh, scene).image.pixels) EXPECT_NEAR(pixel.r, expected, exact);
}

TEST(Lighting, FarFromTheOrigin) {
  // Values and vertices are exact in binary there too, so that only the arithmetic can lose digits.
  const dvec3 gradient(0.25, -0.5, 1);
  Mesh mesh = make_box(4, [&](dvec3 p) { return glm::dot(gradient, p); });
  const dvec3 shift(1e7, -3e7, 5e7);
  for (dvec3& point : mesh.points) point += shift;
  Scene scene = lit_scene();
  look(scene, dvec3(2.25, 1.875, 3.125) + shift, dvec3(0.5) + shift);
  for_each_ray(scene, render(mesh, scene).image,
               [&](const WorldRay& ray, const vec4& pixel) { expect_factor(ray, gradient, pixel); });
}

/// The eye is 1e6 sizes away: view coordinates have lost ten digits of the cells' shape, world coordinates none.
TEST(Lighting, FarFromTheEye) {
  const dvec3 gradient(0.25, -0.5, 1);
  const Mesh mesh = make_box(2, [&](dvec3 p) { return 1e-3 * glm::dot(gradient, p); });
  Scene scene = lit_scene({5e5, 6e5, 7e5});
  make_orthographic(scene, 2);
  for_each_ray(scene, render(mesh, scene).image,
               [&](const WorldRay& ray, const vec4& pixel) { expect_factor(ray, gradient, pixel); });
}

TEST(Lighting, AnySizeOfWorldAndValue) {
  const dvec3 gradient(0.3, 0.5, -0.2);
  for (const double scale : {1e-12, 1e-6, 1e6, 1e9})
    for (const double unit : {1e-300, 1e-6, 1e6, 1e99}) {
      Mesh mesh = make_box(3, [&](dvec3 p) { return unit * glm::dot(gradient, p); });
      for (dvec3& point : mesh.points) point *= scale;
      Scene scene = lit_scene();
      scene.transfer_function.densities = {{0, 2 / scale}};
      scene.camera.position *= scale;
      scene.camera.focal_point *= scale;
      for_each_ray(scene, render(mesh, scene).image,
                   [&](const WorldRay& ray, const vec4& pixel) { expect_factor(ray, gradient, pixel); });
    }
}

TEST(Lighting, FlatCellsAddNothing) {
  const dvec3 gradient(0.3, 0.5, -0.2);
  Mesh mesh = make_box(2, [&](dvec3 p) { return glm::dot(gradient, p); });
  add_flat_cells(mesh);
  const Scene scene = lit_scene();
  for_each_ray(scene, render(mesh, scene).image, [&](const WorldRay& ray, const vec4& pixel) {
    expect_alpha(pixel.a, 2, box_length(ray), exact);
    expect_factor(ray, gradient, pixel);
  });
}

TEST(Lighting, MissingValuesEmptyTheirCells) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const Mesh mesh = make_box(4, [&](dvec3 p) { return p.z > 0.5 ? nan : p.z; });
  Scene scene = lit_scene();
  make_orthographic(scene, 0.8);
  look(scene, {0.5, 0.5, 4}, dvec3(0.5));
  for (const vec4& pixel : render(mesh, scene).image.pixels) {
    expect_alpha(pixel.a, 2, 0.5, exact);
    EXPECT_NEAR(pixel.r, (light.ambient + light.diffuse) * pixel.a, exact);
  }
}

/// Corners in a box of these edges, values of a linear field. The bound is the rounding of corners and values (1e-16)
/// times the flatness of the cell.
TEST(GradientDirection, OfALinearField) {
  struct Case {
    dvec3 box;
    double tolerance;
  };
  const Case cases[] = {{dvec3(1), 1e-11},    {dvec3(1e-100), 1e-11}, {dvec3(1e100), 1e-11},
                        {{1, 1, 1e-4}, 1e-8}, {{1, 1e-8, 1}, 1e-4},   {{1e-3, 1e-6, 1e-3}, 1e-8}};
  std::mt19937 random(7);
  std::uniform_real_distribution<double> unit(-1, 1);
  const auto vector = [&] { return random_vector(unit, random); };
  for (const auto& [box, tolerance] : cases)
    for (int trial = 0; trial < 1000; ++trial) {
      CellCorners corners{vector(), vector(), vector(), vector()};
      const double volume =
          glm::determinant(dmat3(corners[1] - corners[0], corners[2] - corners[0], corners[3] - corners[0]));
      if (std::abs(volume) < 0.01) continue;
      for (dvec3& corner : corners) corner *= box;
      const dvec3 gradient = glm::normalize(vector());
      std::array<double, 4> values{};
      for (int i = 0; i < 4; ++i) values[i] = glm::dot(gradient, corners[i]);
      const dvec3 found = gradient_direction(corners, values);
      EXPECT_NEAR(glm::length(found), 1, 1e-14);
      EXPECT_LT(glm::length(glm::cross(found, gradient)), tolerance) << box.x << " " << box.y << " " << box.z;
    }
}

TEST(GradientDirection, NoGradient) {
  const CellCorners corners{dvec3(0), dvec3(1, 0, 0), dvec3(0, 1, 0), dvec3(0, 0, 1)};
  EXPECT_EQ(gradient_direction(corners, {0.1, 0.1, 0.1, 0.1}), dvec3(0));
  EXPECT_EQ(gradient_direction({dvec3(3), dvec3(3), dvec3(3), dvec3(3)}, {1, 2, 3, 4}), dvec3(0));
  EXPECT_EQ(gradient_direction({dvec3(0), dvec3(1), dvec3(2), dvec3(3)}, {1, 2, 3, 4}), dvec3(0));
}

TEST(GradientDirection, IsFiniteInFlatCellsAndForTheLargestValues) {
  const CellCorners flat{dvec3(0), dvec3(1, 0, 0), dvec3(0, 1, 0), dvec3(1, 1, 0)};
  EXPECT_EQ(glm::abs(gradient_direction(flat, {0, 1, 0, 0.3})), dvec3(0, 0, 1));
  const CellCorners needle{dvec3(0), dvec3(1, 0, 0), dvec3(0, 1e-90, 0), dvec3(0, 0, 1e-90)};
  EXPECT_EQ(gradient_direction(needle, {0, 0, 1, 0}), dvec3(0, 1, 0));
  const CellCorners corners{dvec3(0), dvec3(1, 0, 0), dvec3(0, 1, 0), dvec3(0, 0, 1)};
  EXPECT_EQ(gradient_direction(corners, {-1e100, -1e100, -1e100, 1e100}), dvec3(0, 0, 1));
}

}  // namespace
}  // namespace splatvol::test
