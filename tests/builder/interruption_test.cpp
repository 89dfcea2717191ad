// Builds that are stopped in each of their stages.
#include "base/interruption.h"

#include <gmock/gmock.h>

#include <string>

#include "builder/pipeline/build.h"
#include "tests/builder/support/meshes.h"
#include "tests/builder/support/piece_source.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

struct Interruption : FolderTest, testing::WithParamInterface<const char*> {
  // Builds a mesh or scattered points; requests a stop when a stage comes.
  Result<BuildReport> build_until(const std::string& stage, bool with_cells) {
    Mesh mesh = lattice(20);
    if (!with_cells) mesh.tetrahedra.clear();
    PieceSource source({mesh_piece(mesh, [](dvec3 p) { return p.x; })});
    std::stop_source stop;
    const Interruptible heeds(stop.get_token());
    return build_volume(source, path("out.svol"), {}, [&](const char* now, double) {
      if (now == stage) stop.request_stop();
    });
  }

  void expect_stopped(const std::string& stage, bool with_cells) {
    EXPECT_THAT(build_until(stage, with_cells), FailsWith(ErrorCode::cancelled));
  }
};

TEST_P(Interruption, LeavesNothing) {
  for (const bool with_cells : {true, false}) expect_stopped(GetParam(), with_cells);
  EXPECT_THAT(names(), testing::IsEmpty());
}

TEST_P(Interruption, KeepsTheFileThatIsThere) {
  ASSERT_TRUE(build_until("none", true));
  const std::string before = read("out.svol");
  expect_stopped(GetParam(), true);
  EXPECT_THAT(names(), testing::ElementsAre("out.svol"));
  EXPECT_EQ(read("out.svol"), before);
}

INSTANTIATE_TEST_SUITE_P(Stages, Interruption,
                         testing::Values("reading", "connecting", "reducing", "writing", "checking"),
                         [](const auto& stage) { return std::string(stage.param); });

}  // namespace
}  // namespace splatvol::test
