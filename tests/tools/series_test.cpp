// Time steps through the programs: built, appended, shown.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "pictures/image.h"
#include "tests/support/program_json.h"

namespace splatvol::test {
namespace {

using testing::HasSubstr;

struct SeriesPrograms : ProgramTest {
  void SetUp() override {
    for (int step = 0; step < 3; ++step) write_grid(fmt::format("grid_{}.vtk", step), 9, step);
    std::ofstream(path("s.json")) << R"({"camera": {"position": [4, 4, 30], "focal_point": [4, 4, 4], "up": [0, 1, 0],
      "vertical_fov_degrees": 30}, "image": {"width": 64, "height": 48}, "background": [0, 0, 0], "attribute": "p",
      "transfer_function": {"domain": [0, 30], "colors": [[0, 1, 0.5, 0.2], [1, 0.2, 0.5, 1]],
      "density": [[0, 0.1], [1, 0.3]]}, "lighting": false})";
  }

  // A legacy file with a lattice of `side` points along each axis. `array`: the head of its values.
  template <class Value>
  void write_lattice(const std::string& name, int side, const std::string& array, const Value& value) const {
    std::ofstream file(path(name));
    file << "# vtk DataFile Version 3.0\ntest\nASCII\nDATASET STRUCTURED_POINTS\n"
         << fmt::format("DIMENSIONS {0} {0} {0}\nORIGIN 0 0 0\nSPACING 1 1 1\n", side)
         << fmt::format("POINT_DATA {}\n{}\n", side * side * side, array);
    for (int i = 0; i < side * side * side; ++i) file << value(i % side, i / side % side) << "\n";
  }
  void write_vectors(const std::string& name) const {
    write_lattice(name, 9, "VECTORS p double", [](int x, int) { return fmt::format("{} 1 0", x); });
  }
  void write_grid(const std::string& name, int side, int step, const std::string& attribute = "p") const {
    write_lattice(name, side, "SCALARS " + attribute + " double 1\nLOOKUP_TABLE default",
                  [step](int x, int y) { return x + step * y; });
  }

  void expect_same_picture(const std::string& a, const std::string& b) const {
    const auto difference = compare_images(read_exr(path(a)).value(), read_exr(path(b)).value());
    ASSERT_TRUE(difference);
    EXPECT_EQ(difference->rmse, 0) << a << " and " << b;
  }
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
    expect_done(
        fmt::format("svrender {} --scene s.json --tolerance 1 --steps all --progress-frames frames -o last.exr", name));
    for (int step = 0; step < 3; ++step) {
      EXPECT_TRUE(std::filesystem::remove(path(fmt::format("frames/frame-{:04}.png", step))));
      expect_done(fmt::format("svbuild grid_{}.vtk -o one.svol", step));
      expect_done("svrender one.svol --scene s.json --tolerance 1 -o one.exr");
      expect_done(fmt::format("svrender {} --scene s.json --tolerance 1 --step {} -o step.exr", name, step));
      expect_same_picture("one.exr", "step.exr");
      expect_done(fmt::format("svrender {} --scene s.json --tolerance 1 --time {} -o time.exr", name, step + 0.2));
      expect_same_picture("one.exr", "time.exr");
    }
    expect_same_picture("one.exr", "last.exr");
  }
}

TEST_F(SeriesPrograms, SvinfoListsTheSteps) {
  expect_done("svbuild --series grid_0.vtk grid_1.vtk grid_2.vtk -o s.svol");
  expect_done("svbuild --series-of-files grid_0.vtk grid_1.vtk -o f.svols");
  expect_done("svbuild --series-of-files --append grid_2.vtk -o f.svols");
  for (const std::string name : {"s.svol", "f.svols"}) {
    const auto info = document_of(run("svinfo " + name + " --json --step 1"));
    EXPECT_EQ(info["series"]["steps"].size(), 3U);
    EXPECT_EQ(info["series"]["step"], 1);
    EXPECT_EQ(info["attributes"][0]["max"], 16);
    EXPECT_EQ(info["series"]["attributes"][0]["name"], "p");
    EXPECT_EQ(info["series"]["attributes"][0]["min"], 0);
    EXPECT_EQ(info["series"]["attributes"][0]["max"], 24);
    EXPECT_THAT(run("svinfo " + name).text, HasSubstr("shown here"));
  }
}

// The mesh of a series of files may change.
TEST_F(SeriesPrograms, ASeriesOfFilesPlaysLikeASeries) {
  write_grid("other.vtk", 7, 3);
  expect_done("svbuild --series-of-files grid_0.vtk other.vtk -o f.svols");
  for (const auto& [step, mesh] : {std::pair{0, "grid_0"}, {1, "other"}}) {
    expect_done(fmt::format("svbuild {}.vtk -o one.svol", mesh));
    expect_done("svexport one.svol -o one.vtu");
    expect_done(fmt::format("svexport f.svols --step {} -o step.vtu", step));
    EXPECT_EQ(read("one.vtu"), read("step.vtu"));
  }
  expect_refusal("svexport f.svols --step 2 -o x.vtu", "no step 2; the last is 1");
  expect_done("svview f.svols --size 640x480 --screenshot shot.exr");
  expect_done("svview one.svol --size 640x480 --screenshot one.exr");
  const Image shot = read_exr(path("shot.exr")).value(), one = read_exr(path("one.exr")).value();
  EXPECT_EQ(shot.width, 640);
  EXPECT_GT(compare_images(shot, one)->rmse, 0) << "no steps in the panel";

  std::filesystem::remove(path("f-0001.svol"));
  expect_refusal("svview f.svols --screenshot x.exr", "f-0001.svol");
  expect_done("svinfo f.svols --step 0");
}

// The names of the files of f.svols, each of which is there.
std::vector<std::string> files_of_index(const std::string& folder) {
  std::vector<std::string> files;
  const auto index = nlohmann::json::parse(std::ifstream(folder + "f.svols"));
  for (const auto& step : index["steps"]) files.push_back(step["file"]);
  for (const std::string& file : files) EXPECT_TRUE(std::filesystem::exists(folder + file)) << file;
  return files;
}

TEST_F(SeriesPrograms, TwoAppendsAtOnceLoseNoStep) {
  for (int round = 0; round < 12; ++round) {
    ASSERT_EQ(run("rm -f *svol*").code, 0);
    expect_done("svbuild --series-of-files grid_0.vtk -o f.svols");
    const std::string append = "svbuild --series-of-files --append -o f.svols";
    const Outcome both =
        run(fmt::format("{0} grid_1.vtk & sleep 0.0{1}; {0} grid_2.vtk && wait $!", append, round % 4));
    EXPECT_EQ(both.code, 0) << both.text;
    EXPECT_EQ(files_of_index(folder_).size(), 3U) << both.text;
  }
  expect_done("svinfo f.svols --verify");
}

// One file takes one append at a time: the other one is refused, or comes later.
TEST_F(SeriesPrograms, TwoAppendsToOneFileAtOnceTellTheTruth) {
  for (int round = 0; round < 8; ++round) {
    expect_done("svbuild --series grid_0.vtk -o s.svol");
    const std::string append = "svbuild --append -o s.svol";
    const Outcome both = run(fmt::format(
        "{0} grid_1.vtk & sleep 0.0{1}; {0} grid_2.vtk; a=$?; wait $!; exit $((2 * a + $?))", append, round % 4));
    const std::size_t failed = static_cast<std::size_t>(both.code % 2 + both.code / 2);
    const auto info = document_of(run("svinfo s.svol --json"));
    EXPECT_EQ(info["series"]["steps"].size(), 3 - failed) << both.text;
    EXPECT_LT(failed, 2U) << both.text;
    expect_done("svinfo s.svol --verify");
  }
}

// Also one whose end is too sudden to remove anything.
TEST_F(SeriesPrograms, AnAppendThatWasKilledIsInNoOnesWay) {
  expect_done("svbuild --series-of-files grid_0.vtk -o f.svols");
  for (int milliseconds = 5; milliseconds < 200; milliseconds += milliseconds / 5 + 4) {
    const Outcome killed = run(fmt::format(
        "timeout -s KILL {} svbuild --series-of-files --append grid_1.vtk -o f.svols", 1e-3 * milliseconds));
    const std::size_t steps = files_of_index(folder_).size();
    expect_done("svbuild --series-of-files --append grid_2.vtk -o f.svols");
    EXPECT_EQ(files_of_index(folder_).size(), steps + 1) << killed.text;
  }
  const int last = std::stoi(files_of_index(folder_).back().substr(2));
  std::ofstream(path(fmt::format("f-{:04}.svol", last + 1))) << "left";
  EXPECT_THAT(run("svbuild --series-of-files --append grid_2.vtk -o f.svols").text,
              HasSubstr(fmt::format("f-{:04}.svol: is there already", last + 1)));
  EXPECT_EQ(files_of_index(folder_).back(), fmt::format("f-{:04}.svol", last + 2));
  expect_done("svinfo f.svols --verify");
}

// Two attributes that agree at the first step only: each file has both by their own names.
TEST_F(SeriesPrograms, AFirstStepOfEqualValuesHasAllAttributes) {
  for (int step = 0; step < 2; ++step) {
    std::string text = "x,y,z,a,b\n";
    for (int i = 0; i < 27; ++i) text += fmt::format("{},{},{},{},{}\n", i % 3, i / 3 % 3, i / 9, i, i * (1 + step));
    write(fmt::format("points_{}.csv", step), text);
  }
  expect_done("svbuild --series-of-files points_0.csv points_1.csv -o f.svols");
  const auto info = document_of(run("svinfo f.svols --json --step 0"));
  EXPECT_EQ(info["attributes"].size(), 2U);
  EXPECT_EQ(info["series"]["attributes"][1]["name"], "b");
  EXPECT_EQ(info["series"]["attributes"][1]["max"], 52);
}

// An attribute that a step lacks is missing there. Appended steps bring no new ones.
TEST_F(SeriesPrograms, AttributesOfSomeSteps) {
  write_grid("named.vtk", 9, 0, "q");
  for (const std::string kind : {"--series", "--series-of-files"}) {
    const std::string name = kind == "--series" ? "y.svol" : "y.svols";
    expect_done(fmt::format("svbuild {} --strict grid_0.vtk named.vtk -o {}", kind, name));
    for (int step = 0; step < 2; ++step) {
      const auto info = document_of(run(fmt::format("svinfo {} --json --step {}", name, step)));
      ASSERT_EQ(info["attributes"].size(), 2U);
      EXPECT_EQ(info["attributes"][0]["missing"], step == 0 ? 0 : 729);
      EXPECT_EQ(info["attributes"][1]["missing"], step == 0 ? 729 : 0);
    }
    expect_done(fmt::format("svinfo {} --verify", name));
    const auto drawn = run(fmt::format("svrender {} --scene s.json --tolerance 1 --step 1 -o missing.exr", name));
    EXPECT_EQ(drawn.code, 0);
    EXPECT_THAT(drawn.err, HasSubstr("no point has a value of the attribute"));
  }
  expect_done("svbuild --series grid_0.vtk -o x.svol");
  expect_done("svbuild --series-of-files grid_0.vtk -o x.svols");
  expect_refusal("svbuild --append named.vtk -o x.svol", "the series does not have the attribute \"q\"");
  expect_refusal("svbuild --series-of-files --append named.vtk -o x.svols", "leave it out by --attribute p");
  EXPECT_FALSE(std::filesystem::exists(path("x-0001.svol")));
}

TEST_F(SeriesPrograms, AVectorIsAppendedToAVectorOnly) {
  write_vectors("vectors_0.vtk");
  write_vectors("vectors_1.vtk");
  for (const std::string kind : {"--series", "--series-of-files"}) {
    const std::string numbers = kind == "--series" ? "n.svol" : "n.svols";
    const std::string vectors = kind == "--series" ? "v.svol" : "v.svols";
    const std::string append = kind == "--series" ? "--append" : "--series-of-files --append";
    expect_done(fmt::format("svbuild {} grid_0.vtk grid_1.vtk -o {}", kind, numbers));
    expect_done(fmt::format("svbuild {} vectors_0.vtk -o {}", kind, vectors));
    const std::string before = run("svinfo " + numbers + " --json").text;
    expect_refusal(fmt::format("svbuild {} vectors_1.vtk -o {}", append, numbers), "a vector of 3 components");
    EXPECT_EQ(run("svinfo " + numbers + " --json").text, before);
    expect_refusal(fmt::format("svbuild {} grid_1.vtk -o {}", append, vectors), "p[0]");
    expect_done(fmt::format("svbuild {} vectors_1.vtk -o {}", append, vectors));
    expect_refusal(fmt::format("svbuild {} --attribute p grid_2.vtk vectors_1.vtk -o x{}", kind, numbers),
                   "a number in");
    expect_done(fmt::format("svbuild {} --attribute p vectors_1.vtk -o {}", append, numbers));
    expect_done(fmt::format("svinfo {} --verify", numbers));
  }
}

// An index that is changed by hand.
TEST_F(SeriesPrograms, VerifyComparesAnIndexWithItsFiles) {
  expect_done("svbuild --series-of-files --unit p=Pa grid_0.vtk grid_1.vtk -o f.svols");
  expect_done("svinfo f.svols --verify");
  const std::string index = read("f.svols");
  const auto change = [&](const std::string& key, const nlohmann::json& value) {
    auto document = nlohmann::json::parse(index);
    document["attributes"][0][key] = value;
    write("f.svols", document.dump());
  };
  change("unit", "kPa");
  expect_refusal("svinfo f.svols --verify", "the unit of 'p'");
  change("max", 7);
  expect_refusal("svinfo f.svols --verify", "the range of 'p'");
  change("min", -1);
  expect_refusal("svinfo f.svols --verify", "the range of 'p'");
  auto document = nlohmann::json::parse(index);
  document["steps"][1]["file"] = std::string("f-0000.svol\0b", 13);
  write("f.svols", document.dump());
  expect_refusal("svinfo f.svols", "steps[1].file");
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
  expect_done("svrender s.svol --scene s.json --step 0 --title Waves --time-label -o told.png");
  expect_done("svrender s.svol --scene s.json --step 0 --title 'Waves, time 0' -o asked.png");
  expect_done("svrender s.svol --scene s.json --step 1 --title Waves --time-label -o later.png");
  EXPECT_EQ(read("told.png"), read("asked.png"));
  EXPECT_NE(read("later.png"), read("told.png"));
  expect_refusal("svexport s.svol --step 2 -o x.vtu", "no step 2; the last is 1");
  expect_done("svexport s.svol --step 0 -o x.vtu");
  expect_refusal("svrender s.svol --scene s.json --steps 0:1 -o x.png", "--progress-frames", 2);
  expect_refusal("svrender s.svol --scene s.json --steps 1:5 --progress-frames . -o x.png", "the last is 1");
}

}  // namespace
}  // namespace splatvol::test
