// Generated inputs: independent of threads, with the positions and values that they promise.
#include "builder/sources/generator.h"
#include "builder/opening/open_source.h"

#include <gmock/gmock.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <random>
#include <set>
#include <tuple>

#include "builder/mesh/tetrahedra.h"
#include "tests/builder/sources/tetrahedron_faces.h"

namespace splatvol::test {
namespace {

using namespace ::testing;

struct Points {
  std::vector<dvec3> positions;
  std::vector<double> values;
};

/// Reads all points of a source, and checks its promises about them.
Points read(Source& source) {
  const auto bounds = source.bounds().value();
  Points all;
  std::size_t pieces = 0;
  while (auto piece = source.next().value()) {
    all.positions.insert(all.positions.end(), piece->points.begin(), piece->points.end());
    all.values.insert(all.values.end(), piece->values[0].begin(), piece->values[0].end());
    EXPECT_LE(piece->points.size(), max_piece_points);
    ++pieces;
  }
  EXPECT_EQ(source.piece_count(), pieces);
  EXPECT_EQ(source.point_count(), all.positions.size());
  dvec3 low = all.positions.front(), high = low;
  for (const dvec3& p : all.positions) {
    low = glm::min(low, p);
    high = glm::max(high, p);
  }
  EXPECT_EQ(bounds->low, low);
  EXPECT_EQ(bounds->high, high);
  return all;
}

Points generate(Distribution distribution, std::uint64_t count, bool single_precision = false, std::uint64_t seed = 1) {
  const auto source = generate_points({count, distribution, seed, single_precision});
  EXPECT_EQ(source->single_precision(), single_precision);
  return read(*source);
}

/// The share of positions that pass a test.
double share(const std::vector<dvec3>& positions, const std::function<bool(const dvec3&)>& test) {
  return static_cast<double>(std::ranges::count_if(positions, test)) / static_cast<double>(positions.size());
}

TEST(GeneratedField, IsWhatItsFormulaSays) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> unit(-1, 1);
  for (int i = 0; i < 1000; ++i) {
    const dvec3 p(2 * unit(random), 2 * unit(random), unit(random));
    const double angle = 1.5 * std::atan2(p.y, p.x), s = std::hypot(p.x, p.y) - 1.2;
    const double c = 0.5 * std::cos(angle), d = 0.5 * std::sin(angle);
    const double expected = std::exp(-100 * (std::pow(s - c, 2) + std::pow(p.z - d, 2))) +
                            std::exp(-100 * (std::pow(s + c, 2) + std::pow(p.z + d, 2))) +
                            0.1 * p.x / std::sqrt(4 + glm::dot(p, p));
    EXPECT_NEAR(generated_field(p), expected, 1e-13);
  }
}

TEST(GeneratedField, IsSmoothWhereTheAngleJumps) {
  // Across the half plane y = 0, x < 0 and on the axis; the steepest slope is 2 / (e^(1/2) w sqrt(2)) < 9.
  for (const double x : {-1.7, -1.21, -0.7, 0.0})
    for (const double z : {-0.5, -0.1, 0.0, 0.3})
      for (const double h : {1e-3, 1e-8, 1e-300}) {
        const double above = generated_field({x, h, z}), below = generated_field({x, -h, z});
        EXPECT_NEAR(above, below, 18 * h + 1e-15) << x << " " << z;
      }
  EXPECT_NEAR(generated_field({1.7, 0, 0}), 1 + 0.17 / std::sqrt(4 + 1.7 * 1.7), 1e-12);
  EXPECT_NEAR(generated_field({4e9, 1, 1}), 0.1, 1e-12);
}

TEST(GeneratedPoints, DependOnTheSeedAndTheirNumberOnly) {
  const std::uint64_t count = max_piece_points + 5000;
  for (int d = 0; d < 7; ++d) {
    const auto distribution = static_cast<Distribution>(d);
    const Points all = generate(distribution, count);
    {
      const tbb::global_control one(tbb::global_control::max_allowed_parallelism, 1);
      EXPECT_TRUE(generate(distribution, count).positions == all.positions) << d;
    }
    Points few = generate(distribution, 3000);
    EXPECT_TRUE(std::equal(few.values.begin(), few.values.end(), all.values.begin())) << d;
    for (std::size_t i = 0; i < count; i += 97) ASSERT_EQ(all.values[i], generated_field(all.positions[i])) << d;
    if (distribution == Distribution::equal) continue;
    EXPECT_FALSE(generate(distribution, 3000, false, 2).positions == few.positions) << d;
  }
}

TEST(GeneratedPoints, SinglePrecisionHoldsThemExactly) {
  const Points all = generate(Distribution::vortex, 10000, true);
  const auto fits = [](double value) { return static_cast<double>(static_cast<float>(value)) == value; };
  EXPECT_TRUE(std::ranges::all_of(all.values, fits));
  EXPECT_EQ(share(all.positions, [&](const dvec3& p) { return fits(p.x) && fits(p.y) && fits(p.z); }), 1);
  for (std::size_t i = 0; i < all.values.size(); ++i)
    ASSERT_EQ(all.values[i], static_cast<double>(static_cast<float>(generated_field(all.positions[i]))));
}

// Shares of 100,000 points deviate by up to 1.6e-3. Bounds are 4 times as large.
constexpr std::uint64_t many = 100000;
constexpr double deviation = 6.4e-3;

TEST(GeneratedPoints, UniformFillsTheBox) {
  const Points all = generate(Distribution::uniform, many);
  for (int axis = 0; axis < 3; ++axis)
    for (const double part : {0.1, 0.25, 0.5, 0.9}) {
      const double border = axis == 2 ? -1 + 2 * part : -2 + 4 * part;
      EXPECT_NEAR(share(all.positions, [&](const dvec3& p) { return p[axis] < border; }), part, deviation);
    }
  EXPECT_NEAR(share(all.positions, [](const dvec3& p) { return p.x * p.y * p.z > 0; }), 0.5, deviation);
  EXPECT_EQ(std::set<double>(all.values.begin(), all.values.end()).size(), many) << "none twice";
}

TEST(GeneratedPoints, VortexIsFineRoundTheStrands) {
  const Points all = generate(Distribution::vortex, many);
  EXPECT_EQ(share(all.positions,
                  [](const dvec3& p) { return std::abs(p.x) <= 2 && std::abs(p.y) <= 2 && std::abs(p.z) <= 1; }),
            1);
  // Within d of a strand lie 7/8 d^2 / (d^2 + 0.05^2) (0.3^2 + 0.05^2) / 0.3^2 of all points, and the uniform points
  // there: 1/8 of the share that a tube of length 2 pi 1.2 * 2 has of a box of 32.
  for (const double d : {0.02, 0.05, 0.1, 0.2}) {
    const double near = 0.875 * d * d / (d * d + 0.0025) * (0.0925 / 0.09);
    const double there = 0.125 * std::acos(-1) * d * d * 4 * std::acos(-1) * 1.2 / 32;
    const double measured = share(all.positions, [&](const dvec3& p) {
      const double angle = 1.5 * std::atan2(p.y, p.x);
      const dvec2 c(0.5 * std::cos(angle), 0.5 * std::sin(angle)), q(std::hypot(p.x, p.y) - 1.2, p.z);
      return std::min(glm::distance(q, c), glm::distance(q, -c)) < d;
    });
    EXPECT_NEAR(measured, near + there, deviation) << d;
  }
  // Both strands have as many points, all the way round.
  EXPECT_NEAR(share(all.positions, [](const dvec3& p) { return p.z > 0; }), 0.5, deviation);
  EXPECT_NEAR(share(all.positions, [](const dvec3& p) { return p.x > 0; }), 0.5, deviation);
}

TEST(GeneratedPoints, HardOnesAreHard) {
  const Points tiny = generate(Distribution::half_tiny, many);
  EXPECT_NEAR(share(tiny.positions,
                    [](const dvec3& p) {
                      const dvec3 d = glm::abs(p - dvec3(1.7, 0, 0));
                      return d.x <= 0.002 && d.y <= 0.002 && d.z <= 0.001;
                    }),
              0.5, deviation);

  const Points equal = generate(Distribution::equal, 1000);
  EXPECT_EQ(share(equal.positions, [&](const dvec3& p) { return p == equal.positions[0]; }), 1);

  const Points clusters = generate(Distribution::two_clusters, many);
  EXPECT_NEAR(share(clusters.positions, [](const dvec3& p) { return p.x < 3; }), 0.5, deviation);
  EXPECT_NEAR(share(clusters.positions, [](const dvec3& p) { return p.x > 4e9 - 3 && p.x < 4e9 + 3; }), 0.5, deviation);

  for (const bool single : {false, true}) {
    const Points line = generate(Distribution::line, many, single);
    EXPECT_EQ(share(line.positions, [](const dvec3& p) { return p.x == 2 * p.y && p.y == 2 * p.z; }), 1);
  }

  const Points layer = generate(Distribution::layer, many);
  for (const int decade : {-7, -4, -1})
    EXPECT_NEAR(share(layer.positions, [&](const dvec3& p) { return p.z < std::pow(10, decade); }), 1 + decade / 8.0,
                deviation);
  EXPECT_EQ(share(layer.positions, [](const dvec3& p) { return p.z > 0.99e-8 && p.z <= 1; }), 1);
}

TEST(GeneratedPoints, HalfOfThoseWithClustersLieInClusters) {
  const Points points = generate(Distribution::clusters, many, false, 5);
  // Uniform points have 1e-3 of theirs in a cell of this grid; a fifth of the clusters has nine tenths in one.
  std::map<std::array<int, 3>, double> shares;
  std::size_t outside = 0;
  for (const dvec3& p : points.positions) {
    const bool inside = glm::all(glm::greaterThanEqual(p, dvec3(0))) && glm::all(glm::lessThan(p, dvec3(1)));
    outside += inside ? 0 : 1;
    const dvec3 cell = glm::floor(p * 100.0);
    shares[{static_cast<int>(cell.x), static_cast<int>(cell.y), static_cast<int>(cell.z)}] +=
        1 / static_cast<double>(points.positions.size());
  }
  EXPECT_GT(outside, 0u);
  EXPECT_LT(static_cast<double>(outside), 0.1 * static_cast<double>(points.positions.size()));
  // A cluster has 1/400 of all points. The smallest fill one cell or a few.
  double in_dense = 0;
  int dense = 0;
  for (const auto& [cell, part] : shares)
    if (part > 0.0003) in_dense += part, ++dense;
  EXPECT_GT(dense, 30);
  EXPECT_GT(in_dense, 0.05);
  EXPECT_LT(in_dense, 0.5 + deviation);
  // As many points are left in the first half of the numbers as in the second: clusters do not depend on the count.
  const Points few = generate(Distribution::clusters, 1000, false, 5);
  for (std::size_t i = 0; i < few.positions.size(); ++i) ASSERT_EQ(few.positions[i], points.positions[i]);
}

struct Less {
  bool operator()(const dvec3& a, const dvec3& b) const { return std::tie(a.x, a.y, a.z) < std::tie(b.x, b.y, b.z); }
};

/// Counts of a mesh's pieces.
struct MeshCounts {
  std::size_t pieces = 0, points = 0, tetrahedra = 0;
  double volume = 0;
  std::map<dvec3, double, Less> values;               // at each position
  std::map<dvec3, std::uint64_t, Less> numbers;       // of the positions
  std::map<std::array<std::uint64_t, 3>, int> faces;  // by the numbers of their corners

  void add(const Piece& piece) {
    ++pieces;
    points += piece.points.size();
    tetrahedra += piece.tetrahedra.size();
    EXPECT_EQ(piece.census.cells.at("tetrahedron"), piece.tetrahedra.size());
    EXPECT_EQ(piece.census.tetrahedra, piece.tetrahedra.size());
    for (std::size_t i = 0; i < piece.points.size(); ++i) {
      const dvec3& p = piece.points[i];
      numbers.emplace(p, numbers.size());
      EXPECT_EQ(values.emplace(p, piece.values[0][i]).first->second, piece.values[0][i]);
      EXPECT_EQ(piece.values[0][i], static_cast<double>(static_cast<float>(generated_field(p))));
    }
    for (const auto& tetrahedron : piece.tetrahedra) {
      std::array<dvec3, 4> p;
      std::ranges::transform(tetrahedron, p.begin(), [&](std::uint32_t i) { return piece.points.at(i); });
      const double part = signed_volume_6(p[0], p[1], p[2], p[3]) / 6;
      ASSERT_GT(part, 0);
      volume += part;
      std::array<std::uint64_t, 4> corners{};
      std::ranges::transform(p, corners.begin(), [&](const dvec3& corner) { return numbers.at(corner); });
      for (const auto& face : faces_of(corners)) ++faces[face];
    }
  }
};

TEST(GeneratedMesh, PiecesFitTogetherAndFillTheBox) {
  for (const std::uint64_t pieces : {1, 2, 12, 7}) {
    auto source = generate_mesh({6 * 512, pieces}).value();
    MeshCounts counts;
    while (auto piece = source->next().value()) counts.add(*piece);
    EXPECT_EQ(counts.pieces, pieces);
    EXPECT_EQ(source->piece_count(), pieces);
    EXPECT_EQ(source->point_count(), counts.points);
    EXPECT_EQ(counts.values.size(), 9u * 9 * 9) << "common points are the same to the last bit";
    EXPECT_EQ(counts.tetrahedra, 6u * 512);
    EXPECT_NEAR(counts.volume, 32, 1e-12);
    EXPECT_EQ(std::ranges::count_if(counts.faces, [](const auto& face) { return face.second == 1; }), 6 * 2 * 64);
    EXPECT_TRUE(std::ranges::all_of(counts.faces, [](const auto& face) { return face.second <= 2; }));
    const Box box = *source->bounds().value();
    EXPECT_EQ(box.low, dvec3(-2, -2, -1));
    EXPECT_EQ(box.high, dvec3(2, 2, 1));
  }
}

TEST(GeneratedMesh, DividesItselfIntoPiecesThatCanBeHeld) {
  auto source = generate_mesh({4'000'000, 0}).value();
  EXPECT_EQ(source->piece_count(), 8u);
  EXPECT_EQ(read(*source).positions.size(), 89u * 89 * 89) << "87^3 hexahedra, cut once along each axis";
}

Result<std::unique_ptr<Source>> open_text(const std::string& text, const SourceOptions& options = {}) {
  return open_source({text}, options);
}

TEST(Generated, TextsAreRead) {
  auto source = open_text("gen:points:seed=5,count=1e3,type=float32,distribution=half-tiny").value();
  EXPECT_EQ(read(*source).positions, generate(Distribution::half_tiny, 1000, true, 5).positions);
  source = open_text("gen:points:count=10", {{"value"}, {}}).value();
  EXPECT_EQ(read(*source).positions, generate(Distribution::uniform, 10).positions);
  EXPECT_EQ(open_text("gen:mesh:cells=600,pieces=4").value()->piece_count(), 4u);
  EXPECT_EQ(open_text("gen:mesh:cells=1").value()->point_count(), 8u);
}

TEST(Generated, TextsAreReadStrictly) {
  const auto error_of = [](const std::string& text, const SourceOptions& options = {}) {
    const auto source = open_text(text, options);
    return source ? "(no error)" : source.error().message;
  };
  for (const auto& [text, reason] : std::vector<std::pair<std::string, std::string>>{
           {"gen:", "neither gen:points:... nor gen:mesh:..."},
           {"gen:point:count=1", "neither"},
           {"gen:points:", "'' is not one of the settings count=..., distribution=..., seed=..., type=..."},
           {"gen:points:seed=1", "'' is not a whole number"},
           {"gen:points:count=1,", "'' is not one of the settings"},
           {"gen:points:count", "'count' is not one of the settings"},
           {"gen:points:count=1,count=2", "count is set twice"},
           {"gen:points:count=0", "'0' is not a whole number"},
           {"gen:points:count=-5", "not a whole number"},
           {"gen:points:count=1.5", "not a whole number"},
           {"gen:points:count=1e13", "not a whole number"},
           {"gen:points:count=nan", "not a whole number"},
           {"gen:points:count=10 ", "not a whole number"},
           {"gen:points:count=1,seed=-1", "not a seed"},
           {"gen:points:count=1,seed=18446744073709551616", "not a seed"},
           {"gen:points:count=1,distribution=round", "uniform, vortex, half-tiny"},
           {"gen:points:count=1,type=float", "neither float32 nor float64"},
           {"gen:points:count=1,cells=1", "'cells=1' is not one of the settings"},
           {"gen:mesh:pieces=1", "'' is not a whole number"},
           {"gen:mesh:cells=48,pieces=3", "3 pieces of 2^3 hexahedra: too few for 3 x 1 x 1 parts"},
           {"gen:mesh:cells=1e12,pieces=1", "too large"},
           {"gen:mesh:cells=1e12,pieces=1e7", "at most 1000000"}})
    EXPECT_THAT(error_of(text), AllOf(StartsWith(text), HasSubstr(reason)));
  EXPECT_THAT(error_of("gen:points:count=1", {{"heat"}, {}}), HasSubstr("no attribute \"heat\"; there are: value"));
  EXPECT_THAT(error_of("gen:points:count=1", {{}, {"x", "y", "z", "a"}}), HasSubstr("columns cannot be named"));
  EXPECT_THAT(open_source({"a.npy", "gen:points:count=1"}, {}).error().message, HasSubstr("must be the only input"));
}

}  // namespace
}  // namespace splatvol::test
