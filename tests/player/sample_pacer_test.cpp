#include "player/sample_pacer.h"

#include <gtest/gtest.h>

namespace splatvol {
namespace {

// A machine that needs so many seconds for a segment of a ray, and for a tetrahedron.
double seconds_of(const SamplePacer::Work& work, int spacing, double of_segment, double of_tetrahedron) {
  return of_tetrahedron * static_cast<double>(work.tetrahedra) +
         of_segment * static_cast<double>(work.segments) / (spacing * spacing);
}

TEST(SamplePacer, FitsTheTimeOfAnyMachine) {
  constexpr double wanted = 0.02;
  for (const double of_segment : {1e-10, 1e-9, 1e-8, 1e-7})
    for (const std::uint64_t tetrahedra : {1000u, 30'000u, 1'000'000u}) {
      const SamplePacer::Work work = {tetrahedra, 20 * tetrahedra};
      const auto seconds = [&](int spacing) { return seconds_of(work, spacing, of_segment, 3 * of_segment); };
      SamplePacer pacer;
      pacer.set_seconds(wanted);
      int spacing = pacer.spacing(work);
      for (int picture = 0; picture < 30 && spacing > 0; ++picture) {
        pacer.add(work, spacing, seconds(spacing));
        spacing = pacer.spacing(work);
      }
      if (spacing == 0) continue;
      EXPECT_LE(seconds(spacing), 2 * wanted) << of_segment << " " << tetrahedra;
      if (spacing > 1) {
        EXPECT_GT(seconds(spacing / 2), 0.3 * wanted) << of_segment << " " << tetrahedra;
      }
    }
}

TEST(SamplePacer, HasNoTimeForMuchWork) {
  SamplePacer pacer;
  EXPECT_TRUE(pacer.fits({1000, 100'000}));
  EXPECT_EQ(pacer.spacing({1000, 100'000}), 1);
  EXPECT_FALSE(pacer.fits({100'000'000, 1}));
  EXPECT_EQ(pacer.spacing({100'000'000, 1}), 0);
  EXPECT_EQ(pacer.spacing({1, 100'000'000'000}), 0);
}

// Pictures with other samples look different: they do not come in turns.
TEST(SamplePacer, KeepsTheSamples) {
  SamplePacer pacer;
  pacer.set_seconds(0.01);
  const SamplePacer::Work work = {10'000, 1'000'000};
  const int first = pacer.spacing(work);
  ASSERT_GT(first, 1);
  for (const double jitter : {1.2, 0.8, 1.1, 0.9, 1.3, 0.7}) {
    pacer.add(work, first, 0.01 * jitter);
    EXPECT_EQ(pacer.spacing(work), first);
  }
}

}  // namespace
}  // namespace splatvol
