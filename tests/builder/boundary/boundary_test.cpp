// The boundary of meshes: its faces, its patches, and fewer triangles of it.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "base/file.h"
#include "builder/boundary/boundary_faces.h"
#include "builder/boundary/rest_parts.h"
#include "builder/boundary/simplify.h"
#include "builder/boundary/triangle_tree.h"
#include "builder/boundary/welded_surface.h"
#include "builder/pipeline/build.h"
#include "format/boundary.h"
#include "format/volume.h"
#include "tests/builder/support/meshes.h"
#include "tests/builder/support/piece_source.h"
#include "tests/support/results.h"

namespace splatvol::test {
namespace {

using namespace ::testing;

Piece piece_of(const Mesh& mesh) {
  Piece piece;
  piece.points = mesh.points;
  piece.tetrahedra = mesh.tetrahedra;
  piece.values = {sample(mesh, [](dvec3 p) { return p.x; })};
  return piece;
}

// Triangles that bound a mesh and whose middles are in a region, as a patch.
Patch patch_of(const std::string& name, const Mesh& mesh, const std::function<bool(dvec3)>& holds) {
  Patch patch{name, {mesh.points, {}}};
  for (const OuterFace& face : find_outer_faces(mesh.points, mesh.tetrahedra)) {
    std::array<std::uint32_t, 3> corners{};
    dvec3 middle(0);
    for (std::size_t k = 0; k < 3; ++k) {
      corners[k] = static_cast<std::uint32_t>(face.corners[k]);
      middle += mesh.points[corners[k]] / 3.0;
    }
    if (holds(middle)) patch.mesh.triangles.push_back(corners);
  }
  return patch;
}

// Those in the plane `axis` = `value`, which is a side of the mesh.
Patch patch_at(const std::string& name, const Mesh& mesh, int axis, double value) {
  return patch_of(name, mesh, [=](dvec3 middle) { return std::abs(middle[axis] - value) < 1e-9; });
}

BoundaryFaces faces_of(const std::vector<Piece>& pieces, std::size_t memory = BoundaryFaces::least_memory()) {
  auto faces = value_of(BoundaryFaces::create(memory, testing::TempDir()));
  for (const Piece& piece : pieces) EXPECT_EQ(message_of(faces.add(piece)), "");
  return faces;
}

Boundary whole(const std::vector<Piece>& pieces) {
  BoundaryFaces faces = faces_of(pieces);
  return value_of(whole_boundary(faces));
}

Boundary simplified(const std::vector<Piece>& pieces, std::uint64_t most) {
  BoundaryFaces faces = faces_of(pieces);
  return value_of(simplified_boundary(faces, most));
}

using Corner = std::tuple<double, double, double>;
Corner corner_of(const dvec3& p) { return {p.x, p.y, p.z}; }

// How often each edge is there, by the positions of its ends, in all patches together. Every edge of a closed surface
// is there twice, once in each direction.
std::size_t open_edges(const Boundary& boundary) {
  std::map<std::pair<Corner, Corner>, int> edges;
  for (const Patch& patch : boundary.patches)
    for (const auto& triangle : patch.mesh.triangles)
      for (std::size_t k = 0; k < 3; ++k) {
        const Corner a = corner_of(patch.mesh.points[triangle[k]]),
                     b = corner_of(patch.mesh.points[triangle[(k + 1) % 3]]);
        edges[{std::min(a, b), std::max(a, b)}] += a < b ? 1 : -1;
      }
  return static_cast<std::size_t>(std::ranges::count_if(edges, [](const auto& edge) { return edge.second != 0; }));
}

// Six times the volume that closed triangles enclose.
double volume_6(const Boundary& boundary) {
  double sum = 0;
  for (const Patch& patch : boundary.patches)
    for (const auto& [a, b, c] : patch.mesh.triangles)
      sum += glm::dot(patch.mesh.points[a], glm::cross(patch.mesh.points[b], patch.mesh.points[c]));
  return sum;
}

// A ball of radius 1.
Mesh ball(std::uint32_t cells) {
  return lattice(cells, [](dvec3 p) {
    const dvec3 q = 2.0 * p - 1.0;
    const double largest = std::max({std::abs(q.x), std::abs(q.y), std::abs(q.z)});
    return largest > 0 ? q * largest / glm::length(q) : q;
  });
}

TEST(BoundaryOfMeshes, ACubeHasTwelveTriangles) {
  const Boundary boundary = whole({piece_of(lattice(1))});
  ASSERT_EQ(boundary.patches.size(), 6u);
  for (std::size_t side = 0; side < 6; ++side) {
    EXPECT_EQ(boundary.patches[side].name, names_of_sides()[side]);
    ASSERT_EQ(boundary.patches[side].mesh.triangles.size(), 2u);
    EXPECT_EQ(middle_of(boundary.patches[side].mesh, 0)[static_cast<int>(side / 2)], side % 2);
    EXPECT_EQ(boundary.patches[side].mesh.points.size(), 4u);
  }
  EXPECT_EQ(boundary.triangles, 12u);
  EXPECT_EQ(boundary.error, 0);
  EXPECT_EQ(open_edges(boundary), 0u);
  EXPECT_NEAR(volume_6(boundary), 6, 1e-12) << "corners run counterclockwise from outside";
}

TEST(BoundaryOfMeshes, PiecesHaveNoFaceInside) {
  const auto right = lattice(3, [](dvec3 p) { return p + dvec3(1, 0, 0); });
  const Boundary boundary = whole({piece_of(lattice(3)), piece_of(right)});
  EXPECT_EQ(boundary.triangles, 2u * 9 * 10);
  EXPECT_EQ(open_edges(boundary), 0u);
  EXPECT_NEAR(volume_6(boundary), 12, 1e-12);
}

TEST(BoundaryOfMeshes, CellsOfTheirOwnHaveTheSame) {
  const Mesh mesh = lattice(3);
  Piece piece;
  piece.cells.emplace();
  piece.cells->corners = mesh.points;
  piece.cells->tetrahedra = mesh.tetrahedra;
  EXPECT_EQ(whole({piece}).triangles, 9u * 12);
}

// Four faces lie in one, and neither they nor it bound the mesh.
TEST(BoundaryOfMeshes, HangingNodesAreInside) {
  const auto right = lattice(4, [](dvec3 p) { return p + dvec3(1, 0, 0); });
  const Boundary boundary = whole({piece_of(lattice(2)), piece_of(right)});
  EXPECT_EQ(boundary.triangles, 5u * 8 + 5u * 32);
  EXPECT_EQ(boundary.patches.size(), 6u) << "and nothing is left of them beside the sides";
  for (const Patch& patch : boundary.patches)
    for (const auto& [a, b, c] : patch.mesh.triangles)
      EXPECT_FALSE(patch.mesh.points[a].x == 1 && patch.mesh.points[b].x == 1 && patch.mesh.points[c].x == 1);
}

TEST(BoundaryOfMeshes, AGapIsNoHangingNode) {
  const auto right = lattice(4, [](dvec3 p) { return p + dvec3(1.001, 0, 0); });
  EXPECT_EQ(whole({piece_of(lattice(2)), piece_of(right)}).triangles, 6u * 8 + 6u * 32);
}

TEST(BoundaryOfMeshes, PatchesHaveTheirFaces) {
  const Mesh mesh = lattice(3);
  Piece piece = piece_of(mesh);
  piece.patches = {patch_at("top", mesh, 2, 1), patch_at("bottom", mesh, 2, 0), patch_at("inside", mesh, 2, 0.5)};
  // A wall between two cells, of which no cell is the only one.
  piece.patches.push_back({"wall", {{dvec3(1, 0, 0) / 3.0, dvec3(1, 1, 0) / 3.0, dvec3(1, 1, 1) / 3.0}, {{0, 1, 2}}}});
  const Boundary boundary = whole({piece});
  std::map<std::string, std::size_t> triangles;
  std::vector<std::string> names;
  for (const Patch& patch : boundary.patches) {
    names.push_back(patch.name);
    triangles[patch.name] = patch.mesh.triangles.size();
  }
  EXPECT_THAT(names, ElementsAre("bottom", "inside", "top", "wall", "side x-", "side x+", "side y-", "side y+"));
  EXPECT_EQ(triangles["top"], 18u);
  EXPECT_EQ(triangles["bottom"], 18u);
  EXPECT_EQ(triangles["inside"], 0u);
  EXPECT_EQ(triangles["wall"], 1u);
  EXPECT_EQ(triangles["side y+"], 18u);
}

TEST(BoundaryOfMeshes, OfPatchesOnlyTheRestIsLeftOut) {
  const Mesh mesh = lattice(2);
  Piece piece = piece_of(mesh);
  for (int side = 0; side < 6; ++side)
    piece.patches.push_back(patch_at(fmt::format("side {}", side), mesh, side / 2, side % 2));
  const Boundary boundary = whole({piece});
  EXPECT_EQ(boundary.patches.size(), 6u);
  EXPECT_EQ(boundary.triangles, 48u);
  EXPECT_EQ(open_edges(boundary), 0u);
}

TEST(BoundaryOfMeshes, AFaceOfTwoPatchesBelongsToTheSmaller) {
  const Mesh mesh = lattice(2);
  Piece piece = piece_of(mesh);
  piece.patches = {patch_at("all", mesh, 2, 1), patch_at("top", mesh, 2, 1)};
  const Patch bottom = patch_at("all", mesh, 2, 0);
  piece.patches[0].mesh.triangles.insert(piece.patches[0].mesh.triangles.end(), bottom.mesh.triangles.begin(),
                                         bottom.mesh.triangles.end());
  const Boundary boundary = whole({piece});
  EXPECT_EQ(boundary.patches[0].name, "all");
  EXPECT_EQ(boundary.patches[0].mesh.triangles.size(), 8u);
  EXPECT_EQ(boundary.patches[1].name, "top");
  EXPECT_EQ(boundary.patches[1].mesh.triangles.size(), 8u);
}

TEST(BoundaryOfMeshes, APatchWithADamagedPointChangesNothing) {
  const Mesh mesh = lattice(2);
  Piece piece = piece_of(mesh);
  piece.patches = {patch_at("top", mesh, 2, 1)};
  piece.patches[0].mesh.points.push_back(dvec3(1e30));
  piece.patches[0].mesh.triangles.push_back({0, 1, static_cast<std::uint32_t>(mesh.points.size())});
  EXPECT_EQ(whole({piece}).triangles, 48u);
}

// The names and numbers of triangles of the patches, in their order.
using Sizes = std::vector<std::pair<std::string, std::size_t>>;
Sizes sizes_of(const Boundary& boundary) {
  Sizes sizes;
  for (const Patch& patch : boundary.patches) sizes.emplace_back(patch.name, patch.mesh.triangles.size());
  return sizes;
}

// Adds the patches on the sides that have triangles.
Sizes with_sides(Sizes sizes, const std::array<std::size_t, box_sides>& of_sides) {
  for (std::size_t side = 0; side < box_sides; ++side)
    if (of_sides[side] > 0) sizes.emplace_back(names_of_sides()[side], of_sides[side]);
  return sizes;
}

// The number of two-sided triangles in a patch.
std::size_t two_sided_of(const Boundary& boundary, const std::string& name) {
  const auto patch = std::ranges::find(boundary.patches, name, &Patch::name);
  return static_cast<std::size_t>(std::ranges::count(patch->mesh.two_sided, true));
}

// A wall in the middle of a lattice of an even number of cells: cells are on both of its sides.
Patch wall_in(const Mesh& mesh, const std::string& name) {
  Patch wall{name, {mesh.points, {}}};
  for (const auto& tetrahedron : mesh.tetrahedra)
    for (std::size_t omitted = 0; omitted < 4; ++omitted) {
      std::vector<std::uint32_t> face;
      for (std::size_t k = 0; k < 4; ++k)
        if (k != omitted) face.push_back(tetrahedron[k]);
      const auto is_in_plane = [&](std::uint32_t point) { return std::abs(mesh.points[point].x - 0.5) < 1e-9; };
      if (std::ranges::all_of(face, is_in_plane) && mesh.points[tetrahedron[omitted]].x > 0.5)
        wall.mesh.triangles.push_back({face[0], face[1], face[2]});
    }
  return wall;
}

TEST(TwoSidedTriangles, AreThoseOfBaffles) {
  const Mesh mesh = lattice(4);
  Piece piece = piece_of(mesh);
  piece.patches = {wall_in(mesh, "wall"), patch_at("top", mesh, 2, 1)};
  // A patch may be on the hull, too.
  const Patch bottom = patch_at("wall", mesh, 2, 0);
  piece.patches.push_back(bottom);
  const Boundary boundary = whole({piece});
  EXPECT_EQ(two_sided_of(boundary, "wall"), 32U);
  EXPECT_EQ(two_sided_of(boundary, "top"), 0U);
  EXPECT_EQ(two_sided_of(boundary, "side x-"), 0U);
  const TriangleMesh& wall = boundary.patches[1].mesh;
  EXPECT_EQ(wall.triangles.size(), 64U);
  for (std::size_t i = 0; i < wall.triangles.size(); ++i)
    EXPECT_EQ(wall.is_two_sided(i), std::abs(middle_of(wall, i).x - 0.5) < 1e-9 && middle_of(wall, i).z > 1e-9) << i;
}

// A tetrahedron without volume and without neighbours does not tell where its outside is.
TEST(TwoSidedTriangles, AreThoseOfFlatTetrahedra) {
  Mesh mesh = lattice(1);
  const auto first = static_cast<std::uint32_t>(mesh.points.size());
  for (const dvec3& corner : {dvec3(3, 0.2, 0.5), dvec3(4, 0.2, 0.5), dvec3(3, 0.8, 0.5), dvec3(4, 0.8, 0.5)})
    mesh.points.push_back(corner);
  mesh.tetrahedra.push_back({first, first + 1, first + 2, first + 3});
  const Boundary boundary = whole({piece_of(mesh)});
  EXPECT_THAT(sizes_of(boundary), ElementsAreArray(with_sides({{"outer 1", 2}, {"outer 2", 4}}, {2, 0, 2, 2, 2, 2})));
  EXPECT_EQ(two_sided_of(boundary, "outer 1"), 0U);
  EXPECT_EQ(two_sided_of(boundary, "outer 2"), 4U);
}

// The wall stays a plane, and what is simplified still runs counterclockwise from outside.
TEST(TwoSidedTriangles, AreSimplifiedApartFromTheOthers) {
  const Mesh mesh = lattice(20);
  Piece piece = piece_of(mesh);
  piece.patches = {wall_in(mesh, "wall"), patch_at("wall", mesh, 2, 0)};
  const Boundary boundary = simplified({piece}, 1500);
  EXPECT_LE(boundary.kept, 1500U);
  EXPECT_LT(boundary.error, 1e-6);
  const TriangleMesh& wall = boundary.patches[0].mesh;
  EXPECT_GT(two_sided_of(boundary, "wall"), 0U);
  EXPECT_LT(two_sided_of(boundary, "wall"), wall.triangles.size());
  for (std::size_t i = 0; i < wall.triangles.size(); ++i)
    for (const std::uint32_t corner : wall.triangles[i])
      EXPECT_NEAR(wall.is_two_sided(i) ? wall.points[corner].x - 0.5 : wall.points[corner].z, 0, 1e-6);
  Boundary hull = boundary;  // without the wall, whose triangles come last, it is closed
  hull.patches[0].mesh.triangles.resize(wall.triangles.size() - two_sided_of(boundary, "wall"));
  EXPECT_NEAR(volume_6(hull), 6, 1e-9);
}

// The two faces of a plate that is thinner than the cells of the grid become one, which has cells on both sides.
TEST(TwoSidedTriangles, AreThoseOfJoinedFaces) {
  const auto weld = [](double thickness) {
    const Box box{dvec3(0), {1, 1, 1}};
    WeldedSurface welded(box, 40);
    // A body of `thickness` in a flow, and loose triangles, so that points are joined.
    for (const double z : {0.501, 0.501 + thickness})
      for (int i = 0; i < 8; ++i)
        for (int j = 0; j < 8; ++j) {
          const dvec3 a(i / 8.0, j / 8.0, z), b = a + dvec3(0.125, 0, 0), c = a + dvec3(0, 0.125, 0);
          EXPECT_TRUE(z > 0.501 ? welded.add({{a, c, b}, 0, true}) : welded.add({{a, b, c}, 0, true}));
        }
    EXPECT_GT(welded.moved(), 0);
    return static_cast<std::size_t>(std::ranges::count(welded.sides(), false));
  };
  EXPECT_EQ(weld(0.4), 0U);
  EXPECT_GT(weld(0.001), 5U);
}

// A lattice without the cubes that lie in a box.
Mesh hollow(std::uint32_t cells, const Box& body) {
  Mesh mesh = lattice(cells);
  std::erase_if(mesh.tetrahedra, [&](const auto& tetrahedron) {
    dvec3 middle(0);
    for (const std::uint32_t corner : tetrahedron) middle += mesh.points[corner] / 4.0;
    return squared_distance(body, middle) == 0;
  });
  return mesh;
}

// Cubes of one cell with edges of 0.1, at some places.
Piece cubes_at(const std::vector<dvec3>& places) {
  Mesh mesh;
  for (const dvec3& place : places) {
    const auto first = static_cast<std::uint32_t>(mesh.points.size());
    const Mesh cube = lattice(1, [&](dvec3 p) { return place + 0.1 * p; });
    mesh.points.insert(mesh.points.end(), cube.points.begin(), cube.points.end());
    for (auto tetrahedron : cube.tetrahedra) {
      for (std::uint32_t& corner : tetrahedron) corner += first;
      mesh.tetrahedra.push_back(tetrahedron);
    }
  }
  return piece_of(mesh);
}

TEST(ConnectedParts, ABodyIsApartFromTheHullRoundIt) {
  const Boundary boundary = whole({piece_of(hollow(6, {dvec3(0.35), dvec3(0.65)}))});
  EXPECT_THAT(sizes_of(boundary), ElementsAreArray(with_sides({{"outer 2", 6u * 8}}, {72, 72, 72, 72, 72, 72})));
  EXPECT_EQ(boundary.patches[0].mesh.points.size(), 26u);
  EXPECT_EQ(open_edges(boundary), 0u);
  EXPECT_NEAR(volume_6(boundary), 6 * (1 - 1.0 / 27), 1e-12);
  const Boundary touching = whole({piece_of(hollow(6, {dvec3(0.35, 0.35, 0), dvec3(0.65)}))});
  EXPECT_THAT(sizes_of(touching), ElementsAreArray(with_sides({{"outer 1", 72}}, {72, 72, 72, 72, 64, 72})));
}

TEST(ConnectedParts, AreInTheOrderOfTheirSizesThenOfTheirPlaces) {
  // Rounding moves the corners of some.
  const std::vector<dvec3> places = {{0.3, 0.7, 0.2}, {0.1 + 0.2, 0.2, 0.2}, {0.3, 0.2, 0.7}};
  std::vector<Piece> pieces = {cubes_at(places), piece_of(lattice(1, [](dvec3 p) { return 2.0 * p + 3.0; }))};
  const Boundary boundary = whole(pieces);
  EXPECT_THAT(sizes_of(boundary),
              ElementsAreArray(
                  with_sides({{"outer 1", 6}, {"outer 2", 6}, {"outer 3", 8}, {"outer 4", 8}}, {6, 2, 4, 2, 4, 2})));
  const auto low = [&](const Boundary& from, std::size_t part) {
    Box box;
    for (const dvec3& p : from.patches[part].mesh.points) box.include(p);
    return box.low;
  };
  const std::vector<dvec3> expected = {dvec3(3), {0.3, 0.2, 0.2}, {0.3, 0.2, 0.7}, {0.3, 0.7, 0.2}};
  for (std::size_t part = 0; part < expected.size(); ++part)
    EXPECT_LT(glm::distance(low(boundary, part), expected[part]), 1e-9) << part;
  std::ranges::reverse(pieces);
  const Boundary other = whole(pieces);
  for (std::size_t part = 0; part < expected.size(); ++part) {
    EXPECT_EQ(other.patches[part].name, boundary.patches[part].name);
    EXPECT_TRUE(other.patches[part].mesh.points == boundary.patches[part].mesh.points) << part;
  }
}

TEST(ConnectedParts, BeyondALimitAreOnePatch) {
  std::vector<dvec3> places;
  for (int i = 0; i < 32; ++i) places.emplace_back(i, 0, 0);
  std::vector<std::string> names;
  for (const auto& [name, triangles] : sizes_of(whole({cubes_at(places)}))) names.push_back(name);
  ASSERT_EQ(names.size(), most_rest_parts + box_sides);
  EXPECT_EQ(names[0], "outer 1");
  EXPECT_EQ(names[9], "outer 10") << "in the order of their numbers";
  EXPECT_EQ(names[31], "outer 32");
  const Boundary boundary =
      whole({piece_of(lattice(3, [](dvec3 p) { return 5.0 * p; })), piece_of(random_tetrahedra(2000))});
  const auto sizes = sizes_of(boundary);
  ASSERT_EQ(sizes.size(), most_rest_parts - 1 + box_sides);
  EXPECT_EQ(sizes.front(), std::pair(std::string("outer 2"), std::size_t{4})) << "the first is on the sides only";
  EXPECT_EQ(sizes[29], std::pair(std::string("outer 31"), std::size_t{4}));
  EXPECT_EQ(sizes[30], std::pair(std::string("outer rest"), std::size_t{4 * 1970}));
  EXPECT_EQ(sizes.back(), std::pair(std::string("side z+"), std::size_t{18}));
}

// All faces of a patch stay together, and the rest does not get a name that the input uses.
TEST(ConnectedParts, LeaveTheInputsPatchesAsTheyAre) {
  const Mesh mesh = hollow(6, {dvec3(0.35), dvec3(0.65)});
  const auto with = [&](const std::vector<std::string>& names) {
    Piece piece = piece_of(mesh);
    for (const std::string& name : names) piece.patches.push_back({name, {}});
    // Two sides that do not touch.
    for (const double x : {0.0, 1.0}) piece.patches.push_back(patch_at(names[0], mesh, 0, x));
    return sizes_of(whole({piece}));
  };
  EXPECT_THAT(with({"sides"}), ElementsAreArray(with_sides({{"sides", 144}, {"outer 2", 48}}, {0, 0, 72, 72, 72, 72})));
  EXPECT_THAT(with({"sides", "outer 2"}), ElementsAre(Pair("outer 2", 0u), Pair("sides", 144u), Pair("outer", 336u)));
  EXPECT_THAT(with({"sides", "outer rest"}),
              ElementsAre(Pair("outer rest", 0u), Pair("sides", 144u), Pair("outer", 336u)));
  EXPECT_THAT(with({"sides", "side x-"}), ElementsAre(Pair("side x-", 0u), Pair("sides", 144u), Pair("outer", 336u)));
  EXPECT_THAT(with({"outer"}), ElementsAre(Pair("outer", 480u))) << "the rest belongs to it";
  EXPECT_THAT(with({"outer 99"}),
              ElementsAreArray(with_sides({{"outer 99", 144}, {"outer 2", 48}}, {0, 0, 72, 72, 72, 72})));
}

// A file holds 4096 patches.
TEST(ConnectedParts, FitBesideThePatchesOfTheInput) {
  Piece piece = cubes_at({{0, 0, 0}, {1, 0, 0}, {2, 0, 0}});
  for (int i = 0; i < 4094; ++i) piece.patches.push_back({fmt::format("patch {}", i), {}});
  Boundary boundary = whole({piece});
  EXPECT_EQ(boundary.patches.size(), 4096u);
  EXPECT_EQ(boundary.patches[4095].name, "outer rest");
  EXPECT_EQ(boundary.patches[4095].mesh.triangles.size(), 24u);
  piece.patches.push_back({"another", {}});
  boundary = whole({piece});
  EXPECT_EQ(boundary.patches.size(), 4096u);
  EXPECT_EQ(boundary.patches[4095].name, "outer");
}

// Too many triangles to hold: their points are joined first.
TEST(ConnectedParts, AreThoseOfTheJoinedSurface) {
  BoundaryFaces faces = faces_of({piece_of(ball(20)), piece_of(lattice(20, [](dvec3 p) { return p + 1.5; }))});
  WeldedSurface welded(faces.box(), 1000);
  ASSERT_TRUE(faces.visit([&](const BoundaryTriangle& triangle) { return welded.add(triangle); }));
  ASSERT_GT(welded.moved(), 0);
  std::vector<std::uint32_t> patches = welded.patches();
  EXPECT_THAT(split_rest(welded.points(), welded.triangles(), most_rest_parts, 1, 1, patches),
              ElementsAre("outer 1", "outer 2"));
  for (std::size_t i = 0; i < patches.size(); ++i) {
    const dvec3 corner = welded.points()[welded.triangles()[i][0]];
    ASSERT_EQ(patches[i], corner.x + corner.y + corner.z < 3 ? 1u : 2u);
  }
}

TEST(ConnectedParts, ShareNoTriangleOnceSimplified) {
  const Mesh mesh = hollow(30, {dvec3(0.3), dvec3(0.6)});
  const Boundary boundary = simplified({piece_of(mesh)}, 1000);
  ASSERT_EQ(boundary.patches.size(), 1u + box_sides);
  EXPECT_LE(boundary.kept, 1000u);
  EXPECT_EQ(open_edges(boundary), 0u);
  EXPECT_LT(boundary.error, 1e-6);
  EXPECT_NEAR(volume_6(boundary), 6 * (1 - 0.027), 1e-6);
}

TEST(BoundaryOfMeshes, PointsWithoutCellsHaveNone) {
  Piece piece = piece_of(lattice(2));
  piece.tetrahedra.clear();
  BoundaryFaces faces = faces_of({piece});
  EXPECT_THAT(whole_boundary(faces).error().message, HasSubstr("no cells with a volume"));
}

TEST(SimplifiedBoundary, OfAPlaneIsExact) {
  const Boundary boundary = simplified({piece_of(lattice(20))}, 100);
  EXPECT_EQ(boundary.triangles, 6u * 800);
  EXPECT_LE(boundary.kept, 100u);
  EXPECT_LT(boundary.error, 1e-6);
  EXPECT_EQ(open_edges(boundary), 0u);
  EXPECT_NEAR(volume_6(boundary), 6, 1e-9);
}

// Distances from a sphere that are found in another way.
TEST(SimplifiedBoundary, OfABallIsClosedAndWithinItsError) {
  const Boundary full = whole({piece_of(ball(24))});
  double before = 1;
  for (const std::uint64_t most : {100, 400, 1600}) {
    const Boundary boundary = simplified({piece_of(ball(24))}, most);
    EXPECT_LE(boundary.kept, most);
    EXPECT_GT(boundary.kept, most / 2);
    EXPECT_EQ(open_edges(boundary), 0u);
    ASSERT_EQ(boundary.patches.size(), 1u);
    const TriangleMesh& mesh = boundary.patches[0].mesh;
    const TriangleTree tree(mesh.points, mesh.triangles);
    double largest = 0;
    for (const dvec3& p : full.patches[0].mesh.points) largest = std::max(largest, tree.distance(p));
    EXPECT_NEAR(largest, boundary.error, 1e-12);
    // All corners lie on the sphere, so a point of it is as far as its triangle's height, or less.
    double height = 0;
    for (const auto& [a, b, c] : mesh.triangles)
      height = std::max(height, 1 - glm::length(mesh.points[a] + mesh.points[b] + mesh.points[c]) / 3);
    EXPECT_LT(boundary.error, 2 * height);
    EXPECT_LT(boundary.error, before / 2);
    before = boundary.error;
  }
}

TEST(SimplifiedBoundary, PatchesStayJoined) {
  const Mesh mesh = ball(24);
  Piece piece = piece_of(mesh);
  // Halves and quarters of the ball: three of them meet in a point.
  piece.patches = {patch_of("left", mesh, [](dvec3 p) { return p.x < 0; }),
                   patch_of("upper right", mesh, [](dvec3 p) { return p.x >= 0 && p.y >= 0; })};
  const Boundary boundary = simplified({piece}, 1000);
  EXPECT_EQ(boundary.patches.size(), 3u);
  EXPECT_LE(boundary.kept, 1000u);
  EXPECT_EQ(open_edges(boundary), 0u);
  EXPECT_NEAR(volume_6(boundary), 6 * 4.18879, 0.5);
  for (const Patch& patch : boundary.patches) EXPECT_GT(patch.mesh.triangles.size(), 100u) << patch.name;
}

// Tetrahedra without neighbours: no edge can be collapsed, and points are joined.
TEST(SimplifiedBoundary, IsNeverLargerThanAsked) {
  const Boundary boundary = simplified({piece_of(random_tetrahedra(2000))}, 500);
  EXPECT_EQ(boundary.triangles, 8000u);
  EXPECT_LE(boundary.kept, 500u);
  EXPECT_GT(boundary.error, 0);
  EXPECT_LT(boundary.error, std::sqrt(3.0));
}

TEST(SimplifiedBoundary, DoesNotDependOnMemoryAndThreads) {
  const std::vector<Piece> pieces = {piece_of(ball(20)), piece_of(lattice(20, [](dvec3 p) { return p + 1.5; }))};
  const auto bytes = [&](std::size_t memory, int threads) {
    const tbb::global_control control(tbb::global_control::max_allowed_parallelism, static_cast<std::size_t>(threads));
    BoundaryFaces faces = faces_of(pieces, memory);
    const Boundary boundary = simplified_boundary(faces, 2000).value();
    EXPECT_THAT(sizes_of(boundary), ElementsAre(Pair("outer 1", _), Pair("outer 2", _), Pair("side x+", _),
                                                Pair("side y+", _), Pair("side z+", _)));
    return format::pack_boundary(boundary.patches, boundary.error).value().section;
  };
  const auto first = bytes(BoundaryFaces::least_memory(), 1);
  EXPECT_EQ(first, bytes(BoundaryFaces::least_memory() * 64, 2));
}

TEST(WeldedSurfaces, HaveTheSmallestCellsThatFit) {
  const Mesh mesh = ball(20);
  const auto weld = [&](std::uint64_t most, bool backwards) {
    std::vector<BoundaryTriangle> triangles;
    BoundaryFaces faces = faces_of({piece_of(mesh)});
    EXPECT_TRUE(faces.visit([&](const BoundaryTriangle& triangle) {
      triangles.push_back(triangle);
      return Status();
    }));
    if (backwards) std::ranges::reverse(triangles);
    WeldedSurface welded(faces.box(), most);
    for (const BoundaryTriangle& triangle : triangles) EXPECT_TRUE(welded.add(triangle));
    return welded;
  };
  const WeldedSurface exact = weld(4800, false);
  EXPECT_EQ(exact.triangles().size(), 4800u);
  EXPECT_EQ(exact.points().size(), 2402u);
  EXPECT_EQ(exact.moved(), 0);
  const WeldedSurface coarse = weld(1000, false), other = weld(1000, true);
  EXPECT_LE(coarse.triangles().size(), 1000u);
  EXPECT_GT(coarse.triangles().size(), 100u);
  EXPECT_EQ(coarse.triangles().size(), other.triangles().size());
  EXPECT_EQ(coarse.moved(), other.moved());
  for (const dvec3& p : coarse.points()) EXPECT_NEAR(glm::length(p), 1, coarse.moved());
}

TEST(TriangleTrees, FindTheNearestTriangle) {
  const dvec3 a(0), b(1, 0, 0), c(0, 2, 0);
  EXPECT_DOUBLE_EQ(squared_distance({0.2, 0.2, 3}, a, b, c), 9);
  EXPECT_DOUBLE_EQ(squared_distance({-3, -4, 0}, a, b, c), 25);
  EXPECT_DOUBLE_EQ(squared_distance({0.5, -2, 0}, a, b, c), 4);
  EXPECT_DOUBLE_EQ(squared_distance({3, 0, 0}, a, b, b), 4) << "of an edge";
  const Boundary boundary = whole({piece_of(ball(8))});
  const TriangleMesh& mesh = boundary.patches[0].mesh;
  const TriangleTree tree(mesh.points, mesh.triangles);
  std::mt19937_64 random(4);
  std::uniform_real_distribution<double> uniform(-2, 2);
  for (int i = 0; i < 200; ++i) {
    const dvec3 p = random_vector(uniform, random);
    double least = 1e9;
    for (const auto& [d, e, f] : mesh.triangles)
      least = std::min(least, squared_distance(p, mesh.points[d], mesh.points[e], mesh.points[f]));
    EXPECT_EQ(tree.distance(p), std::sqrt(least));
  }
  EXPECT_EQ(TriangleTree({}, {}).distance(dvec3(0)), std::numeric_limits<double>::infinity());
}

// Whole builds.
struct BuildsWithABoundary : testing::Test {
  Result<BuildReport> build(const std::string& name, std::uint64_t triangles, std::uint64_t memory, bool cells = true) {
    Piece piece = piece_of(ball(12));
    if (cells) piece.patches = {patch_at("none", ball(12), 2, 9)};
    if (!cells) piece.tetrahedra.clear();
    PieceSource source({piece});
    return build_volume(source, path(name), {.memory = memory, .boundary_triangles = triangles},
                        [](const char*, double) {});
  }
  static std::string path(const std::string& name) { return testing::TempDir() + "/" + name; }
  static std::string bytes(const std::string& name) { return read_text_file(path(name)).value(); }
};

TEST_F(BuildsWithABoundary, HoldItInTheFile) {
  const auto report = value_of(build("boundary.svol", 500, std::uint64_t{1} << 30));
  ASSERT_TRUE(report.boundary.has_value());
  EXPECT_EQ(report.boundary->triangles, 12u * 144);
  EXPECT_LE(report.boundary->kept, 500u);
  const auto volume = format::Volume::open(open_file(path("boundary.svol")).value()).value();
  ASSERT_TRUE(volume->info().boundary.has_value());
  EXPECT_EQ(volume->info().boundary->patches.size(), 2u);
  EXPECT_EQ(volume->info().boundary->error, report.boundary->error);
  const std::size_t outer = 1;
  EXPECT_EQ(volume->read_boundary({&outer, 1})->triangles.size(), report.boundary->kept);

  ASSERT_TRUE(build("less.svol", 500, std::uint64_t{1} << 24));
  EXPECT_TRUE(bytes("boundary.svol") == bytes("less.svol")) << "whatever the memory";
}

TEST_F(BuildsWithABoundary, AreTheSameBesides) {
  ASSERT_TRUE(build("with.svol", 500, std::uint64_t{1} << 30));
  ASSERT_TRUE(build("without.svol", 0, std::uint64_t{1} << 30));
  const auto with = format::Volume::open(open_file(path("with.svol")).value()).value();
  const auto without = format::Volume::open(open_file(path("without.svol")).value()).value();
  EXPECT_FALSE(without->info().boundary.has_value());
  EXPECT_EQ(with->geometry_hash().value(), without->geometry_hash().value());
  EXPECT_EQ(with->info().provenance, without->info().provenance);
}

TEST_F(BuildsWithABoundary, NeedCells) {
  EXPECT_THAT(message_of(build("none.svol", 500, std::uint64_t{1} << 30, false)), HasSubstr("no cells with a volume"));
}

}  // namespace
}  // namespace splatvol::test
