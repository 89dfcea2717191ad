// The kernel `moments` against closed forms and against its definition in double precision.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <glm/gtc/quaternion.hpp>
#include <limits>
#include <memory>
#include <numbers>
#include <numeric>
#include <random>

#include "splat/ellipsoid.h"
#include "splat/kernel.h"
#include "tests/renderer/device_name.h"
#include "tests/renderer/draw_parts.h"
#include "tests/renderer/random_splats.h"
#include "tests/renderer/raster_test.h"
#include "tests/support/random.h"

namespace splatvol::test {
namespace {

using glm::dmat3;
using glm::dquat;
using glm::dvec4;
using std::numbers::pi;
using ::testing::HasSubstr;

/// A cluster's moments before packing.
struct Cluster {
  dvec3 position{0};
  double mass = 1;
  dvec3 deviations{1};
  dquat orientation{1, 0, 0, 0};
  double value = 0;
  double value_deviation = 0;
  dvec3 correlation{0};
  dvec3 boundary{0};  // foot of the perpendicular from the centroid, in deviations along the principal axes
};

MomentsSplat material_of(const Cluster& cluster) {
  return {{cluster.mass, cluster.deviations, cluster.orientation, cluster.boundary},
          cluster.position,
          cluster.value,
          cluster.value_deviation,
          cluster.correlation};
}

std::vector<MomentsSplat> materials_of(const std::vector<Cluster>& clusters, const dvec3& origin = dvec3(0)) {
  std::vector<MomentsSplat> materials;
  for (const Cluster& cluster : clusters) {
    materials.push_back(material_of(cluster));
    materials.back().center -= origin;
  }
  return materials;
}

/// Returns the numbers that the drawing record of a cluster holds, if it is alone in its row.
MomentsSplat recorded(const Cluster& cluster) {
  const MomentsSplat exact = material_of(cluster);
  MomentsSplat held = unpack(pack_row(std::span(&exact, 1), dvec3(0), 1), 0);
  held.center = exact.center;
  return held;
}

/// White, with extinction `slope` times the value from 0 to 1000.
TransferFunction ramp(double slope) {
  return {.lo = 0, .hi = 1000, .colors = {{0, {1, 1, 1}}}, .densities = {{0, 0}, {1, 1000 * slope}}};
}

/// White, with the same extinction everywhere.
TransferFunction uniform(double extinction) {
  TransferFunction function = ramp(0);
  function.densities = {{0, extinction}};
  return function;
}

/// The variance that rasterizers add to a splat; none if it is behind the eye.
std::optional<double> widening(const MomentsSplat& splat, const View& view) {
  const double z = view.to_view(splat.center).z;
  const dvec3 across = view.forward * glm::mat3_cast(splat.orientation) * splat.deviations;
  const double reach = moments_half_width * glm::length(across) * (1 + 1.1 * glm::length(splat.boundary));
  if (z + reach <= 0) return {};
  const double pixel = (view.orthographic ? 1 : std::max(z, (z + reach) / 2)) / view.focal;
  return pixel_variance * pixel * pixel;
}

/// The ray of a pixel; its direction has a depth of 1.
struct PixelRay {
  dvec3 origin, direction;

  PixelRay(const View& view, double pixel_x, double pixel_y) : origin(view.eye), direction(view.forward) {
    const dvec3 aside =
        ((pixel_x - 0.5 * view.width) * view.right + (pixel_y - 0.5 * view.height) * view.up) / view.focal;
    (view.orthographic ? origin : direction) += aside;
  }
};

/// The integral of the density along a chord, and the mean of s there, by quadrature.
struct DensityIntegral {
  double mass;
  double mean_s;
};

DensityIntegral integrate_density(const Chord& chord) {
  // s is substituted by t: at the ends the density has a root of the distance, which would spoil the sum.
  double integral = 0;
  double moment = 0;
  constexpr int samples = 500;
  for (int i = 0; i < samples; ++i) {
    const double t = (i + 0.5) / samples;
    const double s = chord.begin + (chord.end - chord.begin) * t * t * (3 - 2 * t);
    const double density = chord.density(s) * 6 * t * (1 - t);
    integral += density;
    moment += density * s;
  }
  return {integral * (chord.end - chord.begin) / samples, integral > 0 ? moment / integral : chord.begin};
}

/// Averages the transfer function over normally distributed values: colour, weighted with extinction; extinction.
dvec4 average_transfer(const TransferFunction& function, double mean, double spread) {
  dvec4 sum(0);
  double weight = 0;
  constexpr int values = 151;
  for (int i = 0; i < values; ++i) {
    const double z = -5 + 10 * (i + 0.5) / values;
    const double value = mean + spread * z;
    const double density = std::exp(-0.5 * z * z);
    sum += density * function.extinction(value) * dvec4(function.color(value), 1);
    weight += density;
    if (spread == 0) break;
  }
  return sum.a > 0 ? dvec4(dvec3(sum) / sum.a, sum.a / weight) : dvec4(0);
}

/// Returns the mean |cos| with the line of sight of gradients that scatter round their mean, up to the spread of their
/// lengths. `unexplained`: the share of the value's variance that the mean gradient leaves.
double mean_cosine(double cosine, double unexplained) {
  const double scatter = unexplained / (1.5 * (1 - unexplained));
  if (!(scatter > 0)) return cosine;
  const double s = std::sqrt(scatter), z = cosine / s;
  const double along = cosine * std::erf(z / std::numbers::sqrt2) + s * std::sqrt(2 / pi) * std::exp(-0.5 * z * z);
  return along / std::sqrt(1 + 8 / pi * scatter);
}

/// Draws one splat on one pixel's ray by its definition, as far as it is in front of a surface: integrals by
/// quadrature, in double precision.
dvec4 evaluate(const MomentsSplat& splat, const View& view, double pixel_x, double pixel_y,
               const TransferFunction& function, const std::optional<Lighting>& lighting, double surface) {
  const auto variance = widening(splat, view);
  if (!variance) return dvec4(0);
  const PixelRay ray(view, pixel_x, pixel_y);
  auto chord = chord_of(ellipsoid_of(splat.center, splat, *variance), ray.origin, ray.direction);
  if (!chord) return dvec4(0);
  chord->begin = std::max(chord->begin, 0.0);
  chord->end = std::min(chord->end, surface);
  if (chord->end <= chord->begin) return dvec4(0);
  const DensityIntegral density = integrate_density(*chord);
  const double length = glm::length(ray.direction), depth = density.mass * length;

  const LinearField field = field_of(splat.center, splat, value_of(splat), *variance);
  const double slope = glm::dot(field.slope, ray.direction);
  const dvec3 widened = glm::sqrt(splat.deviations * splat.deviations + *variance);
  const double along = slope / glm::length(ray.direction * glm::mat3_cast(splat.orientation) / widened);
  const double spread = std::sqrt(field.deviation * field.deviation + along * along);
  const dvec4 material = average_transfer(function, field.at(ray.origin + density.mean_s * ray.direction), spread);

  const double steepest = glm::length(field.slope);
  const double cosine = steepest > 0 ? std::abs(slope) / steepest / length : 1;
  const dvec3& correlation = splat.correlations;
  const double unexplained = splat.value_deviation > 0 ? 1 - glm::dot(correlation, correlation) : 0;
  const double light = lighting ? lighting->ambient + lighting->diffuse * mean_cosine(cosine, unexplained) : 1;
  const double alpha = -std::expm1(-depth * material.a);
  return {light * alpha * dvec3(material), alpha};
}

Image evaluate(const Cluster& cluster, const View& view, const TransferFunction& function,
               const std::optional<Lighting>& lighting = {}, const SurfaceDepths* surfaces = nullptr) {
  const MomentsSplat splat = recorded(cluster);
  Image image{view.width, view.height, {}};
  for (int y = 0; y < view.height; ++y)
    for (int x = 0; x < view.width; ++x) {
      const double surface = surfaces ? surfaces->depths[image.pixels.size()] : std::numeric_limits<double>::infinity();
      image.pixels.emplace_back(evaluate(splat, view, x + 0.5, view.height - y - 0.5, function, lighting, surface));
    }
  return image;
}

/// A plane that leans to one side, at a depth in the middle of the picture.
SurfaceDepths leaning_plane(const View& view, double middle) {
  SurfaceDepths surfaces{view.width, view.height, {}};
  for (int y = 0; y < view.height; ++y)
    for (int x = 0; x < view.width; ++x) {
      const double aside = static_cast<double>(x - view.width / 2) / view.width;
      surfaces.depths.push_back(static_cast<float>(std::max(middle + 0.3 * aside, 0.0)));
    }
  return surfaces;
}

/// Returns the largest difference of any channel, alpha included.
double largest_difference(const Image& a, const Image& b) {
  double largest = 0;
  for (std::size_t i = 0; i < a.pixels.size(); ++i)
    for (int channel = 0; channel < 4; ++channel)
      largest = std::max<double>(largest, std::abs(a.pixels[i][channel] - b.pixels[i][channel]));
  return largest;
}

/// Turns x, y and z into three oblique axes.
const dquat oblique = glm::normalize(dquat(0.8, 0.3, -0.5, 0.2));

/// Returns clusters that are cubes of edge `h`, round the points of a lattice in [-reach, reach]^3 that `keep` accepts.
template <class Keep>
std::vector<Cluster> cubes(double h, int reach, const Keep& keep) {
  std::vector<Cluster> clusters;
  for (int z = -reach; z <= reach; ++z)
    for (int y = -reach; y <= reach; ++y)
      for (int x = -reach; x <= reach; ++x)
        if (const dvec3 position = h * dvec3(x, y, z); keep(position))
          clusters.push_back({.position = position, .mass = h * h * h, .deviations = dvec3(h / std::sqrt(12.0))});
  return clusters;
}

/// Returns overlapping splats of all shapes around the origin.
std::vector<Cluster> cloud(int count) {
  std::mt19937 generator(5);
  std::uniform_real_distribution<double> coordinate(-1, 1);
  std::vector<Cluster> clusters(count);
  for (Cluster& cluster : clusters) {
    const auto direction = [&] { return random_vector(coordinate, generator); };
    cluster.position = direction();
    const dvec3 axis = direction();
    cluster.orientation = glm::normalize(dquat(coordinate(generator), axis));
    cluster.deviations = 0.15 * glm::exp(1.5 * direction());
    if (cluster.deviations.x < cluster.deviations.y) std::swap(cluster.deviations.x, cluster.deviations.y);
    if (cluster.deviations.y < cluster.deviations.z) std::swap(cluster.deviations.y, cluster.deviations.z);
    if (cluster.deviations.x < cluster.deviations.y) std::swap(cluster.deviations.x, cluster.deviations.y);
    cluster.mass = 10 * cluster.deviations.x * cluster.deviations.y * cluster.deviations.z;
    cluster.value = 0.5 + 0.5 * coordinate(generator);
    cluster.value_deviation = 0.1;
    cluster.correlation = 0.5 * direction();
  }
  return clusters;
}

struct MomentsTest : test::RasterizerTest {
  MomentsTest() : RasterizerTest(KernelKind::moments) {}

  Image picture(const std::vector<Cluster>& clusters, const View& view, const TransferFunction& function,
                SortMode sort = SortMode::exact, dvec3 origin = dvec3(0)) {
    return picture(materials_of(clusters, origin), view, function, sort, origin);
  }

  Image picture(const std::vector<MomentsSplat>& splats, const View& view, const TransferFunction& function,
                SortMode sort = SortMode::exact, dvec3 origin = dvec3(0)) {
    EXPECT_TRUE(renderer_->set_transfer_function(function, {}));
    EXPECT_TRUE(renderer_->set_draw_list(make_list(splats, {{origin, 0, splats.size()}})));
    return redraw(view, sort);
  }
};

TEST_P(MomentsTest, RoundSplatHasItsClosedForm) {
  // Orthographic, with a pixel for a world unit: depth = K m 3 / (pi a^2) (1 - r^2 / a^2)^2.
  const double deviation = 7;
  const double a = 0.95 * std::sqrt(12.0) * std::sqrt(deviation * deviation + 0.1);
  const double mass = 12345;
  for (const double extinction : {1e-5, 1e-3, 0.1, 3.0}) {
    const Image image = picture({Cluster{.position = {0, 0, -100}, .mass = mass, .deviations = dvec3(deviation)}},
                                orthographic_view(65), uniform(extinction));
    for (int x = 0; x < 65; ++x) {
      const double square = (x - 32) * (x - 32) / (a * a);
      const double depth = square < 1 ? extinction * mass * 3 / (pi * a * a) * (1 - square) * (1 - square) : 0;
      // The part fainter than 3e-4 is cut, and its light given to the rest.
      EXPECT_NEAR(image.at(x, 32).a, -std::expm1(-depth), 3.2e-4 + 2e-4 * depth) << x;
      EXPECT_NEAR(image.at(32, x).g, -std::expm1(-depth), 3.2e-4 + 2e-4 * depth) << x;
    }
    if (extinction < 0.01) {
      EXPECT_NEAR(total_alpha(image) / (extinction * mass), 1, 0.04);  // the cut lies between pixels
    }
  }
}

struct Case {
  const char* name;
  Cluster cluster;
};

/// Splats of every shape, at every distance from the eye, and with a boundary.
std::vector<Case> cases() {
  const dquat edge_on = glm::angleAxis(pi / 2, dvec3(1, 0, 0));  // the thin axis upwards
  return {
      {"round", {.position = {0.3, -0.2, -5}, .deviations = dvec3(0.3)}},
      {"oblique", {.position = {-0.5, 0.4, -4}, .deviations = {0.5, 0.2, 0.1}, .orientation = oblique}},
      {"off centre", {.position = {2.2, 2.1, -6}, .deviations = {0.5, 0.2, 0.1}, .orientation = oblique}},
      {"needle", {.position = {0, 0, -4}, .deviations = {0.6, 1e-4, 1e-5}, .orientation = oblique}},
      {"needle of ratio 1e8", {.position = {0.1, 0, -4}, .deviations = {1, 1e-8, 1e-8}, .orientation = oblique}},
      {"needle at the eye",
       {.position = {0.1, 0.1, -3},
        .deviations = {0.8, 1e-8, 1e-8},
        .orientation = glm::angleAxis(pi / 2, dvec3(0, 1, 0))}},
      {"pancake", {.position = {0, 0, -4}, .deviations = {1, 0.8, 1e-8}, .orientation = oblique}},
      {"pancake face on", {.position = {0, 0, -4}, .deviations = {0.5, 0.3, 1e-8}}},
      {"pancake edge on", {.position = {0.01, 0.02, -4}, .deviations = {0.5, 0.5, 1e-8}, .orientation = edge_on}},
      {"eye outside, near", {.position = {0.2, 0.1, -1.2}, .deviations = dvec3(0.3)}},
      {"eye outside, nearer", {.position = {0.2, 0.1, -1.0}, .deviations = dvec3(0.3)}},
      {"eye inside, behind the centre", {.position = {0.1, 0.1, -0.4}, .deviations = dvec3(0.3)}},
      {"eye in the centre", {.deviations = {0.3, 0.2, 0.1}, .orientation = oblique}},
      {"eye inside, before the centre", {.position = {0.1, -0.2, 0.5}, .deviations = {0.5, 0.3, 0.2}}},
      {"beside the eye", {.position = {2, 0.3, -0.3}, .deviations = {0.6, 0.5, 0.4}, .orientation = oblique}},
      {"behind the eye, reaching before it",
       {.position = {1, 0, 0.5}, .deviations = {1, 0.2, 0.1}, .orientation = oblique}},
      {"wall",
       {.position = {3, 2, -1}, .deviations = {20, 15, 0.01}, .orientation = glm::angleAxis(0.2, dvec3(1, 0, 0))}},
      {"wall beside the eye",
       {.position = {0.1, 0, 0}, .deviations = {5, 5, 0.001}, .orientation = glm::angleAxis(pi / 2, dvec3(0, 1, 0))}},
      {"point", {.position = {0.01, 0.02, -4}, .mass = 1e-4, .deviations = dvec3(0)}},
      {"bounded",
       {.position = {0.1, -0.2, -5},
        .deviations = {0.4, 0.3, 0.2},
        .orientation = oblique,
        .boundary = {0.5, -0.8, 1}}},
      {"bounded, nearer",
       {.position = {0.1, -0.2, -2.5},
        .deviations = {0.4, 0.3, 0.2},
        .orientation = oblique,
        .boundary = {0.5, -0.8, 1}}},
      {"bounded, nearly cut by the eye's plane",
       {.position = {0.1, -0.2, -1.4},
        .deviations = {0.4, 0.3, 0.2},
        .orientation = oblique,
        .boundary = {-0.5, 0.8, 1}}},
      {"bounded pancake",
       {.position = {0, 0, -4}, .deviations = {0.6, 0.5, 1e-8}, .orientation = oblique, .boundary = {1.3, 0, 0}}},
      {"bounded pancake, face",
       {.position = {0, 0, -4}, .deviations = {0.6, 0.5, 0.05}, .orientation = oblique, .boundary = {0, 0, 1.6}}},
      {"bounded, the eye inside",
       {.position = {0.1, 0.1, 0.1}, .deviations = {0.3, 0.2, 0.2}, .orientation = oblique, .boundary = {0.3, 1, 0.4}}},
      {"bounded, the eye beyond",
       {.position = {0.1, 0.1, -0.5}, .deviations = {0.3, 0.2, 0.2}, .boundary = {0, 0, 1.5}}},
  };
}

/// Half opaque at its brightest, unless the eye cuts that part.
TransferFunction half_opaque(const Cluster& cluster) {
  const double thick = 12 * pi / 3 * std::pow(std::max(cluster.deviations.x, 0.02), 2.0);
  return uniform(0.7 * thick / cluster.mass);
}

TEST_P(MomentsTest, SingleSplatsAgreeWithTheirDefinition) {
  for (const auto& [name, cluster] : cases())
    for (const View& view : {perspective_view(), orthographic_view(3)}) {
      SCOPED_TRACE(testing::Message() << name << ", orthographic " << view.orthographic);
      const TransferFunction function = half_opaque(cluster);
      const Image expected = evaluate(cluster, view, function);
      const Image image = picture({cluster}, view, function);
      expect_sane(image);
      // Single precision, at an outline that may be steep over a pixel.
      EXPECT_LT(largest_difference(image, expected), 1e-3);
      EXPECT_NEAR(total_alpha(image), total_alpha(expected), 1e-3 * total_alpha(expected) + 0.05);
    }
}

TEST_P(MomentsTest, SplatsEndAtSurfaces) {
  for (const auto& [name, cluster] : cases())
    for (const View& view : {perspective_view(), orthographic_view(3)})
      for (const double behind : {-0.2, 0.0, 0.1, 1.0}) {
        SCOPED_TRACE(testing::Message() << name << ", orthographic " << view.orthographic << ", " << behind);
        const TransferFunction function = half_opaque(cluster);
        const SurfaceDepths surfaces = leaning_plane(view, behind - cluster.position.z);
        ASSERT_TRUE(renderer_->set_surface_depths(std::make_shared<const SurfaceDepths>(surfaces)));
        const Image image = picture({cluster}, view, function);
        expect_sane(image);
        const Image expected = evaluate(cluster, view, function, {}, &surfaces);
        EXPECT_LT(largest_difference(image, expected), 1e-3);
      }
}

TEST_P(MomentsTest, ValuesVaryWithinASplat) {
  const Cluster base{.deviations = {0.5, 0.3, 0.2},
                     .orientation = oblique,
                     .value = 0.45,
                     .value_deviation = 0.2,
                     .correlation = {0.7, -0.4, 0.5}};
  for (const dvec3 position : {dvec3(0.3, 0.1, -5), dvec3(0.2, 0.1, -2), dvec3(0.1, 0.1, -0.6), dvec3(0.05, 0, 0.1)}) {
    for (const double value_deviation : {0.0, 0.02, 0.2, 3.0}) {
      Cluster cluster = base;
      cluster.position = position;
      cluster.value_deviation = value_deviation;
      for (const View& view : {perspective_view(33, 33), orthographic_view(4, 33, 33)}) {
        for (const auto& lighting : {std::optional<Lighting>(), std::optional(Lighting{0.2, 0.7})}) {
          renderer_->set_lighting(lighting);
          const Image image = picture({cluster}, view, lively(2));
          expect_sane(image);
          // The table's rows are 5 % apart. The renderer takes light and spread as the same all over a splat that the
          // eye's plane does not cut, even at depth 2, where it reaches two thirds of the way to the eye.
          // Its mean |cos| is 2 % off at most.
          const double bound = !view.orthographic && position.z == -2 ? 4e-2 : lighting ? 8e-3 : 4e-3;
          EXPECT_LT(rmse(image, evaluate(cluster, view, lively(2), lighting)), bound)
              << position.z << " " << value_deviation << " " << view.orthographic << " " << lighting.has_value();
        }
      }
    }
  }
}

TEST_P(MomentsTest, CubesMakeASlab) {
  // 33 x 33 x 5 cubes; rays through the middle cross five layers. A lattice has its largest ripple along its rows: a
  // seventh of the depth. It averages out.
  const double extinction = 0.3;
  const std::vector<Cluster> slab = cubes(1, 16, [](dvec3 p) { return std::abs(p.z) <= 2; });
  const double alpha = -std::expm1(-extinction * 5);
  for (const SortMode sort : {SortMode::none, SortMode::axis, SortMode::exact}) {
    const Image image = picture(slab, orthographic_view(10, 101, 101, {0, 0, 50}), uniform(extinction), sort);
    for (int y = 0; y < 101; ++y)
      for (int x = 0; x < 101; ++x) ASSERT_NEAR(image.at(x, y).a, alpha, 0.06) << x << " " << y;
    EXPECT_NEAR(total_alpha(image) / (101 * 101), alpha, 0.002);
  }
}

TEST_P(MomentsTest, CubesMakeABall) {
  const double radius = 12;
  const double extinction = 0.1;
  const std::vector<Cluster> ball = cubes(1, 12, [&](dvec3 p) { return glm::length(p) <= radius; });
  const double volume = static_cast<double>(ball.size());
  ASSERT_NEAR(volume / (4 * pi / 3 * radius * radius * radius), 1, 0.02);

  const View view = perspective_view(101, 101, {0, 0, 60});
  const Image image = picture(ball, view, uniform(extinction));
  double squares = 0;
  for (int y = 0; y < 101; ++y) {
    for (int x = 0; x < 101; ++x) {
      const dvec3 direction = glm::normalize(dvec3((x - 50) / view.focal, (y - 50) / view.focal, 1));
      const double distance = 60 * glm::length(glm::dvec2(direction));
      const double chord = distance < radius ? 2 * std::sqrt(radius * radius - distance * distance) : 0;
      const double error = image.at(x, y).a - -std::expm1(-extinction * chord);
      squares += error * error;
      // Only pixels away from the staircase of the outer cubes.
      if (distance < radius - 2) {
        ASSERT_NEAR(error, 0, 0.05) << x << " " << y;
      }
    }
  }
  EXPECT_LT(std::sqrt(squares / (101 * 101)), 0.03);
}

TEST_P(MomentsTest, ValuesMakeAGaussianBlob) {
  // Extinction falls as a Gaussian of standard deviation 5 cubes; so does the line integral.
  const double sigma = 5;
  const double extinction = 0.15;
  std::vector<Cluster> blob = cubes(1, 17, [](dvec3 p) { return glm::length(p) < 17; });
  for (Cluster& cube : blob) {
    cube.value = std::exp(-glm::dot(cube.position, cube.position) / (2 * sigma * sigma));
    const dvec3 gradient = -cube.position / (sigma * sigma) * cube.value;
    cube.value_deviation = glm::length(gradient) / std::sqrt(12.0);
    cube.correlation = glm::length(gradient) > 0 ? glm::normalize(gradient) : dvec3(0);
    cube.value *= 500;
    cube.value_deviation *= 500;
  }
  const Image image = picture(blob, orthographic_view(40, 101, 101, {0, 0, 50}), ramp(extinction / 500));
  for (int y = 0; y < 101; ++y) {
    for (int x = 0; x < 101; ++x) {
      const double square = ((x - 50) * (x - 50) + (y - 50) * (y - 50)) * std::pow(40.0 / 101, 2.0);
      const double depth = extinction * sigma * std::sqrt(2 * pi) * std::exp(-square / (2 * sigma * sigma));
      ASSERT_NEAR(image.at(x, y).a, -std::expm1(-depth), 0.05) << x << " " << y;
    }
  }
}

TEST_P(MomentsTest, SubPixelSplatsKeepTheirLight) {
  // Faint points at random positions, some with a boundary. The sum of alpha is extinction times mass times the pixels
  // of a world area.
  std::mt19937 generator(8);
  std::uniform_real_distribution<double> coordinate(-1, 1);
  for (const double deviation : {0.0, 1e-6, 0.03, 0.1, 0.3, -0.001, -0.1, -0.3}) {
    for (const View& view : {perspective_view(256, 256), orthographic_view(256, 256, 256)}) {
      const double depth = 100;
      const double scale = view.orthographic ? 1 : view.focal / depth;  // pixels for a world unit
      const double mass = 0.05 / scale / scale;
      std::vector<Cluster> points;
      for (int i = 0; i < 4000; ++i)
        points.push_back(
            {.position = {100 / scale * coordinate(generator), 100 / scale * coordinate(generator), -depth},
             .mass = mass,
             .deviations = dvec3(std::abs(deviation) / scale),
             .boundary = deviation < 0 ? dvec3(0.5, -0.8, 0.4) : dvec3(0)});
      const Image image = picture(points, view, uniform(1));
      // Overlaps and the curve of 1 - exp(-t) take 1 %. Off the axis, ray and distance are 1 % longer than the depth,
      // and the square of the distance counts.
      EXPECT_NEAR(total_alpha(image) / (4000 * 0.05), 1, 0.04) << deviation << " " << view.orthographic;
    }
  }
}

TEST_P(MomentsTest, BoundaryIsAPlaneThatNothingCrosses) {
  // Material on the left, seen from the front: a sharp edge through the middle of the picture, and as much light.
  const View view = orthographic_view(65);
  const Cluster half{.position = {-6, 0, -100}, .mass = 1000, .deviations = dvec3(8), .boundary = {0.75, 0, 0}};
  const Image image = picture({half}, view, uniform(1e-3));
  double right = 0;
  for (int y = 0; y < 65; ++y)
    for (int x = 33; x < 65; ++x) right += image.at(x, y).a;
  EXPECT_EQ(right, 0);
  EXPECT_GT(image.at(31, 32).a, 0.5 * image.at(24, 32).a);
  // A pixel whose centre lies on the edge is bright or dark as a whole.
  EXPECT_NEAR(total_alpha(image), 1, 0.03);

  // With its reflection it makes the whole splat: symmetric, and with all of the light.
  Cluster other = half;
  other.position.x = 6;
  other.boundary.x = -0.75;
  const Image whole = picture({half, other}, view, uniform(1e-3));
  for (int y = 0; y < 65; ++y)
    for (int x = 0; x < 32; ++x) ASSERT_NEAR(whole.at(x, y).a, whole.at(64 - x, y).a, 1e-5);
  EXPECT_NEAR(total_alpha(whole), 2, 0.02);
  // Seen face on it is thinner towards the edge, but its light is the same.
  const Cluster facing{.position = {0, 0, -100}, .mass = 1000, .deviations = dvec3(8), .boundary = {0, 0, 0.75}};
  EXPECT_NEAR(total_alpha(picture({facing}, view, uniform(1e-3))), 1, 0.01);
}

TEST_P(MomentsTest, OrderChangesColoursOnly) {
  std::vector<Cluster> clusters = cloud(300);
  const View view = perspective_view(64, 64, {0, 0, 4});
  const Image sorted = picture(clusters, view, lively(3), SortMode::exact);
  std::mt19937 generator(4);
  std::ranges::shuffle(clusters, generator);
  const Image shuffled = picture(clusters, view, lively(3), SortMode::none);
  EXPECT_GT(rmse(sorted, shuffled), 0.01);
  for (std::size_t i = 0; i < sorted.pixels.size(); ++i) ASSERT_NEAR(sorted.pixels[i].a, shuffled.pixels[i].a, 1e-4);
}

TEST_P(MomentsTest, NoSortingKeepsTheGivenOrder) {
  const Cluster far{.position = {0, 0, -9}, .mass = 50, .deviations = dvec3(1), .value = 0};
  const Cluster near{.position = {0, 0, -4}, .mass = 50, .deviations = dvec3(1), .value = 1};
  TransferFunction function = uniform(1);
  function.hi = 1;
  function.colors = {{0, {1, 0, 0}}, {1, {0, 0, 1}}};
  const View view = perspective_view();
  const Image exact = picture({near, far}, view, function, SortMode::exact);
  EXPECT_LT(rmse(picture({far, near}, view, function, SortMode::none), exact), 1e-6);
  EXPECT_GT(picture({near, far}, view, function, SortMode::none).at(32, 32).r, 0.8);
  EXPECT_GT(exact.at(32, 32).b, 0.8);
}

TEST_P(MomentsTest, AxisOrderIsExactAlongTheAxis) {
  // Splats behind each other along each axis, in two batches, seen from both ends.
  std::vector<int> positions(40);
  std::iota(positions.begin(), positions.end(), -20);
  std::mt19937 generator(3);
  std::ranges::shuffle(positions, generator);
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<MomentsSplat> splats;
    const dvec3 origin(1e6, -2e6, 3e6);
    for (const int position : positions) {
      Cluster cluster{.mass = 10, .deviations = dvec3(1), .value = 0.02 * (position + 25)};
      cluster.position[axis] = position;
      splats.push_back(material_of(cluster));
    }
    ASSERT_TRUE(renderer_->set_transfer_function(lively(1), {}));
    ASSERT_TRUE(renderer_->set_draw_list(make_list(splats, {{origin, 0, 15}, {origin, 15, 25}})));
    for (const double side : {-40.0, 40.0}) {
      Camera camera{.position = origin, .focal_point = origin};
      camera.position[axis] += side;
      camera.position[(axis + 2) % 3] += 3;
      camera.up = dvec3(0);
      camera.up[(axis + 1) % 3] = 1;
      const View view = make_view(camera, 48, 48).value();
      const Image exact = redraw(view, SortMode::exact);
      ASSERT_GT(total_alpha(exact), 10);
      EXPECT_LT(rmse(redraw(view, SortMode::axis), exact), 1e-6) << axis << " " << side;
      EXPECT_GT(rmse(redraw(view, SortMode::none), exact), 1e-3) << axis << " " << side;

      // The splats were sorted only once.
      double least = 1;
      for (int i = 0; i < 5; ++i) least = std::min(least, renderer_->draw(view, SortMode::axis, 1)->sort);
      EXPECT_LT(least, 1e-6);
    }
  }
}

TEST_P(MomentsTest, PictureMovesWithTheScene) {
  const std::vector<Cluster> clusters = cloud(300);
  Camera camera{.position = {0.5, 0.3, 2.5}, .focal_point = {0.1, 0, 0}};
  const Image expected = picture(clusters, make_view(camera, 64, 64).value(), lively(3));
  ASSERT_GT(total_alpha(expected), 500);

  const auto moved = [&](dquat turn, dvec3 shift, double scale) {
    std::vector<Cluster> result = clusters;
    for (Cluster& cluster : result) {
      cluster.position = scale * (turn * cluster.position) + shift;
      cluster.orientation = turn * cluster.orientation;
      cluster.deviations *= scale;
      cluster.mass *= scale * scale * scale;
    }
    Camera other = camera;
    other.position = scale * (turn * camera.position) + shift;
    other.focal_point = scale * (turn * camera.focal_point) + shift;
    other.up = turn * camera.up;
    return picture(result, make_view(other, 64, 64).value(), lively(3 / scale), SortMode::exact, shift);
  };
  const dquat turn = glm::normalize(dquat(0.3, -0.7, 0.4, 0.5));
  const dquat still(1, 0, 0, 0);
  EXPECT_LE(rmse(moved(turn, dvec3(0), 1), expected), 1e-3);
  EXPECT_LE(rmse(moved(still, dvec3(1e7, -2e7, 3e7), 1), expected), 1e-3);
  for (const double scale : {1e-6, 1e6}) EXPECT_LE(rmse(moved(turn, dvec3(0), scale), expected), 1e-3) << scale;
}

TEST_P(MomentsTest, NothingJumpsAsTheEyeFliesThrough) {
  // The eye moves through a flat oblique splat, near its centre, from 3 before it to 1 behind: other forms take over.
  const Cluster cluster{.deviations = {0.5, 0.3, 0.1},
                        .orientation = oblique,
                        .value = 0.5,
                        .value_deviation = 0.1,
                        .correlation = {0.6, 0.5, -0.4}};
  Image last;
  for (int frame = 0; frame <= 400; ++frame) {
    const Image image = picture({cluster}, perspective_view(32, 32, {0.05, 0.1, 3 - 0.01 * frame}), lively(0.1));
    expect_sane(image);
    if (frame > 0) {
      ASSERT_LT(largest_difference(image, last), 0.01) << frame;
    }
    last = image;
  }
  EXPECT_EQ(total_alpha(last), 0);
}

// A ball whose gradient is turned by `angle` from the line of sight, in a plane that contains it.
Cluster with_gradient(double angle, double correlation) {
  return {.position = {0, 0, -10},
          .mass = 100,
          .deviations = dvec3(1),
          .orientation = glm::angleAxis(angle, dvec3(0, 1, 0)),
          .value = 500,
          .value_deviation = 1,
          .correlation = {0, 0, correlation}};
}

TEST_P(MomentsTest, LightFollowsTheGradient) {
  const View view = orthographic_view(9, 9, 9);
  const TransferFunction function = uniform(10);
  for (const double angle : {0.0, 0.4, 1.0, 1.5}) {
    const Cluster cluster = with_gradient(angle, 1);
    renderer_->set_lighting(Lighting{0.25, 0.5});
    const Image lit = picture({cluster}, view, function);
    EXPECT_NEAR(lit.at(4, 4).r, 0.25 + 0.5 * std::cos(angle), 1e-3);
    EXPECT_NEAR(lit.at(4, 4).a, 1, 1e-4);

    // Without a gradient: full light. Without lighting: the colour itself.
    Cluster flat = cluster;
    flat.value_deviation = 0;
    EXPECT_NEAR(picture({flat}, view, function).at(4, 4).r, 0.75, 1e-3);
    renderer_->set_lighting({});
    EXPECT_NEAR(picture({cluster}, view, function).at(4, 4).r, 1, 1e-3);
  }
}

TEST_P(MomentsTest, GradientsThatScatterHaveTheirMeanLight) {
  const View view = orthographic_view(9, 9, 9);
  std::mt19937 random(7);
  std::normal_distribution<double> normal;
  for (const double angle : {0.0, 0.7, 1.2, pi / 2}) {
    for (const double correlation : {1.0, 0.9, 0.6, 0.2, 0.0}) {
      const Cluster cluster = with_gradient(angle, correlation);
      renderer_->set_lighting(Lighting{0, 1});
      const Image lit = picture({cluster}, view, uniform(10));

      // The mean of |cos| itself, of gradients whose scatter follows from a field of the second order.
      const double unexplained = 1 - correlation * correlation;
      const double scatter = std::sqrt(unexplained / 1.5);
      const dvec3 mean = correlation * dvec3(std::sin(angle), 0, std::cos(angle));
      constexpr int samples = 20'000;
      double sum = 0;
      for (int i = 0; i < samples; ++i)
        sum += std::abs(glm::normalize(mean + scatter * random_vector(normal, random)).z);
      EXPECT_NEAR(lit.at(4, 4).r, sum / samples, 0.04) << angle << " " << correlation;
    }
  }
}

TEST_P(MomentsTest, NarrowDomainsAndWideSpreads) {
  // Half of the values lie below the domain, where the extinction is 0, half above.
  TransferFunction function{
      .lo = 1000, .hi = 1000.001, .colors = {{0, {1, 0, 0}}, {1, {0, 1, 0}}}, .densities = {{0, 0}, {1, 1}}};
  ASSERT_TRUE(renderer_->set_transfer_function(function, {.value_offset = 1000}));
  const Cluster cluster{.position = {0, 0, -10}, .mass = 50, .deviations = dvec3(3), .value_deviation = 10};
  ASSERT_TRUE(renderer_->set_draw_list(make_list(materials_of({cluster}), {{dvec3(0), 0, 1}})));
  const Image image = redraw(orthographic_view(9, 9, 9));
  const double a = 0.95 * std::sqrt(12.0) * std::sqrt(9.1);
  EXPECT_NEAR(image.at(4, 4).a, -std::expm1(-0.5 * 50 * 3 / (pi * a * a)), 2e-3);
  // A spread counts as eight domains at most: an eighth times 0.4 times a third of the light comes from the domain.
  EXPECT_NEAR(image.at(4, 4).g / image.at(4, 4).a, 1, 0.02);
}

// A bent axis draws what a linear one draws of the moments that the splat has on the bent axis.
TEST_P(MomentsTest, BentAxesTakeTheMomentsOnTheAxis) {
  const auto drawn = [&](const TransferFunction& function, const Cluster& cluster, const DrawingUnits& units) {
    EXPECT_TRUE(renderer_->set_transfer_function(function, units));
    EXPECT_TRUE(renderer_->set_draw_list(make_list(materials_of({cluster}), {{dvec3(0), 0, 1}})));
    return redraw(perspective_view());
  };
  for (const ValueAxis axis : {ValueAxis::log, ValueAxis::asinh})
    for (const double value : {2e-3, 0.7, 40.0, -5.0})
      for (const double share : {0.01, 0.5, 3.0}) {
        SCOPED_TRACE(testing::Message() << int(axis) << ", " << value << " +- " << share * std::abs(value));
        Cluster cluster{.position = {0, 0, -10},
                        .mass = 3,
                        .deviations = {1, 0.7, 0.4},
                        .orientation = oblique,
                        .value = value,
                        .value_deviation = share * std::abs(value),
                        .correlation = {0.5, -0.4, 0.3}};
        TransferFunction function = lively(0.8);
        function.axis = axis;
        function.lo = axis == ValueAxis::log ? 1e-3 : -100;
        function.hi = 100;
        function.linear_width = 0.01;
        const AxisMoments t = function.moments_of(value, cluster.value_deviation);
        // A value is 0.5 more than a quarter of the stored value.
        cluster.value = (value - 0.5) * 4, cluster.value_deviation *= 4;
        const Image bent = drawn(function, cluster, {.value_offset = 0.5, .value_scale = 0.25});
        cluster.value = t.mean, cluster.value_deviation = t.deviation;
        const Image linear = drawn(lively(0.8), cluster, {});
        for (std::size_t i = 0; i < linear.pixels.size(); ++i)
          ASSERT_LT(glm::length(bent.pixels[i] - linear.pixels[i]), 1e-3f) << i;
      }
}

/// Splats with zeros, extreme numbers and numbers that are not finite, in many combinations.
std::vector<Cluster> hard_cases() {
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  constexpr double infinity = std::numeric_limits<double>::infinity();
  const std::vector<double> numbers{0, 1e-40, 1e-30, 1e-10, 1, 1e10, 1e30, 3e38, infinity, nan, -1};
  std::vector<Cluster> clusters;
  for (const double mass : numbers)
    for (const double deviation : numbers)
      for (const double z : {-1e30, -1e10, -1.0, -1e-10, -1e-38, 0.0, 1e-3, 1.0, nan})
        for (const double thin : {1.0, 1e-8, 0.0})
          clusters.push_back({.position = {0, 1e-3 * z, z},
                              .mass = mass,
                              .deviations = {deviation, deviation, deviation * thin},
                              .orientation = oblique,
                              .value = 0.5,
                              .value_deviation = 0.3,
                              .correlation = {0.6, 0.6, 0.5},
                              .boundary = thin == 1 ? dvec3(0) : dvec3(1, -2, thin)});
  for (const double value : numbers)
    for (const double value_deviation : numbers)
      for (const double z : {-5.0, -0.1})
        clusters.push_back({.position = {0, 0, z},
                            .mass = 0.1,
                            .deviations = dvec3(0.3),
                            .value = value,
                            .value_deviation = value_deviation,
                            .correlation = {1, 1, 1}});
  return clusters;
}

TEST_P(MomentsTest, HardCasesStaySane) {
  const std::vector<Cluster> clusters = hard_cases();
  for (const double extinction : {1e-30, 1.0, 1e30}) {
    for (const View& view : {perspective_view(33, 17), orthographic_view(3, 33, 17)}) {
      // All of them, then each alone: an opaque splat could hide an error of another.
      expect_sane(picture(clusters, view, lively(extinction)));
      const std::vector<MomentsSplat> splats = materials_of(clusters);
      for (std::uint64_t i = 0; i < splats.size(); i += extinction == 1 ? 1 : 7) {
        ASSERT_TRUE(renderer_->set_draw_list(make_list(splats, {{dvec3(0), i, 1}})));
        expect_sane(redraw(view, SortMode::none));
        if (HasFailure())
          FAIL() << i << ": mass " << clusters[i].mass << ", deviations " << clusters[i].deviations.x << " "
                 << clusters[i].deviations.z << ", z " << clusters[i].position.z << " value " << clusters[i].value
                 << " " << clusters[i].value_deviation << " extinction " << extinction << " " << view.orthographic;
      }
    }
  }
}

TEST_P(MomentsTest, WhatDrawsNothing) {
  constexpr double nan = std::numeric_limits<double>::quiet_NaN();
  const std::vector<Cluster> nothing{
      {.position = {0, 0, -5}, .mass = 0},
      {.position = {0, 0, -5}, .mass = nan},
      {.position = {0, 0, -5}, .value = nan},
      {.position = {0, 0, 5}, .deviations = dvec3(1)},    // behind the eye
      {.position = {50, 0, -5}, .deviations = dvec3(1)},  // outside the picture
      {.position = {5, 0, 0}, .deviations = dvec3(0.5)},  // beside the eye, outside
      {.position = {0, 0, -5}, .value = 0, .value_deviation = 0},
  };
  TransferFunction function = lively(100);
  for (const Cluster& cluster : nothing) {
    Cluster visible = cluster;
    if (&cluster != &nothing.back() && !std::isnan(cluster.value)) visible.value = 1;
    EXPECT_EQ(total_alpha(picture({visible}, perspective_view(), function)), 0) << &cluster - nothing.data();
  }
}

TEST_P(MomentsTest, RefusesSplatsOfTheOtherKernel) {
  const DrawList octant = make_list(std::vector<OctantSplat>(1), {{dvec3(0), 0, 1}});
  const DrawList moments = make_list(std::vector<MomentsSplat>(3), {{dvec3(0), 0, 3}});
  EXPECT_THAT(renderer_->set_draw_list(octant).error().message, HasSubstr("octant"));
  const auto other = make_rasterizer(GetParam(), {.kernel = KernelKind::octant, .in_current_context = true}).value();
  EXPECT_THAT(other->set_draw_list(moments).error().message, HasSubstr("moments"));
}

INSTANTIATE_TEST_SUITE_P(Devices, MomentsTest, testing::Values(Device::gl, Device::cpu), device_name);

}  // namespace
}  // namespace splatvol::test
