#include "builder/points/delaunay_subdomains.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <functional>
#include <iterator>
#include <memory>
#include <numbers>
#include <span>

#include "builder/mesh/boundary.h"
#include "builder/scattered/scattered.h"
#include "builder/sources/generator.h"
#include "tests/builder/support/meshes.h"
#include "tests/builder/support/piece_source.h"
#include "tests/builder/support/point_sets.h"
#include "tests/support/long.h"
#include "tests/support/results.h"

namespace splatvol::test {
namespace {

using Points = std::vector<dvec3>;

constexpr std::size_t memory = std::size_t{1} << 26;

std::string folder() { return std::filesystem::temp_directory_path(); }

PointStream stream_of(Source& source) {
  return value_of(PointStream::create(source, false, memory, folder(), [](double) {}));
}

PointBatch empty_batch() {
  PointBatch batch;
  batch.values.resize(1);
  batch.value_moments.resize(1);
  batch.gradients.resize(1);
  return batch;
}

using Ranks = std::array<std::uint64_t, 4>;

// All points at once, in one triangulation.
PointBatch whole(Source& source, std::vector<Tetrahedron>* all_tetrahedra = nullptr) {
  PointStream stream = stream_of(source);
  PointBatch all = empty_batch();
  while (*stream.next(all)) {
  }
  const auto tetrahedra = value_of(delaunay_tetrahedra(all.positions));
  MeshMaterial material = material_of({all.positions, tetrahedra}, all.values[0]);
  all.moments = std::move(material.moments);
  all.value_moments[0] = std::move(material.value_moments);
  all.gradients[0] = std::move(material.gradients);
  all.planes = boundary_planes(all.positions, find_outer_faces(all.positions, tetrahedra));
  if (all_tetrahedra) *all_tetrahedra = tetrahedra;
  return all;
}

struct InSubdomains {
  PointBatch points;
  std::uint64_t uncertain, disputed;
  std::vector<RankedTetrahedron> tetrahedra;  // by their corners
};

InSubdomains in_subdomains(Source& source, std::size_t subdomain_points, std::uint64_t bytes = memory,
                           std::size_t most_points = DelaunaySubdomains::default_most_points) {
  PointStream stream = stream_of(source);
  std::vector<RankedTetrahedron> tetrahedra;
  const auto take = [&](std::span<const RankedTetrahedron> some) -> Status {
    tetrahedra.insert(tetrahedra.end(), some.begin(), some.end());
    return {};
  };
  auto subdomains = value_of(DelaunaySubdomains::create(stream, bytes, folder(), subdomain_points, most_points, take));
  PointBatch all = empty_batch();
  while (value_of(subdomains.next(all))) {
  }
  std::ranges::sort(tetrahedra, {}, &RankedTetrahedron::corners);
  return {std::move(all), subdomains.uncertain(), subdomains.disputed(), std::move(tetrahedra)};
}

std::vector<Ranks> ranks_of(std::span<const RankedTetrahedron> tetrahedra) {
  std::vector<Ranks> ranks;
  for (const RankedTetrahedron& tetrahedron : tetrahedra) ranks.push_back(tetrahedron.corners);
  return ranks;
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
  std::vector<Tetrahedron> tetrahedra;
  const PointBatch all = whole(*make(), &tetrahedra);
  const InSubdomains parts = in_subdomains(*make(), subdomain_points);
  expect_same(all, parts.points);
  EXPECT_EQ(parts.uncertain, 0u);
  EXPECT_EQ(parts.disputed, 0u);
  std::vector<RankedTetrahedron> expected;
  const std::vector<dvec3>& p = all.positions;
  for (const auto& [a, b, c, d] : tetrahedra)
    expected.push_back({{a, b, c, d}, sign_of_volume(p[a], p[b], p[c], p[d])});
  EXPECT_TRUE(parts.tetrahedra == expected) << parts.tetrahedra.size() << " for " << expected.size();
}

Make points(Points points) {
  return [points = std::move(points)] { return std::make_unique<PieceSource>(std::vector{scattered(points)}); };
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

TEST(DelaunaySubdomains, FindTheTetrahedraOfTheWhole) {
  for (const Distribution distribution :
       {Distribution::uniform, Distribution::vortex, Distribution::half_tiny, Distribution::two_clusters,
        Distribution::layer, Distribution::line, Distribution::equal}) {
    SCOPED_TRACE(distribution_names()[static_cast<std::size_t>(distribution)]);
    expect_whole(generated(distribution), 1500);
  }
}

TEST(DelaunaySubdomains, FindThoseOfBoundaryLayersWhateverTheirDirection) {
  for (const double angle : sample_of<double>({0.5, 0})) expect_whole(points(boundary_layer(1e-3, angle)), 2000);
}

TEST(DelaunaySubdomains, FindThoseOfLatticesThoughAllIsCospherical) {
  expect_whole(points(lattice_points({20, 20, 20})), 1000);
  expect_whole(points(lattice_points({20, 20, 20}, {1, 0.5, 1e-3})), 1000);
}

// At first each subdomain lies on one of two planes, and no plane spans a volume.
TEST(DelaunaySubdomains, FindThoseBetweenTwoSheetsFarApart) {
  expect_whole(points(lattice_points({60, 60, 2}, {1, 1, 20})), 600);
}

TEST(DelaunaySubdomains, LeaveHolesAsEmptyAsTheWholeDoes) {
  Points shell;
  for (const dvec3& p : random_points(40'000, 2, dvec3(-1)))
    if (glm::length(p) < 1 && glm::length(p) > 0.7) shell.push_back(p);
  expect_whole(points(shell), 1500);
  // Random points end somewhere near the border: on both sides, a layer of about half a spacing, 0.03, is uncertain.
  const double volume = 4.0 / 3 * std::numbers::pi * (1 - 0.7 * 0.7 * 0.7);
  EXPECT_NEAR(total_mass(in_subdomains(*points(shell)(), 1500).points.moments) / volume, 1, 0.15);
}

TEST(DelaunaySubdomains, GiveCoincidentPointsVolumeOnceThoughTheyFillSubdomains) {
  Points many = random_points(3000);
  many.insert(many.end(), 5000, dvec3(0.5));
  const auto copies = random_points(1000);
  many.insert(many.end(), copies.begin(), copies.end());
  expect_whole(points(many), 700);
}

TEST(DelaunaySubdomains, LeaveMissingValuesMissing) {
  Piece piece = scattered(random_points(6000));
  for (std::size_t i = 0; i < piece.values[0].size(); i += 7) piece.values[0][i] = std::nan("");
  expect_whole([&] { return std::make_unique<PieceSource>(std::vector{piece}); }, 1000);
}

TEST(DelaunaySubdomains, FindNothingWhereNoFourPointsSpanAVolume) {
  for (const auto& flat : {lattice_points({80, 80, 1}), Points{dvec3(3)}, lattice_points({3, 1, 1})}) {
    expect_whole(points(flat), 1000);
    EXPECT_EQ(total_mass(in_subdomains(*points(flat)(), 1000).points.moments), 0);
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
    EXPECT_NEAR(total_mass(in_subdomains(*generated(Distribution::vortex)(), subdomain_points).points.moments) / volume,
                1, 1e-11);
}

TEST(DelaunaySubdomains, DoNotDependOnMemory) {
  const auto one = in_subdomains(*generated(Distribution::uniform)(), 1000, 0);
  const auto many = in_subdomains(*generated(Distribution::uniform)(), 1000, std::uint64_t{1} << 40);
  expect_same(one.points, many.points);
  EXPECT_EQ(ranks_of(one.tetrahedra), ranks_of(many.tetrahedra));
}

// A subdomain on a line looks for a point beside the line among all other points.
TEST(DelaunaySubdomains, SayWhereTheirHaloWouldBecomeTooLarge) {
  const auto line = generated(Distribution::line, 40'000);
  const InSubdomains uncertain = in_subdomains(*line(), 1 << 13, memory, 1 << 15);
  EXPECT_GT(uncertain.uncertain, 0u);
  EXPECT_EQ(in_subdomains(*line(), 1 << 13, memory, 1 << 17).uncertain, 0u);
}

// With hardly any halo, tetrahedra at the subdomains' borders are others on both sides.
TEST(DelaunaySubdomains, TakeNoTetrahedronTwiceAndCountThoseInDoubt) {
  const auto make = generated(Distribution::vortex, 20'000);
  const InSubdomains all = in_subdomains(*make(), 1 << 11);
  const InSubdomains parts = in_subdomains(*make(), 1 << 11, memory, 1 << 12);
  ASSERT_GT(parts.uncertain, 0u);
  EXPECT_GT(parts.disputed, 0u);
  std::vector<Ranks> ranks = ranks_of(parts.tetrahedra);
  EXPECT_EQ(std::ranges::adjacent_find(ranks), ranks.end());
  const std::vector<Ranks> right = ranks_of(all.tetrahedra);
  std::vector<Ranks> wrong;
  std::ranges::set_symmetric_difference(ranks, right, std::back_inserter(wrong));
  EXPECT_GT(wrong.size(), 0u);
  EXPECT_LT(wrong.size(), right.size() / 2);
  // It does not depend on how many subdomains are triangulated at the same time.
  const InSubdomains one = in_subdomains(*make(), 1 << 11, 0, 1 << 12);
  EXPECT_EQ(ranks_of(one.tetrahedra), ranks);
  EXPECT_EQ(one.disputed, parts.disputed);
}

// Subdomains of ten points each.
struct Shared {
  std::vector<Ranks> taken;
  std::uint64_t disputed;
};

struct Found {
  bool is_certain;
  std::vector<Ranks> tetrahedra;
};

Shared share(const std::vector<Found>& subdomains) {
  std::vector<std::uint64_t> begins;
  for (std::size_t i = 0; i <= subdomains.size(); ++i) begins.push_back(10 * i);
  Shared result;
  const auto take = [&](std::span<const RankedTetrahedron> some) -> Status {
    for (const RankedTetrahedron& tetrahedron : some) result.taken.push_back(tetrahedron.corners);
    return {};
  };
  const auto shared = value_of(SharedTetrahedra::create(begins, folder(), take));
  for (const Found& subdomain : subdomains) {
    FoundTetrahedra found{.is_certain = subdomain.is_certain};
    for (const Ranks& ranks : subdomain.tetrahedra) {
      Tetrahedron& corners = found.corners.emplace_back();
      for (std::size_t k = 0; k < 4; ++k) {
        corners[k] = static_cast<std::uint32_t>(found.ranks.size());
        found.ranks.push_back(ranks[k]);
      }
      found.signs.push_back(1);
    }
    EXPECT_TRUE(shared->add(found).has_value());
  }
  EXPECT_TRUE(shared->finish().has_value());
  result.disputed = shared->disputed();
  std::ranges::sort(result.taken);
  return result;
}

TEST(SharedTetrahedra, AreTakenOnceFromTheFirstThatIsCertain) {
  const Ranks own{1, 2, 3, 4}, two{2, 3, 4, 15}, three{5, 12, 13, 24};
  const std::vector<Ranks> all{own, two, three};
  const auto everyone = [&](bool first, bool second, bool third) {
    const Shared shared = share({{first, all}, {second, {two, three}}, {third, {three}}});
    EXPECT_EQ(shared.taken, all) << first << second << third;
    EXPECT_EQ(shared.disputed, 0u) << first << second << third;
  };
  for (int certain = 0; certain < 8; ++certain) everyone((certain & 1) != 0, (certain & 2) != 0, (certain & 4) != 0);
}

TEST(SharedTetrahedra, OfSubdomainsThatDisagreeAreThoseOfTheFirstThatIsCertain) {
  const Ranks a{2, 3, 4, 15}, b{2, 3, 4, 16};
  using testing::ElementsAre;
  const auto both = [&](bool first, bool second) { return share({{first, {a}}, {second, {b}}}); };
  EXPECT_THAT(both(true, false).taken, ElementsAre(a));
  EXPECT_THAT(both(false, true).taken, ElementsAre(b));
  EXPECT_THAT(both(false, false).taken, ElementsAre(a));
  for (const auto& [first, second] : {std::pair(true, false), {false, true}, {false, false}})
    EXPECT_EQ(both(first, second).disputed, 2u);
}

TEST(SharedTetrahedra, CountTheLostOnce) {
  const Ranks three{5, 12, 13, 24};
  const Shared lost = share({{false, {}}, {false, {three}}, {false, {three}}});
  EXPECT_TRUE(lost.taken.empty());
  EXPECT_EQ(lost.disputed, 1u);
  const Shared kept = share({{false, {}}, {false, {three}}, {true, {three}}});
  EXPECT_THAT(kept.taken, testing::ElementsAre(three));
  EXPECT_EQ(kept.disputed, 1u);
}

}  // namespace
}  // namespace splatvol::test
