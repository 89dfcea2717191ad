// Recordings.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "player/events.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol {
namespace {

using testing::HasSubstr;

class Recording : public test::FolderTest {
 protected:
  void write(const std::string& text) const { FolderTest::write("recording.jsonl", text); }
  const std::string file = path("recording.jsonl");
};

TEST_F(Recording, ComesBackAsItWas) {
  const std::vector<FrameInput> frames = {
      {0.25, {WindowResized{800, 600, 1600, 1200, 2}, PointerMoved{1.5, 2}, ButtonChanged{1, true}}},
      {0, {}},
      {1, {Scrolled{0, -1}, KeyChanged{key::f1, false}, TextTyped{0x20AC}, FilesDropped{{"/a b/\"c\".svol", "d"}}}}};
  std::string text;
  auto recording = RecordingFile::create(file);
  ASSERT_TRUE(recording);
  for (const FrameInput& frame : frames) {
    text += to_line(frame);
    ASSERT_TRUE(recording->add(frame));
    EXPECT_EQ(*read_text_file(file), text) << "it is there at once";
  }
  const auto read = test::value_of(load_recording(file));
  ASSERT_EQ(read.size(), frames.size());
  std::string again;
  for (const FrameInput& frame : read) again += to_line(frame);
  EXPECT_EQ(again, text);
  EXPECT_EQ(std::get<FilesDropped>(read[2].events[3]).paths[0], "/a b/\"c\".svol");
  EXPECT_EQ(std::get<WindowResized>(read[0].events[0]).pixel_width, 1600);
}

// A program that crashed, or a disk that is full.
TEST_F(Recording, MayBeCutOffAnywhere) {
  const std::string line = to_line({0.25, {PointerMoved{1.5, 2}, FilesDropped{{"a"}}}});
  for (std::size_t bytes = 0; bytes <= line.size(); ++bytes) {
    write(line + line + line.substr(0, bytes));
    const auto read = test::value_of(load_recording(file));
    EXPECT_EQ(read.size(), bytes + 1 < line.size() ? 2u : 3u) << bytes;
  }
  write(line + line.substr(0, 5) + "\n" + line);
  EXPECT_FALSE(load_recording(file)) << "not cut off";
  EXPECT_THAT(RecordingFile::create("no/such/folder.jsonl").error().message, HasSubstr("no/such/folder.jsonl"));
  auto full = RecordingFile::create("/dev/full");
  ASSERT_TRUE(full);
  EXPECT_THAT(full->add({}).error().message, HasSubstr("No space left"));
}

TEST_F(Recording, RefusesWhatIsNone) {
  const std::string good = to_line({0.1, {}});
  for (const auto& [text, reason] : {std::pair<std::string, std::string>{"", "empty"},
                                     {"no JSON\n", ":1: "},
                                     {good + "{}\n", ":2: "},
                                     {R"({"seconds": -1, "events": []})", "negative"},
                                     {R"({"seconds": 0, "events": [["jump", 1]]})", "jump"},
                                     {R"({"seconds": 0, "events": [["key", 100000, true]]})", "100000"},
                                     {R"({"seconds": 0, "events": [["key", "A", true]]})", "not a frame"},
                                     {R"({"seconds": 0, "events": [["key", 4294967361, true]]})", "out of range"},
                                     {R"({"seconds": 0, "events": [["button", 1e300, true]]})", "out of range"},
                                     {R"({"seconds": 0, "events": [["text", -1]]})", "out of range"},
                                     {R"({"seconds": 0, "events": [["size", 9, 9, -1, 9, 1]]})", "size"},
                                     {R"({"seconds": 0, "events": [["size", 9, 9, 9, 9, 0]]})", "scale"}}) {
    write(text);
    const auto read = load_recording(file);
    ASSERT_FALSE(read) << text;
    EXPECT_THAT(read.error().message, HasSubstr(reason));
  }
  EXPECT_FALSE(load_recording("no/such.jsonl"));
}

// Returns the events of each frame as the letters of their kinds.
std::string frames_of(const std::vector<Event>& events) {
  EventQueue queue;
  queue.add(events);
  std::string frames;
  while (!queue.is_empty()) {
    for (const Event& event : queue.take_frame()) frames += "mbskt"[event.index()];
    frames += ' ';
  }
  return frames;
}

TEST(EventQueue, GivesAFrameToEachChangeThatWouldHideAnother) {
  const PointerMoved move{1, 2};
  const ButtonChanged press{0, true}, release{0, false};
  const KeyChanged down{'A', true}, up{'A', false}, other{'B', true}, back{key::backspace, true};
  const TextTyped text{'a'};
  EXPECT_EQ(frames_of({press, release, press, release}), "b b b b ");
  EXPECT_EQ(frames_of({move, move, press, move, move, release, move}), "mm b mm b m ");
  EXPECT_EQ(frames_of({Scrolled{0, 1}, Scrolled{0, 1}, move, Scrolled{0, 1}}), "ssm s ");
  EXPECT_EQ(frames_of({down, other, up}), "kk k ");
  EXPECT_EQ(frames_of({down, down, down}), "kkk ") << "a key that repeats";
  EXPECT_EQ(frames_of({down, text, other, text}), "ktkt ") << "fast typing";
  EXPECT_EQ(frames_of({text, back, text}), "t k t ");
  EXPECT_EQ(frames_of({KeyChanged{key::left_control, true}, press}), "kb ");
  EXPECT_EQ(frames_of({press, KeyChanged{key::left_control, false}}), "b k ");
}

TEST(EventQueue, KeepsWhatWaits) {
  EventQueue queue;
  queue.add({ButtonChanged{0, true}, ButtonChanged{0, false}});
  EXPECT_EQ(queue.take_frame().size(), 1u);
  queue.add({PointerMoved{3, 4}});
  EXPECT_FALSE(std::get<ButtonChanged>(queue.take_frame().at(0)).down);
  EXPECT_EQ(std::get<PointerMoved>(queue.take_frame().at(0)).x, 3);
  EXPECT_TRUE(queue.is_empty());
  EXPECT_TRUE(queue.take_frame().empty());
}

TEST(Keys, AreThoseOfTheUsersLayout) {
  EXPECT_EQ(key_by_name('Y', "z"), 'Z') << "QWERTZ";
  EXPECT_EQ(key_by_name('Q', "a"), 'A') << "AZERTY";
  EXPECT_EQ(key_by_name('1', "&"), '1') << "digits of AZERTY";
  EXPECT_EQ(key_by_name('R', "\xd0\xba"), 'R') << "Cyrillic";
  EXPECT_EQ(key_by_name('R', ""), 'R');
  EXPECT_EQ(key_by_name(key::tab, ""), key::tab);
}

}  // namespace
}  // namespace splatvol
