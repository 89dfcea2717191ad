#include "streamer/fade.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <tuple>

#include "streamer/paged_volume.h"
#include "tests/streamer/fixture.h"

namespace splatvol::test {
namespace {

constexpr std::uint64_t plenty = std::numeric_limits<std::uint64_t>::max();
constexpr double rounding = 1e-5;  // of sums of single-precision weights

// Everything is resident, except a random share, which is another for each question.
struct Shelf final : Residency {
  double missing = 0;
  std::mt19937 random{1};

  bool holds(std::span<const PointRange>) override {
    return std::uniform_real_distribution<double>(0, 1)(random) >= missing;
  }
};

// Cuts of a volume in memory that fade into each other.
struct FadeTest : testing::Test {
  Cut cut(const View& view, double percent) {
    CutOptions options{.detail = {.tolerance_percent = percent}, .kernel = KernelKind::octant};
    options.compare_above = 16;  // many nodes
    return select_cut(opened->info(), paged, view, visibility, options).value();
  }
  void advance(const View& view, Cut next, double change, std::uint64_t most_splats = plenty) {
    shown = fade(opened->info().cube, view, shown, std::move(next), shelf, {change, most_splats});
  }

  // Returns the sum of weights that is drawn for each point.
  std::vector<double> coverage() const {
    return test::coverage(volume, shown.cut, [this](std::size_t i) { return static_cast<double>(shown.weight_of(i)); });
  }

  // Weights by cube and resolution.
  using Weights = std::map<std::tuple<double, double, double, double, std::uint32_t>, double>;
  Weights weights() const {
    Weights result;
    for (std::size_t i = 0; i < shown.cut.items.size(); ++i) {
      const CutItem& item = shown.cut.items[i];
      const dvec3& origin = item.cube.origin;
      result[{origin.x, origin.y, origin.z, item.cube.edge, item.resolution}] +=
          static_cast<double>(shown.weight_of(i));
    }
    return result;
  }

  TestVolume volume = sample_volume(4000, 61);
  std::shared_ptr<const format::Volume> opened = format::Volume::open(source_of(volume)).value();
  MemoryBudget budget{1u << 30};
  Cache cache{budget};
  PagedVolume paged{*opened, {1}, cache};
  ValueVisibility visibility{opaque(), volume.info.attributes[1]};
  Shelf shelf;
  FadingCut shown;
};

double largest_change(const std::map<std::tuple<double, double, double, double, std::uint32_t>, double>& a,
                      const std::map<std::tuple<double, double, double, double, std::uint32_t>, double>& b) {
  double largest = 0;
  const auto compare = [&](const auto& from, const auto& to) {
    for (const auto& [key, weight] : from) {
      const auto found = to.find(key);
      largest = std::max(largest, std::abs(weight - (found == to.end() ? 0 : found->second)));
    }
  };
  compare(a, b);
  compare(b, a);
  return largest;
}

View view_of_all(std::uint32_t seed) {
  std::mt19937 random(seed);
  return test::view_of_all(random);
}

// Each call changes weights by `change`, however often the tolerance changes meanwhile. Each point is drawn once.
TEST_F(FadeTest, NoWeightJumpsAndEachPointIsDrawnOnce) {
  std::mt19937 random(62);
  const View view = view_of_all(62);
  const double change = 0.13;  // 1 is not a multiple of it: the last change is smaller
  advance(view, cut(view, 4), change);
  std::size_t fading = 0, waiting = 0;
  for (int frame = 0; frame < 300; ++frame) {
    const double percent = std::exp2(std::uniform_real_distribution<double>(-2, 5)(random) * (frame % 40 < 20));
    const Weights before = weights();
    const Cut next = cut(view, percent);
    advance(view, next, change);
    ASSERT_LE(largest_change(before, weights()), change + rounding) << "frame " << frame;
    ASSERT_THAT(coverage(), testing::Each(testing::DoubleNear(1, rounding))) << "frame " << frame;
    fading += shown.fades.empty() ? 0 : 1;
    std::uint64_t splats = 0;
    for (std::size_t i = 0; i < shown.cut.items.size(); ++i)
      if (shown.roles.empty() || !shown.roles[i].leaving)
        for (const PointRange& range : shown.cut.ranges_of(shown.cut.items[i])) splats += range.count;
    waiting += splats != next.splats ? 1 : 0;
  }
  EXPECT_GT(fading, 150u);
  EXPECT_GT(waiting, 50u) << "for fades to end";
}

TEST_F(FadeTest, EndsInTheNextCutAfterAsManySteps) {
  const View view = view_of_all(63);
  for (const double percent : {8.0, 1.0, 30.0}) {
    const Cut next = cut(view, percent);
    const bool first = shown.cut.items.empty();
    int steps = 0;
    for (bool steady = false; !steady; ++steps) {
      advance(view, next, 0.1);
      steady = shown.fades.empty();
      ASSERT_LE(steps, 10);
      for (const Fade& fade : shown.fades) EXPECT_NEAR(fade.weight, 0.1 * (steps + 1), rounding);
    }
    EXPECT_EQ(steps, first ? 1 : 10) << "nothing fades at first";
    EXPECT_EQ(shown.cut, next);
  }
}

// Points in the picture. Some were out of view when a change began.
TEST_F(FadeTest, WhatComesIntoViewIsDrawnOnce) {
  Camera camera{.vertical_fov_degrees = 12, .position = {0.5, 0.5, 4}};
  std::size_t fading = 0, checked = 0;
  for (int frame = 0; frame < 600; ++frame) {
    shelf.missing = frame < 400 ? 0 : 0.01;
    camera.focal_point = dvec3(0.5) + 0.5 * dvec3(std::sin(0.05 * frame), std::sin(0.083 * frame), 0);
    const View view = make_view(camera, 200, 150).value();
    constexpr std::array percents{10.0, 40.0, 20.0, 80.0, 20.0, 5.0};
    advance(view, cut(view, percents[static_cast<std::size_t>(frame) / 7 % percents.size()]), 0.1);
    const std::vector<double> drawn = coverage();
    for (std::size_t point = 0; point < drawn.size(); ++point) {
      const dvec3 p = view.to_view(volume.positions[point]);
      if (!(p.z > 0 && std::abs(p.x) * view.focal < 100 * p.z && std::abs(p.y) * view.focal < 75 * p.z)) continue;
      ASSERT_NEAR(drawn[point], 1, rounding) << "frame " << frame << ", point " << point;
      ++checked;
    }
    fading += shown.fades.size();
  }
  EXPECT_GT(fading, 1000u);
  EXPECT_GT(checked, 100000u);
}

bool overlap(const Cube& a, const Cube& b) {
  const double slack = 1e-12;
  return glm::all(glm::lessThan(a.origin + slack, b.origin + b.edge)) &&
         glm::all(glm::lessThan(b.origin + slack, a.origin + a.edge));
}

TEST_F(FadeTest, IsBackToFront) {
  std::mt19937 random(65);
  std::size_t pairs = 0, overlapping = 0;
  for (int frame = 0; frame < 40; ++frame) {
    const View view = test::view_of_all(random);
    advance(view, cut(view, frame % 2 == 0 ? 3 : 6), 0.3);
    const std::vector<CutItem>& items = shown.cut.items;
    for (std::size_t i = 0; i < items.size(); ++i)
      for (std::size_t j = i + 1; j < items.size(); ++j, ++pairs) {
        if (overlap(items[i].cube, items[j].cube)) {
          ASSERT_GE(items[i].cube.edge, items[j].cube.edge);
          ++overlapping;
        } else {
          ASSERT_FALSE(may_hide(view, items[i].cube, items[j].cube)) << "frame " << frame << ": " << i << ", " << j;
        }
      }
  }
  EXPECT_GT(pairs, 10000u);
  EXPECT_GT(overlapping, 100u);
}

TEST_F(FadeTest, WithoutRoomOrOldSplatsItChangesAtOnce) {
  const View view = view_of_all(66);
  const Cut coarse = cut(view, 8), fine = cut(view, 2);
  advance(view, coarse, 0.1);
  advance(view, fine, 0.1, 0);
  EXPECT_EQ(shown.cut, fine);

  advance(view, coarse, 0.1, fine.splats / 2);
  EXPECT_GT(shown.fades.size(), 0u) << "half of it has room";
  EXPECT_LE(shown.cut.splats, coarse.splats + fine.splats / 2);
  EXPECT_GT(shown.cut.splats, coarse.splats + fine.splats / 4);
  EXPECT_THAT(coverage(), testing::Each(testing::DoubleNear(1, rounding)));

  shelf.missing = 1;
  advance(view, coarse, 0.1);
  EXPECT_EQ(shown.cut, coarse);
  EXPECT_TRUE(shown.fades.empty());
}

TEST_F(FadeTest, OfFewAndOfCoincidentPoints) {
  for (const std::size_t count : {1u, 700u}) {
    volume = make_test_volume(std::vector<dvec3>(count, dvec3(0.3)), {std::vector<double>(count, 1.0)}, {});
    opened = format::Volume::open(source_of(volume)).value();
    PagedVolume pages(*opened, {0}, cache);
    const View view = view_of_all(67);
    CutOptions options{.kernel = KernelKind::octant};
    const ValueVisibility visible(opaque(), volume.info.attributes[0]);
    FadingCut last;
    for (int frame = 0; frame < 12; ++frame) {
      options.detail.tolerance_percent = frame < 3 ? std::numeric_limits<double>::infinity() : 0;
      const Cut next = select_cut(opened->info(), pages, view, visible, options).value();
      last = fade(opened->info().cube, view, last, next, shelf, {0.2, plenty});
      if (frame >= 8) {
        EXPECT_EQ(last.cut, next);
      }
    }
    cache.clear();
  }
}

}  // namespace
}  // namespace splatvol::test
