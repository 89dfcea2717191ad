// svview, started like a user starts it: recordings, screenshots, camera paths, a real window.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <thread>

#include "base/file.h"
#include "format/volume.h"
#include "pictures/image.h"
#include "scene/scene.h"
#include "tests/renderer/surfaces/shapes.h"
#include "tests/support/programs.h"
#include "tests/support/test_volume.h"

namespace splatvol::test {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;
using testing::HasSubstr;

struct Svview : test::ProgramTest {
  void SetUp() override {
    ASSERT_TRUE(write_test_volume(volume_of_x(3000), path("v.svol")));
    // Turns, zooms, and hides the numbers: some of them are times.
    write("r.jsonl", R"({"seconds":0.1,"events":[["size",640,480,640,480,1],["pointer",500,200]]})"
                     "\n"
                     R"({"seconds":0.1,"events":[["button",0,true],["pointer",540,230],["button",0,false]]})"
                     "\n"
                     R"({"seconds":0.1,"events":[["scroll",0,2],["key",72,true],["key",72,false]]})"
                     "\n"
                     R"({"seconds":0.1,"events":[["pointer",350,400]]})"
                     "\n");
  }

  Outcome run(const std::string& arguments,
              const std::string& environment = "env -u DISPLAY -u WAYLAND_DISPLAY") const {
    return ProgramTest::run(environment + " svview " + arguments);
  }
  void refuses(const std::string& arguments, const std::string& reason, int code = 1) const {
    const Outcome outcome = run(arguments);
    EXPECT_EQ(outcome.code, code) << arguments << "\n" << outcome.text;
    EXPECT_THAT(outcome.text, HasSubstr(reason)) << arguments;
  }
};

TEST_F(Svview, ReplaysARecordingWithoutAWindow) {
  const Outcome first = run("v.svol --replay r.jsonl --screenshot a.exr");
  ASSERT_EQ(first.code, 0) << first.text;
  EXPECT_EQ(first.text, "");
  ASSERT_EQ(run("v.svol --replay r.jsonl --screenshot b.exr").code, 0);
  ASSERT_EQ(run("v.svol --size 640x480 --screenshot c.exr").code, 0);
  const Image a = *read_exr(path("a.exr"));
  EXPECT_EQ(a.width, 640);
  EXPECT_EQ(a.height, 480);
  EXPECT_EQ(compare_images(a, *read_exr(path("b.exr")))->max, 0);       // the same replay
  EXPECT_GT(compare_images(a, *read_exr(path("c.exr")))->rmse, 0.005);  // the picture before it
}

// A scene that names its file opens it, and shows what was seen when it was saved.
TEST_F(Svview, ASceneNamesItsFile) {
  const auto picture = [&](const std::string& arguments) {
    const Outcome outcome = run(arguments + " --size 640x480 --screenshot a.exr");
    EXPECT_EQ(outcome.code, 0) << outcome.text;
    return read_exr(path("a.exr")).value();
  };
  expect_done("svinfo v.svol --scene s.json");
  UsedScene used = load_used_scene(path("s.json")).value();
  const Image expected = picture("v.svol --scene s.json --tolerance 9");
  used.use = {.file = "v.svol", .quality = {.tolerance_percent = 9}};
  write("named.json", to_json(used));
  EXPECT_LT(compare_images(picture("named.json"), expected)->rmse, 0.02) << "but for numbers of times";
  EXPECT_LT(compare_images(picture("--scene named.json"), expected)->rmse, 0.02);
  used.use.file = path("v.svol");
  EXPECT_LT(compare_images(picture("--scene '" + to_json(used, -1) + "'"), expected)->rmse, 0.02);

  refuses("s.json --screenshot b.png", "names no file");
}

// The plate hides what is behind it, while the picture moves too: the recording ends with a turn.
TEST_F(Svview, ShowsTheSurfacesOfAScene) {
  expect_done("svinfo v.svol --scene s.json");
  auto scene = nlohmann::json::parse(read("s.json"));
  write("plate.stl", stl_of(test::plate({-9, -9, 0.5}, {18, 0, 0}, {0, 18, 0})));
  const auto screenshot = [&](const nlohmann::json& surfaces, const std::string& device) {
    if (!surfaces.is_null()) scene["surfaces"] = surfaces;
    write("s.json", scene.dump());
    const Outcome outcome = run("v.svol --scene s.json --replay r.jsonl --screenshot a.exr --device " + device);
    EXPECT_EQ(outcome.code, 0) << outcome.text;
    return *read_exr(path("a.exr"));
  };
  for (const char* device : {"cpu", "gl"}) {
    scene.erase("surfaces");
    const Image without = screenshot(nullptr, device);
    const Image off = screenshot({{{"file", "plate.stl"}, {"shown", false}}}, device);
    // Besides the panel's list.
    const vec4 middle_without = without.at(500, 240);
    EXPECT_EQ(off.at(500, 240), middle_without);
    const Image plate = screenshot({{{"file", "plate.stl"}, {"color", {0, 0, 9}}}}, device);
    EXPECT_GT(plate.at(500, 240).b, middle_without.b + 0.2F) << device;
    const Image glass = screenshot({{{"file", "plate.stl"}, {"color", {0, 0, 9}}, {"opacity", 0.02}}}, device);
    EXPECT_GT(glass.at(500, 240).b, middle_without.b + 0.01F) << device;
    EXPECT_LT(glass.at(500, 240).b, plate.at(500, 240).b) << device;
  }
  scene["surfaces"] = {{{"file", "gone.stl"}}};
  write("s.json", scene.dump());
  refuses("v.svol --scene s.json --screenshot b.png", "gone.stl: cannot open");
}

TEST_F(Svview, DrawsACameraPath) {
  write("path.json", R"({"seconds": 0.5, "cameras": [
    {"position": [0.5, 0.5, 4], "focal_point": [0.5, 0.5, 0.5], "up": [0, 1, 0], "vertical_fov_degrees": 30},
    {"position": [4, 0.5, 0.5], "focal_point": [0.5, 0.5, 0.5], "up": [0, 1, 0], "vertical_fov_degrees": 30}]})");
  fs::create_directories(path("frames"));
  const Outcome outcome = run("v.svol --play path.json --frames frames --fps 10 --size 64x48");
  ASSERT_EQ(outcome.code, 0) << outcome.text;
  EXPECT_EQ(std::distance(fs::directory_iterator(path("frames")), {}), 5);
  EXPECT_TRUE(fs::exists(path("frames/frame-00004.png")));
}

TEST_F(Svview, TellsOfPartsThatCannotBeRead) {
  expect_done("svinfo v.svol --scene s.json");
  std::string bytes = read("v.svol");
  const auto volume = *format::Volume::open(*open_file(path("v.svol")));
  const auto rows = std::ranges::find(volume->sections(), format::SectionKind::rows, &format::SectionEntry::kind);
  for (std::size_t i = 1; i < 500; i += 100) bytes[rows->offset + rows->packed_bytes - i] ^= 0x55;  // the finest
  write("damaged.svol", bytes);
  write("path.json", R"({"seconds": 1, "cameras": [
    {"position": [0.5, 0.5, 4], "focal_point": [0.5, 0.5, 0.5], "up": [0, 1, 0], "vertical_fov_degrees": 30}]})");
  fs::create_directories(path("frames"));
  for (const std::string arguments : {" --screenshot a.png", " --play path.json --frames frames --fps 2"}) {
    refuses("damaged.svol" + arguments + " --size 64x48 --scene s.json", "could not be read");
  }
}

// Too little memory for a picture ends a replay.
TEST_F(Svview, APictureThatCannotBeDrawnEndsAReplay) {
  refuses("v.svol --memory 10K --size 64x48 --screenshot a.png", "memory");
}

TEST_F(Svview, SaysWhatIsWrong) {
  write("bad.jsonl", "[]\n");
  refuses("none.svol --screenshot a.png", "none.svol");
  refuses("v.svol --replay bad.jsonl", "bad.jsonl:1");
  refuses("v.svol --screenshot a.txt", "a.txt", 2);
  refuses("v.svol --size 0x5", "0x5", 2);
  refuses("v.svol --max-error 0 --screenshot a.png", "not a number above 0", 2);
  refuses("v.svol --max-error 0.01 --tolerance 1 --screenshot a.png", "excludes", 2);
  refuses("v.svol --play none.json --frames .", "none.json");
  refuses("v.svol", "no window");  // without a display
  EXPECT_FALSE(fs::exists(path("a.png")));
}

// Runs a display server without a screen during its lifetime.
class Xvfb {
 public:
  Xvfb() {
    int ends[2];
    if (::pipe(ends) != 0) return;
    process_ = ::fork();
    if (process_ == 0) {
      const int null = ::open("/dev/null", O_RDWR);
      ::dup2(null, 1);
      ::dup2(null, 2);
      const std::string write_end = std::to_string(ends[1]);
      ::execlp("Xvfb", "Xvfb", "-displayfd", write_end.c_str(), "-screen", "0", "800x600x24", "-nolisten", "tcp",
               nullptr);
      ::_exit(127);
    }
    ::close(ends[1]);
    std::string number;
    for (char c; ::read(ends[0], &c, 1) == 1 && c != '\n';) number += c;
    ::close(ends[0]);
    if (!number.empty()) display_ = ":" + number;
  }
  ~Xvfb() {
    ::kill(process_, SIGTERM);
    ::waitpid(process_, nullptr, 0);
  }
  Xvfb(const Xvfb&) = delete;
  Xvfb& operator=(const Xvfb&) = delete;

  [[nodiscard]] const std::string& display() const { return display_; }  // empty: no server

 private:
  pid_t process_ = -1;
  std::string display_;
};

TEST_F(Svview, AWindowShowsWhatIsShownWithoutOne) {
  const Xvfb server;
  if (server.display().empty()) GTEST_SKIP() << "no Xvfb on this machine (package xvfb)";
  const std::string options = "v.svol --replay r.jsonl --screenshot ";
  const Outcome in_window = run(options + "w.exr --window", "env -u WAYLAND_DISPLAY DISPLAY=" + server.display());
  ASSERT_EQ(in_window.code, 0) << in_window.text;
  ASSERT_EQ(run(options + "a.exr").code, 0);
  // A window's pixels have 8 bits.
  EXPECT_LT(compare_images(*read_exr(path("w.exr")), *read_exr(path("a.exr")))->max, 0.02);
}

// Recordings tell how a crash came about.
TEST_F(Svview, ARecordingSurvivesTheEndOfTheProgram) {
  const Xvfb server;
  if (server.display().empty()) GTEST_SKIP() << "no Xvfb on this machine (package xvfb)";
  const std::string recording = path("lost.jsonl"), volume = path("v.svol"), display = "DISPLAY=" + server.display();
  const pid_t viewer = ::fork();
  if (viewer == 0) {
    ::execlp("env", "env", "-u", "WAYLAND_DISPLAY", display.c_str(), SPLATVOL_BIN "/svview", volume.c_str(), "--record",
             recording.c_str(), nullptr);
    ::_exit(127);
  }
  const auto frames = [&] {
    const auto text = read_text_file(recording);
    return text ? std::ranges::count(*text, '\n') : 0;
  };
  for (int tenths = 0; tenths < 600 && frames() < 3; ++tenths) std::this_thread::sleep_for(100ms);
  ::kill(viewer, SIGKILL);
  ::waitpid(viewer, nullptr, 0);
  EXPECT_GE(frames(), 3);
  EXPECT_EQ(run(volume + " --replay " + recording + " --screenshot a.png").code, 0);
}

}  // namespace
}  // namespace splatvol::test
