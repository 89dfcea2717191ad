#include "streamer/splats/occlusion.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <optional>
#include <random>
#include <set>
#include <utility>
#include <vector>

#include "streamer/splats/cut.h"
#include "streamer/splats/paged_volume.h"
#include "tests/builder/support/built_input.h"
#include "tests/streamer/fixture.h"
#include "tests/support/random.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

// Returns how long the line from the eye to `to` is inside a cube. With parallel rays it begins in the eye's plane.
double way_within(const Cube& cube, const View& view, const dvec3& to) {
  const dvec3 way = view.orthographic ? view.to_view(to).z * view.forward : to - view.eye;
  const dvec3 from = to - way;
  double enter = 0, leave = 1;
  for (int axis = 0; axis < 3; ++axis) {
    double a = (cube.origin[axis] - from[axis]) / way[axis],
           b = (cube.origin[axis] + cube.edge - from[axis]) / way[axis];
    if (a > b) std::swap(a, b);
    enter = std::max(enter, a);
    leave = std::min(leave, b);
  }
  return std::max(leave - enter, 0.0) * glm::length(way);
}

bool is_in_picture(const View& view, const dvec3& point) {
  const dvec3 p = view.to_view(point);
  const double scale = view.orthographic ? view.focal : view.focal / p.z;
  return p.z > 0 && std::abs(p.x) * scale < 0.5 * view.width && std::abs(p.y) * scale < 0.5 * view.height;
}

// Octants of the unit cube, some of them opaque. Every position in a hidden cube must be hidden.
TEST(Occlusion, HidesOnlyWhatCannotBeSeen) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(0, 1);
  int hidden = 0;
  for (int trial = 0; trial < 400; ++trial) {
    const View view = random_view(random);
    Occlusion occlusion(view);
    std::vector<std::pair<Cube, double>> cubes;
    // Octants of octants, front to back.
    const std::function<void(const Cube&, int)> visit = [&](const Cube& cube, int depth) {
      if (depth == 2) {
        if (occlusion.is_small(cube) || uniform(random) < 0.3) return;
        cubes.emplace_back(cube, 40 * uniform(random));
        return occlusion.add(cube, cubes.back().second);
      }
      const unsigned nearest = nearest_octant(view, cube);
      for (unsigned i = 0; i < 8; ++i) {
        const unsigned octant = i ^ nearest;
        const double edge = 0.5 * cube.edge;
        visit({cube.origin + edge * dvec3(octant & 1, octant >> 1 & 1, octant >> 2), edge}, depth + 1);
      }
    };
    visit({dvec3(0), 1}, 0);
    for (int i = 0; i < 200; ++i) {
      const Cube cube{{1.4 * uniform(random) - 0.2, 1.4 * uniform(random) - 0.2, 1.4 * uniform(random) - 0.2},
                      0.1 * uniform(random)};
      if (!occlusion.hides(cube)) continue;
      ++hidden;
      for (int sample = 0; sample < 20; ++sample) {
        const dvec3 point = cube.origin + cube.edge * random_vector(uniform, random);
        if (!is_in_picture(view, point)) continue;
        double depth = 0;
        for (const auto& [front, extinction] : cubes) depth += extinction * way_within(front, view, point);
        // Between rays the optical depth may be slightly less.
        ASSERT_GT(depth, 0.8 * Occlusion::closed) << "trial " << trial;
      }
    }
  }
  EXPECT_GT(hidden, 1000);
}

TEST(Occlusion, AddsUpAlongRaysAndNotWithTheEyeInside) {
  Camera camera{.position = {0.5, 0.5, 10}, .focal_point = {0.5, 0.5, 0}};
  const View view = make_view(camera, 400, 300).value();
  const Cube front{{0, 0, 1}, 1}, back{{0, 0, 0}, 1}, behind{{0.3, 0.3, -1}, 0.4}, beside{{0.8, 0.3, -1}, 0.4};
  Occlusion occlusion(view);
  EXPECT_FALSE(occlusion.hides(behind));
  occlusion.add(front, 4);
  EXPECT_FALSE(occlusion.hides(behind)) << "of optical depth 4 only";
  occlusion.add(back, 4);
  EXPECT_TRUE(occlusion.hides(behind));
  EXPECT_FALSE(occlusion.hides(beside)) << "part of it shows";
  EXPECT_FALSE(occlusion.hides(back));
  EXPECT_FALSE(occlusion.hides({{0.4, 0.4, 1.5}, 0.2}));
  EXPECT_TRUE(occlusion.hides({{0.4, 0.4, 0.02}, 0.2})) << "inside, behind where the ray is closed";

  Occlusion inside(view);
  inside.add({{-10, -10, -5}, 30}, 100);
  EXPECT_FALSE(inside.hides(behind));
}

// The box [-2, 2] x [-2, 2] x [-1, 1], full of material. All of it is opaque, or half.
struct OpaqueMesh : FolderTest {
  void SetUp() override {
    build_input(input(), path("m.svol"));
    volume_ = format::Volume::open(open_file(path("m.svol")).value()).value();
    paged_ = std::make_unique<PagedVolume>(*volume_, format::SummaryAttributes{0}, own_room(1U << 30));
    filled_ = FilledNodes::find(*volume_, *paged_->root().value(), {0});
  }
  virtual const char* input() const { return "gen:mesh:cells=2e5"; }

  Cut cut(const View& view, double extinction, const CutOptions& options) {
    return cut(*paged_, view, extinction, options);
  }

  Cut cut(IndexPages& pages, const View& view, double extinction, const CutOptions& options) {
    const TransferFunction function{0, 1, {{0, {1, 1, 1}}}, {{0, extinction}}};
    const ValueVisibility visibility(function, volume_->info().attributes[0]);
    return select_cut(volume_->info(), pages, view, visibility, options).value();
  }

  static View view(dvec3 eye) {
    Camera camera{.position = eye};
    return make_view(camera, 512, 512).value();
  }

  std::shared_ptr<const format::Volume> volume_;
  std::unique_ptr<PagedVolume> paged_;
  FilledNodes filled_;
};

TEST_F(OpaqueMesh, IsFilled) {
  ASSERT_TRUE(filled_.any());
  EXPECT_FALSE(filled_.has(0)) << "the cube is twice the box";
}

TEST_F(OpaqueMesh, DrawsTheFrontOnly) {
  constexpr double extinction = 20;
  for (const dvec3 eye : {dvec3(5, 4, 8), dvec3(-9, 1, 2), dvec3(0.5, 12, 0.3)}) {
    for (const std::optional<ErrorGoal> goal : {std::optional<ErrorGoal>(), std::optional(ErrorGoal{0, 20000})}) {
      const View from = view(eye);
      CutOptions options{.detail = {.tolerance_percent = 1, .goal = goal}};
      const Cut all = cut(from, extinction, options);
      options.filled = &filled_;
      const Cut front = cut(from, extinction, options);
      if (!goal) {
        EXPECT_LT(front.splats, 0.8 * static_cast<double>(all.splats));
        // Nodes that are drawn are drawn as before.
        for (const CutItem& item : front.items)
          EXPECT_TRUE(std::ranges::any_of(all.items, [&](const CutItem& other) {
            return item.cube.origin == other.cube.origin && item.cube.edge == other.cube.edge &&
                   item.resolution == other.resolution;
          }));
      }
      // Nodes that are left out are all deep in the material.
      const auto is_drawn = [&](const dvec3& p) {
        return std::ranges::any_of(front.items, [&](const CutItem& item) {
          return glm::all(glm::lessThanEqual(item.cube.origin, p)) &&
                 glm::all(glm::lessThanEqual(p, item.cube.origin + item.cube.edge));
        });
      };
      std::mt19937 random(3);
      std::uniform_real_distribution<double> uniform(-1, 1);
      for (int sample = 0; sample < 2000; ++sample) {
        const dvec3 p(2 * uniform(random), 2 * uniform(random), uniform(random));
        if (is_drawn(p)) continue;
        const double way = way_within({{-2, -2, -2}, 4}, from, p);  // at least the length through the box
        double through = way;
        const dvec3 towards = glm::normalize(from.eye - p);
        for (const double side : {-1.0, 1.0})
          if (side * towards.z > 0) through = std::min(through, (side - p.z) / towards.z);
        ASSERT_GT(extinction * through, 0.9 * Occlusion::closed);
      }
    }
  }
}

TEST_F(OpaqueMesh, NothingIsHiddenByWhatCanBeSeenThrough) {
  CutOptions options;
  const Cut all = cut(view({5, 4, 8}), 1, options);
  options.filled = &filled_;
  EXPECT_EQ(cut(view({5, 4, 8}), 1, options), all);
}

TEST_F(OpaqueMesh, NorByWhatAClipBoxTakesAway) {
  View clipped = view({0, 0, 12});
  clipped.clip.box = Box{{-2, -2, -1}, {2, 2, -0.8}};
  CutOptions options;
  const Cut all = cut(clipped, 30, options);
  options.filled = &filled_;
  EXPECT_EQ(cut(clipped, 30, options), all) << "a slab of optical depth 6";
  clipped.clip = {std::nullopt, {make_plane({0, 0, -0.8}, {0, 0, -1})}};
  EXPECT_EQ(cut(clipped, 30, options), all) << "the same by a clip plane";
}

TEST_F(OpaqueMesh, WhatIsKeptIsTakenForTheSameViewAndValuesOnly) {
  CutOptions options{.filled = &filled_};
  CutOptions keeping = options;
  std::optional<KeptOcclusion> kept;
  keeping.kept_occlusion = &kept;
  View clipped = view({5, 4, 8});
  clipped.clip.box = Box{{-2, -2, -1}, {2, 2, -0.8}};
  for (const View& from : {view({5, 4, 8}), view({5, 4, 8.001}), clipped, view({5, 4, 8})})
    for (const double extinction : {20.0, 1.0, 40.0, 40.0})
      EXPECT_EQ(cut(from, extinction, keeping), cut(from, extinction, options)) << extinction;

  // Another tolerance reuses the kept occlusion, here one that hides nothing.
  kept->occlusion = Occlusion(view({5, 4, 8}));
  keeping.detail.tolerance_percent = 0.8;
  CutOptions all = keeping;
  all.filled = nullptr;
  all.kept_occlusion = nullptr;
  EXPECT_EQ(cut(view({5, 4, 8}), 40, keeping), cut(view({5, 4, 8}), 40, all));
}

// The pages of an index; some of them are there.
class SomePages final : public IndexPages {
 public:
  explicit SomePages(IndexPages& all) : all_(all) {}
  [[nodiscard]] Result<std::shared_ptr<const format::IndexPage>> root() override { return all_.root(); }
  [[nodiscard]] Result<std::shared_ptr<const format::IndexPage>> linked(const format::IndexPage& page,
                                                                        std::uint32_t node) override {
    const std::uint64_t offset = page.pages[page.links[node]].offset;
    asked.insert(offset);
    if (!there.contains(offset)) return nullptr;
    return all_.linked(page, node);
  }
  std::set<std::uint64_t> asked, there;

 private:
  IndexPages& all_;
};

// A mesh with more index pages than the root.
class OpaqueMeshInPages : public OpaqueMesh {
  const char* input() const override { return "gen:mesh:cells=1e6"; }
};

TEST_F(OpaqueMeshInPages, WhatIsKeptIsFoundAgainWhenPagesComeOrGo) {
  CutOptions options{.detail = {.tolerance_percent = 1}, .filled = &filled_};
  CutOptions keeping = options;
  std::optional<KeptOcclusion> kept;
  keeping.kept_occlusion = &kept;
  std::mt19937 random(5);
  int came = 0, went = 0;  // pages that the occlusion depends on
  for (const dvec3 eye : {dvec3(3, 2, 5), dvec3(-3, -2, 5), dvec3(3, -2, -5), dvec3(-3, 2, -5)}) {
    SomePages pages(*paged_), pages_of_fresh(*paged_);
    for (int step = 0; step < 12; ++step) {
      pages.asked.clear();
      pages_of_fresh.asked.clear();
      const Cut again = cut(pages, view(eye), 3, keeping), fresh = cut(pages_of_fresh, view(eye), 3, options);
      ASSERT_EQ(again, fresh) << "step " << step;
      EXPECT_EQ(again.complete, fresh.complete);
      ASSERT_EQ(pages.asked, pages_of_fresh.asked);
      if (pages.asked.empty()) break;

      // One of the pages that were asked for arrives, or is dropped.
      std::vector<std::uint64_t> asked(pages.asked.begin(), pages.asked.end());
      const std::uint64_t page = asked[random() % asked.size()];
      const bool comes = pages.there.insert(page).second;
      if (!comes) pages.there.erase(page);
      pages_of_fresh.there = pages.there;
      if (!kept->links.empty()) ++(comes ? came : went);
    }
  }
  EXPECT_GT(came, 3);
  EXPECT_GT(went, 3);
}

}  // namespace
}  // namespace splatvol::test
