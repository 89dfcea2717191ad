// Steps that play.
#include "player/playing.h"

#include <gtest/gtest.h>

namespace splatvol {
namespace {

TEST(Playing, EndsAtTheLastStepUnlessItLoops) {
  Playing playing;
  EXPECT_EQ(playing.next(0, 3), std::nullopt) << "it has not begun";
  playing.begin();
  EXPECT_EQ(playing.next(0, 3), 1U);
  EXPECT_TRUE(playing.is_begun());
  EXPECT_EQ(playing.next(2, 3), std::nullopt);
  EXPECT_FALSE(playing.is_begun());

  playing.loops = true;
  playing.begin();
  EXPECT_EQ(playing.next(2, 3), 0U);
  EXPECT_TRUE(playing.is_begun());
}

TEST(Playing, EndsIfTheAwaitedStepDoesNotCome) {
  Playing playing;
  playing.begin();
  playing.await(1);
  EXPECT_EQ(playing.next(1, 3), 2U);
  EXPECT_EQ(playing.next(1, 3), 2U) << "nothing was asked for since";
  playing.await(2);
  EXPECT_EQ(playing.next(1, 3), std::nullopt);
  EXPECT_FALSE(playing.is_begun());

  playing.begin();
  playing.await(1);
  playing.end();
  playing.begin();
  EXPECT_EQ(playing.next(0, 3), 1U) << "what was awaited is forgotten";
}

// Frames do not divide a step's time.
TEST(Playing, KeepsTheRateOnTheAverage) {
  Playing playing;
  playing.steps_per_second = 4;
  playing.begin();
  int steps = 0;
  for (int frames = 0; frames < 1000; ++frames) {
    playing.pass(0.07);
    steps += playing.is_due(true) ? 1 : 0;
  }
  EXPECT_NEAR(steps, 4 * 70, 1);
}

TEST(Playing, LeavesTimeToShowAPicture) {
  Playing playing;
  playing.steps_per_second = 4;
  EXPECT_DOUBLE_EQ(playing.picture_seconds(), 0.2);
}

TEST(Playing, WaitsForTheNextStepAndCatchesUpOnce) {
  Playing playing;
  playing.begin();
  for (int frames = 0; frames < 100; ++frames) {
    playing.pass(0.1);
    EXPECT_FALSE(playing.is_due(false));
  }
  EXPECT_TRUE(playing.is_due(true));
  EXPECT_TRUE(playing.is_due(true));
  EXPECT_FALSE(playing.is_due(true));
}

}  // namespace
}  // namespace splatvol
