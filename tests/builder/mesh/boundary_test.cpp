#include "builder/mesh/boundary.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "tests/builder/support/meshes.h"
#include "tests/support/random.h"

namespace splatvol::test {
namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

std::vector<OuterFace> faces_of(const Mesh& mesh) { return find_outer_faces(mesh.points, mesh.tetrahedra); }

std::vector<BoundaryPlane> planes_of(const Mesh& mesh) { return boundary_planes(mesh.points, faces_of(mesh)); }

dvec3 area_of(const std::vector<dvec3>& points, const OuterFace& face) {
  const auto& [a, b, c] = face.corners;
  return glm::cross(points[b] - points[a], points[c] - points[a]) / 2.0;
}

double area_of(const std::vector<dvec3>& points, const std::vector<OuterFace>& faces) {
  double sum = 0;
  for (const OuterFace& face : faces) sum += glm::length(area_of(points, face));
  return sum;
}

// The volume that a surface encloses, by the divergence theorem. It equals the mesh's volume only if every face looks
// outwards.
double enclosed(const std::vector<dvec3>& points, const std::vector<OuterFace>& faces) {
  double sum = 0;
  for (const OuterFace& face : faces) sum += glm::dot(points[face.corners[0]] - points[0], area_of(points, face)) / 3;
  return sum;
}

// The number of the cube's faces that a lattice point lies on, and the sum of their normals.
int borders(dvec3 p, dvec3& normals) {
  normals = dvec3(0);
  int count = 0;
  for (int axis = 0; axis < 3; ++axis)
    if (p[axis] == 0 || p[axis] == 1) {
      normals[axis] = p[axis] == 0 ? -1 : 1;
      ++count;
    }
  return count;
}

SymmetricMatrix add_square(SymmetricMatrix s, const dvec3& d) {
  return {s.xx + d.x * d.x, s.yy + d.y * d.y, s.zz + d.z * d.z, s.xy + d.x * d.y, s.xz + d.x * d.z, s.yz + d.y * d.z};
}

// The foot in world space, relative to the centroid.
dvec3 foot_of(const dvec3& boundary, const SplatShape& shape) {
  return glm::mat3_cast(shape.orientation) * (shape.deviations * boundary);
}

dvec3 foot_of(const BoundaryPlane& plane, const SpatialMoments& moments) {
  const SplatShape shape = shape_of(moments);
  return foot_of(boundary_foot(plane, moments, shape), shape);
}

void expect_equal(const SymmetricMatrix& a, const SymmetricMatrix& b, double tolerance) {
  EXPECT_NEAR(a.xx, b.xx, tolerance);
  EXPECT_NEAR(a.yy, b.yy, tolerance);
  EXPECT_NEAR(a.zz, b.zz, tolerance);
  EXPECT_NEAR(a.xy, b.xy, tolerance);
  EXPECT_NEAR(a.xz, b.xz, tolerance);
  EXPECT_NEAR(a.yz, b.yz, tolerance);
}

void expect_same(const std::vector<BoundaryPlane>& a, const std::vector<BoundaryPlane>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].area, b[i].area);
    EXPECT_EQ(a[i].offset, b[i].offset);
  }
}

TEST(OuterFaces, OfOneTetrahedronLookOutwardsHoweverItIsTurned) {
  const std::vector<dvec3> points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  Tetrahedron corners = {0, 1, 2, 3};
  do {
    const Mesh mesh{points, {corners}};
    const std::vector<OuterFace> faces = faces_of(mesh);
    ASSERT_EQ(faces.size(), 4u);
    for (const OuterFace& face : faces) {
      EXPECT_TRUE(face.has_side);
      EXPECT_GT(glm::dot(area_of(points, face), points[face.corners[0]] - dvec3(0.25)), 0);
    }
  } while (std::ranges::next_permutation(corners).found);
}

TEST(OuterFaces, OfALatticeAreItsSurface) {
  for (const Mesh& mesh : {lattice(4), jittered(4, 0.2)}) {
    const std::vector<OuterFace> faces = faces_of(mesh);
    EXPECT_EQ(faces.size(), 6u * 4 * 4 * 2);
    EXPECT_NEAR(enclosed(mesh.points, faces), volume(mesh), 1e-14);
  }
  const Mesh mesh = lattice(4);
  EXPECT_NEAR(area_of(mesh.points, faces_of(mesh)), 6, 1e-13);
}

TEST(OuterFaces, AreThereForEachOfSeparateTetrahedra) {
  const Mesh mesh = random_tetrahedra(500);
  const std::vector<OuterFace> faces = faces_of(mesh);
  EXPECT_EQ(faces.size(), 2000u);
  EXPECT_NEAR(enclosed(mesh.points, faces), volume(mesh), 1e-12);
}

TEST(OuterFaces, DoNotDependOnTheNumberOfThreadsNorTheOrderOfTheMesh) {
  Mesh mesh = jittered(20, 0.2);  // vertices for several tasks
  const std::vector<BoundaryPlane> planes = planes_of(mesh);
  {
    const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
    expect_same(planes, planes_of(mesh));
  }
  std::ranges::shuffle(mesh.tetrahedra, std::mt19937(3));
  const std::vector<BoundaryPlane> shuffled = planes_of(mesh);
  for (std::size_t i = 0; i < planes.size(); ++i)
    EXPECT_NEAR(glm::distance(planes[i].area, shuffled[i].area), 0, 1e-17);
}

TEST(OuterFaces, OfABrokenMeshThatThreeCellsShareAreInside) {
  Mesh mesh{{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}, {0, 0, -1}, {1, 1, 1}}, {}};
  for (const std::uint32_t apex : {3u, 4u, 5u}) mesh.tetrahedra.push_back({0, 1, 2, apex});
  EXPECT_EQ(faces_of(mesh).size(), 9u);
}

TEST(OuterFaces, OfCellsThatNameACornerTwiceAreNone) {
  Mesh mesh = lattice(2);
  const std::size_t count = faces_of(mesh).size();
  mesh.tetrahedra.insert(mesh.tetrahedra.begin(), {{0, 0, 1, 2}, {5, 4, 5, 4}, {7, 8, 9, 9}, {3, 3, 3, 3}});
  EXPECT_EQ(faces_of(mesh).size(), count);
  EXPECT_TRUE(find_outer_faces({}, {}).empty());
}

// A square as a flat tetrahedron: it has two faces on each diagonal.
constexpr Tetrahedron flat_square = {0, 1, 2, 3};
const std::vector<dvec3> pyramids = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0.5, 0.5, -1}, {0.5, 0.5, 1}};

TEST(OuterFaces, PassThroughAFlatCellInside) {
  const Mesh mesh{pyramids, {{0, 1, 2, 4}, {0, 2, 3, 4}, flat_square, {0, 1, 3, 5}, {1, 2, 3, 5}}};
  const std::vector<OuterFace> faces = faces_of(mesh);
  EXPECT_EQ(faces.size(), 8u);
  EXPECT_NEAR(enclosed(mesh.points, faces), 2.0 / 3, 1e-15);
}

// The cells behind a flat cell decide which of its sides is outside. The order of its corners and its neighbours'
// corners does not matter, and a second flat cell between may pass the decision on.
TEST(OuterFaces, OfAFlatCellTakeTheirSideFromNeighbours) {
  for (const bool twice : {false, true}) {
    Tetrahedron flat = flat_square;
    do {
      Mesh mesh{pyramids, {flat, {1, 0, 2, 4}, {0, 2, 3, 4}}};
      // The vertex at the square's middle makes the two flat cells differ. Else the second would only change the
      // diagonal back.
      mesh.points[5] = {0.5, 0.5, 0};
      if (twice) mesh.tetrahedra.insert(mesh.tetrahedra.begin(), {5, 3, 0, 1});
      const std::vector<OuterFace> faces = faces_of(mesh);
      EXPECT_EQ(faces.size(), twice ? 8u : 6u);
      EXPECT_NEAR(enclosed(mesh.points, faces), 1.0 / 3, 1e-15);
      for (const OuterFace& face : faces) EXPECT_TRUE(face.has_side);
    } while (std::ranges::next_permutation(flat).found);
  }
}

TEST(OuterFaces, OfFlatCellsAloneHaveNoSide) {
  const Mesh mesh{pyramids, {flat_square}};
  const std::vector<OuterFace> faces = faces_of(mesh);
  ASSERT_EQ(faces.size(), 4u);
  for (const OuterFace& face : faces) EXPECT_FALSE(face.has_side);
  for (const BoundaryPlane& plane : planes_of(mesh)) EXPECT_EQ(plane.area, dvec3(0));
}

TEST(OuterFaces, LieOnBothSidesOfASlit) {
  const Mesh left = lattice(2), right = lattice(2, [](dvec3 p) { return p + dvec3(1, 0, 0); });
  Mesh slit = left;
  for (Tetrahedron corners : right.tetrahedra) {
    for (std::uint32_t& corner : corners) corner += static_cast<std::uint32_t>(left.points.size());
    slit.tetrahedra.push_back(corners);
  }
  slit.points.insert(slit.points.end(), right.points.begin(), right.points.end());
  const std::vector<OuterFace> faces = faces_of(slit);
  EXPECT_NEAR(area_of(slit.points, faces), 12, 1e-13);
  EXPECT_NEAR(enclosed(slit.points, faces), 2, 1e-14);
}

// A lattice point has no plane inside, the face's plane within a face, and one of the faces' planes at edges and
// corners.
TEST(BoundaryPlanes, OfALattice) {
  constexpr std::uint32_t cells = 4;
  for (const double scale : {1e-6, 1.0, 1e6})
    for (const dvec3& origin : {dvec3(0), scale * dvec3(1e7, -1e7, 3e6)}) {
      const Mesh unit = lattice(cells);
      const Mesh mesh = lattice(cells, [&](dvec3 p) { return origin + scale * p; });
      const std::vector<BoundaryPlane> planes = planes_of(mesh);
      const double tolerance = origin == dvec3(0) ? 1e-15 : 1e-8;  // coordinates of 10^7 are rounded
      for (std::size_t i = 0; i < planes.size(); ++i) {
        dvec3 normals;
        const int count = borders(unit.points[i], normals);
        const dvec3 area = planes[i].area / (scale * scale / (cells * cells));
        EXPECT_EQ(planes[i].offset, 0);
        if (count == 0) {
          EXPECT_EQ(area, dvec3(0));
        } else if (count == 1) {
          EXPECT_NEAR(glm::distance(area, normals), 0, tolerance);
        } else {
          const dvec3 normal = glm::normalize(area);
          EXPECT_NEAR(std::max({std::abs(normal.x), std::abs(normal.y), std::abs(normal.z)}), 1, tolerance);
          EXPECT_NEAR(glm::dot(normal, normals), 1, tolerance);
        }
      }
    }
}

// On a lattice, a border point's cell and its mirror image have the moments of an inner point's cell together.
TEST(BoundaryFoot, ReflectedMaterialEqualsAFullCells) {
  const Mesh unit = lattice(4);
  for (const dvec3& stretch : {dvec3(1), dvec3(1, 1, 1e-4), dvec3(1e-4, 1e-4, 1)})
    for (const double scale : {1e-6, 1.0, 1e6})
      for (const double distance : {0.0, 1e7}) {
        // The mesh is turned, so that no axis is special.
        const dmat3 turn = glm::mat3_cast(glm::normalize(glm::dquat(0.3, -0.5, 0.7, 0.2)));
        // The longest edge of a cell is `scale`. Distances from the origin count in shortest edges, so that rounding
        // does not destroy the cells.
        const double shortest = scale * std::min({stretch.x, stretch.y, stretch.z});
        const dvec3 origin = distance * shortest * dvec3(1, -1, 0.5);
        const Mesh mesh = lattice(4, [&](dvec3 p) { return origin + turn * (scale * stretch * p); });
        const std::vector<BoundaryPlane> planes = planes_of(mesh);
        const std::vector<SpatialMoments> moments = moments_of(mesh);
        const SpatialMoments& full = moments[2 * 25 + 2 * 5 + 2];
        // Positions are rounded to 1e-16 of the distance from the origin, which is 1e-8 of the shortest edge.
        const double tolerance = distance > 0 ? 1e-6 : 1e-9;
        for (std::size_t i = 0; i < planes.size(); ++i) {
          dvec3 normals;
          const int count = borders(unit.points[i], normals);
          const dvec3 foot = foot_of(planes[i], moments[i]);
          if (count == 0) {
            EXPECT_EQ(foot, dvec3(0));
          }
          if (count != 1) continue;
          // Compares in the unit lattice, where rounding has one size.
          const dvec3 back = glm::transpose(turn) * foot / (scale * stretch);
          const auto shrink = [&](const SymmetricMatrix& s) {
            const dmat3 matrix(s.xx, s.xy, s.xz, s.xy, s.yy, s.yz, s.xz, s.yz, s.zz);
            const dmat3 m = glm::transpose(turn) * matrix * turn;
            const dvec3 t = scale * stretch;
            return SymmetricMatrix{m[0][0] / t.x / t.x, m[1][1] / t.y / t.y, m[2][2] / t.z / t.z,
                                   m[0][1] / t.x / t.y, m[0][2] / t.x / t.z, m[1][2] / t.y / t.z};
          };
          EXPECT_NEAR(moments[i].mass * 2 / full.mass, 1, tolerance);
          expect_equal(add_square(shrink(moments[i].covariance), back), shrink(full.covariance), tolerance);
        }
      }
}

// A uniform slab at the plane, stretched in any way: the foot is sqrt(3) deviations from the centroid, straight out.
TEST(BoundaryFoot, OfASlabIsAtSqrt3WhateverItsShape) {
  for (const double thickness : {1e-5, 1e-4, 1.0, 1e4, 1e5}) {
    const SpatialMoments moments{.mass = 1,
                                 .centroid = {0, 0, -thickness / 2},
                                 .covariance = {.xx = 1, .yy = 4, .zz = thickness * thickness / 12}};
    const SplatShape shape = shape_of(moments);
    const dvec3 foot = boundary_foot({{0, 0, 3}, 0}, moments, shape);
    EXPECT_NEAR(glm::length(foot), std::sqrt(3.0), 1e-10);
    EXPECT_NEAR(foot_of(foot, shape).z, thickness / 2, 1e-10 * thickness);
    // The same slab, relative to another point.
    SpatialMoments elsewhere = moments;
    elsewhere.centroid += dvec3(1, 2, 3) * thickness;
    EXPECT_NEAR(glm::distance(boundary_foot({{0, 0, 3}, 9 * thickness}, elsewhere, shape), foot), 0, 1e-10);
  }
}

// Compares with the definition, in matrices: the foot relative to the centroid is S n d / (n^T S n). It lies on the
// plane, and its length is below 4.
TEST(BoundaryFoot, IsWhereThePlaneIsNearestInTheMetricOfTheMaterial) {
  std::mt19937_64 random(9);
  std::uniform_real_distribution<double> uniform(-1, 1);
  int kept = 0;
  for (int n = 0; n < 2000; ++n) {
    const dmat3 turn = glm::mat3_cast(glm::normalize(random_quaternion(uniform, random)));
    const dvec3 deviations(1, std::pow(10, 2 * uniform(random) - 2), std::pow(10, 2 * uniform(random) - 2));
    dmat3 s(0);
    for (int k = 0; k < 3; ++k) s += deviations[k] * deviations[k] * glm::outerProduct(turn[k], turn[k]);
    const SpatialMoments moments{.mass = 1,
                                 .centroid = {uniform(random), uniform(random), uniform(random)},
                                 .covariance = {s[0][0], s[1][1], s[2][2], s[0][1], s[0][2], s[1][2]}};
    const dvec3 normal = glm::normalize(random_vector(uniform, random));
    const double distance = (1.5 + 3 * uniform(random)) * std::sqrt(glm::dot(normal, s * normal));
    const BoundaryPlane plane{7.0 * normal, 7 * (distance + glm::dot(normal, moments.centroid))};
    const SplatShape shape = shape_of(moments);
    const dvec3 boundary = boundary_foot(plane, moments, shape);
    const double square = distance * distance / glm::dot(normal, s * normal);
    ASSERT_EQ(boundary != dvec3(0), distance > 0 && square >= 1 && square <= 12);
    if (boundary == dvec3(0)) continue;
    ++kept;
    const dvec3 foot = foot_of(boundary, shape);
    EXPECT_NEAR(glm::distance(foot, distance / glm::dot(normal, s * normal) * (s * normal)), 0, 1e-8);
    EXPECT_NEAR(glm::dot(normal, foot), distance, 1e-8 * distance);
    EXPECT_NEAR(glm::length(boundary), std::sqrt(square), 1e-7);
    EXPECT_LT(glm::length(boundary), 4);
  }
  EXPECT_GT(kept, 500);
}

TEST(BoundaryFoot, IsNoneWhereThereIsNothingToReflect) {
  const SpatialMoments slab{.mass = 1, .centroid = {0, 0, -0.5}, .covariance = {1, 1, 1.0 / 12}};
  EXPECT_NE(boundary_foot({{0, 0, 1}, 0}, slab, shape_of(slab)), dvec3(0));
  EXPECT_EQ(boundary_foot({}, slab, shape_of(slab)), dvec3(0));
  EXPECT_EQ(boundary_foot({{0, 0, -1}, 0}, slab, shape_of(slab)), dvec3(0));    // material beyond the plane
  EXPECT_EQ(boundary_foot({{0, 0, 1}, 1}, slab, shape_of(slab)), dvec3(0));     // far away: its square is 27
  EXPECT_EQ(boundary_foot({{0, 0, 1}, -0.5}, slab, shape_of(slab)), dvec3(0));  // through the middle
  const SpatialMoments sheet{.mass = 1, .centroid = {0, 0, -0.5}, .covariance = {.xx = 1, .yy = 1}};
  EXPECT_EQ(boundary_foot({{0, 0, 1}, 0}, sheet, shape_of(sheet)), dvec3(0));
  EXPECT_EQ(boundary_foot({{0, 0, 1}, 1}, SpatialMoments{}, shape_of(SpatialMoments{})), dvec3(0));
  SpatialMoments point;
  point.mass = 1;
  EXPECT_EQ(boundary_foot({{0, 0, 1}, 1}, point, shape_of(point)), dvec3(0));
}

// A sector of a disc is mirrored up to 210 degrees, and is not if it goes far round a corner.
TEST(BoundaryFoot, IsNoneForMaterialOnBothSides) {
  // A sector round the direction -x, of thickness 1 along z, in closed form.
  const auto foot_length = [](double degrees) {
    const double half = degrees * std::acos(-1.0) / 360;
    const double mean = -2 * std::sin(half) / (3 * half);
    const double ripple = std::sin(2 * half) / (2 * half);
    const SpatialMoments moments{.mass = 1,
                                 .centroid = {mean, 0, 0},
                                 .covariance = {(1 + ripple) / 4 - mean * mean, (1 - ripple) / 4, 1.0 / 12}};
    return glm::length(boundary_foot({{1, 0, 0}, 0}, moments, shape_of(moments)));
  };
  for (const double degrees : {90, 150, 180, 210}) EXPECT_GT(foot_length(degrees), 1) << degrees;
  for (const double degrees : {240, 270, 300}) EXPECT_EQ(foot_length(degrees), 0) << degrees;
}

// A cone of height 1, from its apex at the origin downwards. The square of the distance in deviations is 15 for the
// plane that touches the apex, and 5/3 for the base.
TEST(BoundaryFoot, OfAConeIsAtItsBaseNotAtItsApex) {
  const SpatialMoments cone{.mass = 1, .centroid = {0, 0, -0.75}, .covariance = {0.15, 0.15, 3.0 / 80}};
  EXPECT_EQ(boundary_foot({{0, 0, 1}, 0}, cone, shape_of(cone)), dvec3(0));
  EXPECT_NEAR(glm::length(boundary_foot({{0, 0, -1}, 1}, cone, shape_of(cone))), std::sqrt(5.0 / 3), 1e-14);
}

// A ball of tetrahedra: every surface vertex has a plane. It looks outwards, up to the angle between neighbouring
// faces.
TEST(BoundaryPlanes, OfABallLookOutwards) {
  constexpr std::uint32_t cells = 12;
  // Turns shells of cubes into shells of spheres.
  const Mesh mesh = lattice(cells, [](dvec3 p) {
    const dvec3 c = 2.0 * p - 1.0;
    const double shell = std::max({std::abs(c.x), std::abs(c.y), std::abs(c.z)});
    return shell > 0 ? shell * glm::normalize(c) : dvec3(0);
  });
  const std::vector<BoundaryPlane> planes = planes_of(mesh);
  const std::vector<SpatialMoments> moments = moments_of(mesh);
  const std::vector<OuterFace> faces = faces_of(mesh);
  EXPECT_NEAR(enclosed(mesh.points, faces), volume(mesh), 1e-13);
  dvec3 sum(0);
  double total = 0;
  std::size_t feet = 0, surface = 0;
  for (std::size_t i = 0; i < planes.size(); ++i) {
    const bool outer = glm::length(mesh.points[i]) > 1 - 1e-9;
    ASSERT_EQ(planes[i].area != dvec3(0), outer);
    if (!outer) continue;
    ++surface;
    // A face spans at most a tangent of 2/12 sqrt(2), and a normal may be that far from the vertex's direction.
    EXPECT_GT(glm::dot(glm::normalize(planes[i].area), mesh.points[i]), 0.97);
    sum += planes[i].area;
    total += glm::length(planes[i].area);
    const dvec3 foot = foot_of(planes[i], moments[i]);
    if (foot != dvec3(0)) ++feet;
  }
  EXPECT_GE(feet, surface - 8);             // a vertex at a corner of the cube may own too little
  EXPECT_NEAR(glm::length(sum), 0, 1e-12);  // the surface is closed, and no group loses a face to another
  EXPECT_NEAR(total, area_of(mesh.points, faces), 0.01 * total);
}

TEST(BoundaryPlanes, OfFacesThatAreTooLargeTooSmallOrNotFiniteAreNone) {
  for (const double scale : {0.0, 1e-170, 1e170, std::numeric_limits<double>::infinity(), nan}) {
    const Mesh mesh = lattice(1, [&](dvec3 p) { return scale * p; });
    for (const BoundaryPlane& plane : planes_of(mesh)) {
      EXPECT_EQ(plane.area, dvec3(0)) << scale;
      EXPECT_EQ(plane.offset, 0);
    }
  }
}

TEST(MergedPlanes, AreTheLargestGroupsSum) {
  const dvec3 up(0, 0, 1), right(1, 0, 0), tilted = glm::normalize(dvec3(0.3, 0, 1));
  // `right` has the largest member, `up` the largest sum.
  const std::vector<BoundaryPlane> members = {{2.0 * up, 0}, {3.0 * right, 0}, {}, {1.5 * tilted, 0}, {0.1 * right, 0}};
  const std::vector<dvec3> shifts = {{0, 0, 1}, {5, 0, 0}, {nan, nan, nan}, {0, 0, 2}, {0, 0, 0}};
  const BoundaryPlane merged = merge_planes(members, shifts);
  EXPECT_NEAR(glm::distance(merged.area, 2.0 * up + 1.5 * tilted), 0, 1e-15);
  EXPECT_NEAR(merged.offset, 2 + 1.5 * 2 * tilted.z, 1e-15);
  EXPECT_EQ(merge_planes({}, {}).area, dvec3(0));
  EXPECT_EQ(merge_planes(std::vector<BoundaryPlane>(3), std::vector<dvec3>(3)).area, dvec3(0));
}

// The planes on a flat face merge into the plane of the face: relative to any point, at once or in steps.
TEST(MergedPlanes, OfAFlatFaceStayOnIt) {
  const Mesh mesh = lattice(4, [](dvec3 p) { return dvec3(p.x, p.y, p.z + 0.3 * p.x + 0.5 * p.y); });
  std::vector<BoundaryPlane> planes;
  std::vector<dvec3> shifts;
  const std::vector<BoundaryPlane> all = planes_of(mesh);
  const dvec3 from(0.2, 0.7, 0.1);
  const dvec3 normal = glm::normalize(dvec3(-0.3, -0.5, 1));
  for (std::size_t i = 0; i < all.size(); ++i)
    if (glm::dot(all[i].area, normal) > 0.99 * glm::length(all[i].area) && all[i].area != dvec3(0)) {
      planes.push_back(all[i]);
      shifts.push_back(mesh.points[i] - from);
    }
  ASSERT_GE(planes.size(), 9u);
  const BoundaryPlane whole = merge_planes(planes, shifts);
  const double area = glm::length(whole.area);
  EXPECT_NEAR(glm::distance(whole.area / area, normal), 0, 1e-14);
  EXPECT_NEAR(whole.offset / area, glm::dot(normal, dvec3(0, 0, 1) - from), 1e-14);

  const std::size_t half = planes.size() / 2;
  const dvec3 between(3, -1, 0);
  std::vector<dvec3> first(shifts.begin(), shifts.begin() + static_cast<std::ptrdiff_t>(half));
  for (dvec3& shift : first) shift -= between;
  const std::vector<BoundaryPlane> halves = {
      merge_planes(std::span(planes).first(half), first),
      merge_planes(std::span(planes).subspan(half), std::span(shifts).subspan(half))};
  const BoundaryPlane steps = merge_planes(halves, std::vector<dvec3>{between, dvec3(0)});
  EXPECT_NEAR(glm::distance(steps.area, whole.area), 0, 1e-14);
  EXPECT_NEAR(steps.offset, whole.offset, 1e-14);
}

// If a whole cube is one cluster, its plane is one of the cube's faces, as far from the centroid as a slab's.
TEST(MergedPlanes, OfACubeAreOneFaces) {
  const Mesh mesh = lattice(4);
  const std::vector<BoundaryPlane> planes = planes_of(mesh);
  const std::vector<SpatialMoments> moments = moments_of(mesh);
  std::vector<dvec3> shifts;
  SpatialMoments cluster;
  for (std::size_t i = 0; i < planes.size(); ++i) {
    shifts.push_back(mesh.points[i] - mesh.points[0]);
    merge(cluster, moments[i], shifts.back());
  }
  const BoundaryPlane merged = merge_planes(planes, shifts);
  EXPECT_NEAR(std::max({std::abs(merged.area.x), std::abs(merged.area.y), std::abs(merged.area.z)}),
              glm::length(merged.area), 1e-15);
  EXPECT_NEAR(glm::length(boundary_foot(merged, cluster, shape_of(cluster))), std::sqrt(3.0), 1e-12);
  EXPECT_NEAR(glm::length(foot_of(merged, cluster)), 0.5, 1e-12);
}

}  // namespace
}  // namespace splatvol::test
