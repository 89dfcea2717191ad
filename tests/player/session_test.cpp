// Recordings of a hand's events steer a session without a window, threads and OpenGL, by a clock of the test.
#include "player/session.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "player/steering.h"
#include "tests/player/session_fixture.h"

namespace splatvol {
namespace {

constexpr double frame_seconds = 0.016;

// Each look at the clock takes some time.
class FakeHost final : public InlineHost {
 public:
  explicit FakeHost(double seconds_of_a_look) : seconds_of_a_look_(seconds_of_a_look) {}
  [[nodiscard]] double now() const override { return seconds_of_a_look_ * ++looks_; }

 private:
  double seconds_of_a_look_;
  mutable int looks_ = 0;
};

double waves(dvec3 p) { return std::sin(5 * p.x) + p.y; }

class RecordedSession : public test::SessionFixture {
 protected:
  RecordedSession() : SessionFixture(80, 60) { test::write_series(path("s.svol")); }

  struct Played {
    std::vector<Image> pictures = {};     // of each frame of the recording
    std::vector<std::size_t> steps = {};  // one after the other
    Scene scene = {};
    Image at_rest = {};
  };

  // Plays a recording in a session that rests before and after.
  [[nodiscard]] Played play(const std::string& recording, const std::optional<Scene>& scene = {},
                            double seconds_of_a_look = 0.001) const {
    std::ofstream(path("r.jsonl")) << recording;
    FakeHost clock(seconds_of_a_look);
    const auto session = open(path("s.svol"), clock);
    Steering steering;
    if (scene) session->scene = *scene;
    Played played{.steps = {session->step()}};
    const auto frame = [&](const FrameInput& input) {
      steering.begin_frame(input.seconds);
      for (const Event& event : input.events)
        steering.handle(event, session.get(), {0, {1.0 * width, 1.0 * height}, 1}, {});
      steering.move(input.seconds, session.get(), {});
      EXPECT_EQ(test::message_of(session->play(input.seconds)), "");
      draw(*session, input.seconds);
      steering.remember(*session, {});
      if (session->step() != played.steps.back()) played.steps.push_back(session->step());
    };
    const auto rest = [&] {
      do frame({1, {}});
      while (!session->is_settled() || session->is_playing());  // ends by the test's time limit
    };
    rest();
    for (const FrameInput& input : test::value_of(load_recording(path("r.jsonl")))) {
      frame(input);
      played.pictures.push_back(test::value_of(session->image()));
    }
    rest();
    played.scene = session->scene;
    played.at_rest = test::value_of(session->image());
    return played;
  }

  static double difference(const Image& a, const Image& b) { return compare_images(a, b).value().max; }
};

// A drag, a burst of the wheel, lighting.
constexpr const char* hand = R"({"seconds":0.02,"events":[["pointer",40,30]]}
{"seconds":0.02,"events":[["button",0,true]]}
{"seconds":0.02,"events":[["pointer",50,33]]}
{"seconds":0.02,"events":[["pointer",60,36],["button",0,false]]}
{"seconds":0.5,"events":[]}
{"seconds":0.02,"events":[["scroll",0,2]]}
{"seconds":0.02,"events":[["scroll",0,1]]}
{"seconds":0.5,"events":[]}
{"seconds":0.02,"events":[["key",76,true]]}
{"seconds":0.02,"events":[["key",76,false]]}
)";
// Control Z, once.
constexpr const char* undo = R"({"seconds":0.5,"events":[["key",341,true],["key",90,true]]}
{"seconds":0.02,"events":[["key",90,false],["key",341,false]]}
)";

TEST_F(RecordedSession, ShowsTheSameEachTime) {
  const Played first = play(hand), second = play(hand);
  ASSERT_EQ(first.pictures.size(), 10U);
  EXPECT_EQ(first.scene, second.scene);
  int changes = 0;
  for (std::size_t i = 0; i < first.pictures.size(); ++i) {
    EXPECT_EQ(difference(first.pictures[i], second.pictures[i]), 0) << i;
    if (i > 0 && difference(first.pictures[i], first.pictures[i - 1]) > 0) ++changes;
  }
  EXPECT_GE(changes, 5) << "two motions, two turns of the wheel and the light";
  EXPECT_TRUE(first.scene.lighting);

  // On a slow machine pictures are coarser while something moves, and at rest the same.
  const Played slow = play(hand, {}, 10);
  for (const std::size_t i : {5, 6}) EXPECT_GT(difference(slow.pictures[i], first.pictures[i]), 0.001) << i;
  EXPECT_EQ(difference(slow.at_rest, first.at_rest), 0);

  // What rests does not depend on the way.
  const Played there = play("{\"seconds\":0.02,\"events\":[]}\n", first.scene);
  EXPECT_EQ(difference(there.at_rest, first.at_rest), 0);
}

TEST_F(RecordedSession, UndoesAndRedoesAHand) {
  const std::string redo = R"({"seconds":0.5,"events":[["key",341,true],["key",89,true]]}
{"seconds":0.02,"events":[["key",89,false],["key",341,false]]}
)";
  const std::string all = hand;
  const Played before = play("{\"seconds\":0.02,\"events\":[]}\n"), after = play(all);
  EXPECT_EQ(play(all + undo).scene.camera, after.scene.camera) << "only the light is undone";
  EXPECT_FALSE(play(all + undo).scene.lighting);
  const Played wheel = play(all + undo + undo);  // the burst is one change, the drag another one
  EXPECT_NE(wheel.scene.camera, after.scene.camera);
  EXPECT_NE(wheel.scene.camera, before.scene.camera);
  const Played undone = play(all + undo + undo + undo);
  EXPECT_EQ(undone.scene, before.scene);
  EXPECT_EQ(difference(undone.at_rest, before.at_rest), 0);
  EXPECT_EQ(play(all + undo + undo + undo + undo).scene, before.scene) << "there is no more";
  const Played redone = play(all + undo + undo + undo + redo + redo + redo);
  EXPECT_EQ(redone.scene, after.scene);
  EXPECT_EQ(difference(redone.at_rest, after.at_rest), 0);
}

TEST_F(RecordedSession, PlaysSteps) {
  const std::string space = R"({"seconds":0.02,"events":[["key",32,true]]}
{"seconds":0.02,"events":[["key",32,false]]}
)";
  const std::string left = R"({"seconds":0.02,"events":[["key",263,true]]}
{"seconds":0.02,"events":[["key",263,false]]}
)";
  const Played played = play(space), stopped = play(space + space), back = play(left + left + left);
  EXPECT_EQ(played.steps, (std::vector<std::size_t>{2, 0, 1, 2})) << "behind the last comes the first";
  EXPECT_EQ(stopped.steps, (std::vector<std::size_t>{2, 0}));
  EXPECT_EQ(back.steps, (std::vector<std::size_t>{2, 1, 0}));
  EXPECT_EQ(difference(stopped.at_rest, back.at_rest), 0);
  EXPECT_GT(difference(stopped.at_rest, played.at_rest), 0.01);
}

// A clock that goes on by the time of the last picture, whenever somebody looks.
class SlowingHost final : public InlineHost {
 public:
  [[nodiscard]] double now() const override {
    if (session && session->exact())
      seconds_ += 0.01 * slower;
    else if (session && session->frame())
      seconds_ += 2e-7 * slower * static_cast<double>(session->frame()->splats);
    return seconds_;
  }

  const Session* session = nullptr;
  double slower = 1;

 private:
  mutable double seconds_ = 0;
};

// A slower machine shows fewer pictures, and none with a larger error than wanted, as long as there is time for it.
TEST_F(RecordedSession, ASlowerMachineKeepsTheError) {
  test::build_mesh(test::lattice(32), waves, path("m.svol"), {.keep_cells = true});
  SlowingHost clock;
  const auto session = open(path("m.svol"), clock);
  clock.session = session.get();
  settled(*session);
  // Returns how often the rung changes.
  const auto move = [&](int frames) {
    int changes = 0;
    for (int frame = 0; frame < frames; ++frame) {
      const Recipe before = session->shown_recipe().recipe;
      session->scene.camera.position += dvec3(0.001);
      draw(*session, frame_seconds);
      EXPECT_TRUE(session->shown_recipe().moves);
      changes += session->shown_recipe().recipe == before ? 0 : 1;
    }
    return changes;
  };
  static_cast<void>(move(10));
  EXPECT_TRUE(session->exact());
  EXPECT_EQ(session->shown_recipe().recipe.sample_spacing, 1);

  clock.slower = 4;
  EXPECT_LE(move(20), 2);
  EXPECT_LE(session->shown_recipe().error, settings.moving.max_error);
  EXPECT_LE(session->draw_seconds(), 1.5 * settings.moving.seconds);

  clock.slower = 100;
  static_cast<void>(move(20));
  EXPECT_FALSE(session->exact());
  EXPECT_LE(session->draw_seconds(), 3 * settings.moving.seconds);
}

// Its jobs end when they are told to.
class HoldingHost final : public InlineHost {
 public:
  [[nodiscard]] std::unique_ptr<Job> begin(std::function<bool()> work, Priority priority) override {
    if (!holds) return InlineHost::begin(std::move(work), priority);
    held_.push_back(std::make_shared<Held>(Held{std::move(work)}));
    return std::make_unique<HeldJob>(held_.back());
  }
  void end_all() {
    for (const auto& held : std::exchange(held_, {})) held->run();
  }

  bool holds = false;

 private:
  struct Held {
    std::function<bool()> work;
    bool has_ended = false;

    void run() {
      if (!has_ended) has_ended = work();
    }
  };
  struct HeldJob final : Job {
    explicit HeldJob(std::shared_ptr<Held> of) : held(std::move(of)) {}
    ~HeldJob() override { held->run(); }
    [[nodiscard]] bool wait(double seconds) const override {
      if (!std::isfinite(seconds)) held->run();
      return held->has_ended;
    }
    std::shared_ptr<Held> held;
  };
  std::vector<std::shared_ptr<Held>> held_;
};

class MovingSession : public test::SessionFixture {
 protected:
  MovingSession() : SessionFixture(80, 60) {}

  [[nodiscard]] std::unique_ptr<Session> open(bool keeps_cells = true) {
    test::build_mesh(test::lattice(12), waves, path("m.svol"), {.keep_cells = keeps_cells});
    settings.on_picture = [this](const CompletePicture& picture) {
      shown.push_back({picture.scene.camera, picture.recipe});
      light = 0;
      for (const vec4& pixel : picture.image.pixels) light += pixel.r + pixel.g + pixel.b;
    };
    auto session = SessionFixture::open(path("m.svol"), holding);
    settled(*session);
    return session;
  }

  struct Shown {
    Camera camera;
    ShownRecipe recipe;
  };
  HoldingHost holding;
  std::vector<Shown> shown;
  double light = 0;  // of the last picture
};

// A newer camera ends no picture of what moves, and none queue. What is shown has the camera that is told.
TEST_F(MovingSession, ShowsEachPictureThatItBegan) {
  const auto session = open();
  const dvec3 at_rest = session->view().eye;
  shown.clear();
  holding.holds = true;
  std::vector<Camera> cameras;
  const auto turn = [&] {
    session->scene.camera.position += dvec3(0.05, 0, 0);
    cameras.push_back(session->scene.camera);
    draw(*session, frame_seconds);
  };
  turn();
  EXPECT_TRUE(session->is_drawing());
  turn();
  turn();
  EXPECT_TRUE(shown.empty());
  EXPECT_EQ(session->view().eye, at_rest);
  holding.end_all();
  draw(*session, frame_seconds);
  ASSERT_EQ(shown.size(), 1U);
  EXPECT_EQ(shown[0].camera, cameras[0]);
  EXPECT_EQ(session->view().eye, cameras[0].position);
  EXPECT_TRUE(session->is_drawing()) << "the newest";
  holding.end_all();
  draw(*session, frame_seconds);
  ASSERT_EQ(shown.size(), 2U);
  EXPECT_EQ(shown[1].camera, cameras[2]);
  EXPECT_EQ(session->view().eye, cameras[2].position);
  for (const Shown& picture : shown) EXPECT_TRUE(picture.recipe.moves);
  holding.end_all();
}

// Pictures only become finer when the hand rests.
TEST_F(MovingSession, RestsWithoutAWorsePicture) {
  const auto session = open();
  for (int turns = 0; turns < 3; ++turns) {
    session->scene.camera.position += dvec3(0.1, 0, 0);
    draw(*session, frame_seconds);
    shown.erase(shown.begin(), shown.end() - 1);
    ASSERT_TRUE(shown[0].recipe.moves);
    ASSERT_TRUE(shown[0].recipe.recipe.is_exact());
    settled(*session);
    for (std::size_t i = 1; i < shown.size(); ++i) {
      EXPECT_TRUE(shown[i].recipe.recipe.is_exact()) << "no splats between";
      EXPECT_LT(shown[i].recipe.recipe.sample_spacing, shown[i - 1].recipe.recipe.sample_spacing);
    }
    EXPECT_EQ(shown.back().recipe.recipe, (Recipe::of_cells(1)));
  }
}

TEST_F(MovingSession, LeavesOutNoContours) {
  for (const bool keeps_cells : {true, false}) {
    const auto session = open(keeps_cells);
    session->scene.transfer_function.densities = {{0, 0}};
    settled(*session);
    session->scene.contours = {{.values = {0.5}, .color = dvec3(1)}};
    session->scene.camera.position += dvec3(0.1, 0, 0);
    light = 0;
    draw(*session, frame_seconds);
    EXPECT_TRUE(shown.back().recipe.moves);
    EXPECT_EQ(shown.back().recipe.recipe.is_exact(), keeps_cells);
    EXPECT_GT(light, 100) << keeps_cells;
    EXPECT_EQ(session->scene.contours.size(), 1U);
  }
}

// Errors of moving pictures are those that the picture at rest has told.
TEST_F(MovingSession, LearnsErrorsAtRest) {
  const auto session = open();
  session->settings.drawing.sample_spacing = 4;
  settled(*session);
  session->settings.drawing.sample_spacing.reset();
  settled(*session);
  session->settings.moving.max_error = 1;
  for (int turns = 0; turns < 3; ++turns) {
    session->scene.camera.position += dvec3(0.001, 0, 0);
    draw(*session, frame_seconds);
    EXPECT_TRUE(shown.back().recipe.is_measured);
  }
}

TEST_F(RecordedSession, StepsThatPlayHaveTheirCells) {
  test::write_series(path("cells.svol"), {.keep_cells = true});
  std::vector<std::pair<std::size_t, Recipe>> shown;
  settings.on_picture = [&](const CompletePicture& picture) {
    shown.emplace_back(picture.step, picture.recipe.recipe);
  };
  InlineHost at_once;
  const auto session = open(path("cells.svol"), at_once);
  settled(*session);
  session->choose_step(0);
  settled(*session);
  shown.clear();
  session->toggle_playing();
  while (session->is_playing()) {  // ends by the test's time limit
    EXPECT_EQ(test::message_of(session->play(0.05)), "");
    draw(*session, 0.05);
  }
  for (const std::size_t step : {1U, 2U}) {
    const auto first = std::ranges::find(shown, step, &std::pair<std::size_t, Recipe>::first);
    ASSERT_NE(first, shown.end()) << step;
    EXPECT_TRUE(first->second.is_exact()) << step;
  }
}

}  // namespace
}  // namespace splatvol
