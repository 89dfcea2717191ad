// A time series.
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include "builder/series/series_files.h"
#include "tests/player/session_fixture.h"

namespace splatvol::test {
namespace {

struct SessionSteps : SessionFixture {
  SessionSteps() : SessionFixture(160, 120) { write_series(path("series.svol")); }

  // Returns the path of the index.
  std::string write_files(const std::string& name,
                          const std::vector<SeriesStep>& steps = {step_at(0), step_at(1), step_at(2)}) const {
    require(build_series_of_files(steps, path(name), false, {}, [](const char*, double) {}));
    return path(name);
  }

  // Plays the steps to the end. Returns those that are shown.
  std::vector<std::size_t> played(Session& session) const {
    constexpr double frame_seconds = 0.02;
    std::vector<std::size_t> shown;
    double seconds = 0;
    session.toggle_playing();
    for (; !session.is_settled() || session.is_playing(); seconds += frame_seconds) {  // ends by the test's time limit
      EXPECT_EQ(message_of(session.play(frame_seconds)), "");
      draw(session, frame_seconds);
      if (session.is_step_shown() && (shown.empty() || session.step() != shown.back())) shown.push_back(session.step());
    }
    EXPECT_GE(seconds, static_cast<double>(shown.size() - 1) / session.playback.steps_per_second - 1e-9);
    return shown;
  }
};

TEST_F(SessionSteps, LookLikeFilesOfTheirOwn) {
  const auto series = open(path("series.svol"));
  EXPECT_EQ(series->times(), (std::vector<double>{0, 0.5, 1}));
  EXPECT_EQ(series->step(), 2u) << "the last comes first";
  const Image last = settled(*series);
  ASSERT_TRUE(series->show_step(1));
  EXPECT_EQ(series->step(), 1u);
  const Image middle = settled(*series);
  EXPECT_GT(compare_images(last, middle)->rmse, 0.01);

  require(build_volume(*step_at(1).open().value(), path("single.svol"), {}, [](const char*, double) {}));
  const auto single = open(path("single.svol"));
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
TEST_F(SessionSteps, OfFilesLookLikeTheFiles) {
  const auto series = open(write_files("f.svols", {step_at(0), step_at(1, 9), step_at(2)}));
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

  const auto single = open(path("f-0001.svol"));
  single->scene = series->scene;
  EXPECT_EQ(compare_images(settled(*single), middle)->max, 0);

  // A file that is gone: the step stays.
  std::filesystem::remove(path("f-0000.svol"));
  EXPECT_FALSE(series->show_step(0));
  EXPECT_EQ(series->step(), 1u);
  EXPECT_EQ(compare_images(settled(*series), middle)->max, 0);
  ASSERT_TRUE(series->show_step(2));
  EXPECT_EQ(compare_images(settled(*series), last)->max, 0);
}

// The step's own file is gone, too: it is open, and stays.
TEST_F(SessionSteps, StayWhileAllFilesAreAway) {
  const std::string index = write_files("g.svols", {step_at(0), step_at(1)});
  const auto series = open(index);
  const Image last = settled(*series);
  for (const char* file : {"g-0000.svol", "g-0001.svol"}) std::filesystem::rename(path(file), path(file) + ".away");
  for (int tries = 0; tries < 2; ++tries) {
    EXPECT_FALSE(series->show_step(0));
    EXPECT_EQ(series->step(), 1u);
    EXPECT_EQ(compare_images(settled(*series), last)->max, 0);
  }
  // Another kernel reads the file that is open.
  series->settings.drawing.kernel = KernelKind::octant;
  EXPECT_GT(compare_images(settled(*series), last)->max, 0);
  EXPECT_TRUE(series->troubles().empty());

  std::filesystem::rename(path("g-0000.svol.away"), path("g-0000.svol"));
  EXPECT_TRUE(series->show_step(0));
  EXPECT_GT(compare_images(settled(*series), last)->rmse, 0.01);
}

// The window does not wait for a step that a hand asks for.
TEST_F(SessionSteps, AreReadAside) {
  const std::string index = write_files("aside.svols");
  for (const std::string& file : {path("series.svol"), index}) {
    const auto session = open_slow(file);
    const Image last = settled(*session);

    stalls = true;
    session->ask_step(0);
    draw(*session);
    while (waiting == 0) std::this_thread::yield();
    for (int i = 0; i < 20; ++i) draw(*session);
    EXPECT_TRUE(session->is_reading());
    EXPECT_FALSE(session->is_settled());
    EXPECT_FALSE(session->is_step_shown());
    EXPECT_EQ(session->step(), 0u) << "the slider's";
    const TransferFunction before = session->scene.transfer_function;
    session->scene.transfer_function.colors = {{0, dvec3(1, 0, 0)}};  // the user edits
    const TransferFunction edited = session->scene.transfer_function;
    for (int i = 0; i < 1000 && !(session->drawn_scene().transfer_function == edited); ++i) draw(*session);
    EXPECT_EQ(session->drawn_scene().transfer_function, edited);
    EXPECT_TRUE(session->is_reading());
    session->ask_step(1);  // and goes on
    draw(*session);
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
    const auto waits = open(file);
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
}

TEST_F(SessionSteps, StayWhereAnotherCannotBeRead) {
  const auto session = open(write_files("lost.svols"));
  std::filesystem::remove(path("lost-0000.svol"));
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

TEST_F(SessionSteps, PlayFromTheFirstToTheLast) {
  const auto session = open(path("series.svol"));
  settled(*session);
  EXPECT_EQ(played(*session), (std::vector<std::size_t>{0, 1, 2})) << "behind the last comes the first";
  EXPECT_TRUE(session->troubles().empty());
}

// A picture may take most of a step's time, however quick a hand wants its pictures. Cells are read ahead.
TEST_F(SessionSteps, PlayExactly) {
  settings.moving = {.max_error = 1, .seconds = 1e-9, .smooth_seconds = 1e-9};
  std::vector<std::pair<std::size_t, Recipe>> drawn;
  settings.on_picture = [&](const CompletePicture& picture) {
    if (picture.recipe.moves) drawn.emplace_back(picture.step, picture.recipe.recipe);
  };
  write_series(path("cells.svol"), {.keep_cells = true});
  const auto session = open(path("cells.svol"));
  session->playback.steps_per_second = 2.5;
  settled(*session);
  ASSERT_TRUE(session->show_step(0));
  settled(*session);
  while (session->is_reading_ahead()) std::this_thread::yield();
  drawn.clear();
  EXPECT_EQ(played(*session), (std::vector<std::size_t>{0, 1, 2}));
  ASSERT_EQ(drawn.size(), 2U) << "one for each step that comes";
  for (std::size_t i = 0; i < 2; ++i) EXPECT_EQ(drawn[i], std::pair(i + 1, Recipe::of_cells(1)));
}

// Files are read aside. One that cannot be read is the end.
TEST_F(SessionSteps, OfFilesPlayUntilOneCannotBeRead) {
  const auto session = open(write_files("played.svols"));
  settled(*session);
  EXPECT_EQ(played(*session), (std::vector<std::size_t>{0, 1, 2}));
  EXPECT_TRUE(session->troubles().empty());
  std::filesystem::remove(path("played-0001.svol"));
  EXPECT_EQ(played(*session), (std::vector<std::size_t>{0}));
  EXPECT_EQ(session->troubles().size(), 1u);
}

}  // namespace
}  // namespace splatvol::test
