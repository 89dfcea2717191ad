#include "builder/pipeline/estimate.h"

#include <gtest/gtest.h>

#include "builder/opening/open_own.h"
#include "tests/support/results.h"

namespace splatvol::test {
namespace {

InputSize size_of(const std::string& input, const SourceOptions& options = {}) {
  const auto source = value_of(open_own({input}, options));
  return value_of(measure_input(*source, true));
}

BuildOptions with_memory(std::uint64_t bytes) { return {.memory = bytes}; }

void expect_rises(const Range& range) {
  EXPECT_GT(range.low, 0);
  EXPECT_LT(range.low, range.high);
}

TEST(MeasureInput, TakesWhatPointsDeclare) {
  const InputSize size = size_of("gen:points:count=1e12");  // which no test could read
  EXPECT_EQ(size.points, 1'000'000'000'000U);
  EXPECT_EQ(size.attributes, 1U);
  EXPECT_FALSE(size.was_read);
  EXPECT_FALSE(size.has_material);
}

TEST(MeasureInput, ReadsMeshesPieceByPiece) {
  const auto source = value_of(open_own({"gen:mesh:cells=1e5,pieces=3"}, {}));
  double share = 0;
  const auto size = value_of(measure_input(*source, true, [&](double fraction) {
    EXPECT_GE(fraction, share);
    share = fraction;
  }));
  EXPECT_TRUE(size.was_read && size.has_material);
  EXPECT_EQ(size.pieces, 3U);
  EXPECT_NEAR(static_cast<double>(size.tetrahedra), 1e5, 2e4);
  EXPECT_GT(size.points, size.tetrahedra / 7);
  EXPECT_EQ(share, 1);
}

TEST(EstimateBuild, IsARangeOfEachPart) {
  for (const std::string input : {"gen:points:count=1000", "gen:points:count=1e8", "gen:mesh:cells=1e5"}) {
    const BuildEstimate estimate = estimate_build(size_of(input), {}, 1, 2);
    for (const Range& range : {estimate.file, estimate.disk, estimate.memory, estimate.seconds}) expect_rises(range);
    EXPECT_GE(estimate.disk.low, estimate.file.low) << input;
  }
}

TEST(EstimateBuild, ChoosesTheConnectivityAsABuildDoes) {
  const auto used = [](const std::string& input, Connectivity asked = Connectivity::automatic) {
    return estimate_build(size_of(input), {.connectivity = asked}, 1, 2).connectivity;
  };
  EXPECT_EQ(used("gen:mesh:cells=1e4"), Connectivity::mesh);
  EXPECT_EQ(used("gen:points:count=1e6"), Connectivity::delaunay);
  EXPECT_EQ(used("gen:points:count=2e6"), Connectivity::none);
  EXPECT_EQ(used("gen:points:count=1e8"), Connectivity::boxes);
  EXPECT_EQ(used("gen:points:count=1e8", Connectivity::delaunay), Connectivity::delaunay);
}

TEST(EstimateBuild, MoreMemoryTakesLessDisk) {
  const InputSize size = size_of("gen:points:count=1e8");
  const BuildEstimate little = estimate_build(size, with_memory(std::uint64_t{64} << 20), 1, 2);
  const BuildEstimate much = estimate_build(size, with_memory(std::uint64_t{64} << 30), 1, 2);
  EXPECT_GT(little.disk.high, much.disk.high);
  EXPECT_LT(little.memory.high, much.memory.high);
  EXPECT_EQ(little.file.high, much.file.high);
}

TEST(EstimateBuild, StepsShareTheirMesh) {
  const InputSize size = size_of("gen:mesh:cells=1e5");
  const BuildEstimate one = estimate_build(size, {}, 1, 2), ten = estimate_build(size, {}, 10, 2);
  EXPECT_GT(ten.file.high, one.file.high);
  EXPECT_LT(ten.file.high, 10 * one.file.high);
  EXPECT_GT(ten.seconds.low, one.seconds.low);
  EXPECT_GT(ten.memory.high, one.memory.high);  // they are reduced together
}

TEST(EstimateBuild, KeptCellsTakeRoomAndTime) {
  const InputSize size = size_of("gen:mesh:cells=1e5");
  BuildOptions options;
  const BuildEstimate without = estimate_build(size, options, 1, 2);
  options.keep_cells = true;
  const BuildEstimate with = estimate_build(size, options, 1, 2);
  const auto tetrahedra = static_cast<double>(size.tetrahedra);
  EXPECT_NEAR(with.file.high - without.file.high, 3.2 * tetrahedra, 1);
  EXPECT_GT(with.disk.high, without.disk.high + 3.2 * tetrahedra);
  EXPECT_GT(with.seconds.low, without.seconds.low);
}

// Each point has some six of them; the builder counts them.
TEST(EstimateBuild, KeptDelaunayTetrahedraTakeRoom) {
  const InputSize size = size_of("gen:points:count=1e5");
  BuildOptions options;
  const BuildEstimate without = estimate_build(size, options, 1, 2);
  ASSERT_EQ(without.connectivity, Connectivity::delaunay);
  options.keep_cells = true;
  const BuildEstimate with = estimate_build(size, options, 1, 2);
  EXPECT_GT(with.file.high, without.file.high + 6 * 2.9 * 1e5);
  options.connectivity = Connectivity::boxes;  // these have no cells
  const double kept = estimate_build(size, options, 1, 2).file.high;
  options.keep_cells = false;
  EXPECT_EQ(kept, estimate_build(size, options, 1, 2).file.high);
}

TEST(EstimateBuild, ThreadsSaveTime) {
  const InputSize size = size_of("gen:points:count=1e8");
  EXPECT_LT(estimate_build(size, {}, 1, 8).seconds.high, estimate_build(size, {}, 1, 1).seconds.low);
}

TEST(EstimateBuild, SaysWhatIsNeededBeyondTheGrant) {
  const BuildEstimate estimate =
      estimate_build(size_of("gen:points:count=1e6"), with_memory(std::uint64_t{64} << 20), 1, 2);
  EXPECT_GT(estimate.least_memory, std::uint64_t{800} << 20);  // all points are joined at once
}

}  // namespace
}  // namespace splatvol::test
