#include "builder/mesh/tetrahedra.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <random>
#include <set>

#include "builder/mesh/lattice.h"
#include "tests/builder/sources/tetrahedron_faces.h"
#include "tests/support/random.h"

namespace splatvol::test {
namespace {

using Nodes = std::vector<std::uint32_t>;
using Tetrahedra = std::vector<TetrahedronSplitter::Tetrahedron>;
using Triangle = std::array<std::uint32_t, 3>;

struct Split {
  Tetrahedra tetrahedra;
  CellCensus census;
};

double absolute_volume(const std::vector<dvec3>& points, const Tetrahedra& tetrahedra) {
  double sum = 0;
  for (const auto& [a, b, c, d] : tetrahedra)
    sum += std::abs(signed_volume_6(points[a], points[b], points[c], points[d])) / 6;
  return sum;
}

Split split_cell(CellShape shape, const std::vector<dvec3>& points, Nodes nodes = {}) {
  Split split;
  if (nodes.empty()) {
    nodes.resize(points.size());
    std::iota(nodes.begin(), nodes.end(), 0);
  }
  TetrahedronSplitter(points, split.tetrahedra, split.census).split(shape, nodes);
  return split;
}

Split split_polyhedron(const std::vector<dvec3>& points, const std::vector<Nodes>& faces) {
  Split split;
  Nodes stream;
  for (const Nodes& face : faces) {
    stream.push_back(static_cast<std::uint32_t>(face.size()));
    stream.insert(stream.end(), face.begin(), face.end());
  }
  TetrahedronSplitter(points, split.tetrahedra, split.census).split_polyhedron(stream);
  return split;
}

/// The number of tetrahedra that have each triangle.
std::map<Triangle, int> triangle_uses(const Tetrahedra& tetrahedra) {
  std::map<Triangle, int> uses;
  for (const auto& tetrahedron : tetrahedra)
    for (const Triangle& triangle : test::faces_of(tetrahedron)) ++uses[triangle];
  return uses;
}

const std::vector<dvec3> cube = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0},
                                 {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}};
const std::vector<Nodes> cube_faces = {{0, 3, 2, 1}, {4, 5, 6, 7}, {0, 1, 5, 4},
                                       {1, 2, 6, 5}, {2, 3, 7, 6}, {3, 0, 4, 7}};

/// The points of a prism over a counterclockwise polygon, in the order of VTK's prisms and hexahedra.
std::vector<dvec3> prism(const std::vector<dvec2>& polygon) {
  std::vector<dvec3> points;
  for (const double z : {0.0, 1.0})
    for (const dvec2 p : polygon) points.emplace_back(p.x, p.y, z);
  return points;
}

std::vector<Nodes> prism_faces(std::uint32_t sides) {
  std::vector<Nodes> faces(2);
  for (std::uint32_t i = 0; i < sides; ++i) {
    faces[0].insert(faces[0].begin(), i);
    faces[1].push_back(sides + i);
    faces.push_back({i, (i + 1) % sides, sides + (i + 1) % sides, sides + i});
  }
  return faces;
}

double polygon_area(const std::vector<dvec2>& polygon) {
  double twice = 0;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const dvec2 p = polygon[i], q = polygon[(i + 1) % polygon.size()];
    twice += p.x * q.y - q.x * p.y;
  }
  return twice / 2;
}

std::vector<dvec2> regular_polygon(int sides) {
  std::vector<dvec2> polygon;
  for (int i = 0; i < sides; ++i) polygon.emplace_back(std::cos(2 * M_PI * i / sides), std::sin(2 * M_PI * i / sides));
  return polygon;
}

/// Adds the nodes in the middles of the edges.
std::vector<dvec3> quadratic(std::vector<dvec3> corners, const std::vector<std::pair<int, int>>& edges) {
  for (const auto& [a, b] : edges)
    corners.push_back((corners[static_cast<std::size_t>(a)] + corners[static_cast<std::size_t>(b)]) / 2.0);
  return corners;
}

/// Adds nodes in the middles of some nodes.
std::vector<dvec3> with_middles(std::vector<dvec3> points, const std::vector<Nodes>& groups) {
  for (const Nodes& group : groups) {
    dvec3 sum(0);
    for (const std::uint32_t node : group) sum += points[node];
    points.push_back(sum / static_cast<double>(group.size()));
  }
  return points;
}

const std::vector<std::pair<int, int>> tetrahedron_edges = {{0, 1}, {1, 2}, {2, 0}, {0, 3}, {1, 3}, {2, 3}};
const std::vector<std::pair<int, int>> hexahedron_edges = {{0, 1}, {1, 2}, {2, 3}, {3, 0}, {4, 5}, {5, 6},
                                                           {6, 7}, {7, 4}, {0, 4}, {1, 5}, {2, 6}, {3, 7}};
const std::vector<std::pair<int, int>> wedge_edges = {{0, 1}, {1, 2}, {2, 0}, {3, 4}, {4, 5},
                                                      {5, 3}, {0, 3}, {1, 4}, {2, 5}};
const std::vector<std::pair<int, int>> pyramid_edges = {{0, 1}, {1, 2}, {2, 3}, {3, 0}, {0, 4}, {1, 4}, {2, 4}, {3, 4}};

struct UnitCell {
  CellShape shape;
  std::vector<dvec3> points;
  double volume;
  std::size_t tetrahedra;
};

std::vector<UnitCell> unit_cells() {
  const std::vector<dvec3> tetrahedron = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  const std::vector<dvec3> voxel = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0},
                                    {0, 0, 1}, {1, 0, 1}, {0, 1, 1}, {1, 1, 1}};
  const std::vector<dvec3> wedge = {{0, 0, 0}, {0, 1, 0}, {1, 0, 0}, {0, 0, 1}, {0, 1, 1}, {1, 0, 1}};
  const std::vector<dvec3> pyramid = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0.5, 0.5, 1}};
  return {{CellShape::tetrahedron, tetrahedron, 1.0 / 6, 1},
          {CellShape::voxel, voxel, 1, 6},
          {CellShape::hexahedron, cube, 1, 6},
          {CellShape::wedge, wedge, 0.5, 3},
          {CellShape::pyramid, pyramid, 1.0 / 3, 2},
          {CellShape::pentagonal_prism, prism(regular_polygon(5)), polygon_area(regular_polygon(5)), 9},
          {CellShape::hexagonal_prism, prism(regular_polygon(6)), polygon_area(regular_polygon(6)), 12},
          {CellShape::quadratic_tetrahedron, quadratic(tetrahedron, tetrahedron_edges), 1.0 / 6, 8},
          {CellShape::quadratic_hexahedron, quadratic(cube, hexahedron_edges), 1, 0},
          {CellShape::quadratic_wedge, quadratic(wedge, wedge_edges), 0.5, 0},
          {CellShape::quadratic_pyramid, quadratic(pyramid, pyramid_edges), 1.0 / 3, 0},
          {CellShape::biquadratic_hexahedron,
           with_middles(quadratic(cube, hexahedron_edges), {{0, 3, 7, 4}, {1, 2, 6, 5}, {0, 1, 5, 4}, {2, 3, 7, 6}}), 1,
           36},
          {CellShape::triquadratic_pyramid,
           with_middles(quadratic(pyramid, pyramid_edges),
                        {{0, 1, 2, 3}, {0, 1, 4}, {1, 2, 4}, {2, 3, 4}, {3, 0, 4}, {0, 1, 2, 3, 4}}),
           1.0 / 3, 32}};
}

TEST(Tetrahedra, UnitCellsKeepTheirVolume) {
  for (const UnitCell& cell : unit_cells()) {
    SCOPED_TRACE(shape_name(cell.shape));
    ASSERT_EQ(cell.points.size(), node_count(cell.shape));
    const Split split = split_cell(cell.shape, cell.points);
    EXPECT_NEAR(absolute_volume(cell.points, split.tetrahedra), cell.volume, 1e-15 * 8);
    EXPECT_EQ(split.census.tetrahedra, split.tetrahedra.size());
    EXPECT_EQ(split.census.inverted, 0u);
    EXPECT_EQ(split.census.flat, 0u);
    EXPECT_EQ(split.census.not_star_shaped, 0u);
    if (cell.tetrahedra) {
      EXPECT_EQ(split.tetrahedra.size(), cell.tetrahedra);
    }
    std::set<std::uint32_t> used;
    for (const auto& tetrahedron : split.tetrahedra) used.insert(tetrahedron.begin(), tetrahedron.end());
    EXPECT_EQ(used.size(), cell.points.size()) << "every node takes part";
    for (const auto& [triangle, uses] : triangle_uses(split.tetrahedra)) EXPECT_LE(uses, 2);
  }
}

/// The triangles on the plane z = `z`, by sorted positions of their corners.
std::set<std::vector<std::array<double, 2>>> triangles_at(double z, const std::vector<dvec3>& points,
                                                          const Split& split) {
  std::set<std::vector<std::array<double, 2>>> triangles;
  for (const auto& [triangle, uses] : triangle_uses(split.tetrahedra)) {
    std::vector<std::array<double, 2>> corners;
    for (const std::uint32_t i : triangle)
      if (points[i].z == z) corners.push_back({points[i].x, points[i].y});
    std::ranges::sort(corners);
    if (corners.size() == 3) triangles.insert(corners);
  }
  return triangles;
}

// The base of a biquadratic hexahedron is cut as a quadratic cell's, its sides as those of cells with middles.
TEST(Tetrahedra, BiquadraticHexahedraFitTheirNeighbours) {
  const std::vector<UnitCell> cells = unit_cells();
  const auto cell_of = [&](CellShape shape) { return *std::ranges::find(cells, shape, &UnitCell::shape); };
  UnitCell biquadratic = cell_of(CellShape::biquadratic_hexahedron);
  const UnitCell quadratic = cell_of(CellShape::quadratic_hexahedron),
                 pyramid = cell_of(CellShape::triquadratic_pyramid);
  const auto faces_of = [](const UnitCell& cell) {
    return triangles_at(0, cell.points, split_cell(cell.shape, cell.points));
  };
  EXPECT_EQ(faces_of(biquadratic), faces_of(quadratic));
  for (dvec3& p : biquadratic.points) p = dvec3(p.x, 1 - p.z, p.y);  // stands on a side
  EXPECT_EQ(faces_of(biquadratic), faces_of(pyramid));
}

TEST(Tetrahedra, VolumeDoesNotDependOnPositionOrRotation) {
  // Turns about a skew axis, so that no coordinate decides alone which vertex is lowest.
  const double c = std::cos(0.7), s = std::sin(0.7);
  const dmat3 turn = dmat3(c, s, 0, -s, c, 0, 0, 0, 1) * dmat3(1, 0, 0, 0, c, s, 0, -s, c);
  for (UnitCell cell : unit_cells()) {
    SCOPED_TRACE(shape_name(cell.shape));
    for (dvec3& p : cell.points) p = turn * p + dvec3(3, -2, 5);
    const Split split = split_cell(cell.shape, cell.points);
    EXPECT_NEAR(absolute_volume(cell.points, split.tetrahedra), cell.volume, 1e-13);
    EXPECT_EQ(split.census.inverted, 0u);
    EXPECT_EQ(split.census.not_star_shaped, 0u);
  }
}

/// The 24 ways to name the corners of a hexahedron without mirroring it.
std::vector<Nodes> hexahedron_rotations() {
  const Nodes around_z = {1, 2, 3, 0, 5, 6, 7, 4};
  const Nodes around_x = {3, 2, 6, 7, 0, 1, 5, 4};
  std::set<Nodes> found = {{0, 1, 2, 3, 4, 5, 6, 7}};
  for (std::size_t size = 0; size != found.size();) {
    size = found.size();
    for (const Nodes& nodes : std::set<Nodes>(found))
      for (const Nodes& turn : {around_z, around_x}) {
        Nodes turned;
        for (const std::uint32_t i : turn) turned.push_back(nodes[i]);
        found.insert(turned);
      }
  }
  return {found.begin(), found.end()};
}

TEST(Tetrahedra, TwoHexahedraAgreeOnTheirSharedFace) {
  const std::vector<Nodes> rotations = hexahedron_rotations();
  ASSERT_EQ(rotations.size(), 24u);
  std::mt19937 random(7);
  std::uniform_real_distribution<double> jitter(-0.2, 0.2);
  for (int trial = 0; trial < 3000; ++trial) {
    // Twelve points in any numbering. Half of the trials use the exact lattice, where rounding decides nothing.
    Nodes number(12);
    std::iota(number.begin(), number.end(), 0);
    std::ranges::shuffle(number, random);
    std::vector<dvec3> points(12);
    const auto at = [&](int i, int j, int k) { return number[static_cast<std::size_t>((k * 2 + j) * 3 + i)]; };
    for (int k = 0; k < 2; ++k)
      for (int j = 0; j < 2; ++j)
        for (int i = 0; i < 3; ++i) {
          points[at(i, j, k)] = dvec3(i, j, k);
          if (trial % 2) points[at(i, j, k)] += random_vector(jitter, random);
        }
    Split split;
    TetrahedronSplitter splitter(points, split.tetrahedra, split.census);
    for (int i = 0; i < 2; ++i) {
      const Nodes nodes = {at(i, 0, 0), at(i + 1, 0, 0), at(i + 1, 1, 0), at(i, 1, 0),
                           at(i, 0, 1), at(i + 1, 0, 1), at(i + 1, 1, 1), at(i, 1, 1)};
      Nodes turned;
      for (const std::uint32_t corner : rotations[random() % rotations.size()]) turned.push_back(nodes[corner]);
      splitter.split(CellShape::hexahedron, turned);
    }
    const std::set<std::uint32_t> shared = {at(1, 0, 0), at(1, 1, 0), at(1, 0, 1), at(1, 1, 1)};
    int matched = 0;
    for (const auto& [triangle, uses] : triangle_uses(split.tetrahedra)) {
      if (!std::ranges::all_of(triangle, [&](std::uint32_t v) { return shared.contains(v); })) continue;
      ASSERT_EQ(uses, 2) << "trial " << trial;
      ++matched;
    }
    ASSERT_EQ(matched, 2) << "trial " << trial;
  }
}

/// A grid of n^3 cells in the unit cube, with inner points moved at random. Every cell is a hexahedron in a random
/// rotation, six pyramids around a middle point, or a polyhedron.
struct MixedGrid {
  explicit MixedGrid(int n, unsigned seed) : random(seed) {
    std::uniform_real_distribution<double> jitter(-0.25 / n, 0.25 / n);
    const auto inner = [n](int i) { return i > 0 && i < n; };
    for (int k = 0; k <= n; ++k)
      for (int j = 0; j <= n; ++j)
        for (int i = 0; i <= n; ++i) {
          const double z = inner(k) ? jitter(random) : 0, y = inner(j) ? jitter(random) : 0;
          const double x = inner(i) ? jitter(random) : 0;
          points.push_back(dvec3(i, j, k) / static_cast<double>(n) + dvec3(x, y, z));
        }
    const auto at = [n](int i, int j, int k) { return static_cast<std::uint32_t>((k * (n + 1) + j) * (n + 1) + i); };
    for (int k = 0; k < n; ++k)
      for (int j = 0; j < n; ++j)
        for (int i = 0; i < n; ++i)
          cells.push_back({at(i, j, k), at(i + 1, j, k), at(i + 1, j + 1, k), at(i, j + 1, k), at(i, j, k + 1),
                           at(i + 1, j, k + 1), at(i + 1, j + 1, k + 1), at(i, j + 1, k + 1)});
    for (const Nodes& cell : cells) {
      dvec3 middle(0);
      for (const std::uint32_t node : cell) middle += points[node] / 8.0;
      middles.push_back(static_cast<std::uint32_t>(points.size()));
      points.push_back(middle);
    }
  }

  Split split() {
    const std::vector<Nodes> rotations = hexahedron_rotations();
    Split result;
    TetrahedronSplitter splitter(points, result.tetrahedra, result.census);
    for (std::size_t c = 0; c < cells.size(); ++c) {
      Nodes nodes;
      for (const std::uint32_t corner : rotations[random() % rotations.size()]) nodes.push_back(cells[c][corner]);
      const unsigned kind = random() % 3;
      if (kind == 0) splitter.split(CellShape::hexahedron, nodes);
      Nodes stream;
      for (const Nodes& face : cube_faces) {
        // A pyramid stands on the inner side of the face.
        const Nodes pyramid = {nodes[face[3]], nodes[face[2]], nodes[face[1]], nodes[face[0]], middles[c]};
        if (kind == 1) splitter.split(CellShape::pyramid, pyramid);
        stream.push_back(4);
        for (const std::uint32_t corner : face) stream.push_back(nodes[corner]);
      }
      if (kind == 2) splitter.split_polyhedron(stream);
    }
    return result;
  }

  std::mt19937 random;
  std::vector<dvec3> points;
  std::vector<Nodes> cells;
  Nodes middles;
};

TEST(Tetrahedra, MixedGridsAreConforming) {
  for (unsigned seed = 0; seed < 4; ++seed) {
    MixedGrid grid(6, seed);
    const Split split = grid.split();
    const auto on_boundary = [&](const Triangle& triangle) {
      for (int axis = 0; axis < 3; ++axis)
        for (const double side : {0.0, 1.0})
          if (std::ranges::all_of(triangle, [&](std::uint32_t v) { return grid.points[v][axis] == side; })) return true;
      return false;
    };
    for (const auto& [triangle, uses] : triangle_uses(split.tetrahedra))
      ASSERT_EQ(uses, on_boundary(triangle) ? 1 : 2) << "seed " << seed;
    EXPECT_EQ(split.census.inverted, 0u);
    EXPECT_EQ(split.census.not_star_shaped, 0u);
    EXPECT_NEAR(absolute_volume(grid.points, split.tetrahedra), 1, 1e-12);
  }
}

TEST(Tetrahedra, PiecesWithPointsOfTheirOwnAgree) {
  // Both pieces have the same warped face, but number its points in opposite orders.
  const std::vector<dvec3> left = {{0, 0, 0}, {1, 0, 0.1}, {1, 1, -0.1}, {0, 1, 0},
                                   {0, 0, 1}, {1, 0, 1},   {1.1, 1, 1},  {0, 1, 1}};
  std::vector<dvec3> right = {{2, 1, 1}, {2, 0, 1}, {2, 1, 0}, {2, 0, 0}, left[6], left[5], left[2], left[1]};
  const Split a = split_cell(CellShape::hexahedron, left);
  const Split b = split_cell(CellShape::hexahedron, right, {7, 3, 2, 6, 5, 1, 0, 4});
  ASSERT_EQ(b.census.inverted, 0u);
  const auto face = [](const std::vector<dvec3>& points, const Split& split) {
    std::set<std::vector<double>> triangles;
    for (const auto& [triangle, uses] : triangle_uses(split.tetrahedra)) {
      std::vector<double> corners;
      for (const std::uint32_t v : triangle)
        if (points[v].x >= 1 && points[v].x < 1.5) corners.insert(corners.end(), {points[v].y + 10 * points[v].z});
      std::ranges::sort(corners);
      if (corners.size() == 3) triangles.insert(corners);
    }
    return triangles;
  };
  EXPECT_EQ(face(left, a).size(), 2u);
  EXPECT_EQ(face(left, a), face(right, b));
}

TEST(Tetrahedra, QuadraticHexahedraAreConforming) {
  // Two cells in a row have the nodes of two polyhedra: 8 + 8 - 4 corners, 12 + 12 - 4 edges.
  std::vector<dvec3> points = quadratic(cube, hexahedron_edges);
  std::map<std::array<double, 3>, std::uint32_t> index;
  for (std::uint32_t i = 0; i < points.size(); ++i) index[{points[i].x, points[i].y, points[i].z}] = i;
  Nodes first(20), second;
  std::iota(first.begin(), first.end(), 0);
  for (std::uint32_t i = 0; i < 20; ++i) {
    const dvec3 p = points[i] + dvec3(1, 0, 0);
    const auto [entry, is_new] = index.try_emplace({p.x, p.y, p.z}, static_cast<std::uint32_t>(points.size()));
    if (is_new) points.push_back(p);
    second.push_back(entry->second);
  }
  ASSERT_EQ(points.size(), 32u);
  for (dvec3& p : points) p += 0.05 * dvec3(std::sin(9 * p.y), std::sin(7 * p.z), std::sin(5 * p.x));
  Split split;
  TetrahedronSplitter splitter(points, split.tetrahedra, split.census);
  splitter.split(CellShape::quadratic_hexahedron, first);
  splitter.split(CellShape::quadratic_hexahedron, second);
  const std::set<std::uint32_t> shared = [&] {
    std::set<std::uint32_t> nodes;
    for (const std::uint32_t node : second)
      if (node < 20) nodes.insert(node);
    return nodes;
  }();
  ASSERT_EQ(shared.size(), 8u);
  int matched = 0;
  for (const auto& [triangle, uses] : triangle_uses(split.tetrahedra)) {
    if (!std::ranges::all_of(triangle, [&](std::uint32_t v) { return shared.contains(v); })) continue;
    EXPECT_EQ(uses, 2);
    ++matched;
  }
  EXPECT_EQ(matched, 6) << "four corners and two halves of the middle";
}

TEST(Tetrahedra, StarShapedPolyhedraNeedNotBeConvex) {
  // L shapes of three unit squares, turned so that the lowest vertex sees all of the first and a part of the others.
  const std::vector<std::vector<dvec2>> shapes = {{{0, 0}, {2, 0}, {2, 1}, {1, 1}, {1, 2}, {0, 2}},
                                                  {{0, 0}, {2, 0}, {2, 2}, {1, 2}, {1, 1}, {0, 1}},
                                                  {{0, 1}, {1, 1}, {1, 0}, {2, 0}, {2, 2}, {0, 2}}};
  for (const auto& shape : shapes) {
    const std::vector<dvec3> points = prism(shape);
    const Split split = split_polyhedron(points, prism_faces(6));
    EXPECT_NEAR(absolute_volume(points, split.tetrahedra), 3, 1e-14);
    EXPECT_EQ(split.census.inverted, 0u);
    EXPECT_EQ(split.census.not_star_shaped, 0u);
  }
}

TEST(Tetrahedra, PolyhedraThatNoVertexSeesAreCounted) {
  const std::vector<dvec2> u = {{0, 0}, {3, 0}, {3, 2}, {2, 2}, {2, 1}, {1, 1}, {1, 2}, {0, 2}};
  const std::vector<dvec3> points = prism(u);
  const Split split = split_polyhedron(points, prism_faces(8));
  EXPECT_EQ(split.census.not_star_shaped, 1u);
  EXPECT_GT(split.census.inverted, 0u);
  double signed_sum = 0;
  for (const auto& [a, b, c, d] : split.tetrahedra)
    signed_sum += signed_volume_6(points[a], points[b], points[c], points[d]) / 6;
  EXPECT_NEAR(std::abs(signed_sum), polygon_area(u), 1e-14) << "what is too much has its opposite";
}

TEST(Tetrahedra, FacesTurnedAgainstEachOtherAreTurnedBack) {
  // Every choice of turned faces of an L shape; its apex decides on the orientation.
  const std::vector<dvec3> points = prism({{0, 0}, {2, 0}, {2, 2}, {1, 2}, {1, 1}, {0, 1}});
  for (unsigned turned = 0; turned < 256; ++turned) {
    std::vector<Nodes> faces = prism_faces(6);
    for (unsigned i = 0; i < 8; ++i)
      if (turned >> i & 1) std::ranges::reverse(faces[i]);
    const Split split = split_polyhedron(points, faces);
    ASSERT_NEAR(absolute_volume(points, split.tetrahedra), 3, 1e-14) << turned;
    ASSERT_EQ(split.census.inverted, 0u) << turned;
    ASSERT_EQ(split.census.not_star_shaped, 0u) << turned;
  }
}

TEST(Tetrahedra, MirroredCellsCountAsInverted) {
  for (UnitCell cell : unit_cells()) {
    SCOPED_TRACE(shape_name(cell.shape));
    for (dvec3& p : cell.points) p.x = -p.x;
    const Split split = split_cell(cell.shape, cell.points);
    EXPECT_NEAR(absolute_volume(cell.points, split.tetrahedra), cell.volume, 1e-14);
    EXPECT_EQ(split.census.not_star_shaped, 0u);
    const bool either = cell.shape == CellShape::wedge || cell.shape == CellShape::quadratic_wedge;
    EXPECT_EQ(split.census.inverted, either ? 0u : split.tetrahedra.size());
  }
}

TEST(Tetrahedra, FlatAndCollapsedCells) {
  const std::vector<dvec3> square = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}};
  const Split flat = split_cell(CellShape::tetrahedron, square);
  EXPECT_EQ(flat.census.flat, 1u);
  EXPECT_EQ(flat.census.inverted, 0u);

  // A hexahedron with one edge collapsed at both ends is a wedge. If all its nodes are one, it is nothing.
  const Split wedge = split_cell(CellShape::hexahedron, cube, {0, 1, 2, 2, 4, 5, 6, 6});
  EXPECT_NEAR(absolute_volume(cube, wedge.tetrahedra), 0.5, 1e-15);
  EXPECT_EQ(wedge.census.flat, 0u);
  EXPECT_EQ(split_cell(CellShape::hexahedron, cube, Nodes(8, 3)).tetrahedra.size(), 0u);
}

TEST(Tetrahedra, CellsWithoutAPlaceAreLeftOut) {
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    std::vector<dvec3> points = cube;
    points[5].y = bad;
    EXPECT_EQ(split_cell(CellShape::hexahedron, points).census.non_finite, 1u);
    EXPECT_TRUE(split_cell(CellShape::hexahedron, points).tetrahedra.empty());
    EXPECT_EQ(split_polyhedron(points, cube_faces).census.non_finite, 1u);
    EXPECT_EQ(split_cell(CellShape::tetrahedron, points, {0, 1, 3, 4}).tetrahedra.size(), 1u);
  }
}

/// The lattice positions of a unit cell, in an arbitrary order.
std::vector<dvec3> lattice_positions(CellShape shape, int order) {
  std::vector<dvec3> positions;
  for (int i = order; i >= 0; --i)
    for (int k = 0; k <= order; ++k)
      for (int j = 0; j <= order; ++j) {
        if (shape == CellShape::wedge && i + j > order) continue;
        if (shape == CellShape::tetrahedron && i + j + k > order) continue;
        positions.push_back(dvec3(i, j, k) / static_cast<double>(order));
      }
  return positions;
}

TEST(Lattice, LinearCellsFillTheCell) {
  const std::map<CellShape, double> volumes = {
      {CellShape::hexahedron, 1}, {CellShape::wedge, 0.5}, {CellShape::tetrahedron, 1.0 / 6}};
  for (const auto& [shape, volume] : volumes)
    for (int order = 1; order <= 5; ++order) {
      SCOPED_TRACE(fmt::format("{} of order {}", shape_name(shape), order));
      const std::vector<dvec3> positions = lattice_positions(shape, order);
      EXPECT_EQ(lattice_order(shape, false, positions.size()), order);
      const auto cells = divide_lattice(shape, order, order, positions).value();
      Split split;
      TetrahedronSplitter splitter(positions, split.tetrahedra, split.census);
      for (std::size_t at = 0; at < cells.size(); at += node_count(shape))
        splitter.split(shape, std::span(cells).subspan(at, node_count(shape)));
      EXPECT_NEAR(absolute_volume(positions, split.tetrahedra), volume, 1e-13);
      EXPECT_EQ(split.census.inverted, 0u);
      for (const auto& [triangle, uses] : triangle_uses(split.tetrahedra)) EXPECT_LE(uses, 2);
    }
}

TEST(Lattice, RefusesNodesThatAreNoLattice) {
  std::vector<dvec3> positions = lattice_positions(CellShape::hexahedron, 2);
  positions[3] = positions[4];
  EXPECT_FALSE(divide_lattice(CellShape::hexahedron, 2, 2, positions));
  positions.pop_back();
  EXPECT_FALSE(divide_lattice(CellShape::hexahedron, 2, 2, positions));
  EXPECT_FALSE(lattice_order(CellShape::hexahedron, false, 26));
}

// The tetrahedra of whole cells, with sorted corners.
std::multiset<std::array<std::uint32_t, 4>> parts_of(const std::vector<WholeCell>& cells) {
  std::multiset<std::array<std::uint32_t, 4>> parts;
  for (const WholeCell& cell : cells)
    for (const auto& corners : format::tetrahedra_of(cell.shape, cell.split)) {
      std::array<std::uint32_t, 4> part{};
      std::ranges::transform(corners, part.begin(), [&](std::uint8_t k) { return cell.corners[k]; });
      std::ranges::sort(part);
      parts.insert(part);
    }
  return parts;
}

TEST(WholeCells, AreSplitAsTheirTetrahedraAre) {
  std::mt19937 random(7);
  constexpr std::array shapes = {CellShape::pyramid, CellShape::wedge, CellShape::hexahedron, CellShape::voxel};
  for (int trial = 0; trial < 4000; ++trial) {
    // From barely bent ones to some that are inside out.
    const CellShape shape = shapes[random() % shapes.size()];
    std::vector<dvec3> points(cube.begin(), cube.begin() + static_cast<std::ptrdiff_t>(node_count(shape)));
    if (shape == CellShape::wedge) points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {1, 0, 1}, {0, 1, 1}};
    if (shape == CellShape::pyramid) points[4] = {0.5, 0.5, 1};
    if (shape == CellShape::voxel) std::swap(points[2], points[3]), std::swap(points[6], points[7]);
    std::uniform_real_distribution<double> bend(-0.1 - trial % 4 * 0.3, 0.1 + trial % 4 * 0.3);
    for (dvec3& point : points) point += random_vector(bend, random);
    Nodes nodes(points.size());
    std::iota(nodes.begin(), nodes.end(), 0);
    Split split;
    std::vector<WholeCell> cells;
    TetrahedronSplitter splitter(points, split.tetrahedra, split.census);
    splitter.list_whole_cells(cells);
    splitter.split(shape, nodes);
    ASSERT_EQ(cells.size(), 1u);
    EXPECT_EQ(cells[0].first, 0u);
    EXPECT_EQ(cells[0].count, split.tetrahedra.size());
    std::multiset<std::array<std::uint32_t, 4>> tetrahedra;
    for (std::array<std::uint32_t, 4> corners : split.tetrahedra) {
      std::ranges::sort(corners);
      tetrahedra.insert(corners);
    }
    ASSERT_EQ(parts_of(cells), tetrahedra) << "trial " << trial;
  }
}

TEST(WholeCells, LeaveOutWhatNoShapeHas) {
  Split split;
  std::vector<WholeCell> cells;
  TetrahedronSplitter splitter(cube, split.tetrahedra, split.census);
  splitter.list_whole_cells(cells);
  splitter.split(CellShape::hexahedron, Nodes{0, 1, 2, 3, 4, 5, 6, 6});  // collapsed
  splitter.split(CellShape::tetrahedron, Nodes{0, 1, 2, 5});
  splitter.split_polyhedron(Nodes{3, 0, 1, 2, 3, 0, 2, 5, 3, 0, 5, 1, 3, 1, 5, 2});  // a tetrahedron
  EXPECT_TRUE(cells.empty());
  splitter.split(CellShape::hexahedron, Nodes{0, 1, 2, 3, 4, 5, 6, 7});
  ASSERT_EQ(cells.size(), 1u);
  EXPECT_EQ(cells[0].first + cells[0].count, split.tetrahedra.size());
}

TEST(WholeCells, ListPolyhedraAndPrismsByTheirTetrahedra) {
  Split split;
  std::vector<WholeCell> cells;
  std::vector<dvec3> points = prism(regular_polygon(6));
  TetrahedronSplitter splitter(points, split.tetrahedra, split.census);
  splitter.list_whole_cells(cells);
  Nodes nodes(12);
  std::iota(nodes.begin(), nodes.end(), 0);
  splitter.split(CellShape::hexagonal_prism, nodes);
  splitter.split_polyhedron(
      Nodes{4, 0, 1, 7, 6, 4, 1, 2, 8, 7, 4, 2, 3, 9, 8, 4, 3, 0, 6, 9, 4, 3, 2, 1, 0, 4, 6, 7, 8, 9});
  ASSERT_EQ(cells.size(), 2u);
  std::uint32_t next = 0;
  for (const WholeCell& cell : cells) {
    EXPECT_EQ(cell.shape, format::CellShape::polyhedron);
    EXPECT_EQ(std::exchange(next, cell.first + cell.count), cell.first);
    EXPECT_GT(cell.count, 2u);
    for (std::uint32_t i = cell.first; i < next; ++i)
      EXPECT_EQ(split.tetrahedra[i][3], split.tetrahedra[cell.first][3]);
  }
  EXPECT_EQ(next, split.tetrahedra.size());
}

}  // namespace
}  // namespace splatvol::test
