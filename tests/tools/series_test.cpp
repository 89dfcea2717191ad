// Time steps through the programs: built, appended, shown.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "base/file.h"
#include "scene/image.h"

namespace splatvol {
namespace {

using testing::HasSubstr;

struct Outcome {
  int code;
  std::string text;  // of stdout and stderr
};

class SeriesPrograms : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::temp_directory_path() / fmt::format("splatvol_series_{}", ::getpid());
    std::filesystem::create_directories(folder_);
    for (int step = 0; step < 3; ++step) write_grid(fmt::format("grid_{}.vtk", step), 9, step);
    std::ofstream(path("s.json")) << R"({"camera": {"position": [4, 4, 30], "focal_point": [4, 4, 4], "up": [0, 1, 0],
      "vertical_fov_degrees": 30}, "image": {"width": 64, "height": 48}, "background": [0, 0, 0], "attribute": "p",
      "transfer_function": {"domain": [0, 30], "colors": [[0, 1, 0.5, 0.2], [1, 0.2, 0.5, 1]],
      "density": [[0, 0.1], [1, 0.3]]}, "lighting": false})";
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  [[nodiscard]] std::string path(const std::string& name) const { return (folder_ / name).string(); }

  // A legacy file with a lattice of `side` points along each axis.
  void write_grid(const std::string& name, int side, int step) const {
    std::ofstream file(path(name));
    file << "# vtk DataFile Version 3.0\ntest\nASCII\nDATASET STRUCTURED_POINTS\n"
         << fmt::format("DIMENSIONS {0} {0} {0}\nORIGIN 0 0 0\nSPACING 1 1 1\n", side)
         << fmt::format("POINT_DATA {}\nSCALARS p double 1\nLOOKUP_TABLE default\n", side * side * side);
    for (int i = 0; i < side * side * side; ++i) file << (i % side) + step * (i / side % side) << "\n";
  }

  Outcome run(const std::string& command_line) const {
    const std::string command = fmt::format("cd '{}' && '{}'/{} 2>&1", folder_.string(), SPLATVOL_BIN, command_line);
    FILE* pipe = ::popen(command.c_str(), "r");
    Outcome outcome{-1, ""};
    char buffer[4096];
    while (const std::size_t got = std::fread(buffer, 1, sizeof(buffer), pipe)) outcome.text.append(buffer, got);
    const int status = ::pclose(pipe);
    if (WIFEXITED(status)) outcome.code = WEXITSTATUS(status);
    return outcome;
  }
  void expect_done(const std::string& command_line) const {
    const Outcome outcome = run(command_line);
    EXPECT_EQ(outcome.code, 0) << command_line << ": " << outcome.text;
  }
  void expect_refusal(const std::string& command_line, const std::string& reason, int code = 1) const {
    const Outcome outcome = run(command_line);
    EXPECT_EQ(outcome.code, code) << command_line << ": " << outcome.text;
    EXPECT_THAT(outcome.text, HasSubstr(reason));
  }
  void expect_same_picture(const std::string& a, const std::string& b) const {
    const auto difference = compare_images(read_exr(path(a)).value(), read_exr(path(b)).value());
    ASSERT_TRUE(difference);
    EXPECT_EQ(difference->rmse, 0) << a << " and " << b;
  }

 private:
  std::filesystem::path folder_;
};

TEST_F(SeriesPrograms, StepsLookLikeFilesOfTheirOwn) {
  expect_done("svbuild --series grid_0.vtk grid_1.vtk -o s.svol");
  expect_done("svbuild --append grid_2.vtk -o s.svol");
  expect_done("svbuild --series-of-files grid_0.vtk grid_1.vtk -o f.svols");
  expect_done("svbuild --series-of-files --append grid_2.vtk -o f.svols");
  expect_done("svinfo s.svol --verify");
  expect_done("svinfo f.svols --verify");
  std::filesystem::create_directories(path("frames"));
  for (const std::string name : {"s.svol", "f.svols"}) {
    expect_done(fmt::format("svrender {} --scene s.json --steps all --progress-frames frames -o last.exr", name));
    for (int step = 0; step < 3; ++step) {
      EXPECT_TRUE(std::filesystem::exists(path(fmt::format("frames/frame-{:04}.png", step))));
      std::filesystem::remove(path(fmt::format("frames/frame-{:04}.png", step)));
      expect_done(fmt::format("svbuild grid_{}.vtk -o one.svol", step));
      expect_done("svrender one.svol --scene s.json -o one.exr");
      expect_done(fmt::format("svrender {} --scene s.json --step {} -o step.exr", name, step));
      expect_same_picture("one.exr", "step.exr");
      expect_done(fmt::format("svrender {} --scene s.json --time {} -o time.exr", name, step + 0.2));
      expect_same_picture("one.exr", "time.exr");
    }
    expect_same_picture("one.exr", "last.exr");
  }
}

TEST_F(SeriesPrograms, SvinfoListsTheSteps) {
  expect_done("svbuild --series grid_0.vtk grid_1.vtk grid_2.vtk -o s.svol");
  const auto info = nlohmann::json::parse(run("svinfo s.svol --json --step 1").text);
  EXPECT_EQ(info["series"]["steps"].size(), 3U);
  EXPECT_EQ(info["series"]["step"], 1);
  EXPECT_EQ(info["attributes"][0]["max"], 16);
  EXPECT_EQ(info["series"]["attributes"][0]["max"], 24);
  EXPECT_THAT(run("svinfo s.svol").text, HasSubstr("shown here"));
}

TEST_F(SeriesPrograms, WrongCallsAreRefused) {
  write_grid("other.vtk", 8, 0);
  expect_refusal("svbuild --series grid_0.vtk other.vtk -o x.svol", "--series-of-files");
  EXPECT_FALSE(std::filesystem::exists(path("x.svol")));
  expect_done("svbuild --series-of-files grid_0.vtk other.vtk -o x.svols");
  expect_done("svbuild grid_0.vtk -o one.svol");
  expect_refusal("svbuild --append grid_1.vtk -o one.svol", "not a time series");
  expect_refusal("svbuild --times all grid_0.vtk -o x.svol", "no time steps in it");
  expect_refusal("svbuild --times 3 grid_0.vtk -o x.svol", "neither \"all\" nor", 2);
  expect_refusal("svbuild --series-of-files grid_0.vtk -o x.svol", "NAME.svols");
  expect_refusal("svrender one.svol --scene s.json --step 0 -o x.png", "no time series");
  expect_done("svbuild --series grid_0.vtk grid_1.vtk -o s.svol");
  expect_refusal("svrender s.svol --scene s.json --step 2 -o x.png", "no step 2; the last is 1");
  expect_refusal("svexport s.svol --step 2 -o x.vtu", "no step 2; the last is 1");
  expect_done("svexport s.svol --step 0 -o x.vtu");
  expect_refusal("svrender s.svol --scene s.json --steps 0:1 -o x.png", "--progress-frames", 2);
  expect_refusal("svrender s.svol --scene s.json --steps 1:5 --progress-frames . -o x.png", "the last is 1");
}

}  // namespace
}  // namespace splatvol
