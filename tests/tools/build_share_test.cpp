// The share of a build never falls, whatever its stages tell.
#include "tools/build_share.h"

#include <gtest/gtest.h>

#include <initializer_list>

namespace splatvol::test {
namespace {

TEST(BuildShare, GrowsFromStageToStage) {
  BuildShare share;
  double before = share.state().share;
  EXPECT_EQ(before, 0);
  for (const char* stage : {"reading", "connecting", "reducing", "indexing", "simplifying the boundary",
                            "sorting cells", "writing", "writing cells", "checking"})
    for (const double fraction : {0.25, 0.5, 1.0}) {
      share.update(stage, fraction);
      EXPECT_GT(share.state().share, before) << stage;
      EXPECT_EQ(share.state().stage, stage);
      before = share.state().share;
    }
  EXPECT_NEAR(before, 1, 1e-9);
  share.update("reading", 0);
  EXPECT_EQ(share.state().share, before);
}

TEST(BuildShare, BytesOfTheReaderCountBeforeThereArePieces) {
  BuildShare share;
  share.read(0.5);
  const double half = share.state().share;
  EXPECT_GT(half, 0);
  share.read(0.4);
  EXPECT_EQ(share.state().share, half);
  share.update("reading", 0);
  EXPECT_EQ(share.state().share, half);
  share.update("reading", 0.5);
  EXPECT_GT(share.state().share, half);
}

TEST(BuildShare, StepsOfASeriesShareIt) {
  BuildShare share;
  share.set_steps(4);
  const auto build_group = [&](std::initializer_list<std::size_t> steps) {
    for (const std::size_t step : steps) share.open_step(step);
    share.update("reading", 0);
    share.update("checking", 1);
    return share.state().share;
  };
  EXPECT_NEAR(build_group({0, 1}), 0.5, 1e-9);
  EXPECT_NEAR(build_group({2}), 0.75, 1e-9);
  EXPECT_NEAR(build_group({3}), 1, 1e-9);
}

}  // namespace
}  // namespace splatvol::test
