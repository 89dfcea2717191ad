// Real meshes from end to end: built, opened, streamed.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <optional>

#include "tests/builder/support/built_input.h"
#include "tests/streamer/fixture.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

struct Bluntfin : testing::TestWithParam<KernelKind> {
  static void SetUpTestSuite() {
    const std::string mesh = SPLATVOL_SHARED "/data/bluntfin.vtu";
    if (!std::filesystem::exists(mesh)) return;
    folder_.emplace();
    build_input(mesh, folder_->path("m.svol"));
  }
  static void TearDownTestSuite() { folder_.reset(); }
  void SetUp() override {
    if (!folder_) GTEST_SKIP() << "no " SPLATVOL_SHARED "/data/bluntfin.vtu";
    scene_ = load_scene(SPLATVOL_SHARED "/scenes/bluntfin.json").value();
    view_ = make_view(scene_.camera, scene_.width, scene_.height).value();
  }
  Result<std::unique_ptr<Streamer>> open(std::uint64_t memory = 512u << 20) const {
    return Streamer::open(open_file(folder_->path("m.svol")).value(), {memory, scene_.attribute, GetParam()});
  }

  static inline std::optional<TempFolder> folder_;
  Scene scene_;
  View view_;
};
INSTANTIATE_TEST_SUITE_P(Kernels, Bluntfin, testing::Values(KernelKind::octant, KernelKind::moments), kernel_name);

TEST_P(Bluntfin, AllPointsAtToleranceZero) {
  const auto streamer = open().value();
  EXPECT_EQ(streamer->request(view_, scene_.transfer_function, {0, {}}).value()->splats,
            streamer->info().point_count());
}

TEST_P(Bluntfin, FewerSplatsAndFewerBytesForMoreTolerance) {
  std::uint64_t splats = 1u << 30, bytes = 1u << 30, file_bytes = 0;
  for (const double tolerance : {1.0, 5.0, 10.0, 20.0}) {
    const auto streamer = open().value();
    const FrameSplats& frame = *streamer->request(view_, scene_.transfer_function, {tolerance, {}}).value();
    EXPECT_LT(frame.splats, splats);
    EXPECT_LE(streamer->statistics().bytes_read, bytes);
    splats = frame.splats;
    bytes = streamer->statistics().bytes_read;
    file_bytes = streamer->volume().file_bytes();
  }
  EXPECT_LT(splats, 2000u);
  EXPECT_LT(bytes, file_bytes / 10);
}

TEST_P(Bluntfin, EachResolutionHasTheSameMass) {
  if (GetParam() == KernelKind::octant) GTEST_SKIP() << "octants have none";
  const auto streamer = open().value();
  std::vector<double> masses;
  for (std::size_t r = 0; r < streamer->info().resolutions(); ++r) {
    const FrameSplats& frame = *streamer->request(view_, opaque(), {1, r}).value();
    if (frame.splats < streamer->info().resolution_counts[r]) continue;  // something is out of view
    masses.push_back(mass_of(frame.list));
  }
  ASSERT_GT(masses.size(), 2u);
  // Each mass is off by at most half a quantisation step of its code: a factor 2^(1/256).
  for (const double mass : masses) EXPECT_NEAR(mass, masses.back(), masses.back() * (std::exp2(2.0 / 256) - 1));
}

TEST_P(Bluntfin, ASmallBudgetIsKept) {
  // The least memory that suffices, to the nearest 50 K.
  for (std::uint64_t memory = 200u << 10; memory < 16u << 20; memory += 50u << 10) {
    auto streamer = open(memory);
    if (!streamer) continue;
    const auto frame = (*streamer)->request(view_, opaque(), {0, {}});
    EXPECT_LE((*streamer)->statistics().bytes_resident_peak, memory);
    if (!frame) continue;
    EXPECT_GT((*frame)->splats, 0u);
    EXPECT_LT((*frame)->splats, (*streamer)->info().point_count() / 4);
    EXPECT_GT((*frame)->detail.tolerance_percent, 0);
    return;
  }
  FAIL() << "16 MiB are not enough";
}

}  // namespace
}  // namespace splatvol::test
