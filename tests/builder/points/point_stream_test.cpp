#include "builder/points/point_stream.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <tuple>

#include "builder/points/point_ranges.h"
#include "tests/builder/support/piece_source.h"
#include "tests/support/results.h"
#include "tests/support/whole_points.h"

namespace splatvol::test {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

double wave(dvec3 p) { return std::sin(6 * p.x) + p.y * p.z; }

template <class T>
bool same_bits(const std::vector<T>& a, const std::vector<T>& b) {
  static_assert(std::is_trivially_copyable_v<T>);
  return a.size() == b.size() && (a.empty() || std::memcmp(a.data(), b.data(), a.size() * sizeof(T)) == 0);
}

void expect_same(const WholePoints& a, const WholePoints& b) {
  const PointBatch &p = a.points, &q = b.points;
  EXPECT_TRUE(same_bits(p.keys, q.keys));
  EXPECT_TRUE(same_bits(p.positions, q.positions));
  EXPECT_TRUE(same_bits(p.values[0], q.values[0]));
  EXPECT_TRUE(same_bits(p.moments, q.moments));
  EXPECT_TRUE(same_bits(p.value_moments[0], q.value_moments[0]));
  EXPECT_TRUE(same_bits(p.gradients[0], q.gradients[0]));
  EXPECT_TRUE(same_bits(p.planes, q.planes));
  EXPECT_EQ(a.summary.cube.origin, b.summary.cube.origin);
  EXPECT_EQ(a.summary.cube.edge, b.summary.cube.edge);
  const PointCensus &c = a.summary.census, &d = b.summary.census;
  EXPECT_EQ(std::tie(c.read, c.not_finite, c.merged, c.coincident, c.in_no_cell),
            std::tie(d.read, d.not_finite, d.merged, d.coincident, d.in_no_cell));
}

// Whether these do not fit into the least memory, so that they are sorted on the disk.
bool passes_least_memory(std::uint64_t points, bool material) {
  const std::size_t bytes = PointRecords(1, false, material).bytes();
  return points * bytes > 2 * ExternalSorter::least_memory(bytes);
}

void expect_same_at_any_memory(const std::vector<Piece>& pieces) {
  PieceSource reference(pieces);
  const WholePoints expected = *read_points(reference, true, std::size_t{1} << 30);
  ASSERT_TRUE(passes_least_memory(expected.summary.census.read, expected.summary.has_material));
  for (const bool bounded : {false, true})
    for (const std::size_t memory : {std::size_t{1}, std::size_t{1} << 19, std::size_t{1} << 22})
      for (const std::size_t threads : {1, 4}) {
        SCOPED_TRACE(std::to_string(memory) + " bytes, " + std::to_string(threads) + " threads" +
                     (bounded ? ", bounded" : ""));
        const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
        PieceSource source(pieces, {.bounds = bounded});
        const auto points = value_of(read_points(source, true, memory));
        expect_same(points, expected);
      }
}

TEST(PointStream, MeshesAreTheSameAtAnyMemory) {
  expect_same_at_any_memory(cut(mesh_piece(jittered(14, 0.3), wave), 5));
}

TEST(PointStream, ScatteredPointsAreTheSameAtAnyMemory) {
  Piece piece = scattered(random_points(20'000));
  for (std::size_t i = 0; i < 20'000; i += 7) piece.points[i] = piece.points[i / 2];
  piece.points[5].y = nan;
  piece.values[0][6] = nan;
  expect_same_at_any_memory({piece});
}

TEST(PointStream, RunsOfEqualKeysAreTheSameAtAnyMemory) {
  Piece piece = scattered(random_points(3000));
  for (int i = 0; i < 9000; ++i) piece.points.emplace_back(0.5 + 0x1p-52 * (i % 3), 0.5, 0.5);
  piece.values[0].resize(piece.points.size());
  expect_same_at_any_memory({piece});
}

// A fan of tetrahedra round one edge. Each is a piece of its own, so the edge's vertices come with every piece.
TEST(PointStream, VerticesOfThousandsOfPiecesAreMergedAtAnyMemory) {
  std::vector<Piece> pieces;
  for (int i = 0; i < 5000; ++i) {
    const double angle = i * 1e-3, next = angle + 1e-3;
    Piece& piece = pieces.emplace_back(
        scattered({{0, 0, 0}, {0, 0, 1}, {std::cos(angle), std::sin(angle), 0}, {std::cos(next), std::sin(next), 0}}));
    piece.tetrahedra = {{0, 1, 2, 3}};
    piece.census.tetrahedra = 1;
  }
  PieceSource source(pieces);
  const WholePoints whole = *read_points(source);
  EXPECT_EQ(std::ranges::count(whole.points.positions, dvec3(0, 0, 0)), 1);
  expect_same_at_any_memory(pieces);
}

TEST(PointStream, ComesInMortonOrder) {
  PieceSource source({scattered(random_points(5000))});
  const WholePoints whole = *read_points(source);
  ASSERT_EQ(whole.points.size(), 5000u);
  EXPECT_TRUE(std::ranges::is_sorted(whole.points.keys));
  for (std::size_t i = 0; i < 5000; ++i)
    ASSERT_EQ(whole.points.keys[i], morton_key(whole.points.positions[i], whole.summary.cube));
}

void expect_all_kept(std::size_t copies) {
  Piece piece = scattered(std::vector<dvec3>(copies, dvec3(1, 2, 3)));
  for (std::size_t i = 0; i < copies; ++i) piece.values[0][i] = static_cast<double>(i * 7 % 5);
  PieceSource source({piece});
  const WholePoints whole = *read_points(source);
  EXPECT_EQ(whole.points.values[0], piece.values[0]);
  EXPECT_EQ(whole.summary.census.coincident, copies - 1);
  EXPECT_EQ(whole.summary.census.merged, 0u);
}

TEST(PointStream, CoincidentScatteredPointsStayInInputOrderAndAreCounted) {
  expect_all_kept(5);
  expect_all_kept(4000);
}

TEST(PointStream, CoincidentPointsInLongRunsAreCounted) { expect_all_kept(10'000); }

TEST(PointStream, SinglePrecisionKeepsEveryBit) {
  Piece piece = mesh_piece(jittered(8, 0.3), wave);
  for (dvec3& p : piece.points) p = dvec3(vec3(p));
  for (double& value : piece.values[0]) value = static_cast<double>(static_cast<float>(value));
  piece.values[0][10] = nan;
  const std::vector<Piece> pieces = cut(piece, 3);
  PieceSource single(pieces, {.single_precision = true}), full(pieces);
  expect_same(*read_points(single), *read_points(full));
}

using Coordinates = std::tuple<double, double, double>;
Coordinates coordinates(const dvec3& p) { return {p.x, p.y, p.z}; }

// `points` have the material of the whole mesh, with the rounding of sums in another order.
void expect_material_of(const Piece& whole, const PointBatch& points) {
  ASSERT_EQ(points.size(), whole.points.size());
  const MeshMaterial material = material_of({whole.points, whole.tetrahedra}, whole.values[0]);
  const auto planes = boundary_planes(whole.points, find_outer_faces(whole.points, whole.tetrahedra));
  std::map<Coordinates, std::size_t> index_of;
  for (std::size_t i = 0; i < points.size(); ++i) index_of[coordinates(points.positions[i])] = i;
  std::size_t at_boundary = 0;
  for (std::size_t v = 0; v < whole.points.size(); ++v) {
    const std::size_t i = index_of.at(coordinates(whole.points[v]));
    const SpatialMoments& expected = material.moments[v];
    EXPECT_NEAR(points.moments[i].mass / expected.mass, 1, 1e-13);
    EXPECT_NEAR(points.moments[i].covariance.xx / expected.covariance.xx, 1, 1e-12);
    const ValueMoments& value = material.value_moments[v];
    EXPECT_NEAR(points.value_moments[0][i].mean, value.mean, 1e-14);
    const dvec3& gradient = material.gradients[v];
    EXPECT_LT(glm::length(points.gradients[0][i] - gradient), 1e-10 * glm::length(gradient));
    EXPECT_LE(glm::length(points.planes[i].area - planes[v].area), 1e-12 * glm::length(planes[v].area)) << v;
    EXPECT_EQ(points.planes[i].offset, 0);
    at_boundary += planes[v].area != dvec3(0);
  }
  EXPECT_GT(at_boundary, 100u);
  EXPECT_LT(at_boundary, whole.points.size());
}

TEST(PointStream, PiecesGiveWhatTheWholeMeshGives) {
  const Piece whole = mesh_piece(jittered(10, 0.2), wave);
  for (const std::size_t count : {1, 2, 9}) {
    PieceSource source(cut(whole, count));
    const WholePoints points = *read_points(source);
    EXPECT_EQ(points.summary.census.merged, points.summary.census.read - whole.points.size());
    EXPECT_EQ(points.summary.census.coincident, 0u);
    expect_material_of(whole, points.points);
  }
}

TEST(PointStream, FacesBetweenPiecesAreOuterOnlyIfTheirPointsDiffer) {
  const Mesh left = lattice(3), right = lattice(3, [](dvec3 p) { return p + dvec3(1, 0, 0); });
  for (const bool differ : {false, true}) {
    PieceSource source(
        {mesh_piece(left, wave), mesh_piece(right, [&](dvec3 p) { return wave(p) + (differ ? 1 : 0); })});
    const PointBatch points = (*read_points(source)).points;
    EXPECT_EQ(points.size(), 4u * 4 * (differ ? 8 : 7));
    for (std::size_t i = 0; i < points.size(); ++i) {
      const dvec3& p = points.positions[i];
      if (p.x == 1 && p.y > 0 && p.y < 1 && p.z > 0 && p.z < 1) {
        EXPECT_EQ(points.planes[i].area != dvec3(0), differ);
      }
    }
  }
}

// Vertices of two blocks stay apart whatever their values, and each block ends there. Pieces of one block are joined.
TEST(PointStream, CopiesOfAVertexMayBeThoseOfOneBlock) {
  const auto linear = [](dvec3 p) { return p.x + 2 * p.y; };
  Piece left = mesh_piece(lattice(3), linear);
  Piece right = mesh_piece(lattice(3, [](dvec3 p) { return p + dvec3(1, 0, 0); }), [](dvec3 p) { return p.z + 9; });
  const Piece free_point = scattered({{1, 1.0 / 3, 1.0 / 3}});
  for (const VertexCopies copies : {VertexCopies::same_place, VertexCopies::same_block})
    for (const auto& [block, other] : {std::pair<std::uint64_t, std::uint64_t>{0, 0}, {7, 7}, {7, 5}, {0, 5}}) {
      left.block = block;
      right.block = other;
      PieceSource source({left, free_point, right}, {.copies = copies});
      const WholePoints whole = *read_points(source);
      const bool apart = copies == VertexCopies::same_block && block != other;
      EXPECT_EQ(whole.points.size(), 4u * 4 * (apart ? 8 : 7) + 1);
      EXPECT_EQ(whole.summary.census.merged, apart ? 0u : 16u);
      EXPECT_EQ(whole.summary.census.unlike, apart ? 0u : 16u);
      std::size_t outer = 0;
      double mass = 0;
      for (std::size_t i = 0; i < whole.points.size(); ++i) {
        const dvec3& p = whole.points.positions[i];
        mass += whole.points.moments[i].mass;
        const bool inside = p.y > 0 && p.y < 1 && p.z > 0 && p.z < 1;  // of the common face
        outer += p.x == 1 && inside && whole.points.planes[i].area != dvec3(0) ? 1 : 0;
        EXPECT_TRUE(whole.points.moments[i].mass > 0 || whole.points.planes[i].area == dvec3(0) || !apart);
      }
      EXPECT_EQ(outer, apart ? 2u * 4 : 0u);
      EXPECT_NEAR(mass, 2, 1e-12);
    }
}

// A point of no cell that comes between two copies of a vertex, with the same value, does not part them.
TEST(PointStream, FreePointsDoNotPartTheCopiesOfAVertex) {
  const auto linear = [](dvec3 p) { return p.x + 2 * p.y; };
  const Piece left = mesh_piece(lattice(3), linear);
  const Piece right = mesh_piece(lattice(3, [](dvec3 p) { return p + dvec3(1, 0, 0); }), linear);
  const Piece free_points = scattered({{1, 1.0 / 3, 1.0 / 3}, {1, 0, 1}});
  for (const VertexCopies copies : {VertexCopies::same_values, VertexCopies::same_place, VertexCopies::none}) {
    PieceSource source({left, free_points, right}, {.copies = copies});
    const WholePoints whole = *read_points(source);
    const bool joined = copies != VertexCopies::none;
    EXPECT_EQ(whole.summary.census.merged, joined ? 16u : 0u);
    EXPECT_EQ(whole.summary.census.coincident, joined ? 2u : 18u);
    EXPECT_EQ(whole.points.size(), 4u * 4 * (joined ? 7 : 8) + 2);
  }
}

// A square as a flat cell lies between two pieces, of which it makes the diagonals agree.
TEST(PointStream, FacesBehindAFlatCellOfAnotherPieceAreNotOuter) {
  // No two faces are alike: planes of equal rank would depend on the order of the faces.
  const std::vector<dvec3> pyramids = {{0, 0, 0},   {1.1, 0, 0},    {1.3, 1, 0},
                                       {0, 0.8, 0}, {0.3, 0.4, -1}, {0.5, 0.3, 1.4}};
  const Mesh below{pyramids, {{0, 1, 2, 4}, {0, 2, 3, 4}, {0, 1, 2, 3}}};
  const Mesh above{pyramids, {{0, 1, 3, 5}, {1, 2, 3, 5}}};
  Mesh whole = below;
  whole.tetrahedra.insert(whole.tetrahedra.end(), above.tetrahedra.begin(), above.tetrahedra.end());
  const auto faces = find_outer_faces(whole.points, whole.tetrahedra);
  ASSERT_EQ(faces.size(), 8u);
  const auto planes = boundary_planes(whole.points, faces);
  for (const bool below_first : {false, true}) {
    PieceSource source({cut(mesh_piece(below_first ? below : above, wave), 1)[0],
                        cut(mesh_piece(below_first ? above : below, wave), 1)[0]});
    const PointBatch points = (*read_points(source)).points;
    ASSERT_EQ(points.size(), pyramids.size());
    for (std::size_t i = 0; i < points.size(); ++i) {
      const auto v = static_cast<std::size_t>(std::ranges::find(pyramids, points.positions[i]) - pyramids.begin());
      EXPECT_LE(glm::length(points.planes[i].area - planes[v].area), 1e-15) << v;
    }
  }
}

TEST(PointStream, ZerosOfBothSignsAreOnePosition) {
  Piece whole = mesh_piece(jittered(8, 0.2), [](dvec3 p) { return 2 + p.x; });
  for (dvec3& p : whole.points)
    if (std::abs(p.x - 0.5) < 0.01 + 0.2 / 8) p.x = 0.5;
  std::vector<Piece> halves(2);
  for (dvec3& p : whole.points) p.x -= 0.5;
  for (int side = 0; side < 2; ++side) {
    Piece half = whole;
    std::erase_if(half.tetrahedra, [&](const Tetrahedron& t) {
      const bool right = std::ranges::any_of(t, [&](std::uint32_t v) { return whole.points[v].x > 0; });
      return right == (side == 0);
    });
    halves[static_cast<std::size_t>(side)] = cut(half, 1)[0];
  }
  for (dvec3& p : halves[1].points)
    if (p.x == 0) p.x = -0.0;
  PieceSource source(halves);
  const WholePoints points = *read_points(source);
  EXPECT_EQ(points.summary.census.merged, 81u);
  expect_material_of(whole, points.points);
}

TEST(PointStream, PiecesWithoutCellsHaveNoMaterialWhereOthersHaveSome) {
  // The mesh has two parts, at x in [0, 1] and in [8, 9]; the points of the other pieces lie between them.
  const Piece before = scattered(random_points(50, 0.5, dvec3(3, 0.2, 0.2)));
  const Piece after = scattered(random_points(60, 0.5, dvec3(5, 0.2, 0.2)));
  Mesh right = lattice(4);
  for (dvec3& p : right.points) p.x += 8;
  PieceSource source({before, mesh_piece(lattice(4), wave), mesh_piece(right, wave), after});
  const WholePoints whole = *read_points(source);
  const PointBatch& points = whole.points;
  EXPECT_EQ(whole.summary.census.in_no_cell, 110u);
  ASSERT_EQ(points.moments.size(), points.size());
  ASSERT_EQ(points.planes.size(), points.size());
  double mass = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const dvec3& p = points.positions[i];
    const bool inside = p.x <= 1 || p.x >= 8;
    EXPECT_EQ(points.moments[i].mass > 0, inside) << i;
    EXPECT_EQ(points.value_moments[0][i].mass, points.moments[i].mass);
    EXPECT_TRUE(inside || points.planes[i].area == dvec3(0));
    mass += points.moments[i].mass;
  }
  EXPECT_NEAR(mass, 2, 1e-12);
}

TEST(PointStream, PointsOfNoCellDoNotWidenTheCube) {
  Piece mesh = mesh_piece(lattice(4), wave);
  const std::size_t vertices = mesh.points.size();
  for (const dvec3& p : {dvec3(0.3, 0.31, 0.32), dvec3(1e9), dvec3(0.5, 0.5, -2)}) {
    mesh.points.push_back(p);
    mesh.values[0].push_back(1000 * p.x);
  }
  PieceSource source({mesh});
  const WholePoints whole = *read_points(source);
  EXPECT_EQ(whole.points.size(), vertices + 1);
  EXPECT_EQ(whole.summary.cube.edge, 1);
  EXPECT_EQ(whole.summary.census.in_no_cell, 1u);
  EXPECT_EQ(whole.summary.census.left_out, 2u);
  EXPECT_FLOAT_EQ(static_cast<float>(whole.summary.attributes[0].max), 300);  // of the points that are left
  PieceSource no_cells({mesh});
  EXPECT_EQ((*read_points(no_cells, false)).points.size(), vertices + 3);  // without cells they are points like others
}

TEST(PointStream, NumbersThatCannotBeCoordinatesAreDropped) {
  const double most = std::numeric_limits<float>::max();
  Piece piece =
      scattered({{0, 0, 0}, {1, 1, 1}, {nan, 0, 0}, {0, 9.969209968386869e36, 0}, {0, 0, -most}, {1e51, 0, 0}});
  PieceSource source({piece});
  const WholePoints whole = *read_points(source);
  EXPECT_EQ(whole.points.size(), 2u);
  EXPECT_EQ(whole.summary.census.not_finite, 4u);
  PieceSource flat({scattered({{0, 0, 0}, {1e-60, 0, 0}})});
  EXPECT_FALSE(read_points(flat));
}

TEST(DescribeAttribute, ScalesWhatSinglePrecisionCannotHold) {
  const auto scale = [](double low, double high) { return describe_attribute("a", low, high).scale; };
  for (const auto& [low, high] :
       {std::pair(0.0, 0.0), {0.0, 1.0}, {-1e15, 1e-15}, {1e-15, 1e-12}, {101325.0, 101326.0}})
    EXPECT_EQ(scale(low, high), 1) << low;
  for (const double size : {1e-100, 1e-40, 1e-25, 1e25, 1e51, 1e99}) {
    const format::Attribute a = describe_attribute("a", -0.3 * size, size);
    EXPECT_EQ(std::exp2(std::ilogb(a.scale)), a.scale);
    const double least = size > 1 ? 0x1p63 : 1;
    EXPECT_GE(a.stored(a.max), least);
    EXPECT_LT(a.stored(a.max), 2 * least);
    EXPECT_NEAR(a.min / size, -0.3, 1e-7);
    EXPECT_EQ(a.value(static_cast<float>(a.stored(a.max))), a.max);
  }
}

TEST(PointStream, CellsAreLeftOutWhereTheyAreNotWanted) {
  PieceSource source(cut(mesh_piece(lattice(4), wave), 2));
  const WholePoints whole = *read_points(source, false);
  EXPECT_FALSE(whole.summary.has_material);
  EXPECT_TRUE(whole.points.moments.empty());
  EXPECT_EQ(whole.summary.census.merged, 0u);
  EXPECT_GT(whole.summary.census.coincident, 20u);
}

}  // namespace
}  // namespace splatvol::test
