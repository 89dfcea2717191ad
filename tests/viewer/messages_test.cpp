// Messages of the viewer: toasts, their list, and what Esc ends.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "tests/viewer/viewer_fixture.h"
#include "viewer/frame_loop.h"

namespace splatvol::test {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

constexpr int panel = 336;

struct MessagesTest : test::ViewerFixture {
  void SetUp() override {
    ViewerFixture::SetUp();
    write_two_attributes(path("v.svol"));
    present_ = std::filesystem::current_path();
    std::filesystem::current_path(path());
    resize(800, 600);
    open({.volume = path("v.svol"), .settings = {.works_aside = false}});
    press('H');  // hides the numbers, which change from frame to frame
    settle();
  }
  void TearDown() override { std::filesystem::current_path(present_); }

  // The toasts' texts, the oldest first.
  [[nodiscard]] std::vector<std::string> told() const {
    std::vector<std::string> texts;
    for (const Messages::Message& message : viewer->messages().toasts()) texts.push_back(message.text);
    return texts;
  }
  [[nodiscard]] double seconds_left() const { return viewer->messages().toasts().back().seconds_left; }

  void drop(const std::string& file) { frame({FilesDropped{{file}}}); }
  static std::string no_file(const std::string& file) { return file + ": cannot open: No such file or directory"; }

  // Copies a command, which a note tells. Little time passes.
  void make_note() {
    frame_seconds = 0.01;
    press_with_control('C');
    for (int i = 0; i < 100 && !viewer->is_settled(); ++i) frame({});
    ASSERT_TRUE(viewer->is_settled()) << "though there is a note";
    ASSERT_EQ(told().back(), "copied a command");
  }

  Image rest() {
    frame({PointerMoved{-1, -1}});
    settle();
    return screen();
  }

  // Whether two pictures differ in some columns and rows.
  static bool differ(const Image& a, const Image& b, int left, int right, int top, int bottom) {
    for (int y = top; y < bottom; ++y)
      for (int x = left; x < right; ++x)
        if (a.at(x, y) != b.at(x, y)) return true;
    return false;
  }

 private:
  std::filesystem::path present_;
};

TEST_F(MessagesTest, ANoteIsThereForSixSecondsOfFrames) {
  const Image before = screen();
  make_note();
  EXPECT_TRUE(differ(before, screen(), panel, 800, 400, 486)) << "a toast above the axes";
  EXPECT_FALSE(differ(before, screen(), panel, 800, 486, 600));
  EXPECT_FALSE(differ(before, screen(), panel, 800, 0, 400));

  frame({}, 4);
  EXPECT_THAT(told(), SizeIs(1));
  const double left = seconds_left();
  EXPECT_GT(left, 0);
  EXPECT_LT(left, 2);
  EXPECT_TRUE(viewer->is_settled(0.9 * left));
  EXPECT_FALSE(viewer->is_settled(left)) << "then a frame would look different";
  EXPECT_DOUBLE_EQ(viewer->patience(left - 0.25), 0.25);
  frame({}, 0.9 * left);
  EXPECT_THAT(told(), SizeIs(1));
  frame({}, 0.2 * left);
  EXPECT_THAT(told(), IsEmpty());
  settle();
  EXPECT_FALSE(differ(before, screen(), 0, 800, 0, 600));
}

// Time passes only while the loop waits, as long as it asks for.
TEST_F(MessagesTest, TheLoopSleepsUntilANoteEnds) {
  double now = 0;
  int steps = 0;
  FrameLoop loop(*viewer, {[&](double wait) {
                             now += wait;
                             return FrameInput{wait, {}};
                           },
                           [&](const FrameInput&) {
                             target.use();
                             return Status{};
                           },
                           [] {}});
  make_note();
  const double left = seconds_left();
  for (; !told().empty() && steps < 100; ++steps) ASSERT_TRUE(loop.step());
  EXPECT_NEAR(now, left, 0.01);
  EXPECT_LE(steps, 8) << "it sleeps";

  drop("none.svol");
  settle();
  ASSERT_THAT(told(), SizeIs(1));
  now = 0;
  for (int i = 0; i < 100; ++i) EXPECT_FALSE(*loop.step()) << "an error needs no frames";
  EXPECT_DOUBLE_EQ(now, 100);
}

TEST_F(MessagesTest, ARecordingEndsWithItsNotes) {
  make_note();
  viewer->end_recording();
  frame_seconds = long_time;
  for (int i = 0; i < 20; ++i) settle();
  EXPECT_THAT(told(), SizeIs(1));
}

TEST_F(MessagesTest, AnErrorStaysUntilItIsClosed) {
  const Image before = screen();
  drop("none.svol");
  for (int i = 0; i < 100; ++i) frame({});
  EXPECT_THAT(told(), ElementsAre(no_file("none.svol")));
  EXPECT_TRUE(differ(before, rest(), panel, 800, 400, 486));
  press(key::escape);
  EXPECT_THAT(told(), IsEmpty());
  EXPECT_FALSE(differ(before, rest(), 0, 800, 0, 600));

  drop("a.svol");
  const Image shown = rest();
  int right = 800;  // of the toast
  while (right > panel && !differ(before, shown, right - 1, right, 460, 480)) --right;
  click(right - 16, 470);  // the "x"
  EXPECT_THAT(told(), IsEmpty());
  EXPECT_FALSE(differ(before, rest(), 0, 800, 0, 600));
}

TEST_F(MessagesTest, EqualMessagesAreOne) {
  drop("a.svol");
  drop("b.svol");
  drop("a.svol");
  EXPECT_THAT(told(), ElementsAre(no_file("b.svol"), no_file("a.svol"))) << "the newest last";
  EXPECT_EQ(viewer->messages().toasts().back().times, 2);
  EXPECT_THAT(viewer->messages().all(), SizeIs(2));
  // It comes again after it was closed.
  press(key::escape);
  drop("a.svol");
  EXPECT_EQ(viewer->messages().toasts().back().times, 3);
  EXPECT_THAT(viewer->messages().all(), SizeIs(2));
}

TEST_F(MessagesTest, TheListHasAllAndTakesThePlaceOfToasts) {
  const Image before = rest();
  drop("a.svol");
  make_note();
  frame({}, Messages::note_seconds);
  const Image toasts = rest();
  press('M');
  EXPECT_THAT(told(), IsEmpty());
  EXPECT_THAT(viewer->messages().all(), SizeIs(2));
  const Image list = rest();
  EXPECT_TRUE(differ(toasts, list, panel, 800, 130, 300)) << "the list's rows";
  drop("b.svol");
  EXPECT_THAT(told(), ElementsAre(no_file("b.svol"))) << "what is new has a toast";
  EXPECT_TRUE(differ(list, rest(), panel, 800, 130, 300)) << "and a row";
  press(key::escape);
  EXPECT_TRUE(viewer->messages().is_list_open());
  press(key::escape);
  EXPECT_FALSE(viewer->messages().is_list_open());
  EXPECT_FALSE(differ(before, rest(), 0, 800, 0, 600));
}

// In any window there is a toast, and the picture stays in sight.
TEST_F(MessagesTest, ManyToastsDoNotFillTheWindow) {
  for (const WindowResized& size : {WindowResized{800, 600, 800, 600, 1}, WindowResized{1280, 800, 1280, 800, 1},
                                    WindowResized{1600, 1200, 1600, 1200, 2}, WindowResized{300, 200, 300, 200, 1}}) {
    ASSERT_TRUE(target.resize(size.width, size.height));
    frame({size});
    const auto shown = [&] {
      frame({PointerMoved{-1, -1}});
      settle();
      target.use();
      return read_framebuffer(size.width, size.height).value();
    };
    const Image before = shown();
    const int axes = static_cast<int>(114 * size.content_scale);
    std::vector<Image> pictures;
    for (int errors = 1; errors <= 40; ++errors) {
      drop(std::string(static_cast<std::size_t>(7 * errors), 'a') + ".svol");
      if (errors % 10 != 1) continue;
      pictures.push_back(shown());
      EXPECT_TRUE(differ(before, pictures.back(), 0, size.width, 0, size.height - axes)) << errors;
      if (size.height > 300) {
        EXPECT_FALSE(differ(before, pictures.back(), 0, size.width, 0, size.height * 2 / 5)) << errors;
      }
      EXPECT_FALSE(differ(before, pictures.back(), 0, size.width, size.height - axes, size.height)) << errors;
    }
    EXPECT_TRUE(differ(pictures[0], pictures[1], 0, size.width, 0, size.height)) << "and 10 more";
    EXPECT_THAT(told(), SizeIs(40));
    press('M');
    press('M');
    EXPECT_FALSE(differ(before, shown(), 0, size.width, 0, size.height));
  }
}

TEST_F(MessagesTest, EscEndsWhatBeganLast) {
  const Image before = rest();
  const auto shows_pin = [&](const Image& now) { return differ(before, now, 350, 600, 500, 590); };
  const auto shows_help = [&](const Image& now) { return differ(before, now, 400, 540, 100, 250); };
  const auto pin = [&] { click(568, 300); };
  const auto expect = [&](bool is_pinned, bool has_help, std::size_t errors) {
    const Image now = rest();
    EXPECT_EQ(shows_pin(now), is_pinned);
    EXPECT_EQ(shows_help(now), has_help);
    EXPECT_THAT(told(), SizeIs(errors));
  };
  pin();
  press(key::f1);
  drop("a.svol");
  expect(true, true, 1);
  press(key::escape);
  expect(true, true, 0);
  press(key::escape);
  expect(true, false, 0);
  press(key::escape);
  expect(false, false, 0);

  // In another order, and with a pin that is set anew. A dialog goes first.
  drop("a.svol");
  pin();
  rest();
  press(key::f1);
  drop("b.svol");
  press_with_control('O');
  press(key::escape);
  expect(true, true, 2);
  press(key::escape);
  expect(true, true, 1);
  press(key::escape);
  expect(true, false, 1);
  press(key::escape);
  expect(false, false, 1);
  press(key::escape);
  expect(false, false, 0);
  press(key::escape);
  expect(false, false, 0);
}

// What the session cannot do is told once, though frames follow.
TEST_F(MessagesTest, TroublesOfASessionAreToldOnce) {
  viewer->session()->show_attribute("no such");
  settle();
  for (int i = 0; i < 10; ++i) frame({});
  ASSERT_THAT(told(), SizeIs(1));
  EXPECT_THAT(told()[0], HasSubstr("no such"));
  EXPECT_EQ(viewer->messages().toasts()[0].times, 1);
  // The trouble of another session is another one.
  open({.volume = path("v.svol"), .settings = {.works_aside = false}});
  viewer->session()->show_attribute("no such");
  settle();
  EXPECT_THAT(told(), SizeIs(1));
}

// A toast of work, without the rest of the viewer.
struct WorkToast : testing::Test {
  void SetUp() override {
    ASSERT_TRUE(shared_context());
    gui = *Gui::create(1);
    ASSERT_TRUE(target.resize(width, height));
  }

  // Draws a frame; without work, of messages alone. Returns the button that is pressed.
  std::optional<std::size_t> frame(const std::vector<Event>& events, const Messages::Work* work) {
    EXPECT_TRUE(gui->begin({0.1, events}, {width, height, width, height, 1}));
    messages.begin({0, width, height, 1, 1}, false, 0);
    const auto pressed = work ? messages.draw(*work) : std::nullopt;
    static_cast<void>(messages.draw());
    gui->end();
    return pressed;
  }
  Image shown(const Messages::Work* work) {
    static_cast<void>(frame({}, work));
    static_cast<void>(frame({}, work));
    target.use();
    glClearColor(0, 0, 0, 1);
    glClear(GL_COLOR_BUFFER_BIT);
    EXPECT_TRUE(gui->draw());
    return read_framebuffer(width, height).value();
  }

  static constexpr int width = 400, height = 300;
  std::unique_ptr<Gui> gui;
  ByteTarget target;
  Messages messages;
};

TEST_F(WorkToast, ItsButtonsAnswer) {
  const Messages::Work question{.name = "up", .text = "Which axis is up?", .buttons = {"x", "y", "z"}};
  std::vector<std::size_t> pressed;
  for (int x = 0; x < width; x += 2) {
    static_cast<void>(frame({PointerMoved{static_cast<double>(x), height - 8 - 16}}, &question));
    static_cast<void>(frame({ButtonChanged{0, true}}, &question));
    const auto button = frame({ButtonChanged{0, false}}, &question);
    if (button && (pressed.empty() || pressed.back() != *button)) pressed.push_back(*button);
  }
  EXPECT_THAT(pressed, ElementsAre(0, 1, 2));
}

TEST_F(WorkToast, IsThereWhileItIsDrawn) {
  const Image none = shown(nullptr);
  Messages::Work work{.name = "conversion", .text = "mesh.vtu", .buttons = {"cancel"}, .share = 0.1};
  const Image begun = shown(&work);
  EXPECT_GT(compare_images(begun, none)->max, 0);
  work.share = 0.9;
  work.seconds_left = 12;
  EXPECT_GT(compare_images(shown(&work), begun)->max, 0);
  messages.error("beside it");
  EXPECT_GT(compare_images(shown(&work), shown(nullptr))->max, 0);
  messages.close(messages.newest_error());
  EXPECT_EQ(compare_images(shown(nullptr), none)->max, 0);
}

}  // namespace
}  // namespace splatvol::test
