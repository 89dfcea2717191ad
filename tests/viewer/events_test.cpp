// Recordings.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "viewer/events.h"

namespace splatvol {
namespace {

using testing::HasSubstr;

class Recording : public testing::Test {
 protected:
  ~Recording() override { std::filesystem::remove(file); }
  void write(const std::string& text) const { std::ofstream(file) << text; }
  const std::string file = testing::TempDir() + "splatvol_recording_" + std::to_string(::getpid()) + ".jsonl";
};

TEST_F(Recording, ComesBackAsItWas) {
  const std::vector<FrameInput> frames = {
      {0.25, {WindowResized{800, 600, 1600, 1200, 2}, PointerMoved{1.5, 2}, ButtonChanged{1, true}}},
      {0, {}},
      {1, {Scrolled{0, -1}, KeyChanged{key::f1, false}, TextTyped{0x20AC}, FilesDropped{{"/a b/\"c\".svol", "d"}}}}};
  std::string text;
  for (const FrameInput& frame : frames) text += to_line(frame);
  write(text);
  const auto read = load_recording(file);
  ASSERT_TRUE(read) << read.error().message;
  ASSERT_EQ(read->size(), frames.size());
  std::string again;
  for (const FrameInput& frame : *read) again += to_line(frame);
  EXPECT_EQ(again, text);
  EXPECT_EQ(std::get<FilesDropped>((*read)[2].events[3]).paths[0], "/a b/\"c\".svol");
  EXPECT_EQ(std::get<WindowResized>((*read)[0].events[0]).pixel_width, 1600);
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

}  // namespace
}  // namespace splatvol
