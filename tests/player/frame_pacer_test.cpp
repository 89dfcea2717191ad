#include "player/frame_pacer.h"

#include <gtest/gtest.h>

namespace splatvol {
namespace {

// Returns the time of a frame; a part of it does not depend on the splats.
double frame_seconds(double each, std::uint64_t splats) { return 2e-3 + each * static_cast<double>(splats); }

TEST(FramePacer, FindsTheSplatsOfItsTimeWithinAFewFrames) {
  for (const double each : {1e-8, 1e-6, 3e-5}) {
    FramePacer pacer(0.04);
    for (int frame = 0; frame < 8; ++frame) pacer.add(pacer.splats(), frame_seconds(each, pacer.splats()));
    EXPECT_TRUE(pacer.is_near(frame_seconds(each, pacer.splats()))) << each << " s a splat";
  }
}

TEST(FramePacer, StaysWithinBoundsWhateverItIsTold) {
  FramePacer pacer(1e-3);
  for (int frame = 0; frame < 50; ++frame) pacer.add(pacer.splats(), 10);
  EXPECT_EQ(pacer.splats(), 1u);  // never 0
  for (int frame = 0; frame < 100; ++frame) pacer.add(pacer.splats(), 1e-12);
  EXPECT_GT(pacer.splats(), 1'000'000'000u);
  const std::uint64_t before = pacer.splats();
  pacer.add(before, 0);
  pacer.add(0, 1);
  EXPECT_EQ(pacer.splats(), before);
  EXPECT_EQ(FramePacer(1e-300).splats(), 1u);
  EXPECT_EQ(FramePacer(1e300).splats(), 1'000'000'000'000'000u) << "a number that 64 bits hold";
}

}  // namespace
}  // namespace splatvol
