// Files whose ranges and occupancies hide material, with correct hashes: a check of the whole file finds them (R22).
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <random>

#include "base/file.h"
#include "format/volume.h"
#include "tests/support/memory_source.h"
#include "tests/support/surgery.h"
#include "tests/support/test_volume.h"
#include "tests/support/volume_bytes.h"

namespace splatvol::test {
namespace {

using namespace format;
using testing::HasSubstr;

constexpr float middle = 0.5F;  // a value that no point has, and no material near a point

ValueSummary summary_of_middle(const TestVolume& volume) {
  return bins_of(volume.info.attributes[0]).summarize({&middle, 1});
}

// Some resolutions of such chunks are more than one walk through the index holds.
struct HiddenMaterial : testing::TestWithParam<std::uint32_t> {
  // Points with values near 0 and near 1.
  HiddenMaterial() {
    std::mt19937 random(5);
    std::uniform_real_distribution<double> uniform(0, 0.3);
    std::vector<double> values(700);
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = i % 2 == 0 ? uniform(random) : 1 - uniform(random);
    volume_ = make_test_volume(random_points(values.size(), 3), {values},
                               {.coarsest_points = 1, .node_points = 12, .points_per_chunk = GetParam()});
  }

  // Gives the splats of a resolution this distribution of values.
  void set_splats(std::size_t resolution, double mean, double deviation) {
    for (std::size_t i = 0; i < volume_.signals[0][resolution].size(); ++i) {
      SplatValue& value = volume_.signals[0][resolution][i];
      if (!(value.coverage > 0)) continue;
      value.mean = mean;
      value.deviation = deviation;
      volume_.materials[0][resolution][i].include(summary_of_middle(volume_));
    }
  }

  void occupy_nodes() {
    for (ValueSummary& summary : volume_.tree.summaries) summary.include(summary_of_middle(volume_));
  }

  TestVolume volume_;
};

INSTANTIATE_TEST_SUITE_P(PointsPerChunk, HiddenMaterial, testing::Values(64U, 65536U));

TEST_P(HiddenMaterial, WhatIsOccupiedIsAccepted) {
  for (std::size_t r = 0; r < volume_.info.resolutions(); ++r) set_splats(r, middle, 0);
  occupy_nodes();
  EXPECT_EQ(error_of(test_volume_bytes(volume_)), "");
}

TEST_P(HiddenMaterial, TheMeanOfTwoBodiesMayHaveAnEmptyBin) {
  for (std::size_t r = 0; r < volume_.info.resolutions(); ++r)
    for (SplatValue& value : volume_.signals[0][r]) value.mean = middle, value.deviation = 0.5;
  const ValueBins bins = bins_of(volume_.info.attributes[0]);
  const std::vector<float> both{static_cast<float>(bins.min), static_cast<float>(bins.max)};
  for (auto& of_resolution : volume_.materials[0])
    for (ValueSummary& summary : of_resolution) summary = bins.summarize(both);
  for (ValueSummary& summary : volume_.tree.summaries) summary.include(bins.summarize(both));
  ASSERT_EQ(volume_.materials[0][0][0].occupancy & summary_of_middle(volume_).occupancy, 0U);
  EXPECT_EQ(error_of(test_volume_bytes(volume_)), "");
}

TEST_P(HiddenMaterial, AChunkThatHidesItIsRefused) {
  for (std::size_t r = 0; r < volume_.info.resolutions(); ++r) {
    SCOPED_TRACE(r);
    const TestVolume before = volume_;
    set_splats(r, middle, 0);
    occupy_nodes();
    for (ValueSummary& summary : volume_.materials[0][r]) summary.occupancy &= ~summary_of_middle(volume_).occupancy;
    EXPECT_THAT(error_of(test_volume_bytes(volume_)), testing::AllOf(HasSubstr("chunk at"), HasSubstr("[R22]")));
    volume_ = before;
  }
}

TEST_P(HiddenMaterial, NodesThatHideItAreRefused) {
  for (std::size_t r = 0; r < volume_.info.resolutions(); ++r) {
    SCOPED_TRACE(r);
    const TestVolume before = volume_;
    set_splats(r, middle, 0);
    for (const std::size_t threads : {1, 4})
      EXPECT_THAT(error_of(test_volume_bytes(volume_), threads), testing::AllOf(HasSubstr("node"), HasSubstr("[R22]")));
    volume_ = before;
  }
}

// The occupancy is right, but a reader also looks at the range.
TEST_P(HiddenMaterial, NodesWhoseRangesEndBeforeItAreRefused) {
  set_splats(volume_.info.resolutions() - 1, middle, 0);
  occupy_nodes();
  const ValueSummary hidden = summary_of_middle(volume_);
  bool has_narrow_leaf = false;
  for (std::size_t node = 0; node < volume_.tree.size(); ++node) {
    ValueSummary& summary = volume_.tree.summaries[node];
    if (volume_.tree.child_masks[node] != 0) continue;
    std::vector<float> low;
    bool all_low = true;
    for (std::size_t i = 0; i < volume_.positions.size(); ++i)
      if (volume_.holds(node, i)) all_low = all_low && volume_.stored[0][i] < middle;
    if (!all_low) continue;
    has_narrow_leaf = true;
    summary.max = 0.45F;
    EXPECT_NE(summary.occupancy & hidden.occupancy, 0U);
  }
  ASSERT_TRUE(has_narrow_leaf);
  EXPECT_THAT(error_of(test_volume_bytes(volume_)), testing::AllOf(HasSubstr("node"), HasSubstr("[R22]")));
}

// Whatever the material: without the bins near the mean of one splat, its chunk is refused.
TEST(HiddenMaterial, EachSplatIsLookedAt) {
  const TestVolume volume = make_test_volume(random_points(300, 3), {std::vector<double>(300, 2.0)});
  const Dissected parts(test_volume_bytes(volume));
  std::size_t changed = 0;
  for (std::size_t chunk = 0; chunk < parts.count(Part::chunk); ++chunk) {
    const Bytes file = parts.assemble([&](Part part, std::size_t, Bytes& page) {
      if (part != Part::directory_page) return;
      const std::size_t at = sizeof(std::uint64_t) + chunk * sizeof(ChunkEntry);
      if (at + sizeof(ChunkEntry) > page.size()) return;
      auto entry = read_record<ChunkEntry>(page, at);
      changed += entry.occupancy != 0 ? 1 : 0;
      entry.occupancy <<= 1;
      std::memcpy(page.data() + at, &entry, sizeof(entry));
    });
    const auto opened = Volume::open(memory_source(file, "test.svol")).value();
    const bool has_values = opened->read_directory_page(0).value().chunks[chunk].entry.occupancy != 0;
    EXPECT_EQ(error_of(file).empty(), !has_values) << chunk;
  }
  EXPECT_GT(changed, 5U);
}

}  // namespace
}  // namespace splatvol::test
