#include "streamer/splats/cut.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "splat/splat.h"
#include "streamer/splats/paged_volume.h"
#include "tests/streamer/fixture.h"
#include "tests/support/random.h"
#include "tests/support/results.h"

namespace splatvol::test {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

// A volume in memory, which supplies the pages of its index.
struct Bench {
  explicit Bench(TestVolume made, unsigned seed, TransferFunction function = opaque(),
                 KernelKind kind = KernelKind::octant)
      : random(seed),
        kernel(kind),
        volume(std::move(made)),
        opened(format::Volume::open(source_of(volume)).value()),
        paged(*opened, {1}, own_room(1U << 30)),
        visibility(function, volume.info.attributes[1]) {}

  Cut cut(const View& view, CutOptions options) {
    options.kernel = kernel;
    return value_of(select_cut(opened->info(), paged, view, visibility, options));
  }

  std::mt19937 random;  // for views
  KernelKind kernel;
  TestVolume volume;
  std::shared_ptr<const format::Volume> opened;
  PagedVolume paged;
  ValueVisibility visibility;
};

CutOptions tolerance(double percent, std::uint64_t compare_above = 512) {
  return {.detail = {.tolerance_percent = percent}, .compare_above = compare_above};
}

CutOptions fixed(std::size_t resolution, std::uint64_t compare_above = 512) {
  return {.detail = {.resolution = resolution}, .compare_above = compare_above};
}

bool is_in(const Cube& cube, const dvec3& p) {
  return glm::all(glm::greaterThanEqual(p, cube.origin - 1e-12)) &&
         glm::all(glm::lessThanEqual(p, cube.origin + cube.edge + 1e-12));
}

TEST(Cut, RangesAreThePointsOfTheirNode) {
  Bench bench(sample_volume(3000, 1), 1);
  for (int trial = 0; trial < 20; ++trial) {
    const Cut cut = bench.cut(random_view(bench.random), tolerance(std::exp2(trial % 8 - 1)));
    std::uint64_t splats = 0;
    for (const CutItem& item : cut.items) {
      const auto ranges = cut.ranges_of(item);
      for (std::size_t s = 0; s < ranges.size(); ++s) {
        const std::uint64_t begin = s == 0 ? 0 : bench.volume.info.resolution_counts[s - 1];
        ASSERT_GE(ranges[s].begin, begin);
        ASSERT_LE(ranges[s].begin + ranges[s].count, bench.volume.info.resolution_counts[s]);
        for (std::uint64_t i = 0; i < ranges[s].count; ++i)
          ASSERT_TRUE(is_in(item.cube, bench.volume.positions[ranges[s].begin + i]));
        splats += ranges[s].count;
      }
    }
    ASSERT_EQ(cut.splats, splats);
  }
}

TEST(Cut, StandsForEveryPointOnce) {
  for (const auto& [seed, kind] : {std::pair{1u, KernelKind::octant},
                                   {2u, KernelKind::octant},
                                   {3u, KernelKind::octant},
                                   {2u, KernelKind::moments}}) {
    Bench bench(sample_volume(2500, seed), seed, opaque(), kind);
    std::set<std::uint64_t> numbers;
    for (int trial = 0; trial < 30; ++trial) {
      const double percent = 0.02 * std::exp2(std::uniform_real_distribution<double>(0, 8)(bench.random));
      const Cut cut = bench.cut(view_of_all(bench.random), tolerance(percent, trial % 2 == 0 ? 512 : 16));
      ASSERT_THAT(coverage(bench.volume, cut), testing::Each(1))
          << "seed " << seed << ", trial " << trial << ", " << percent << " %";
      numbers.insert(cut.splats);
    }
    EXPECT_GT(numbers.size(), 10u) << "the tolerances are all alike";
  }
}

TEST(Cut, ExtremesAreAllPointsAndTheCoarsestResolution) {
  Bench bench(sample_volume(2000, 4), 4);
  for (int trial = 0; trial < 5; ++trial) {
    const View view = view_of_all(bench.random);
    EXPECT_EQ(bench.cut(view, tolerance(0)).splats, 2000u);
    EXPECT_EQ(bench.cut(view, tolerance(infinity)).splats, bench.volume.info.resolution_counts[0]);
  }
}

TEST(Cut, AFixedResolutionIsThatResolution) {
  Bench bench(sample_volume(2000, 5), 5);
  for (std::size_t r = 0; r < bench.volume.info.resolutions() + 2; ++r) {
    const CutOptions options = fixed(r, 30);
    const std::size_t expected = std::min(r, bench.volume.info.resolutions() - 1);
    const Cut cut = bench.cut(view_of_all(bench.random), options);
    EXPECT_EQ(cut.splats, bench.volume.info.resolution_counts[expected]);
    EXPECT_THAT(coverage(bench.volume, cut), testing::Each(1));
    for (const CutItem& item : cut.items) EXPECT_EQ(item.resolution, expected);
  }
}

TEST(Cut, AFixedResolutionIsCulledToo) {
  Bench bench(sample_volume(4000, 5), 5);
  Camera camera{.position = {0.9, 0.9, 0.9}, .focal_point = {1, 1, 1}};
  const CutOptions options = fixed(bench.volume.info.resolutions() - 1);
  EXPECT_LT(bench.cut(*make_view(camera, 100, 100), options).splats, 1000u);
}

TEST(Cut, MoreToleranceNeverDrawsMore) {
  for (const std::uint32_t seed : {6u, 7u}) {
    Bench bench(sample_volume(2500, seed), seed);
    for (int trial = 0; trial < 15; ++trial) {
      const View view = view_of_all(bench.random);
      std::uint64_t last = std::numeric_limits<std::uint64_t>::max();
      for (double percent = 0.01; percent < 200; percent *= 1.3) {
        const std::uint64_t splats = bench.cut(view, tolerance(percent, 0)).splats;
        ASSERT_LE(splats, last) << "seed " << seed << ", trial " << trial << ", " << percent << " %";
        last = splats;
      }
    }
  }
}

TEST(Cut, ComparingWithChildrenNeverDrawsMore) {
  Bench bench(sample_volume(4000, 8), 8);
  bool fewer = false;
  for (int trial = 0; trial < 60; ++trial) {
    const View view = random_view(bench.random);
    const double percent = std::exp2(trial % 8 - 3);
    const std::uint64_t paper = bench.cut(view, tolerance(percent, std::numeric_limits<std::uint64_t>::max())).splats;
    const std::uint64_t ours = bench.cut(view, tolerance(percent, 100)).splats;
    ASSERT_LE(ours, paper);
    fewer = fewer || ours < paper;
  }
  EXPECT_TRUE(fewer);
}

// Adds the number of pairs of items that it compares.
void expect_back_to_front(const Cut& cut, const View& view, std::size_t& pairs) {
  for (std::size_t i = 0; i < cut.items.size(); ++i)
    for (std::size_t j = i + 1; j < cut.items.size(); ++j, ++pairs)
      ASSERT_FALSE(may_hide(view, cut.items[i].cube, cut.items[j].cube)) << "items " << i << ", " << j;
}

TEST(Cut, IsBackToFront) {
  Bench bench(sample_volume(2500, 10), 10);
  std::size_t inside = 0, parallel = 0, pairs = 0;
  for (int trial = 0; trial < 60; ++trial) {
    const View view = random_view(bench.random);
    inside += !view.orthographic && is_in({{0, 0, 0}, 1}, view.eye);
    parallel += view.orthographic;
    SCOPED_TRACE(trial);
    expect_back_to_front(bench.cut(view, tolerance(trial % 3 == 0 ? 0 : 3)), view, pairs);
  }
  EXPECT_GT(inside, 0u);
  EXPECT_GT(parallel, 0u);
  EXPECT_GT(pairs, 10000u);
}

// A splat as the renderer draws it: a square round its centre, in front of the eye.
bool is_visible(const View& view, const dvec3& point, double size) {
  const dvec3 p = view.to_view(point);
  if (p.z <= 0) return false;
  const double scale = view.orthographic ? view.focal : view.focal / p.z;
  const double reach = std::max(octant_reach * size * scale, octant_smallest_reach_pixels);
  return std::abs(p.x) * scale < 0.5 * view.width + reach && std::abs(p.y) * scale < 0.5 * view.height + reach;
}

TEST(Cut, CullingLosesNoVisibleSplat) {
  Bench bench(sample_volume(3000, 11), 11);
  const std::size_t finest = bench.volume.info.resolutions() - 1;
  std::size_t left_out = 0;
  for (int trial = 0; trial < 80; ++trial) {
    const View view = random_view(bench.random);
    const Cut cut = bench.cut(view, tolerance(trial % 2 == 0 ? 0 : std::exp2(trial % 9 - 3)));
    const std::vector<int> covered = coverage(bench.volume, cut);
    for (std::size_t i = 0; i < covered.size(); ++i) {
      ASSERT_LE(covered[i], 1);
      if (covered[i] == 1) continue;
      ++left_out;
      ASSERT_FALSE(is_visible(view, bench.volume.positions[i], bench.volume.splat_size(finest, i)))
          << "trial " << trial;
    }
  }
  EXPECT_GT(left_out, 50000u);
}

// Whether a part of a splat's ellipsoid is visible. Projects points of its surface and on its axes exactly.
bool ellipsoid_is_visible(const View& view, const TestVolume& volume, std::size_t resolution, std::size_t i) {
  static const std::vector<dvec3> ball = [] {
    std::mt19937 random(3);
    std::normal_distribution<double> normal;
    std::vector<dvec3> points;
    for (int k = 0; k < 60; ++k) {
      const dvec3 direction = glm::normalize(random_vector(normal, random));
      points.push_back(direction);
      points.push_back(0.7 * direction);
    }
    return points;
  }();
  const SplatShape& shape = volume.shapes[resolution][i];
  const dmat3 axes = glm::mat3_cast(shape.orientation);
  return std::ranges::any_of(ball, [&](const dvec3& b) {
    const dvec3 p = view.to_view(volume.centroids[resolution][i] + axes * (std::sqrt(12.0) * shape.deviations * b));
    const double scale = view.orthographic ? view.focal : view.focal / p.z;
    return p.z > 0 && std::abs(p.x) * scale < 0.5 * view.width && std::abs(p.y) * scale < 0.5 * view.height;
  });
}

// Expects that no splat of a resolution is visible that a cut leaves out. Returns the number of those.
std::size_t expect_hidden(const Cut& cut, const View& view, const TestVolume& volume, std::size_t resolution) {
  std::set<std::uint64_t> drawn;
  for (const PointRange& range : cut.ranges)
    for (std::uint64_t i = 0; i < range.count; ++i) drawn.insert(range.begin + i);
  std::size_t left_out = 0;
  for (std::size_t i = 0; i < volume.info.resolution_counts[resolution]; ++i) {
    if (drawn.contains(i)) continue;
    ++left_out;
    EXPECT_FALSE(ellipsoid_is_visible(view, volume, resolution, i)) << "splat " << i;
  }
  return left_out;
}

TEST(Cut, CullingLosesNoVisibleEllipsoid) {
  Bench bench(sample_volume(3000, 11), 11, opaque(), KernelKind::moments);
  const TestVolume& volume = bench.volume;
  std::size_t sticking_out = 0, left_out = 0, seen = 0;
  for (std::size_t i = 0; i < volume.positions.size(); ++i) {
    // The smallest node that has the point.
    std::size_t node = 0;
    for (std::size_t n = 0; n < volume.node_paths.size(); ++n)
      if (volume.holds(n, i) && volume.node_paths[n].size() >= volume.node_paths[node].size()) node = n;
    const Cube cube = cube_of(volume.info.cube, volume.node_paths[node]);
    const dvec3 extent = volume.moments_extent(volume.info.resolutions() - 1, i);
    sticking_out +=
        !is_in(cube, volume.centroids.back()[i] + extent) || !is_in(cube, volume.centroids.back()[i] - extent);
  }
  EXPECT_GT(sticking_out, 500u);
  for (int trial = 0; trial < 150; ++trial) {
    const View view = random_view(bench.random);
    const std::size_t resolution = bench.random() % volume.info.resolutions();
    const Cut cut = bench.cut(view, fixed(resolution, trial % 2 == 0 ? 512 : 0));
    left_out += expect_hidden(cut, view, volume, resolution);
    ASSERT_FALSE(testing::Test::HasFailure()) << "trial " << trial;
    seen += cut.splats;
  }
  EXPECT_GT(left_out, 20000u);
  EXPECT_GT(seen, 20000u);
}

// Makes all splats of a volume equal: balls of half axis `radius`, with centroids `aside` of the points.
TestVolume volume_of_balls(const dvec3& aside, double radius) {
  TestVolume volume = sample_volume(400, 17);
  const std::size_t resolutions = volume.info.resolutions();
  for (std::size_t r = 0; r < resolutions; ++r)
    for (std::size_t i = 0; i < volume.info.resolution_counts[r]; ++i) {
      volume.centroids[r][i] = volume.positions[i] + aside;
      volume.shapes[r][i].deviations = dvec3(radius / std::sqrt(12.0));
    }
  for (std::size_t node = 0; node < volume.tree.size(); ++node) {
    const Cube cube = cube_of(volume.info.cube, volume.node_paths[node]);
    for (std::size_t r = volume.tree.first_resolutions[node]; r < resolutions; ++r) {
      std::uint8_t& code = volume.tree.size_codes[(node * 2 + 1) * resolutions + r] = 255;
      for (std::size_t i = 0; i < volume.info.resolution_counts[r]; ++i)
        if (volume.holds(node, i))
          code = std::min(code, format::size_code(volume.moments_size(r, i, cube), volume.info.cube.edge));
    }
  }
  return volume;
}

TEST(Cut, MomentsWithCentroidsFarOutOfTheirNodeAreNotCulled) {
  // Along the diagonal, by much more than their width.
  Bench bench(volume_of_balls(dvec3(0.2), 1e-4), 17, opaque(), KernelKind::moments);
  const std::size_t finest = bench.volume.info.resolutions() - 1;
  std::size_t left_out = 0;
  for (int trial = 0; trial < 200; ++trial) {
    const View view = random_view(bench.random);
    left_out += expect_hidden(bench.cut(view, fixed(finest, 0)), view, bench.volume, finest);
    ASSERT_FALSE(testing::Test::HasFailure()) << "trial " << trial;
  }
  EXPECT_GT(left_out, 5000u);
}

TEST(Cut, MomentsNearerThanTheirNodeStayWithinTheTolerance) {
  Camera camera{.position = {0.5, 0.5, 2}, .focal_point = dvec3(0.5)};
  const View view = make_view(camera, 200, 200).value();
  const double radius = 0.999 * format::size_bound(43, 1);
  Bench bench(volume_of_balls({0, 0, radius}, radius), 17, opaque(), KernelKind::moments);
  int coarse = 0;
  for (double percent = 1; percent < 40; percent *= 1.01) {
    const Cut cut = bench.cut(view, tolerance(percent, 0));
    for (const CutItem& item : cut.items) {
      if (item.resolution + 1 == bench.volume.info.resolutions()) continue;
      for (const PointRange& range : cut.ranges_of(item))
        for (std::uint64_t i = range.begin; i < range.begin + range.count; ++i, ++coarse) {
          const double depth = view.to_view(bench.volume.centroids[item.resolution][i]).z;
          ASSERT_LE(100 * radius * view.focal / depth, percent * view.height);
        }
    }
  }
  EXPECT_GT(coarse, 100);
}

// Only the finest resolution may break the tolerance.
TEST(Cut, SplatsStayWithinTheTolerance) {
  for (const KernelKind kind : {KernelKind::octant, KernelKind::moments}) {
    Bench bench(sample_volume(3000, 9), 9, opaque(), kind);
    const TestVolume& volume = bench.volume;
    int within = 0, outside_of_their_node = 0, coarser = 0;
    for (int trial = 0; trial < 40; ++trial) {
      const View view = random_view(bench.random);
      const double percent = std::exp2(trial % 8 - 2);
      const Cut cut = bench.cut(view, tolerance(percent));
      for (const CutItem& item : cut.items)
        for (const PointRange& range : cut.ranges_of(item))
          for (std::uint64_t i = range.begin; i < range.begin + range.count; ++i) {
            const bool is_octant = kind == KernelKind::octant;
            const dvec3& center = is_octant ? volume.positions[i] : volume.centroids[item.resolution][i];
            const double depth = view.orthographic ? 1 : view.to_view(center).z;
            const double size = is_octant ? volume.splat_size(item.resolution, i)
                                          : std::sqrt(12.0) * volume.shapes[item.resolution][i].deviations[0];
            const bool coarse =
                depth <= 0 || 100 * size * view.focal / depth > percent * std::min(view.width, view.height);
            const bool finest = item.resolution + 1 == volume.info.resolutions();
            ASSERT_TRUE(!coarse || finest) << "trial " << trial << ", splat " << i;
            within += !coarse;
            coarser += !finest;
            outside_of_their_node += !is_in(item.cube, center);
          }
    }
    EXPECT_GT(within, 5000);
    EXPECT_GT(coarser, 500);
    EXPECT_EQ(outside_of_their_node > 100, kind == KernelKind::moments);
  }
}

TEST(Cut, LeavesOutWhatTheTransferFunctionHides) {
  const TransferFunction function = window(30, 31);  // of 100 z
  TestVolumeOptions options;
  options.moments = false;  // with moments, their material counts
  Bench bench(sample_volume(4000, 12, options), 12, function);
  const Cut cut = bench.cut(view_of_all(bench.random), tolerance(0));
  const std::vector<int> covered = coverage(bench.volume, cut);
  for (std::size_t i = 0; i < covered.size(); ++i) {
    const bool visible = function.extinction(static_cast<double>(bench.volume.stored[1][i])) > 0;
    ASSERT_GE(covered[i], visible ? 1 : 0);
  }
  EXPECT_GT(cut.splats, 0u);
  EXPECT_LT(cut.splats, 2000u);

  Bench nothing(sample_volume(4000, 12), 12, window(200, 300));
  EXPECT_TRUE(nothing.cut(view_of_all(nothing.random), tolerance(0)).items.empty());
}

TEST(Cut, OfASinglePointAndOfCoincidentPoints) {
  Bench one(make_test_volume({dvec3(0.5)}, {{1}, {1}}), 1);
  EXPECT_EQ(one.cut(view_of_all(one.random), tolerance(1)).splats, 1u);

  const std::vector<double> values(100, 1.0);
  Bench many(make_test_volume(std::vector<dvec3>(100, dvec3(0.3)), {values, values}), 1);
  EXPECT_EQ(many.cut(view_of_all(many.random), tolerance(0)).splats, 100u);
  EXPECT_EQ(many.cut(view_of_all(many.random), tolerance(infinity)).splats, many.volume.info.resolution_counts[0]);
}

TEST(Cut, GivesUpPastItsBytes) {
  Bench bench(sample_volume(2000, 14), 14);
  const View view = view_of_all(bench.random);
  CutOptions options = tolerance(0);
  options.kernel = bench.kernel;
  options.max_bytes = 20000;
  EXPECT_THAT(select_cut(bench.opened->info(), bench.paged, view, bench.visibility, options),
              FailsWith(ErrorCode::out_of_budget));
  options.detail.tolerance_percent = infinity;
  EXPECT_TRUE(select_cut(bench.opened->info(), bench.paged, view, bench.visibility, options));
}

TEST(Cut, NeedsTheSizesOfItsKernel) {
  TestVolume volume = sample_volume(100, 15);
  volume.info.size_bounds = {"moments", "others"};
  Bench bench(std::move(volume), 15);
  CutOptions options{.kernel = KernelKind::octant};
  const View view = view_of_all(bench.random);
  EXPECT_THAT(select_cut(bench.opened->info(), bench.paged, view, bench.visibility, options),
              FailsWith(ErrorCode::unsupported, testing::HasSubstr("octant")));
}

// --- Cuts by expected error.

CutOptions goal(std::uint64_t max_splats, double max_error = 0) {
  return {.detail = {.goal = ErrorGoal{max_error, max_splats}}};
}

// Extinction 1, and colours that change only over a small range of attribute 1, which is 100 z.
TransferFunction edge_at(double value) {
  TransferFunction function = opaque();
  function.lo = 0;
  function.hi = 100;
  function.colors = {{0, dvec3(0)}, {value / 100 - 0.02, dvec3(0)}, {value / 100 + 0.02, dvec3(1)}, {1, dvec3(1)}};
  return function;
}

TEST(CutByError, NeverPassesItsSplatsAndStandsForEveryPointOnce) {
  for (const KernelKind kind : {KernelKind::octant, KernelKind::moments}) {
    Bench bench(sample_volume(2500, 21), 21, edge_at(40), kind);
    std::set<std::uint64_t> numbers;
    for (int trial = 0; trial < 30; ++trial) {
      const auto most =
          static_cast<std::uint64_t>(std::exp2(std::uniform_real_distribution<double>(0, 12)(bench.random)));
      const Cut cut = bench.cut(view_of_all(bench.random), goal(most));
      ASSERT_LE(cut.splats, std::max(most, bench.volume.info.resolution_counts[0])) << "trial " << trial;
      ASSERT_THAT(coverage(bench.volume, cut), testing::Each(1)) << "trial " << trial << ", " << most << " splats";
      numbers.insert(cut.splats);
    }
    EXPECT_GT(numbers.size(), 8u) << "the goals are all alike";
  }
}

// Errors are kept in single precision. They grow with the square of the extinction.
TEST(CutByError, AnyExtinctionHasACut) {
  for (const double extinction : {1e15, 1e25, 1e50, 1e100}) {
    TransferFunction function = edge_at(50);
    for (TransferFunction::Density& density : function.densities) density.extinction = extinction;
    Bench bench(sample_volume(500, 22), 22, function);
    const Cut cut = bench.cut(view_of_all(bench.random), goal(100));
    EXPECT_LE(cut.splats, std::max<std::uint64_t>(100, bench.volume.info.resolution_counts[0])) << extinction;
    EXPECT_TRUE(std::isfinite(cut.squared_error)) << extinction;
    EXPECT_THAT(coverage(bench.volume, cut), testing::Each(1)) << extinction;
  }
}

TEST(CutByError, ExtremesAreTheCoarsestResolutionAndNearlyAllPoints) {
  Bench bench(sample_volume(2000, 22), 22, edge_at(50));
  for (int trial = 0; trial < 5; ++trial) {
    const View view = view_of_all(bench.random);
    const std::uint64_t coarsest = bench.volume.info.resolution_counts[0];
    EXPECT_EQ(bench.cut(view, goal(0)).splats, coarsest);
    EXPECT_EQ(bench.cut(view, goal(1)).splats, coarsest);
    EXPECT_EQ(bench.cut(view, goal(1u << 20, 1e3)).splats, coarsest);
    // Except in nodes in which more splats gain nothing.
    EXPECT_GT(bench.cut(view, goal(1u << 20)).splats, 1500u);
  }
}

// Not exactly: the minimised cost also has the seams between resolutions, and the errors that only the parts of a node
// tell.
TEST(CutByError, MoreSplatsLessenTheError) {
  Bench bench(sample_volume(4000, 23), 23, edge_at(30));
  for (int trial = 0; trial < 15; ++trial) {
    const View view = random_view(bench.random);
    double last = infinity, first = 0;
    for (double most = 50; most < 5000; most *= 1.3) {
      const double error = std::sqrt(bench.cut(view, goal(static_cast<std::uint64_t>(most))).squared_error);
      ASSERT_LE(error, 1.25 * last) << "trial " << trial << ", " << most << " splats";
      last = error;
      first = std::max(first, error);
    }
    EXPECT_LE(last, first);
  }
}

TEST(CutByError, MeetsAnError) {
  Bench bench(sample_volume(4000, 24), 24, edge_at(60));
  int between = 0;
  for (int trial = 0; trial < 15; ++trial) {
    const View view = view_of_all(bench.random);
    const double least = std::sqrt(bench.cut(view, goal(1u << 20)).squared_error);
    std::uint64_t last = std::numeric_limits<std::uint64_t>::max();
    for (double share = 1.05; share < 20; share *= 1.5) {
      const Cut cut = bench.cut(view, goal(1u << 20, share * least));
      ASSERT_LE(std::sqrt(cut.squared_error), share * least);
      ASSERT_LE(cut.splats, last);
      last = cut.splats;
      between += cut.splats > bench.volume.info.resolution_counts[0] && cut.splats < 4000;
    }
  }
  EXPECT_GT(between, 20);
}

// With equal numbers of splats. For the same reason a tolerance may have a slightly smaller error.
TEST(CutByError, ExpectsNoMoreThanATolerance) {
  Bench bench(sample_volume(4000, 25), 25, edge_at(70));
  double gains = 0;
  int compared = 0;
  for (int trial = 0; trial < 40; ++trial) {
    const View view = random_view(bench.random);
    const Cut plain = bench.cut(view, tolerance(std::exp2(trial % 6 - 1)));
    if (plain.splats == 0 || plain.squared_error == 0) continue;
    const double ratio = std::sqrt(bench.cut(view, goal(plain.splats)).squared_error / plain.squared_error);
    ASSERT_LE(ratio, 1.1) << "trial " << trial << ", " << plain.splats << " splats";
    gains += std::log(1 / ratio);
    ++compared;
  }
  ASSERT_GT(compared, 20);
  EXPECT_GT(std::exp(gains / compared), 1.05);
}

TEST(CutByError, RefinesWhereColoursChange) {
  Bench bench(sample_volume(4000, 26), 26, edge_at(80));
  double near = 0, elsewhere = 0;
  for (int trial = 0; trial < 5; ++trial) {
    const Cut cut = bench.cut(view_of_all(bench.random), goal(1500));
    for (const CutItem& item : cut.items) {
      const bool holds_edge = item.cube.origin.z < 0.8 && item.cube.origin.z + item.cube.edge > 0.8;
      std::uint64_t splats = 0;
      for (const PointRange& range : cut.ranges_of(item)) splats += range.count;
      const double density = static_cast<double>(splats) / std::pow(item.cube.edge, 3);
      (holds_edge ? near : elsewhere) = std::max(holds_edge ? near : elsewhere, density);
    }
  }
  EXPECT_GE(near, elsewhere);
}

TEST(CutByError, LeavesOutWhatTheTransferFunctionHides) {
  Bench nothing(sample_volume(4000, 27), 27, window(200, 300));
  EXPECT_TRUE(nothing.cut(view_of_all(nothing.random), goal(1000)).items.empty());
  Bench some(sample_volume(4000, 27), 27, window(30, 31));
  EXPECT_LT(some.cut(view_of_all(some.random), goal(1u << 20)).splats, 2500u);
}

TEST(CutByError, OfASinglePointAndOfCoincidentPointsAndOfOneValue) {
  Bench one(make_test_volume({dvec3(0.5)}, {{1}, {1}}), 1);
  EXPECT_EQ(one.cut(view_of_all(one.random), goal(1)).splats, 1u);

  const std::vector<double> values(100, 1.0);
  Bench many(make_test_volume(std::vector<dvec3>(100, dvec3(0.3)), {values, values}), 1);
  EXPECT_LE(many.cut(view_of_all(many.random), goal(1)).splats, many.volume.info.resolution_counts[0]);
  const Cut all = many.cut(view_of_all(many.random), goal(1000));
  EXPECT_GT(all.splats, 0u);
  EXPECT_TRUE(std::isfinite(all.squared_error));

  // Only the shape of the splats causes an error. The expected error is small, and few splats meet the goal.
  Bench alike(sample_volume(2000, 29), 29);
  const View view = view_of_all(alike.random);
  EXPECT_LT(alike.cut(view, goal(500)).squared_error, 1e-6);
  EXPECT_LT(alike.cut(view, goal(1u << 20, 1e-3)).splats, 500u);
}

TEST(CutByError, SaysWhenMoreSplatsWouldNotHelp) {
  Bench bench(sample_volume(3000, 33), 33, edge_at(40));
  for (int trial = 0; trial < 8; ++trial) {
    const View view = random_view(bench.random);
    const Cut all = bench.cut(view, goal(1u << 20));
    EXPECT_TRUE(all.finest);
    EXPECT_GE(all.squared_goal_error, 0.999 * all.squared_error);
    if (all.splats < 200) continue;
    const Cut some = bench.cut(view, goal(all.splats / 4));
    EXPECT_FALSE(some.finest && some.splats <= all.splats / 4) << some.splats << " of " << all.splats;
    EXPECT_GT(some.squared_goal_error, all.squared_goal_error);
  }
}

TEST(CutByError, IsBackToFront) {
  Bench bench(sample_volume(2500, 30), 30, edge_at(20));
  std::size_t pairs = 0;
  for (int trial = 0; trial < 40; ++trial) {
    const View view = random_view(bench.random);
    expect_back_to_front(bench.cut(view, goal(1200)), view, pairs);
  }
  EXPECT_GT(pairs, 1000u);
}

TEST(CutByError, OfWhatIsThere) {
  struct There final : Residency {
    explicit There(std::size_t most_resolutions) : most(most_resolutions) {}
    bool holds(std::span<const PointRange> ranges) override { return ranges.size() <= most; }
    std::size_t most;
  };
  Bench bench(sample_volume(2500, 31), 31, edge_at(45));
  for (int trial = 0; trial < 10; ++trial) {
    const View view = view_of_all(bench.random);
    CutOptions options = goal(1500);
    options.kernel = bench.kernel;
    There all(64), coarsest(1), some(2);
    const auto resident = [&](Residency& there) {
      auto cut = select_resident_cut(bench.opened->info(), bench.paged, there, view, bench.visibility, options);
      EXPECT_TRUE(cut);
      return cut.value_or(Cut{});
    };
    EXPECT_EQ(resident(all), bench.cut(view, options));
    EXPECT_EQ(resident(coarsest).splats, bench.volume.info.resolution_counts[0]);
    for (There* there : {&all, &coarsest, &some})
      ASSERT_THAT(coverage(bench.volume, resident(*there)), testing::Each(1));
  }
}

}  // namespace
}  // namespace splatvol::test
