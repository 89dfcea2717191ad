// Integrals over the cells of a file.
#include "sampler/integrals.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <fstream>

#include "sampler/tetrahedron_cut.h"
#include "tests/sampler/sampled_cells.h"

namespace splatvol::test {
namespace {

using testing::HasSubstr;

constexpr double tiny = 1e-12;  // of sums of a few thousand numbers

// Single precision has its values at multiples of 2^-12.
double linear(const dvec3& p) { return p.x + 2 * p.y + 4 * p.z; }

// Cells of different sizes; coordinates are multiples of 1/256.
Mesh uneven(std::uint32_t cells = 16) {
  return lattice(cells, [](dvec3 p) { return p * p; });
}

void expect_near(double value, double expected, double relative = tiny) {
  EXPECT_NEAR(value, expected, relative * std::abs(expected));
}

void expect_near(const dvec3& position, const dvec3& expected) {
  for (int axis = 0; axis < 3; ++axis) EXPECT_NEAR(position[axis], expected[axis], tiny);
}

struct IntegralsOfCells : SampledCells {
  [[nodiscard]] Result<Integrals> try_to(const IntegralRequest& request, std::uint64_t memory = 1 << 24,
                                         std::size_t threads = 2) const {
    return integrate_cells(*volume_, request, memory, threads, [](double) {});
  }
  [[nodiscard]] Integrals integrate(const IntegralRequest& request = {}) const { return value_of(try_to(request)); }

  // Bytes read of a file that was just opened.
  [[nodiscard]] std::uint64_t bytes_of(const IntegralRequest& request) {
    open("mesh.svol");
    const std::uint64_t before = volume_->bytes_read();
    EXPECT_TRUE(try_to(request));
    return volume_->bytes_read() - before;
  }
};

TEST_F(IntegralsOfCells, OfALinearFieldInBoxesAreVolumeTimesItsMiddle) {
  build_fields(uneven(), {linear});
  const Integrals all = integrate();
  expect_near(all.volume, 1);
  ASSERT_EQ(all.attributes.size(), 1u);
  const Integral& whole = all.attributes[0];
  EXPECT_EQ(whole.name, "value");
  expect_near(whole.volume, 1);
  expect_near(whole.integral, 3.5);
  expect_near(whole.mean, 3.5);
  EXPECT_EQ(whole.low, 0);
  EXPECT_EQ(whole.high, 7);
  EXPECT_EQ(whole.low_position, dvec3(0));
  EXPECT_EQ(whole.high_position, dvec3(1));
  EXPECT_EQ(whole.missing_volume, 0);
  EXPECT_EQ(all.unknown_volume, 0);
  EXPECT_EQ(all.left_out, 0u);

  for (int i = 0; i < 20; ++i) {
    const std::vector<dvec3> ends = random_positions(2, 0, 1);
    const Box box{glm::min(ends[0], ends[1]), glm::max(ends[0], ends[1])};
    const Integrals part = integrate({.box = box});
    const dvec3 extent = box.extent();
    expect_near(part.volume, extent.x * extent.y * extent.z);
    const Integral& of = part.attributes[0];
    expect_near(of.integral, part.volume * linear(0.5 * (box.low + box.high)));
    EXPECT_NEAR(of.low, linear(box.low), tiny);
    EXPECT_NEAR(of.high, linear(box.high), tiny);
    expect_near(of.low_position, box.low);
    expect_near(of.high_position, box.high);
  }
  expect_near(integrate({.box = Box{dvec3(-3), dvec3(5)}}).attributes[0].integral, 3.5);
}

// Faces of cells are in these planes: neighbours that only touch the region do not count.
TEST_F(IntegralsOfCells, PlanesOfFacesCutNothing) {
  build_fields(lattice(8), {linear});
  const Integrals part = integrate({.box = Box{dvec3(0.25), dvec3(0.5)}});
  expect_near(part.volume, 1.0 / 64);
  EXPECT_EQ(part.attributes[0].low, linear(dvec3(0.25)));
  EXPECT_EQ(part.attributes[0].high, linear(dvec3(0.5)));
  expect_near(integrate({.clip_planes = {{{0.5, 0, 0}, {2, -2, 0}}}}).volume, 0.125);  // x - y >= 1/2
}

TEST_F(IntegralsOfCells, OfHalfSpacesHaveClosedForms) {
  build_fields(uneven(), {linear});
  for (const double c : {1e-3, 0.3, 0.7, 1.0}) {
    const HalfSpace corner{{c, 0, 0}, {-3, -3, -3}};  // x + y + z <= c
    const Integrals part = integrate({.clip_planes = {corner}});
    expect_near(part.volume, c * c * c / 6);
    expect_near(part.attributes[0].integral, 7 * c * c * c * c / 24);
    expect_near(part.attributes[0].high, 4 * c);
    expect_near(part.attributes[0].high_position, {0, 0, c});
    expect_near(integrate({.clip_planes = {{corner.point, -corner.normal}}}).volume, 1 - c * c * c / 6);
    const Integrals half = integrate({.clip_planes = {corner, {dvec3(0), {1, -1, 0}}}});  // x >= y
    expect_near(half.volume, c * c * c / 12);
    // And z <= c / 2: a corner of half the size is missing.
    const Integrals cut = integrate({.box = Box{dvec3(0), {1, 1, c / 2}}, .clip_planes = {corner}});
    expect_near(cut.volume, c * c * c / 6 * 7 / 8);
  }
}

TEST_F(IntegralsOfCells, RangesCutAsPlanesDo) {
  build_fields(uneven(), {[](dvec3 p) { return p.x + p.y + p.z; }, [](dvec3 p) { return p.x; }});
  for (const double c : {0.01, 0.7, 1.0}) {
    const Integrals part = integrate({.ranges = {{.attribute = "value", .high = c}}});
    expect_near(part.volume, c * c * c / 6);
    expect_near(part.attributes[0].integral, c * c * c * c / 8);
    EXPECT_EQ(part.attributes[0].high, c);
    expect_near(part.attributes[1].integral, c * c * c * c / 24);
  }
  const Integrals slab = integrate({.ranges = {{"other", 0.3, 0.3 + 1e-6}}});
  expect_near(slab.volume, 0.3 + 1e-6 - 0.3);
  EXPECT_EQ(slab.attributes[1].low, 0.3);
  EXPECT_EQ(slab.attributes[1].high, 0.3 + 1e-6);

  // Only the attribute of the request has integrals.
  const Integrals both = integrate({.attributes = {"other"},
                                    .box = Box{{0, 0.1, 0}, {1, 0.5, 1}},
                                    .ranges = {{"other", 0.2, 0.6}, {.attribute = "value", .low = 2.1}}});
  ASSERT_EQ(both.attributes.size(), 1u);
  // No point with x <= .6 and y <= .5 has x + y + z > 2.1.
  EXPECT_EQ(both.volume, 0);
  EXPECT_TRUE(std::isnan(both.attributes[0].mean));
  EXPECT_TRUE(std::isnan(both.attributes[0].low_position.x));
  const Integrals pyramid = integrate({.ranges = {{"other", 0.5, 1}, {.attribute = "value", .low = 2.5}}});
  expect_near(pyramid.volume, 0.5 * 0.5 * 0.5 / 6);
  EXPECT_EQ(integrate({.ranges = {{"other", 0.3, 0.3}}}).volume, 0);
}

// Tetrahedra of any orientation, flat ones, and some whose points coincide.
TEST_F(IntegralsOfCells, OrientationDoesNotCountAndFlatCellsAreNone) {
  Mesh mesh = lattice(4);
  for (std::size_t t = 0; t < mesh.tetrahedra.size(); t += 3) std::swap(mesh.tetrahedra[t][1], mesh.tetrahedra[t][2]);
  const auto copy = static_cast<std::uint32_t>(mesh.points.size());
  mesh.points.push_back(mesh.points[1]);
  for (const auto& corners : {std::array<std::uint32_t, 4>{0, 1, 2, 3}, {0, 1, 2, 7}, {1, copy, 30, 60}})
    mesh.tetrahedra.push_back({corners[0], corners[1], corners[2], corners[3]});
  build_fields(mesh, {linear});
  const Integrals all = integrate();
  expect_near(all.volume, 1);
  expect_near(all.attributes[0].integral, 3.5);
  expect_near(integrate({.box = Box{dvec3(0.1), dvec3(0.6)}}).volume, 0.125);
}

TEST_F(IntegralsOfCells, TwoBodiesKeepTheirValues) {
  Mesh mesh = lattice(3), other = lattice(3, [](dvec3 p) { return p + dvec3(1, 0, 0); });
  const auto first = static_cast<std::uint32_t>(mesh.points.size());
  for (auto corners : other.tetrahedra) {
    for (std::uint32_t& corner : corners) corner += first;
    mesh.tetrahedra.push_back(corners);
  }
  mesh.points.insert(mesh.points.end(), other.points.begin(), other.points.end());
  Piece piece = mesh_piece(mesh, [](dvec3) { return 1.0; });
  for (std::size_t p = first; p < mesh.points.size(); ++p) piece.values[0][p] = 3;
  build(piece);
  EXPECT_EQ(integrate().attributes[0].low, 1);
  EXPECT_EQ(integrate().attributes[0].high, 3);
  expect_near(integrate().attributes[0].integral, 4);
  expect_near(integrate({.box = Box{{0.5, 0, 0}, {1.25, 1, 1}}}).attributes[0].integral, 0.5 + 0.75);
  expect_near(integrate({.ranges = {{"value", 3, 4}}}).volume, 1);
}

// All tetrahedra of the first cube have its first corner.
TEST_F(IntegralsOfCells, MissingValuesLeaveTheirTetrahedraOut) {
  build_fields(lattice(2), {[](dvec3 p) { return p == dvec3(0) ? none : linear(p); }, linear});
  const Integrals all = integrate();
  expect_near(all.volume, 1);
  expect_near(all.attributes[0].missing_volume, 0.125);
  expect_near(all.attributes[0].volume, 0.875);
  const double without = 3.5 - 0.125 * linear(dvec3(0.25));
  expect_near(all.attributes[0].integral, without);
  expect_near(all.attributes[0].mean, without / 0.875);
  EXPECT_EQ(all.attributes[0].low, 0.5);
  EXPECT_EQ(all.attributes[1].missing_volume, 0);
  expect_near(all.attributes[1].integral, 3.5);

  const Integrals ranged = integrate({.box = Box{dvec3(0), {0.75, 1, 1}}, .ranges = {{"value", 0, 100}}});
  expect_near(ranged.unknown_volume, 0.125);
  expect_near(ranged.volume, 0.625);
  EXPECT_EQ(ranged.attributes[0].missing_volume, 0);
  // No chunk is left out unread where volume without a value counts.
  expect_near(integrate({.ranges = {{"value", 50, 100}}}).unknown_volume, 0.125);
  const Integrals inside = integrate({.box = Box{dvec3(0), dvec3(0.5)}});
  expect_near(inside.attributes[0].missing_volume, 0.125);
  EXPECT_TRUE(std::isnan(inside.attributes[0].mean) && std::isnan(inside.attributes[0].high));
}

TEST_F(IntegralsOfCells, FarFromTheOriginTheyKeepTheirDigits) {
  const dvec3 origin(5e5, 4e6, 100);
  build_fields(lattice(16, [&](dvec3 p) { return origin + p; }), {[&](dvec3 p) { return linear(p - origin); }});
  expect_near(integrate().volume, 1);
  expect_near(integrate().attributes[0].integral, 3.5);
  const Box box{origin + dvec3(0.3, 0.2, 0.1), origin + dvec3(0.8, 0.9, 0.7)};
  const Integrals part = integrate({.box = box});
  const dvec3 extent = box.extent();
  expect_near(part.volume, extent.x * extent.y * extent.z);
  expect_near(part.attributes[0].integral, part.volume * linear(0.5 * ((box.low - origin) + (box.high - origin))));
  const Integrals corner = integrate({.clip_planes = {{origin + dvec3(0.7, 0, 0), {-1, -1, -1}}}});
  expect_near(corner.volume, 0.7 * 0.7 * 0.7 / 6, 1e-9);
}

TEST_F(IntegralsOfCells, NineDecadesOfSizesAddUp) {
  const auto halved = [](double x) { return x == 0 ? 0 : std::exp2(30 * (x - 1)); };
  build_fields(lattice(30, [&](dvec3 p) { return dvec3(halved(p.x), halved(p.y), halved(p.z)); }),
               {[](dvec3 p) { return p.x; }});
  expect_near(integrate().volume, 1);
  expect_near(integrate().attributes[0].integral, 0.5);
  for (const double edge : {1e-9, 3e-6, 0.01, 0.7}) {
    const Integrals part = integrate({.box = Box{dvec3(0), dvec3(edge)}});
    expect_near(part.volume, edge * edge * edge);
    expect_near(part.attributes[0].integral, edge * edge * edge * edge / 2);
    expect_near(integrate({.ranges = {{.attribute = "value", .high = edge}}}).volume, edge);
  }
}

TEST_F(IntegralsOfCells, AllShapesCount) {
  std::ofstream(path("shapes.vtk")) << mesh_of_shapes();
  build_input(path("shapes.vtk"), path("corners.svol"), exact(), {.selection = {"value"}});
  open("corners.svol");
  // Volumes times the values at the centroids.
  expect_near(integrate().volume, 1 + 1 / 3.0 + 0.5 + 1 / 6.0 + 1);
  expect_near(integrate().attributes[0].integral, 3.5 + 6.5 / 3 + 0.5 * (3.5 + 4 / 3.0) + 36.75 / 6 + 11.5);
}

TEST_F(IntegralsOfCells, ValuesOfCellsHoldInAllOfThem) {
  std::ofstream(path("shapes.vtk")) << mesh_of_shapes();
  build_input(path("shapes.vtk"), path("own.svol"), exact(), {.selection = {"number"}, .cells = CellValues::own});
  open("own.svol");
  const Integral all = integrate().attributes[0];
  expect_near(all.volume, 3);
  expect_near(all.integral, 1 / 3.0 + 2 * 0.5 + 3 / 6.0 + 4);
  EXPECT_EQ(all.low, 0);
  EXPECT_EQ(all.high, 4);
  EXPECT_TRUE(all.low_position.x >= 0 && all.low_position.x <= 1 && all.low_position.z <= 1);
  EXPECT_TRUE(all.high_position.x >= 8 && all.high_position.x <= 9);
  const Integrals part = integrate({.box = Box{{0, 0, 0}, {2.5, 1, 1}}});  // touches the pyramid
  expect_near(part.volume, 1.25);
  expect_near(part.attributes[0].integral, 0.5);
  EXPECT_EQ(part.attributes[0].high, 2);
  EXPECT_GE(integrate({.box = Box{{0, 0, 0.75}, {1, 1, 1}}}).attributes[0].low_position.z, 0.75);
  expect_near(integrate({.ranges = {{"number", 1.5, 3}}}).volume, 0.5 + 1 / 6.0);
}

TEST_F(IntegralsOfCells, DoNotDependOnThreadsAndMemory) {
  build_fields(jittered(30, 0.3), {field, [](dvec3 p) { return double{static_cast<float>(p.x * p.y)}; }});
  const IntegralRequest request{
      .box = Box{dvec3(0.05), dvec3(0.9)}, .clip_planes = {{dvec3(0.5), {1, 2, 3}}}, .ranges = {{"value", -0.4, 0.9}}};
  const Integrals expected = value_of(try_to(request, 1 << 26, 1));
  EXPECT_GT(expected.volume, 0.1);
  for (const auto& [memory, threads] : {std::pair{1 << 26, 4}, {1 << 10, 1}, {1 << 10, 3}}) {
    const Integrals again =
        value_of(try_to(request, static_cast<std::uint64_t>(memory), static_cast<std::size_t>(threads)));
    EXPECT_EQ(again.volume, expected.volume);
    for (std::size_t a = 0; a < 2; ++a) {
      const Integral &one = again.attributes[a], &other = expected.attributes[a];
      EXPECT_EQ(one.integral, other.integral);
      EXPECT_EQ(one.mean, other.mean);
      EXPECT_EQ(one.low, other.low);
      EXPECT_EQ(one.high, other.high);
      EXPECT_EQ(one.low_position, other.low_position);
      EXPECT_EQ(one.high_position, other.high_position);
    }
  }
}

TEST_F(IntegralsOfCells, ReadWhatTheRegionMeets) {
  build_fields(lattice(32), {[](dvec3 p) { return p.x; }, [](dvec3 p) { return p.y; }});
  const std::uint64_t all = bytes_of({});
  EXPECT_LT(2 * bytes_of({.box = Box{dvec3(0.1), dvec3(0.2)}}), all);
  EXPECT_LT(2 * bytes_of({.clip_planes = {{dvec3(0.1), {-1, -1, -1}}}}), all);
  EXPECT_LT(4 * bytes_of({.ranges = {{"value", 0.1, 0.2}}}), 3 * all);
  EXPECT_LT(2 * bytes_of({.ranges = {{"value", 0.1, 0.2}, {"other", 0.8, 0.9}}}), all);
}

TEST_F(IntegralsOfCells, NamesWhatIsWrong) {
  build(mesh_piece(lattice(2), linear));
  EXPECT_THAT(message_of(try_to({.attributes = {"heat"}})), HasSubstr("\"heat\""));
  EXPECT_THAT(message_of(try_to({.ranges = {{"heat", 0, 1}}})), HasSubstr("\"heat\""));
  EXPECT_THAT(message_of(try_to({.ranges = {{"value", 1, 0}}})), HasSubstr("lower value first"));
  EXPECT_THAT(message_of(try_to({.ranges = {{"value", none, 0}}})), HasSubstr("lower value first"));
  EXPECT_THAT(message_of(try_to({.box = Box{}})), HasSubstr("lower corner first"));
  EXPECT_THAT(message_of(try_to({.clip_planes = {{dvec3(0), dvec3(0)}}})), HasSubstr("normal"));
  EXPECT_THAT(message_of(try_to({.clip_planes = {{dvec3(none), dvec3(1)}}})), HasSubstr("finite"));
  build(mesh_piece(lattice(2), linear), {});
  EXPECT_THAT(message_of(try_to({})), HasSubstr("keeps no cells"));
}

// Parts on both sides of random planes add up, cut after cut.
TEST(TetrahedronCut, SidesAddUp) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> uniform(-1, 1);
  const auto volume_of = [](const std::vector<TetrahedronPart>& parts) {
    double volume = 0;
    for (const TetrahedronPart& part : parts) {
      volume += part.share;
      const auto& [a, b, c, d] = part.vertices;  // the share is the determinant
      const auto at = [](const CornerWeights& w) { return dvec3(w[1], w[2], w[3]); };
      EXPECT_NEAR(std::abs(glm::dot(at(b) - at(a), glm::cross(at(c) - at(a), at(d) - at(a)))), part.share, 1e-14);
      for (const CornerWeights& w : part.vertices) EXPECT_NEAR(w[0] + w[1] + w[2] + w[3], 1, 1e-14);
    }
    return volume;
  };
  for (int i = 0; i < 200; ++i) {
    std::vector<TetrahedronPart> parts = {whole_tetrahedron()};
    for (int k = 0; k < 4 && !parts.empty(); ++k) {
      std::array<double, 4> values{}, opposite{};
      for (std::size_t c = 0; c < 4; ++c) values[c] = (i + k) % 5 == 0 && c == 2 ? 0 : uniform(random);
      for (std::size_t c = 0; c < 4; ++c) opposite[c] = -values[c];
      const double before = volume_of(parts);
      const std::vector<TetrahedronPart> left = cut_parts(parts, values);
      EXPECT_NEAR(volume_of(left) + volume_of(cut_parts(parts, opposite)), before, 1e-14);
      parts = left;
    }
  }
}

}  // namespace
}  // namespace splatvol::test
