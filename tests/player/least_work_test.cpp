// Pictures of a wanted error: it holds against the exact picture, and no other way to draw is less work and better.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "pictures/image.h"
#include "player/player.h"
#include "renderer/work.h"
#include "tests/builder/support/built_input.h"
#include "tests/builder/support/built_mesh.h"
#include "tests/player/waves.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol {
namespace {

class LeastWork : public test::FolderTest {
 protected:
  struct Drawn {
    double work, error;
    std::uint64_t splats = 0;  // 0: cells
    int spacing = 1;
  };

  static Scene scene() { return test::scene_of_waves(240, 180); }
  static Scene inside() {
    Scene inside = scene();
    inside.camera.position = {0.45, 0.5, 0.6};
    inside.camera.focal_point = {0.6, 0.4, 0};
    return inside;
  }
  static Scene narrow() {
    Scene narrow = scene();
    narrow.transfer_function.densities = {{0.5, 0.0}, {0.505, 80.0}, {0.51, 0.0}};
    return narrow;
  }

  // An open file, with the exact picture of its scene.
  class File {
   public:
    File(const std::string& path, const Scene& scene)
        : player_(test::value_of(Player::open(path, scene, {.device = Device::cpu}))) {
      EXPECT_EQ(test::message_of(player_->draw(Recipe::of_cells())), "");
      exact_ = test::value_of(player_->image());
      segments_ = static_cast<double>(player_->exact()->segments);
    }

    [[nodiscard]] DrawnPicture draw(const Quality& quality) { return test::value_of(player_->draw_picture(quality)); }

    // The last picture.
    [[nodiscard]] Drawn drawn() const {
      const double pixels = static_cast<double>(exact_.width) * exact_.height;
      const int spacing = player_->sample_spacing();
      Drawn drawn{0, compare_images(test::value_of(player_->image()), exact_)->rmse, 0, spacing};
      if (const auto& exact = player_->exact()) {
        drawn.work = work_of_cells({static_cast<double>(exact->tetrahedra), segments_}, pixels, spacing);
      } else {
        drawn.splats = player_->frame()->splats;
        drawn.work =
            work_of_splats(static_cast<double>(drawn.splats), player_->times().draw.fragments, pixels, spacing);
      }
      return drawn;
    }

    // Other ways to draw the picture. Samples farther apart show steps at outlines.
    [[nodiscard]] std::vector<Drawn> alternatives(const Drawn& to) {
      std::vector<Drawn> all;
      const auto splats = static_cast<double>(to.splats > 0 ? to.splats : player_->info().point_count());
      for (const double factor : {0.5, 1.0, 2.0})
        for (const int spacing : {1, 2, 4}) {
          const ErrorGoal goal{0, static_cast<std::uint64_t>(factor * splats)};
          EXPECT_EQ(test::message_of(player_->draw({Detail{.goal = goal}, spacing})), "");
          all.push_back(drawn());
        }
      for (const int spacing : {1, 2}) {
        EXPECT_EQ(test::message_of(player_->draw(Recipe::of_cells(spacing))), "");
        all.push_back(drawn());
      }
      return all;
    }

   private:
    std::unique_ptr<Player> player_;
    Image exact_;
    double segments_;
  };

  static void expect_least_work(const std::string& path, const Scene& scene, const std::string& name) {
    File file(path, scene);
    for (const double error : {0.02, 0.005, 0.001}) {
      const auto label = ::testing::Message() << name << ", " << error;
      const DrawnPicture picture = file.draw({.max_error = error});
      const Drawn drawn = file.drawn();
      EXPECT_LE(drawn.error, 1.25 * error) << label;
      EXPECT_TRUE(picture.search->estimate.measured) << label;
      EXPECT_LE(picture.search->pictures, 16) << label;
      for (const Drawn& other : file.alternatives(drawn))
        EXPECT_FALSE(other.work < 0.9 * drawn.work && other.error < 0.95 * drawn.error)
            << label << ": " << drawn.splats << " splats, " << drawn.spacing << ": " << drawn.work << ", "
            << drawn.error << "; " << other.splats << ", " << other.spacing << ": " << other.work << ", "
            << other.error;
    }
  }
};

TEST_F(LeastWork, IsFoundForMeshes) {
  const test::Mesh mesh = test::jittered(18, 0.2);
  const auto bodies = [](dvec3 p) { return p.x > 0.5 ? 1.0 : 0.0; };
  test::build_mesh(mesh, test::waves, path("waves.svol"), {.keep_cells = true});
  test::build_mesh(mesh, bodies, path("bodies.svol"), {.keep_cells = true});
  expect_least_work(path("waves.svol"), scene(), "waves");
  expect_least_work(path("waves.svol"), inside(), "waves, the eye inside");
  expect_least_work(path("waves.svol"), narrow(), "waves, a narrow function");
  expect_least_work(path("bodies.svol"), scene(), "two bodies");
}

TEST_F(LeastWork, IsFoundForARealMesh) {
  const std::string shared = SPLATVOL_SHARED;
  if (!std::filesystem::exists(shared + "/data/bluntfin.vtu")) GTEST_SKIP() << "no " << shared << "/data/bluntfin.vtu";
  test::build_input(shared + "/data/bluntfin.vtu", path("m.svol"), {.keep_cells = true});
  for (const char* name : {"bluntfin", "bluntfin-close", "bluntfin-ortho", "bluntfin-peak"}) {
    Scene scene = load_scene(fmt::format("{}/scenes/{}.json", shared, name)).value();
    scene.width = scene.height = 256;
    expect_least_work(path("m.svol"), scene, name);
  }
}

}  // namespace
}  // namespace splatvol
