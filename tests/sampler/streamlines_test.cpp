// Streamlines of the cells of a file.
#include "sampler/streamlines.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>

#include "sampler/dormand_prince.h"
#include "tests/sampler/sampled_cells.h"

namespace splatvol::test {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using Vectors = std::function<dvec3(dvec3)>;

struct StreamlinesOfCells : SampledCells {
  static double other(const dvec3& p) { return 4 * p.x - p.y + 2 * p.z; }

  void build_vectors(const Mesh& mesh, const Vectors& of, const BuildOptions& options = exact()) {
    Fields fields;
    for (int axis = 0; axis < 3; ++axis) fields.emplace_back([&of, axis](const dvec3& p) { return of(p)[axis]; });
    fields.emplace_back(other);
    build_fields(mesh, fields, {"v[0]", "v[1]", "v[2]", "other"}, options);
  }

  [[nodiscard]] Result<Streamlines> try_to(const StreamlineRequest& request, std::uint64_t memory = 1 << 24,
                                           std::size_t threads = 2) const {
    return find_streamlines(*volume_, request, memory, threads);
  }
  [[nodiscard]] std::vector<Streamline> lines(const StreamlineRequest& request) const {
    return value_of(try_to(request)).lines;
  }
  [[nodiscard]] Streamline line(const dvec3& seed, StreamlineDirection direction = StreamlineDirection::forward) const {
    return lines({.vector = "v", .seeds = std::vector{seed}, .direction = direction})[0];
  }
};

// [-1, 1]^3.
Mesh irregular(std::uint32_t cells) {
  Mesh mesh = jittered(cells, 0.2);
  for (dvec3& p : mesh.points) p = 2.0 * p - 1.0;
  return mesh;
}

// The unit cube, with cells of different sizes: all corners on the sides stay there.
Mesh uneven(std::uint32_t cells) {
  return lattice(cells, [](dvec3 p) { return p * p; });
}

dvec3 turning(const dvec3& p) { return {-p.y, p.x, 0}; }

TEST(DormandPrince, HasErrorsOfOrderSix) {
  const auto error_of = [](double time, dvec3& estimate) {
    const auto step =
        dormand_prince_step([](const dvec3& p) { return std::optional(turning(p)); }, {1, 0, 0}, {0, 1, 0}, time);
    estimate = step->error;
    EXPECT_NEAR(step->length, time, 1e-3 * std::pow(time, 6));
    return glm::length(step->position - dvec3(std::cos(time), std::sin(time), 0));
  };
  dvec3 of_whole, of_half;
  const double whole = error_of(0.2, of_whole), half = error_of(0.1, of_half);
  EXPECT_NEAR(std::log2(whole / half), 6, 0.5);
  EXPECT_NEAR(std::log2(glm::length(of_whole) / glm::length(of_half)), 5, 0.5);
  EXPECT_GT(glm::length(of_whole), whole);
}

TEST_F(StreamlinesOfCells, TenTurnsEndWhereTheyBegin) {
  build_vectors(irregular(16), turning);
  for (const dvec3& seed : {dvec3(0.5, 0, 0.1), dvec3(0.1, -0.2, -0.5), dvec3(-0.6, 0.5, 0)}) {
    const double radius = glm::length(dvec3(seed.x, seed.y, 0));
    for (const auto direction : {StreamlineDirection::forward, StreamlineDirection::backward}) {
      const Streamline turns = lines({.vector = "v",
                                      .seeds = std::vector{seed},
                                      .direction = direction,
                                      .max_length = 20 * std::numbers::pi * radius})[0];
      const bool is_forward = direction == StreamlineDirection::forward;
      EXPECT_EQ(is_forward ? turns.end : turns.begin, StreamlineEnd::length);
      EXPECT_EQ(is_forward ? turns.begin : turns.end, StreamlineEnd::seed);
      const dvec3 end = is_forward ? turns.positions.back() : turns.positions.front();
      const double angle = is_forward ? turns.times.back() : turns.times.front();
      EXPECT_NEAR(std::abs(angle), 20 * std::numbers::pi, 1e-3 * std::abs(angle));
      const dvec3 expected = std::cos(angle) * dvec3(seed.x, seed.y, 0) + std::sin(angle) * turning(seed);
      EXPECT_LT(glm::length(end - expected - dvec3(0, 0, seed.z)), 1e-4 * radius);
      EXPECT_GT(turns.positions.size(), 100);
    }
  }
}

TEST_F(StreamlinesOfCells, AUniformFieldHasStraightLinesFromSideToSide) {
  const dvec3 velocity(1, 2, -0.5);
  build_vectors(uneven(9), [&](const dvec3&) { return velocity; });
  for (const dvec3& seed : random_positions(20, 0.05, 0.95)) {
    const Streamline straight = line(seed, StreamlineDirection::both);
    EXPECT_EQ(straight.begin, StreamlineEnd::mesh);
    EXPECT_EQ(straight.end, StreamlineEnd::mesh);
    double low = -INFINITY, high = INFINITY;  // times at the sides
    for (int axis = 0; axis < 3; ++axis) {
      const double a = -seed[axis] / velocity[axis], b = (1 - seed[axis]) / velocity[axis];
      low = std::max(low, std::min(a, b)), high = std::min(high, std::max(a, b));
    }
    EXPECT_NEAR(straight.times.front(), low, 1e-9);
    EXPECT_NEAR(straight.times.back(), high, 1e-9);
    for (std::size_t row = 0; row < straight.times.size(); ++row) {
      EXPECT_LT(glm::length(straight.positions[row] - (seed + straight.times[row] * velocity)), 1e-12);
      EXPECT_NEAR(straight.values[3][row], other(straight.positions[row]), 1e-5);
    }
    EXPECT_TRUE(std::ranges::adjacent_find(straight.times, std::greater_equal()) == straight.times.end());
  }
}

TEST_F(StreamlinesOfCells, ASaddleHasHyperbolas) {
  build_vectors(irregular(12), [](const dvec3& p) { return dvec3(p.x, -p.y, 0.25); });
  for (const dvec3& seed : random_positions(20, -0.9, 0.9)) {
    const Streamline hyperbola = line(seed, StreamlineDirection::both);
    for (std::size_t row = 0; row < hyperbola.times.size(); ++row) {
      const double time = hyperbola.times[row];
      const dvec3 expected(seed.x * std::exp(time), seed.y * std::exp(-time), seed.z + 0.25 * time);
      EXPECT_LT(glm::length(hyperbola.positions[row] - expected), 1e-5);
    }
  }
}

TEST_F(StreamlinesOfCells, EndAtMissingValues) {
  build_vectors(lattice(8), [](const dvec3& p) { return dvec3(p.x > 0.6 ? none : 1, 0, 0); });
  const Streamline found = line({0.2, 0.3, 0.4}, StreamlineDirection::both);
  EXPECT_EQ(found.begin, StreamlineEnd::mesh);
  EXPECT_EQ(found.end, StreamlineEnd::missing);
  EXPECT_NEAR(found.positions.front().x, 0, 1e-9);
  EXPECT_NEAR(found.positions.back().x, 0.5, 1e-9);
  EXPECT_THAT(message_of(try_to({.vector = "v", .seeds = std::vector{dvec3(0.9)}})),
              HasSubstr("0 are in no cell, 1 where the vector has no value, 0 where it is 0"));
}

TEST_F(StreamlinesOfCells, EndWhereNothingMoves) {
  build_vectors(uneven(8), [](const dvec3& p) { return dvec3(0.25 - p.x, 0, 0); });
  for (const double x : {0.9, 0.01, 0.25 + 1e-9}) {
    const Streamline found = line({x, 0.3, 0.4});
    EXPECT_EQ(found.end, StreamlineEnd::no_speed) << x;
    EXPECT_NEAR(found.positions.back().x, 0.25, 1e-11);
    EXPECT_LT(found.positions.size(), 200);
  }
  EXPECT_EQ(lines({.vector = "v", .seeds = std::vector{dvec3(0.25, 0.3, 0.4), dvec3(0.5)}})[0].positions.size(), 0);
  EXPECT_THAT(message_of(try_to({.vector = "v", .seeds = std::vector{dvec3(0.25, 0.3, 0.4)}})),
              HasSubstr("1 where it is 0"));
}

TEST_F(StreamlinesOfCells, HaveLimits) {
  build_vectors(irregular(12), [](const dvec3& p) { return 3.0 * turning(p); });
  const StreamlineRequest request{.vector = "v", .seeds = std::vector{dvec3(0.5, 0, 0)}, .max_length = 0.75};
  const Streamline by_length = lines(request)[0];
  EXPECT_EQ(by_length.begin, StreamlineEnd::length);
  EXPECT_EQ(by_length.end, StreamlineEnd::length);
  EXPECT_NEAR(by_length.times.back(), 0.5, 1e-5);
  EXPECT_NEAR(by_length.times.front(), -0.5, 1e-5);
  StreamlineRequest of_steps = request;
  of_steps.max_steps = 3;
  const Streamline by_steps = lines(of_steps)[0];
  EXPECT_EQ(by_steps.end, StreamlineEnd::steps);
  EXPECT_EQ(by_steps.positions.size(), 7);
  StreamlineRequest endless = request;
  endless.max_length = {};
  endless.max_steps = 1'000'000;
  const Streamline usual = lines(endless)[0];
  EXPECT_EQ(usual.end, StreamlineEnd::length);
  EXPECT_NEAR(usual.times.back() * 1.5, 10 * std::sqrt(3.0), 1.5) << "five diagonals of the box";
}

TEST_F(StreamlinesOfCells, SeedsOutsideHaveNone) {
  build_vectors(lattice(4), [](const dvec3&) { return dvec3(1, 0, 0); });
  const std::vector<Streamline> found =
      lines({.vector = "v", .seeds = std::vector{dvec3(0.5), dvec3(0.5, 1.5, 0.5), dvec3(1, 0.3, 0.3)}});
  ASSERT_EQ(found.size(), 3);
  EXPECT_GE(found[0].positions.size(), 2);
  EXPECT_EQ(found[1].positions.size(), 0);
  EXPECT_EQ(found[1].end, StreamlineEnd::mesh);
  EXPECT_NEAR(found[2].positions[0].x, 0, 1e-9) << "a seed on the border has a line";
  EXPECT_THAT(message_of(try_to({.vector = "v", .seeds = SeedLine{dvec3(2), dvec3(3), 7}})),
              AllOf(HasSubstr("7 are in no cell"), HasSubstr("from (0, 0, 0) to (1, 1, 1)")));
}

TEST_F(StreamlinesOfCells, TheFirstOfOverlappingCellsCounts) {
  Mesh mesh = lattice(4), other_mesh = lattice(4);
  const std::size_t first = mesh.points.size();
  for (auto corners : other_mesh.tetrahedra) {
    for (std::uint32_t& corner : corners) corner += static_cast<std::uint32_t>(first);
    mesh.tetrahedra.push_back(corners);
  }
  for (const dvec3& p : other_mesh.points) mesh.points.push_back(p + dvec3(0.03));
  build_vectors(mesh, [](const dvec3& p) { return std::fmod(p.x, 0.25) == 0 ? dvec3(1, 0, 0) : dvec3(0, 1, 0); });
  const Streamline found = line(dvec3(0.5, 0.4, 0.3));
  const std::vector<double> x = sample(found.positions);
  EXPECT_THAT(found.values[0], testing::Pointwise(testing::DoubleEq(), x));
  EXPECT_GT(std::ranges::count(x, 0), 0);
  EXPECT_GT(std::ranges::count(x, 1), 0);
}

TEST_F(StreamlinesOfCells, HaveTheSameBitsForAnyThreadsMemoryAndOrder) {
  const auto field = [](const dvec3& p) {
    return dvec3(std::sin(7 * p.y) + 0.2, std::cos(5 * p.z), std::sin(6 * p.x) - 0.1);
  };
  build_vectors(irregular(16), field, {.keep_cells = true});
  std::vector<dvec3> seeds = random_positions(24, -0.9, 0.9);
  StreamlineRequest request{.vector = "v", .seeds = seeds, .max_length = 2};
  const std::vector<Streamline> expected = value_of(try_to(request, 256 << 20, 1)).lines;
  std::ranges::reverse(seeds);
  request.seeds = seeds;
  for (const auto& [memory, threads] : {std::pair{256 << 20, 2}, {16 << 20, 3}, {1 << 20, 2}}) {
    const auto found = value_of(try_to(request, static_cast<std::uint64_t>(memory), static_cast<std::size_t>(threads)));
    for (std::size_t i = 0; i < seeds.size(); ++i) {
      const Streamline &a = expected[i], &b = found.lines[seeds.size() - 1 - i];
      EXPECT_EQ(a.positions, b.positions) << i;
      EXPECT_EQ(a.times, b.times);
      EXPECT_EQ(a.values, b.values);
      EXPECT_TRUE(a.begin == b.begin && a.end == b.end);
    }
  }
}

TEST_F(StreamlinesOfCells, ReadOnlyChunksOnTheirWay) {
  build_vectors(lattice(32), [](const dvec3&) { return dvec3(1, 0, 0); });
  const std::uint64_t before = volume_->bytes_read();
  ASSERT_TRUE(try_to({.vector = "v", .seeds = SeedLine{{0.1, 0.1, 0.1}, {0.1, 0.11, 0.1}, 50}}));
  EXPECT_LT(volume_->bytes_read() - before, volume_->file_bytes() / 2);
}

TEST_F(StreamlinesOfCells, BeginAtShapes) {
  build_vectors(lattice(2), [](const dvec3&) { return dvec3(1, 0, 0); });
  const auto seeds = [&](const Seeds& of) { return value_of(positions_of(of, *volume_, 1 << 20)); };
  EXPECT_EQ(seeds(SeedLine{dvec3(0), dvec3(1, 0, 0), 3}), (std::vector{dvec3(0), dvec3(0.5, 0, 0), dvec3(1, 0, 0)}));
  EXPECT_EQ(seeds(SeedLine{dvec3(0), dvec3(1, 0, 0), 1}), (std::vector{dvec3(0.5, 0, 0)}));
  EXPECT_EQ(seeds(SeedRectangle{dvec3(0), dvec3(1, 0, 0), dvec3(0, 2, 0), {2, 3}}),
            (std::vector{dvec3(0), dvec3(1, 0, 0), dvec3(0, 1, 0), dvec3(1, 1, 0), dvec3(0, 2, 0), dvec3(1, 2, 0)}));
  build_vectors(lattice(2), [](const dvec3&) { return dvec3(1, 0, 0); },
                {.boundary_triangles = 1000, .keep_cells = true});
  EXPECT_EQ(seeds(SeedPatch{"side x-", 6}).size(), 6U);
  EXPECT_THAT(message_of(positions_of(SeedPatch{"side x-", 6}, *volume_, 64)), HasSubstr("memory has room for 64"));
}

TEST_F(StreamlinesOfCells, BadRequestsAreRefused) {
  build_vectors(lattice(2), [](const dvec3&) { return dvec3(1, 0, 0); });
  const Seeds seeds = std::vector{dvec3(0.5)};
  EXPECT_THAT(message_of(try_to({.vector = "other", .seeds = seeds})),
              AllOf(HasSubstr("\"other\" is no vector"), HasSubstr("vectors: v")));
  EXPECT_THAT(message_of(try_to({.vector = "v", .seeds = std::vector<dvec3>()})), HasSubstr("need a seed"));
  EXPECT_THAT(message_of(try_to({.vector = "v", .seeds = std::vector{dvec3(none)}})), HasSubstr("not finite"));
  EXPECT_THAT(message_of(try_to({.vector = "v", .seeds = SeedLine{dvec3(1), dvec3(1)}})), HasSubstr("no length"));
  EXPECT_THAT(message_of(try_to({.vector = "v", .seeds = SeedRectangle{dvec3(0), dvec3(1), dvec3(2)}})),
              HasSubstr("no area"));
  EXPECT_THAT(message_of(try_to({.vector = "v", .seeds = SeedLine{dvec3(0), dvec3(1), 2'000'000}})),
              HasSubstr("2000000 seeds; at most 1000000"));
  EXPECT_THAT(message_of(try_to({.vector = "v", .seeds = SeedPatch{"inlet"}})), HasSubstr("svbuild --boundary"));
  EXPECT_THAT(message_of(try_to({.vector = "v", .seeds = seeds, .max_length = -1})), HasSubstr("no length"));
  EXPECT_THAT(message_of(try_to({.vector = "v", .seeds = seeds, .max_steps = 0})), HasSubstr("steps"));
  EXPECT_THAT(message_of(try_to({.vector = "v", .seeds = seeds, .attributes = {"gone"}})), HasSubstr("gone"));
  build_vectors(lattice(2), [](const dvec3&) { return dvec3(1, 0, 0); }, {});
  EXPECT_THAT(message_of(try_to({.vector = "v", .seeds = seeds})), HasSubstr("keeps no cells"));
}

}  // namespace
}  // namespace splatvol::test
