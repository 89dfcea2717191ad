// Integrals over contours and slices of the cells of a file.
#include "sampler/surface_integrals.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <numbers>

#include "tests/sampler/sampled_cells.h"

namespace splatvol::test {
namespace {

using testing::HasSubstr;

constexpr double tiny = 1e-12;

double linear(const dvec3& p) { return p.x + 2 * p.y + 4 * p.z; }

void expect_near(double value, double expected, double relative = tiny) {
  EXPECT_NEAR(value, expected, relative * std::abs(expected));
}

struct SurfaceIntegralsOfCells : SampledCells {
  // Cells of different sizes; "value" is linear, "x", "U[0]", "U[1]" and "U[2]" are x, y, z and 1.
  void build_fields(const Mesh& mesh = lattice(16, [](dvec3 p) { return p * p; })) {
    Piece piece = mesh_piece(mesh, linear);
    for (const auto& field :
         std::vector<std::function<double(dvec3)>>{[](dvec3 p) { return p.x; }, [](dvec3 p) { return p.y; },
                                                   [](dvec3 p) { return p.z; }, [](dvec3) { return 1.0; }})
      piece.values.push_back(mesh_piece(mesh, field).values[0]);
    PieceSource source({piece}, {.attributes = {"value", "x", "U[0]", "U[1]", "U[2]"}});
    ASSERT_EQ(message_of(build_volume(source, path("mesh.svol"), exact(), [](const char*, double) {})), "");
    open("mesh.svol");
  }

  [[nodiscard]] Result<SurfaceIntegrals> try_to(const SurfaceRequest& request, std::uint64_t memory = 1 << 24,
                                                std::size_t threads = 2) const {
    return integrate_surface(*volume_, request, memory, threads, [](double) {});
  }
  [[nodiscard]] SurfaceIntegrals integrate(const SurfaceRequest& request) const { return value_of(try_to(request)); }
};

const std::array<std::string, 3> vector = {"U[0]", "U[1]", "U[2]"};

TEST_F(SurfaceIntegralsOfCells, OfASliceAreThoseOfItsRectangle) {
  build_fields();
  for (const double x : {0.125, 0.3, 0.7}) {
    const SurfaceRequest request{.surface = HalfSpace{{x, 5, 5}, {-3, 0, 0}}, .vector = vector};
    const SurfaceIntegrals of = integrate(request);
    expect_near(of.area, 1);
    ASSERT_EQ(of.attributes.size(), 5u);
    const SurfaceIntegral& value = of.attributes[0];
    expect_near(value.area, 1);
    expect_near(value.mean, x + 3);
    expect_near(value.integral, x + 3);
    expect_near(value.low, x);
    expect_near(value.high, x + 6);
    EXPECT_LE(glm::distance(value.low_position, dvec3(x, 0, 0)), tiny);
    EXPECT_LE(glm::distance(value.high_position, dvec3(x, 1, 1)), tiny);
    expect_near(of.attributes[1].mean, x);
    expect_near(of.flux, -0.5);  // the mean of y, against the normal
    EXPECT_TRUE(std::isnan(of.enclosed_volume));
  }
}

TEST_F(SurfaceIntegralsOfCells, OfAContourHaveClosedForms) {
  build_fields();
  // x + 2 y + 4 z = 1 cuts off a corner: a triangle with the middle (1/3, 1/6, 1/12).
  const SurfaceIntegrals of = integrate({.surface = ContourSurface{"value", 1}, .vector = vector});
  const double area = std::sqrt(21.0) / 16;
  expect_near(of.area, area);
  EXPECT_EQ(of.attributes[0].low, 1);
  EXPECT_EQ(of.attributes[0].high, 1);
  expect_near(of.attributes[1].mean, 1.0 / 3);
  expect_near(of.attributes[1].high, 1);
  // To lower values: (-1, -2, -4) / sqrt(21), with the mean vector (1/6, 1/12, 1).
  expect_near(of.flux, -(1.0 / 6 + 2.0 / 12 + 4) / std::sqrt(21.0) * area);
}

TEST_F(SurfaceIntegralsOfCells, AreCutExactly) {
  build_fields();
  const HalfSpace slice{{0, 0, 0.4}, {0, 0, 1}};
  const SurfaceIntegrals boxed =
      integrate({.surface = slice, .integrals = {.attributes = {"x"}, .box = Box{{0.1, 0.3, 0}, {0.6, 0.9, 1}}}});
  expect_near(boxed.area, 0.5 * 0.6);
  expect_near(boxed.attributes[0].mean, 0.35);
  expect_near(boxed.attributes[0].low, 0.1);
  expect_near(boxed.attributes[0].high, 0.6);
  // The triangle x + y <= 1/3.
  const SurfaceIntegrals planed = integrate(
      {.surface = slice, .integrals = {.attributes = {"x"}, .clip_planes = {{{1.0 / 3, 0, 0}, {-1, -1, 0}}}}});
  expect_near(planed.area, 1.0 / 18);
  expect_near(planed.attributes[0].mean, 1.0 / 9);
  // x + 2 y + 1.6 in [2, 2.2]: a stripe of the square.
  const SurfaceIntegrals ranged =
      integrate({.surface = slice,
                 .integrals = {.attributes = {"value"}, .ranges = {{.attribute = "value", .low = 2, .high = 2.2}}}});
  expect_near(ranged.area, (0.36 - 0.16) / 4);
  EXPECT_EQ(ranged.attributes[0].low, 2);
  EXPECT_EQ(ranged.attributes[0].high, 2.2);
  EXPECT_EQ(integrate({.surface = HalfSpace{{2, 0, 0}, {1, 0, 0}}}).area, 0);
  EXPECT_TRUE(std::isnan(integrate({.surface = HalfSpace{{2, 0, 0}, {1, 0, 0}}}).attributes[0].mean));
}

// A face of two cells in the plane is one, and so is one that many cells meet in a point or an edge.
TEST_F(SurfaceIntegralsOfCells, FacesInASliceCountOnce) {
  build_fields(lattice(8));
  for (const dvec3 normal : {dvec3(0, 0, 1), dvec3(0, 0, -1), dvec3(1, 0, 0), dvec3(0, -1, 0)})
    expect_near(integrate({.surface = HalfSpace{dvec3(0.5), normal}}).area, 1);
  expect_near(integrate({.surface = HalfSpace{dvec3(0.5), {1, -1, 0}}}).area, std::sqrt(2.0));
}

TEST_F(SurfaceIntegralsOfCells, AClosedContourHasAVolume) {
  const auto radius = [](dvec3 p) { return double{static_cast<float>(1 - glm::distance(p, dvec3(0.5)))}; };
  build(mesh_piece(jittered(24, 0.2), radius));
  const SurfaceIntegrals ball = integrate({.surface = ContourSurface{"value", 0.6}});
  EXPECT_NEAR(ball.area, 4 * std::numbers::pi * 0.16, 0.02);
  EXPECT_NEAR(ball.enclosed_volume, 4.0 / 3 * std::numbers::pi * 0.064, 0.004);
  const SurfaceRequest half{.surface = ContourSurface{"value", 0.6},
                            .integrals = {.clip_planes = {{dvec3(0.5), {1, 0, 0}}}}};
  EXPECT_NEAR(integrate(half).area, ball.area / 2, 0.01);
  EXPECT_TRUE(std::isnan(integrate(half).enclosed_volume));
  EXPECT_TRUE(std::isnan(integrate({.surface = ContourSurface{"value", 0.3}}).enclosed_volume)) << "it leaves the cube";
  const SurfaceIntegrals one = value_of(try_to({.surface = ContourSurface{"value", 0.6}}, 0, 1));
  EXPECT_EQ(one.area, ball.area);
  EXPECT_EQ(one.enclosed_volume, ball.enclosed_volume);
  EXPECT_EQ(one.attributes[0].integral, ball.attributes[0].integral);
}

TEST_F(SurfaceIntegralsOfCells, MissingValuesAreTold) {
  const auto half = [](dvec3 p) { return p.x > 0.5 ? none : p.x; };
  Piece piece = mesh_piece(lattice(8), linear);
  piece.values.push_back(mesh_piece(lattice(8), half).values[0]);
  PieceSource source({piece}, {.attributes = {"value", "half"}});
  ASSERT_EQ(message_of(build_volume(source, path("mesh.svol"), exact(), [](const char*, double) {})), "");
  open("mesh.svol");
  const HalfSpace slice{{0, 0, 0.4}, {0, 0, 1}};
  const SurfaceIntegrals of = integrate({.surface = slice});
  expect_near(of.area, 1);
  expect_near(of.attributes[1].area, 0.5);
  expect_near(of.attributes[1].missing_area, 0.5);
  expect_near(of.attributes[1].mean, 0.25);
  const SurfaceIntegrals ranged = integrate(
      {.surface = slice, .integrals = {.attributes = {"value"}, .ranges = {{.attribute = "half", .low = 0.25}}}});
  expect_near(ranged.area, 0.25);
  expect_near(ranged.unknown_area, 0.5);
}

TEST_F(SurfaceIntegralsOfCells, OfCellsWithValuesOfTheirOwn) {
  std::ofstream(path("shapes.vtk")) << mesh_of_shapes();
  build_input(path("shapes.vtk"), path("own.svol"), exact(), {.selection = {"number"}, .cells = CellValues::own});
  open("own.svol");
  const SurfaceIntegrals of = integrate({.surface = HalfSpace{{0, 0, 0.25}, {0, 0, 1}}});
  EXPECT_GT(of.area, 0);
  double sum = 0;
  for (const SurfaceIntegral& attribute : of.attributes) sum += attribute.area;
  expect_near(sum, of.area);
  EXPECT_THAT(message_of(try_to({.surface = ContourSurface{"number", 1}})), HasSubstr("values of their own"));
}

TEST_F(SurfaceIntegralsOfCells, SayWhatIsWrong) {
  build_fields();
  EXPECT_THAT(message_of(try_to({.surface = ContourSurface{"heat", 1}})), HasSubstr("heat"));
  EXPECT_THAT(message_of(try_to({.surface = ContourSurface{"value", none}})), HasSubstr("finite"));
  EXPECT_THAT(message_of(try_to({.surface = HalfSpace{{0, 0, 0}, {0, 0, 0}}})), HasSubstr("not 0, 0, 0"));
  EXPECT_THAT(message_of(try_to({.surface = HalfSpace{}, .vector = {"V[0]", "V[1]", "V[2]"}})), HasSubstr("V[0]"));
}

}  // namespace
}  // namespace splatvol::test
