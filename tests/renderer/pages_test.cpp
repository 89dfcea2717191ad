// The memory of OpenGL's rasterizer: pages, what stays in them, and what leaves.
#include "renderer/gl/gl_rasterizer.h"

#include <epoxy/gl.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "tests/renderer/draw_parts.h"
#include "tests/renderer/raster_test.h"
#include "tests/support/results.h"

namespace splatvol::test {
namespace {

constexpr float nan_value = std::numeric_limits<float>::quiet_NaN();

TransferFunction ramp(double extinction) {
  return {.lo = -1,
          .hi = 3,
          .colors = {{0, {1, 0, 0}}, {0.5, {0, 1, 0}}, {1, {0, 0, 1}}},
          .densities = {{0, 0}, {0.25, extinction}, {1, extinction}}};
}

const View view_of_all = perspective_view(64, 48, {0.3, 0.2, 4});

// Draws splats of random positions in parts of 500, with pages that hold few of them.
struct RendererTestPages : ::testing::Test {
  static constexpr std::uint64_t page_bytes = 16 << 10;

  void SetUp() override {
    ASSERT_TRUE(shared_context());
    auto made = value_of(GlRasterizer::create(KernelKind::octant));
    renderer_ = std::move(made);
  }

  static std::vector<OctantSplat> random_splats(std::size_t count) {
    std::mt19937 generator(12);
    std::uniform_real_distribution<float> coordinate(-1, 1);
    std::vector<OctantSplat> splats(count);
    for (OctantSplat& splat : splats)
      splat = {{coordinate(generator), coordinate(generator), coordinate(generator)},
               1 + 2 * coordinate(generator),
               0.1F,
               0};
    return splats;
  }

  static DrawList random_list(std::size_t count) {
    std::vector<DrawPart> parts;
    for (std::size_t first = 0; first < count; first += 500) parts.push_back({dvec3(0), first, 500});
    return make_list(random_splats(count), parts);
  }

  Image draw(GlRasterizer& rasterizer, SortMode sort = SortMode::exact) const {
    EXPECT_TRUE(rasterizer.set_transfer_function(ramp(2), {}));
    EXPECT_TRUE(rasterizer.draw(view_of_all, sort, 1));
    return rasterizer.read_image().value();
  }

  std::unique_ptr<GlRasterizer> renderer_;
};

TEST_F(RendererTestPages, DoNotChangeThePicture) {
  const DrawList list = random_list(20'000);
  const auto paged = GlRasterizer::create(KernelKind::octant, GlRasterizer::default_bytes, page_bytes).value();
  ASSERT_TRUE(renderer_->set_draw_list(list));
  ASSERT_TRUE(paged->set_draw_list(list));
  for (const SortMode sort : {SortMode::none, SortMode::axis, SortMode::exact}) {
    const Image expected = draw(*renderer_, sort);
    ASSERT_GT(total_alpha(expected), 100);
    EXPECT_EQ(rmse(draw(*paged, sort), expected), 0);
  }
}

TEST_F(RendererTestPages, OnlyNewRecordsGoUp) {
  DrawList list = random_list(5'000);
  ASSERT_TRUE(renderer_->set_draw_list(list));
  const std::uint64_t all = renderer_->uploaded_bytes();
  EXPECT_EQ(all, 5'000 * record_bytes(KernelKind::octant));
  const Image expected = draw(*renderer_);

  // Another view of the same rows: some are left out, one comes in part.
  DrawList part = list;
  part.ranges.erase(part.ranges.begin() + 3);
  part.ranges[5].begin += 17;
  part.ranges[5].count -= 17;
  ASSERT_TRUE(renderer_->set_draw_list(part));
  EXPECT_GT(rmse(draw(*renderer_), expected), 1e-4);
  ASSERT_TRUE(renderer_->set_draw_list(list));
  EXPECT_EQ(rmse(draw(*renderer_), expected), 0);
  EXPECT_EQ(renderer_->uploaded_bytes(), all);
}

TEST_F(RendererTestPages, RowsLeaveWhenOthersNeedTheirSlots) {
  const DrawList whole = random_list(40'000);
  DrawList first = whole, second = whole;
  first.ranges.resize(whole.ranges.size() / 2);
  second.ranges.erase(second.ranges.begin(), second.ranges.begin() + static_cast<std::ptrdiff_t>(first.ranges.size()));
  first.splats = second.splats = 20'000;

  // Room for about half of them.
  const auto small = GlRasterizer::create(KernelKind::octant, 1200 << 10, page_bytes).value();
  ASSERT_GT(small->plan_picture(64, 48), 10'000U);
  for (const DrawList* list : {&first, &second, &first, &second}) {
    ASSERT_TRUE(renderer_->set_draw_list(*list));
    ASSERT_TRUE(small->set_draw_list(*list));
    EXPECT_EQ(rmse(draw(*small), draw(*renderer_)), 0);
    EXPECT_LE(small->device_bytes(), 1200U << 10);
  }
  EXPECT_GT(small->uploaded_bytes(), 40'000 * record_bytes(KernelKind::octant));
  EXPECT_EQ(renderer_->uploaded_bytes(), 40'000 * record_bytes(KernelKind::octant));

  EXPECT_THAT(small->set_draw_list(whole), FailsWith(ErrorCode::out_of_budget));
  EXPECT_EQ(total_alpha(draw(*small)), 0);
  ASSERT_TRUE(small->set_draw_list(first));
  ASSERT_TRUE(renderer_->set_draw_list(first));
  EXPECT_EQ(rmse(draw(*small), draw(*renderer_)), 0);
}

// Rows that nothing else holds are no reason for more memory.
TEST_F(RendererTestPages, DroppedRowsMakeRoom) {
  ASSERT_TRUE(renderer_->set_draw_list(random_list(50'000)));
  draw(*renderer_);
  const std::uint64_t bytes = renderer_->device_bytes();
  for (int i = 0; i < 5; ++i) {
    ASSERT_TRUE(renderer_->set_draw_list(random_list(50'000)));
    draw(*renderer_);
  }
  EXPECT_LE(renderer_->device_bytes(), 3 * bytes);
}

// More splats than one buffer of software OpenGL holds.
TEST_F(RendererTestPages, MoreSplatsThanABufferHolds) {
  GLint64 limit = 0;
  glGetInteger64v(GL_MAX_SHADER_STORAGE_BLOCK_SIZE, &limit);
  if (limit > (1 << 28)) GTEST_SKIP() << "this device's limit of " << limit << " bytes is too far to reach in a test";
  const auto count = static_cast<std::size_t>(limit) / sizeof(OctantShape) + 1000;
  std::vector<OctantSplat> splats(50'000, {vec3(0, 0, -1), nan_value, 1, 0});
  const RecordRow missing = pack_row(splats, dvec3(0), 1);
  DrawList list;
  while (list.splats < count) {
    // The same splats as other rows, which go up again.
    const auto blocks = missing.shapes->blocks();
    const RecordRow row{
        std::make_shared<ShapeRow>(missing.shapes->records(), std::vector<RecordBlock>(blocks.begin(), blocks.end())),
        missing.values};
    append(list, row, 0, static_cast<std::uint32_t>(splats.size()));
  }
  splats.back().value = 0;
  append(list, pack_row(splats, dvec3(0), 1), 0, static_cast<std::uint32_t>(splats.size()));
  ASSERT_TRUE(renderer_->set_draw_list(list));
  EXPECT_GT(renderer_->device_bytes(), static_cast<std::uint64_t>(limit));
  ASSERT_TRUE(renderer_->set_transfer_function(ramp(1), {}));
  // The deviation of .4 pixels is widened to .5.
  ASSERT_TRUE(renderer_->draw(orthographic_view(1, 1, 1), SortMode::exact, 1));
  EXPECT_NEAR(renderer_->read_image()->at(0, 0).a, 0.64 * (1 - std::exp(-1.0)), 1e-3);
}

TEST_F(RendererTestPages, AsManySplatsAsFitTakeNoMore) {
  for (const std::uint64_t budget : {std::uint64_t{8} << 20, std::uint64_t{40} << 20}) {
    const auto rasterizer = GlRasterizer::create(KernelKind::octant, budget).value();
    const std::uint64_t most = rasterizer->plan_picture(100, 50);
    ASSERT_GT(most, 1000U);
    ASSERT_LT(most, budget / record_bytes(KernelKind::octant));
    ASSERT_TRUE(rasterizer->set_draw_list(
        make_list(std::vector<OctantSplat>(most, {vec3(0, 0, -1), 0, 0.01F, 0}), {{dvec3(0), 0, most}})));
    ASSERT_TRUE(rasterizer->set_transfer_function(ramp(1), {}));
    for (const int spacing : {1, 4}) {
      ASSERT_TRUE(rasterizer->draw(orthographic_view(50, 100, 50), SortMode::exact, spacing));
      EXPECT_LE(rasterizer->device_bytes(), budget);
    }
    EXPECT_GT(rasterizer->device_bytes(), budget / 2);
  }
  EXPECT_EQ(GlRasterizer::create(KernelKind::octant, 1 << 20).value()->plan_picture(4000, 4000), 0U);
}

TEST_F(RendererTestPages, CountsItsMemoryAndKeepsIt) {
  const std::uint64_t empty = renderer_->device_bytes();
  ASSERT_TRUE(renderer_->set_draw_list(random_list(1000)));
  draw(*renderer_);
  const std::uint64_t filled = renderer_->device_bytes();
  EXPECT_GE(filled - empty, 1000 * record_bytes(KernelKind::octant) + 64 * 48 * sizeof(vec4));
  for (int i = 0; i < 3; ++i) {
    ASSERT_TRUE(renderer_->set_draw_list(random_list(1000)));
    draw(*renderer_);
  }
  EXPECT_EQ(renderer_->device_bytes(), filled);
}

}  // namespace
}  // namespace splatvol::test
