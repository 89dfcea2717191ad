// Builds that are stopped in each of their stages.
#include "base/interruption.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

#include "builder/pipeline/build.h"
#include "tests/builder/support/meshes.h"
#include "tests/builder/support/piece_source.h"
#include "tests/support/require.h"

namespace splatvol {
namespace {

// An empty folder, removed at the end.
class Interruption : public testing::TestWithParam<const char*> {
 public:
  Interruption() { test::require(::mkdtemp(folder_.data()) != nullptr, folder_); }
  ~Interruption() override { std::filesystem::remove_all(folder_); }

 protected:
  // Builds a mesh or scattered points; requests a stop when a stage comes.
  Result<BuildReport> build_until(const std::string& stage, bool with_cells) {
    test::Mesh mesh = test::lattice(20);
    if (!with_cells) mesh.tetrahedra.clear();
    test::PieceSource source({test::mesh_piece(mesh, [](dvec3 p) { return p.x; })});
    std::stop_source stop;
    const Interruptible heeds(stop.get_token());
    return build_volume(source, output(), {}, [&](const char* now, double) {
      if (now == stage) stop.request_stop();
    });
  }

  [[nodiscard]] std::string output() const { return folder_ + "/out.svol"; }

  [[nodiscard]] std::string bytes() const {
    std::ifstream file(output(), std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }

  [[nodiscard]] std::size_t files() const {
    const std::filesystem::directory_iterator folder(folder_);
    return static_cast<std::size_t>(std::distance(begin(folder), end(folder)));
  }

 private:
  std::string folder_ = (std::filesystem::path(testing::TempDir()) / "splatvol-stop-XXXXXX").string();
};

TEST_P(Interruption, StopsAMesh) {
  const auto built = build_until(GetParam(), true);
  ASSERT_FALSE(built);
  EXPECT_EQ(built.error().code, ErrorCode::cancelled) << built.error().message;
  EXPECT_EQ(files(), 0u);
}

TEST_P(Interruption, StopsScatteredPoints) {
  const auto built = build_until(GetParam(), false);
  ASSERT_FALSE(built);
  EXPECT_EQ(built.error().code, ErrorCode::cancelled) << built.error().message;
  EXPECT_EQ(files(), 0u);
}

TEST_P(Interruption, KeepsTheFileThatIsThere) {
  ASSERT_TRUE(build_until("none", true));
  const std::string before = bytes();
  const auto built = build_until(GetParam(), true);
  ASSERT_FALSE(built);
  EXPECT_EQ(built.error().code, ErrorCode::cancelled) << built.error().message;
  EXPECT_EQ(files(), 1u);
  EXPECT_EQ(bytes(), before);
}

INSTANTIATE_TEST_SUITE_P(Stages, Interruption,
                         testing::Values("reading", "connecting", "reducing", "writing", "checking"),
                         [](const auto& stage) { return std::string(stage.param); });

TEST_F(Interruption, IsOffWithoutAStop) { EXPECT_TRUE(build_until("none", true)); }

}  // namespace
}  // namespace splatvol
