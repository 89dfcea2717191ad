#include "builder/points/delaunay_subdomains.h"

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <functional>
#include <memory>
#include <numbers>

#include "builder/mesh/boundary.h"
#include "builder/scattered/scattered.h"
#include "builder/sources/generator.h"
#include "tests/builder/support/piece_source.h"
#include "tests/support/results.h"

namespace splatvol {
namespace {

using Points = std::vector<dvec3>;

constexpr std::size_t memory = std::size_t{1} << 26;

std::string folder() { return std::filesystem::temp_directory_path(); }

PointStream stream_of(Source& source) {
  return test::value_of(PointStream::create(source, false, memory, folder(), [](double) {}));
}

PointBatch empty_batch() {
  PointBatch batch;
  batch.values.resize(1);
  batch.value_moments.resize(1);
  batch.gradients.resize(1);
  return batch;
}

// All points at once, in one triangulation.
PointBatch whole(Source& source) {
  PointStream stream = stream_of(source);
  PointBatch all = empty_batch();
  while (*stream.next(all)) {
  }
  const auto tetrahedra = test::value_of(delaunay_tetrahedra(all.positions));
  const VertexMaterial mesh(all.positions, tetrahedra);
  for (std::size_t i = 0; i < all.size(); ++i) {
    all.moments.push_back(mesh.moments(i));
    all.value_moments[0].push_back(mesh.value_moments(i, all.values[0]));
    all.gradients[0].push_back(mesh.gradient(i, all.values[0]));
  }
  all.planes = boundary_planes(all.positions, find_outer_faces(all.positions, tetrahedra));
  return all;
}

struct InSubdomains {
  PointBatch points;
  std::uint64_t uncertain;
};

InSubdomains in_subdomains(Source& source, std::size_t subdomain_points, std::uint64_t bytes = memory,
                           std::size_t most_points = DelaunaySubdomains::default_most_points) {
  PointStream stream = stream_of(source);
  auto subdomains = test::value_of(DelaunaySubdomains::create(stream, bytes, folder(), subdomain_points, most_points));
  PointBatch all = empty_batch();
  while (test::value_of(subdomains.next(all))) {
  }
  return {std::move(all), subdomains.uncertain()};
}

double total_mass(const PointBatch& points) {
  double sum = 0;
  for (const SpatialMoments& moments : points.moments) sum += moments.mass;
  return sum;
}

bool operator==(const SymmetricMatrix& a, const SymmetricMatrix& b) {
  return a.xx == b.xx && a.yy == b.yy && a.zz == b.zz && a.xy == b.xy && a.xz == b.xz && a.yz == b.yz;
}

bool same_material(const PointBatch& a, const PointBatch& b, std::size_t i) {
  const SpatialMoments &m = a.moments[i], &n = b.moments[i];
  const ValueMoments &v = a.value_moments[0][i], &w = b.value_moments[0][i];
  return m.mass == n.mass && m.centroid == n.centroid && m.covariance == n.covariance && v.mass == w.mass &&
         v.centroid == w.centroid && v.mean == w.mean && v.variance == w.variance && v.covariance == w.covariance &&
         v.min == w.min && v.max == w.max && a.gradients[0][i] == b.gradients[0][i] &&
         a.planes[i].area == b.planes[i].area && a.planes[i].offset == b.planes[i].offset;
}

// Sums have the same terms in the same order, so that they are equal to the last bit.
void expect_same(const PointBatch& a, const PointBatch& b) {
  ASSERT_EQ(a.positions, b.positions);
  EXPECT_EQ(a.keys, b.keys);
  ASSERT_EQ(a.moments.size(), b.moments.size());
  std::size_t others = 0;
  for (std::size_t i = 0; i < a.size(); ++i) others += same_material(a, b, i) ? 0 : 1;
  EXPECT_EQ(others, 0u);
}

using Make = std::function<std::unique_ptr<Source>()>;

void expect_whole(const Make& make, std::size_t subdomain_points) {
  const PointBatch all = whole(*make());
  const InSubdomains parts = in_subdomains(*make(), subdomain_points);
  expect_same(all, parts.points);
  EXPECT_EQ(parts.uncertain, 0u);
}

Make points(Points points) {
  return [points = std::move(points)] {
    return std::make_unique<test::PieceSource>(std::vector{test::scattered(points)});
  };
}

Make generated(Distribution distribution, std::uint64_t count = 10'000) {
  return [=] { return generate_points({count, distribution, 1, false}); };
}

// Wavy rows over a wall, in layers that grow from `first` on, turned about the y axis.
Points boundary_layer(double first, double angle) {
  Points result;
  for (int layer = 0; layer < 20; ++layer)
    for (int i = 0; i < 24; ++i)
      for (int j = 0; j < 24; ++j) {
        const double z = layer == 0 ? 0 : first * std::pow(2 / first, (layer - 1) / 18.0);
        const dvec3 p(i + 0.3 * std::sin(7.0 * j), j + 0.3 * std::sin(5.0 * i), z);
        result.emplace_back(std::cos(angle) * p.x - std::sin(angle) * p.z, p.y,
                            std::sin(angle) * p.x + std::cos(angle) * p.z);
      }
  return result;
}

Points lattice(int nx, int ny, int nz, const dvec3& spacing) {
  Points result;
  for (int i = 0; i < nx; ++i)
    for (int j = 0; j < ny; ++j)
      for (int k = 0; k < nz; ++k) result.push_back(spacing * dvec3(i, j, k));
  return result;
}

TEST(DelaunaySubdomains, FindTheTetrahedraOfTheWhole) {
  for (const Distribution distribution :
       {Distribution::uniform, Distribution::vortex, Distribution::half_tiny, Distribution::two_clusters,
        Distribution::layer, Distribution::line, Distribution::equal}) {
    SCOPED_TRACE(distribution_names()[static_cast<std::size_t>(distribution)]);
    expect_whole(generated(distribution), 1500);
  }
}

TEST(DelaunaySubdomains, FindThoseOfBoundaryLayersWhateverTheirDirection) {
  for (const double angle : {0.0, 0.5}) expect_whole(points(boundary_layer(1e-3, angle)), 2000);
}

TEST(DelaunaySubdomains, FindThoseOfLatticesThoughAllIsCospherical) {
  expect_whole(points(lattice(20, 20, 20, {1, 1, 1})), 1000);
  expect_whole(points(lattice(20, 20, 20, {1, 0.5, 1e-3})), 1000);
}

// At first each subdomain lies on one of two planes, and no plane spans a volume.
TEST(DelaunaySubdomains, FindThoseBetweenTwoSheetsFarApart) {
  expect_whole(points(lattice(60, 60, 2, {1, 1, 20})), 600);
}

TEST(DelaunaySubdomains, LeaveHolesAsEmptyAsTheWholeDoes) {
  Points shell;
  for (const dvec3& p : test::random_points(40'000, 2, dvec3(-1)))
    if (glm::length(p) < 1 && glm::length(p) > 0.7) shell.push_back(p);
  expect_whole(points(shell), 1500);
  // Random points end somewhere near the border: on both sides, a layer of about half a spacing, 0.03, is uncertain.
  const double volume = 4.0 / 3 * std::numbers::pi * (1 - 0.7 * 0.7 * 0.7);
  EXPECT_NEAR(total_mass(in_subdomains(*points(shell)(), 1500).points) / volume, 1, 0.15);
}

TEST(DelaunaySubdomains, GiveCoincidentPointsVolumeOnceThoughTheyFillSubdomains) {
  Points many = test::random_points(3000);
  many.insert(many.end(), 5000, dvec3(0.5));
  const auto copies = test::random_points(1000);
  many.insert(many.end(), copies.begin(), copies.end());
  expect_whole(points(many), 700);
}

TEST(DelaunaySubdomains, LeaveMissingValuesMissing) {
  Piece piece = test::scattered(test::random_points(6000));
  for (std::size_t i = 0; i < piece.values[0].size(); i += 7) piece.values[0][i] = std::nan("");
  expect_whole([&] { return std::make_unique<test::PieceSource>(std::vector{piece}); }, 1000);
}

TEST(DelaunaySubdomains, FindNothingWhereNoFourPointsSpanAVolume) {
  for (const auto& flat : {lattice(80, 80, 1, {1, 1, 1}), Points{dvec3(3)}, lattice(3, 1, 1, {1, 1, 1})}) {
    expect_whole(points(flat), 1000);
    EXPECT_EQ(total_mass(in_subdomains(*points(flat)(), 1000).points), 0);
  }
}

TEST(DelaunaySubdomains, HoldTheVolumeOfTheTetrahedraWhateverTheirSize) {
  const PointBatch all = whole(*generated(Distribution::vortex)());
  double volume = 0;
  const auto tetrahedra = delaunay_tetrahedra(all.positions);
  for (const auto& [a, b, c, d] : *tetrahedra)
    volume += std::abs(glm::dot(all.positions[b] - all.positions[a],
                                glm::cross(all.positions[c] - all.positions[a], all.positions[d] - all.positions[a]))) /
              6;
  // Sums of 1e5 terms, all positive.
  for (const std::size_t subdomain_points : {300, 3000, 100'000})
    EXPECT_NEAR(total_mass(in_subdomains(*generated(Distribution::vortex)(), subdomain_points).points) / volume, 1,
                1e-11);
}

TEST(DelaunaySubdomains, DoNotDependOnMemory) {
  const auto one = in_subdomains(*generated(Distribution::uniform)(), 1000, 0);
  const auto many = in_subdomains(*generated(Distribution::uniform)(), 1000, std::uint64_t{1} << 40);
  expect_same(one.points, many.points);
}

// A subdomain on a line looks for a point beside the line among all other points.
TEST(DelaunaySubdomains, SayWhereTheirHaloWouldBecomeTooLarge) {
  const auto line = generated(Distribution::line, 40'000);
  EXPECT_GT(in_subdomains(*line(), 1 << 13, memory, 1 << 15).uncertain, 0u);
  EXPECT_EQ(in_subdomains(*line(), 1 << 13, memory, 1 << 17).uncertain, 0u);
}

}  // namespace
}  // namespace splatvol
