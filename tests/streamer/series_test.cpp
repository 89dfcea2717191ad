// Time steps of one file, read one after the other.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <optional>

#include "builder/series/series_build.h"
#include "streamer/splats/streamer.h"
#include "tests/builder/support/built_mesh.h"
#include "tests/streamer/fixture.h"
#include "tests/support/fault_source.h"
#include "tests/support/require.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

constexpr std::size_t step_count = 4;

struct StepsOfAFile : testing::TestWithParam<KernelKind> {
  static void SetUpTestSuite() {
    folder_.emplace();
    std::vector<SeriesStep> steps;
    BuildOptions options;
    options.index_leaf_points = 255;  // several index pages
    for (std::size_t step = 0; step < step_count; ++step) {
      steps.push_back(step_at(step));
      const auto source = steps.back().open().value();
      require(build_volume(*source, single(step), options, [](const char*, double) {}));
    }
    require(build_series(std::move(steps), path(), options, [](const char*, double) {}));
  }
  static void TearDownTestSuite() { folder_.reset(); }

  static SeriesStep step_at(std::size_t step) {
    const auto t = static_cast<double>(step);
    return mesh_step({}, lattice(28), [t](dvec3 p) { return std::sin(5 * p.x + t) + 100 * t; });
  }
  static format::SectionEntry index_pages(const format::Volume& volume) {
    for (const format::SectionEntry& section : volume.sections())
      if (section.kind == format::SectionKind::index_pages) return section;
    return {};
  }
  static std::string path() { return folder_->path("series.svol"); }
  static std::string single(std::size_t step) { return folder_->path(fmt::format("{}.svol", step)); }

  static std::unique_ptr<Streamer> open(const std::string& file, std::uint64_t memory = 512u << 20) {
    return Streamer::open(open_file(file).value(), {memory, "value", GetParam()}).value();
  }
  static View view() {
    Camera camera{.position = {0.4, 0.7, 3}, .focal_point = {0.5, 0.5, 0.5}, .up = {0, 1, 0}};
    return make_view(camera, 120, 90).value();
  }
  static TransferFunction function() { return {-1, 301, {{0, {1, 0, 0}}, {1, {0, 0, 1}}}, {{0, 2}, {1, 3}}}; }

  static void expect_same_frames(Streamer& streamer, const std::string& file, const Detail& detail) {
    const FrameSplats& frame = *streamer.request(view(), function(), detail).value();
    const auto fresh = open(file);
    const FrameSplats& expected = *fresh->request(view(), function(), detail).value();
    ASSERT_EQ(frame.splats, expected.splats);
    EXPECT_EQ(streamer.units().value_offset, fresh->units().value_offset);
    EXPECT_EQ(streamer.units().value_scale, fresh->units().value_scale);
    EXPECT_EQ(bytes_of(frame.list), bytes_of(expected.list));
  }

  static inline std::optional<TempFolder> folder_;
};
INSTANTIATE_TEST_SUITE_P(Kernels, StepsOfAFile, testing::Values(KernelKind::octant, KernelKind::moments), kernel_name);

TEST_P(StepsOfAFile, SplatsAreThoseOfAFileOfTheStep) {
  const auto streamer = open(path());
  for (const std::size_t step : {0u, 2u, 1u, 3u, 3u}) {
    ASSERT_TRUE(streamer->set_step(step));
    for (const double tolerance : {0.0, 8.0}) expect_same_frames(*streamer, single(step), {tolerance, {}});
  }
  EXPECT_FALSE(streamer->set_step(step_count));
}

TEST_P(StepsOfAFile, AStepReadsItsOwnBytesOnly) {
  const auto streamer = open(path());
  static_cast<void>(streamer->request(view(), function(), {0, {}}).value());
  for (std::size_t step = 0; step + 1 < step_count; ++step) {
    const std::uint64_t before = streamer->statistics().bytes_read;
    ASSERT_TRUE(streamer->set_step(step));
    static_cast<void>(streamer->request(view(), function(), {0, {}}).value());
    const std::uint64_t read = streamer->statistics().bytes_read - before;
    const format::Volume& volume = streamer->volume();
    // A load run may begin in the preamble, and is then read whole.
    EXPECT_LE(read,
              volume.series()->steps[step].bytes + index_pages(volume).packed_bytes + format::min_first_read_bytes);
    const auto fresh = open(single(step));
    static_cast<void>(fresh->request(view(), function(), {0, {}}).value());
    EXPECT_LT(read, fresh->statistics().bytes_read);
  }
}

// At the next step, an index page is what it was, but for its summaries.
TEST_P(StepsOfAFile, IndexPagesKeepTheirStructure) {
  for (const bool paging : {false, true}) {
    const auto faults = std::make_shared<Faults>(open_file(path()).value());
    const auto streamer =
        Streamer::open(std::make_unique<FaultSource>(faults), {512u << 20, "value", GetParam()}).value();
    const auto show = [&] {
      if (!paging) return streamer->request(view(), function(), {2, {}}).has_value();
      const FrameSplats* frame = nullptr;
      do {
        const auto next = streamer->advance(view(), function(), {2, {}}, 1);
        if (!next || !(*next)->progress.errors.empty()) return false;
        frame = *next;
      } while (!frame->progress.complete);
      return true;
    };
    ASSERT_TRUE(streamer->set_step(0));
    const format::SectionEntry pages = index_pages(streamer->volume());
    faults->fail_range(pages.offset, pages.offset + pages.packed_bytes);
    ASSERT_FALSE(show()) << "the view needs index pages";
    faults->clear();
    ASSERT_TRUE(streamer->set_step(0));
    ASSERT_TRUE(show());
    faults->fail_range(pages.offset, pages.offset + pages.packed_bytes);
    for (const std::size_t step : {1u, 2u, 0u, 3u}) {
      ASSERT_TRUE(streamer->set_step(step));
      EXPECT_TRUE(show()) << step;
    }
  }
}

TEST_P(StepsOfAFile, APrefetchedStepReadsNothingMore) {
  const auto streamer = open(path());
  ASSERT_TRUE(streamer->set_step(0));
  static_cast<void>(streamer->request(view(), function(), {0, {}}).value());
  for (std::size_t step = 1; step < step_count; ++step) {
    streamer->prefetch_step(step);
    ASSERT_TRUE(streamer->set_step(step));
    const std::uint64_t before = streamer->statistics().bytes_read;
    expect_same_frames(*streamer, single(step), {0, {}});
    EXPECT_EQ(streamer->statistics().bytes_read, before);
  }
}

TEST_P(StepsOfAFile, MemoryIsNeverPassed) {
  const std::uint64_t memory = 6u << 20;
  const auto streamer = open(path(), memory);
  for (std::size_t round = 0; round < 2; ++round)
    for (std::size_t step = 0; step < step_count; ++step) {
      ASSERT_TRUE(streamer->set_step(step));
      ASSERT_TRUE(streamer->request(view(), function(), {0, {}}));
      streamer->prefetch_step((step + 1) % step_count);
      EXPECT_LE(streamer->statistics().bytes_resident_peak, memory);
    }
}

TEST_P(StepsOfAFile, PagingStartsAnew) {
  const auto streamer = open(path());
  for (const std::size_t step : {1u, 0u}) {
    ASSERT_TRUE(streamer->set_step(step));
    const FrameSplats* frame = streamer->advance(view(), function(), {2, {}}).value();
    for (int i = 0; i < 1000 && !frame->progress.complete; ++i)
      frame = streamer->advance(view(), function(), {2, {}}, 1).value();
    EXPECT_TRUE(frame->progress.complete);
    EXPECT_TRUE(frame->progress.errors.empty());
  }
}

TEST_P(StepsOfAFile, AStepInAnotherFileIsShownToo) {
  const auto streamer = open(single(0));
  ASSERT_TRUE(streamer->request(view(), function(), {0, {}}));
  ASSERT_TRUE(streamer->set_step(format::Volume::open(open_file(single(2)).value()).value()));
  expect_same_frames(*streamer, single(2), {0, {}});
}

}  // namespace
}  // namespace splatvol::test
