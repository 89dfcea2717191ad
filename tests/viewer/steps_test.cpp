// A time series in the viewer.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>

#include "builder/series_build.h"
#include "renderer/context.h"
#include "tests/builder/support/meshes.h"
#include "tests/builder/support/piece_source.h"
#include "viewer/session.h"

namespace splatvol {
namespace {

constexpr double long_time = 1;  // seconds: longer than any change takes

SeriesStep step_at(int step) {
  return {fmt::format("step {}", step), 0.5 * step, [step]() -> Result<std::unique_ptr<Source>> {
            const test::Mesh mesh = test::lattice(12, [](dvec3 p) { return p; });
            return std::make_unique<test::PieceSource>(
                std::vector{test::mesh_piece(mesh, [step](dvec3 p) { return std::sin(5 * p.x + step) + step; })});
          }};
}

class ViewerSteps : public testing::Test {
 protected:
  void SetUp() override {
    ASSERT_TRUE(context_);
    ASSERT_NE(::mkdtemp(folder_.data()), nullptr);
    const auto silent = [](const char*, double) {};
    ASSERT_TRUE(build_series({step_at(0), step_at(1), step_at(2)}, path("series"), {}, silent));
    ASSERT_TRUE(build_volume(*step_at(1).open().value(), path("single"), {}, silent));
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  [[nodiscard]] std::string path(const std::string& name) const { return folder_ + "/" + name + ".svol"; }

  static Image settled(Session& session) {
    int frames = 0;
    do {
      EXPECT_TRUE(session.draw(160, 120, long_time));
    } while (!session.is_settled() && ++frames < 10000);
    return session.image().value();
  }

  Result<std::unique_ptr<HeadlessContext>> context_ = HeadlessContext::create();
  std::string folder_ = (std::filesystem::temp_directory_path() / "splatvol-viewer-steps-XXXXXX").string();
};

TEST_F(ViewerSteps, LookLikeFilesOfTheirOwn) {
  const auto series = Session::open(path("series"), "", {}).value();
  EXPECT_EQ(series->times(), (std::vector<double>{0, 0.5, 1}));
  EXPECT_EQ(series->step(), 2u) << "the last comes first";
  const Image last = settled(*series);
  ASSERT_TRUE(series->show_step(1));
  EXPECT_EQ(series->step(), 1u);
  const Image middle = settled(*series);
  EXPECT_GT(compare_images(last, middle)->rmse, 0.01);

  const auto single = Session::open(path("single"), "", {}).value();
  EXPECT_TRUE(single->times().empty());
  single->scene = series->scene;
  EXPECT_LE(compare_images(settled(*single), middle)->max, 1e-6);

  // The step stays when the file is opened again.
  series->settings.memory /= 2;
  EXPECT_EQ(compare_images(settled(*series), middle)->max, 0);
  EXPECT_FALSE(series->show_step(3));
  EXPECT_EQ(series->step(), 1u);
  EXPECT_EQ(compare_images(settled(*series), middle)->max, 0);
}

}  // namespace
}  // namespace splatvol
