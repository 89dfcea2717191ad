// A time series in the viewer.
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <filesystem>
#include <thread>

#include "builder/series/series_build.h"
#include "builder/series/series_files.h"
#include "player/session.h"
#include "tests/builder/support/built_mesh.h"
#include "tests/support/results.h"
#include "tests/support/stalled_source.h"
#include "tests/viewer/viewer_fixture.h"

namespace splatvol::test {
namespace {

const auto silent = [](const char*, double) {};

SeriesStep step_at(int step, std::uint32_t cells = 12) {
  return mesh_step(0.5 * step, lattice(cells), [step](dvec3 p) { return std::sin(5 * p.x + step) + step; });
}

struct ViewerSteps : test::ViewerFixture {
  void SetUp() override {
    ViewerFixture::SetUp();
    ASSERT_TRUE(build_series({step_at(0), step_at(1), step_at(2)}, path("series.svol"), {}, silent));
    ASSERT_TRUE(build_volume(*step_at(1).open().value(), path("single.svol"), {}, silent));
  }

  // Returns the name of the index. `steps`: how many files.
  std::string write_files(const std::string& name, int steps = 3) const {
    std::vector<SeriesStep> all;
    for (int step = 0; step < steps; ++step) all.push_back(step_at(step));
    EXPECT_TRUE(build_series_of_files(all, path(name), false, {}, silent));
    return path(name);
  }

  static Image settled(Session& session) {
    do {
      EXPECT_TRUE(session.draw(160, 120, long_time));
    } while (!session.is_settled());  // ends by the test's time limit
    return session.image().value();
  }
};

TEST_F(ViewerSteps, LookLikeFilesOfTheirOwn) {
  const auto series = Session::open(path("series.svol"), "", {}, host).value();
  EXPECT_EQ(series->times(), (std::vector<double>{0, 0.5, 1}));
  EXPECT_EQ(series->step(), 2u) << "the last comes first";
  const Image last = settled(*series);
  ASSERT_TRUE(series->show_step(1));
  EXPECT_EQ(series->step(), 1u);
  const Image middle = settled(*series);
  EXPECT_GT(compare_images(last, middle)->rmse, 0.01);

  const auto single = Session::open(path("single.svol"), "", {}, host).value();
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

// A series of files, whose meshes differ, plays like a series in one file.
TEST_F(ViewerSteps, OfFilesLookLikeTheFiles) {
  const std::string index = folder_ + "f.svols";
  ASSERT_EQ(message_of(build_series_of_files({step_at(0), step_at(1, 9), step_at(2)}, index, false, {}, silent)), "");
  const auto series = Session::open(index, "", {}, host).value();
  EXPECT_EQ(series->times(), (std::vector<double>{0, 0.5, 1}));
  EXPECT_EQ(series->step(), 2u);
  const Image last = settled(*series);
  EXPECT_NEAR(series->range_of_all_steps().max, 3, 0.1);  // a sine and the number of the step
  EXPECT_NEAR(series->range_of_all_steps().min, -1, 0.1);
  ASSERT_TRUE(series->show_step(1));
  EXPECT_FALSE(series->is_step_shown());
  const Image middle = settled(*series);
  EXPECT_TRUE(series->is_step_shown());
  EXPECT_EQ(series->info().point_count(), 1000u);

  const auto single = Session::open(folder_ + "f-0001.svol", "", {}, host).value();
  single->scene = series->scene;
  EXPECT_EQ(compare_images(settled(*single), middle)->max, 0);

  // A file that is gone: the step stays.
  std::filesystem::remove(folder_ + "f-0000.svol");
  EXPECT_FALSE(series->show_step(0));
  EXPECT_EQ(series->step(), 1u);
  EXPECT_EQ(compare_images(settled(*series), middle)->max, 0);
  ASSERT_TRUE(series->show_step(2));
  EXPECT_EQ(compare_images(settled(*series), last)->max, 0);
}

// The step's own file is gone, too: it is open, and stays.
TEST_F(ViewerSteps, StayWhileAllFilesAreAway) {
  const std::string index = write_files("g.svols", 2);
  const auto series = Session::open(index, "", {}, host).value();
  const Image last = settled(*series);
  for (const char* file : {"/g-0000.svol", "/g-0001.svol"})
    std::filesystem::rename(folder_ + file, folder_ + file + ".away");
  for (int tries = 0; tries < 2; ++tries) {
    EXPECT_FALSE(series->show_step(0));
    EXPECT_EQ(series->step(), 1u);
    EXPECT_EQ(compare_images(settled(*series), last)->max, 0);
  }
  // Another kernel reads the file that is open.
  series->settings.drawing.kernel = KernelKind::octant;
  EXPECT_GT(compare_images(settled(*series), last)->max, 0);
  EXPECT_TRUE(series->troubles().empty());

  std::filesystem::rename(folder_ + "g-0000.svol.away", folder_ + "g-0000.svol");
  EXPECT_TRUE(series->show_step(0));
  EXPECT_GT(compare_images(settled(*series), last)->rmse, 0.01);
}

// The window does not wait for a step that a hand asks for.
TEST_F(ViewerSteps, AreReadAside) {
  const std::string index = write_files("aside.svols");
  for (const std::string& file : {path("series.svol"), index}) {
    std::atomic<bool> stalls = false;
    std::atomic<int> waiting = 0;
    const auto open = [&](const std::string& name) { return open_stalled(name, stalls, waiting); };
    const auto session = Session::open(Session::read({.file = file}, "", {}, open).value(), host).value();
    const Image last = settled(*session);

    stalls = true;
    session->ask_step(0);
    EXPECT_TRUE(session->draw(160, 120, long_time));
    while (waiting == 0) std::this_thread::yield();
    for (int i = 0; i < 20; ++i) EXPECT_TRUE(session->draw(160, 120, long_time));
    EXPECT_TRUE(session->is_reading());
    EXPECT_FALSE(session->is_settled());
    EXPECT_FALSE(session->is_step_shown());
    EXPECT_EQ(session->step(), 0u) << "the slider's";
    const TransferFunction before = session->scene.transfer_function;
    session->scene.transfer_function.colors = {{0, dvec3(1, 0, 0)}};  // the user edits
    const TransferFunction edited = session->scene.transfer_function;
    for (int i = 0; i < 1000 && !(session->drawn_scene().transfer_function == edited); ++i)
      EXPECT_TRUE(session->draw(160, 120, long_time));
    EXPECT_EQ(session->drawn_scene().transfer_function, edited);
    EXPECT_TRUE(session->is_reading());
    session->ask_step(1);  // and goes on
    EXPECT_TRUE(session->draw(160, 120, long_time));
    EXPECT_EQ(session->step(), 1u);
    session->cancel_reading();
    EXPECT_EQ(session->step(), 2u);
    EXPECT_EQ(session->scene.transfer_function, edited);
    session->scene.transfer_function = before;
    EXPECT_EQ(compare_images(settled(*session), last)->max, 0);

    stalls = false;
    session->ask_step(1);
    const Image middle = settled(*session);
    EXPECT_EQ(session->step(), 1u);
    EXPECT_TRUE(session->is_step_shown());
    EXPECT_TRUE(session->troubles().empty());
    const auto waits = Session::open(file, "", {}, host).value();
    ASSERT_TRUE(waits->show_step(1));
    EXPECT_EQ(compare_images(settled(*waits), middle)->max, 0);
    EXPECT_EQ(waits->histogram(), session->histogram());

    // The next step of one file is there at once: it was read ahead.
    session->ask_step(0);
    settled(*session);
    while (session->is_reading_ahead()) std::this_thread::yield();
    stalls = true;
    session->ask_step(1);
    session->cancel_reading();
    EXPECT_EQ(session->step(), file == index ? 0u : 1u);
    stalls = false;
  }
  std::filesystem::remove(folder_ + "aside-0000.svol");
  const auto session = Session::open(index, "", {}, host).value();
  const Image last = settled(*session);
  session->ask_step(0);
  EXPECT_EQ(compare_images(settled(*session), last)->max, 0);
  EXPECT_EQ(session->step(), 2u);
  EXPECT_EQ(session->troubles().size(), 1u);

  // An edit stays, too.
  session->scene.transfer_function.colors = {{0, dvec3(1, 0, 0)}};
  session->ask_step(0);
  EXPECT_GT(compare_images(settled(*session), last)->rmse, 0.01);
  EXPECT_EQ(session->scene.transfer_function.colors.size(), 1u);
}

struct PlayingSteps : ViewerSteps {
  void SetUp() override {
    ViewerSteps::SetUp();
    resize(400, 300);
    frame_seconds = 0.02;
    play_file(path("series.svol"));
  }
  void play_file(const std::string& volume) { open({.volume = volume}); }
  [[nodiscard]] std::size_t step() const { return viewer->session()->step(); }
};

TEST_F(PlayingSteps, GoFromTheFirstToTheLast) {
  EXPECT_EQ(step(), 2u);
  press(key::space);
  EXPECT_EQ(step(), 0u) << "behind the last comes the first";
  std::vector<std::size_t> seen = {0};
  double seconds = 0, first_change = 0;
  for (int frames = 0; !viewer->is_settled(); ++frames) {
    ASSERT_LT(frames, 100000);
    const bool shown = viewer->session()->is_step_shown();
    frame({});
    if (step() == seen.back()) {
      seconds += 0.02;
      continue;
    }
    EXPECT_TRUE(shown) << "a step that nobody has seen";
    if (seen.size() == 1) first_change = seconds;
    seen.push_back(step());
  }
  EXPECT_EQ(seen, (std::vector<std::size_t>{0, 1, 2}));
  EXPECT_GE(first_change, 0.2 - 0.05) << "5 steps a second";
}

// Files are read aside. One that cannot be read is the end.
TEST_F(PlayingSteps, OfFilesGoOnUntilOneCannotBeRead) {
  play_file(write_files("played.svols"));
  const auto play = [&] {
    press(key::space);
    std::vector<std::size_t> seen;
    for (int frames = 0; !viewer->is_settled(); ++frames) {
      EXPECT_LT(frames, 100000);
      if (frames == 100000) break;
      frame({});
      if (viewer->session()->is_step_shown() && (seen.empty() || step() != seen.back())) seen.push_back(step());
    }
    return seen;
  };
  EXPECT_EQ(play(), (std::vector<std::size_t>{0, 1, 2}));
  EXPECT_TRUE(viewer->session()->troubles().empty());
  std::filesystem::remove(folder_ + "played-0001.svol");
  EXPECT_EQ(play(), (std::vector<std::size_t>{0}));
  EXPECT_EQ(viewer->session()->troubles().size(), 1u);
}

}  // namespace
}  // namespace splatvol::test
