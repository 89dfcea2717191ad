// A disk that fails once, at each call that changes it: the output is the old file or the new one, and the exit code
// tells which. A sample tries some of the calls, each with one of the errors.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "base/file.h"
#include "tests/support/long.h"
#include "tests/support/programs.h"
#include "tests/support/sanitizers.h"

namespace splatvol::test {
namespace {

namespace fs = std::filesystem;
using testing::HasSubstr;

constexpr int errors[] = {EIO, ENOSPC, EDQUOT, EINTR, EROFS};

struct Use {
  std::string name;
  std::vector<std::string> before;  // commands that make what is there
  std::string command;
  std::string preloaded = {};  // also
};

const std::vector<Use>& uses() {
  const std::string series = "svbuild --threads 1 --series a.csv b.csv -o out/s.svol";
  const std::string files = "svbuild --threads 1 --series-of-files a.csv b.csv -o out/s.svols";
  const std::string mesh = "svbuild gen:mesh:cells=48 -o out/m.svol";
  const std::string cells = "svexport out/m.svol --cells -o out/m.vtu";
  static const std::vector<Use> all = {
      {"a build", {"svbuild b.csv -o out/s.svol"}, "svbuild --threads 1 a.csv -o out/s.svol"},
      {"a build where files have names", {}, "svbuild --threads 1 a.csv -o out/s.svol", SPLATVOL_NO_TMPFILE},
      {"a series", {}, series},
      {"an append", {series}, "svbuild --threads 1 --append c.csv -o out/s.svol"},
      {"a series of files", {}, files},
      {"an append to a series of files",
       {files},
       "svbuild --threads 1 --series-of-files --append c.csv d.csv -o out/s.svols"},
      {"points", {}, "svgen points --count 100 -o out/p.npy"},
      {"a picture", {}, "svrender a.svol --device cpu --size 16x16 --tolerance 0 -o out/p.png"},
      {"a scene", {}, "svinfo a.svol --scene out/s.json"},
      {"a mesh", {}, "svexport a.svol -o out/m.vtu"},
      {"an export of cells", {mesh}, cells},
      {"an export of cells where files have names", {mesh}, cells, SPLATVOL_NO_TMPFILE},
      {"a contour", {mesh}, "svexport out/m.svol --contour 0 -o out/m.vtp"},
      {"voxels", {}, "svexport a.svol --voxel 0.5 -o out/m.vdb"},
      {"a build with cells", {}, "svbuild --threads 1 gen:mesh:cells=300,pieces=2 -o out/s.svol"},
      {"cells where files have names",
       {"svbuild b.csv -o out/s.svol"},
       "svbuild --threads 1 gen:mesh:cells=300,pieces=2 -o out/s.svol",
       SPLATVOL_NO_TMPFILE}};
  return all;
}

struct DiskFaults : ProgramTest {
  void SetUp() override {
    if (is_sanitized) GTEST_SKIP() << "sanitizers want to be loaded first";
    for (int step = 0; step < 4; ++step) {
      std::ofstream points(path(std::string(1, static_cast<char>('a' + step)) + ".csv"));
      points << "x,y,z,v\n";
      for (int i = 0; i < 27; ++i) points << fmt::format("{},{},{},{}\n", i % 3, i / 3 % 3, i / 9, i * (1 + step));
    }
    expect_done("svbuild a.csv -o a.svol");
  }

  using Files = std::map<std::string, std::string>;  // name: bytes

  [[nodiscard]] Files files() const {
    Files all;
    for (const auto& entry : fs::directory_iterator(path("out")))
      all[entry.path().filename()] = *read_text_file(entry.path());
    return all;
  }

  void restore(const Files& all) const {
    fs::remove_all(path("out"));
    fs::create_directory(path("out"));
    for (const auto& [name, bytes] : all) write("out/" + name, bytes);
  }

  struct Outcome : test::Outcome {
    std::vector<std::string> calls;
  };

  // Runs a use. `fault`: variables of tests/support/failing_disk.cpp.
  [[nodiscard]] Outcome run_with(const Use& use, const std::string& fault) const {
    fs::remove(path("log"));
    const std::string preload = "LD_PRELOAD=" SPLATVOL_FAILING_DISK ":" + use.preloaded;
    Outcome outcome{run(fmt::format("{} SPLATVOL_FAIL_LOG=log {} {}", preload, fault, use.command)), {}};
    std::ifstream log(path("log"));
    for (std::string call; std::getline(log, call);) outcome.calls.push_back(call);
    return outcome;
  }

  // The outputs before and after a use without a fault, and its calls.
  struct Course {
    Files before, after;
    std::vector<std::string> calls;
  };

  [[nodiscard]] Course course_of(const Use& use) const {
    restore({});
    for (const std::string& command : use.before) expect_done(command);
    Course course{files(), {}, {}};
    const Outcome outcome = run_with(use, "");
    EXPECT_EQ(outcome.code, 0) << use.name << ": " << outcome.text;
    course.after = files();
    course.calls = outcome.calls;
    for (const auto& [name, bytes] : course.after)
      if (name.ends_with(".svol") || name.ends_with(".svols")) expect_done("svinfo --verify out/" + name);
    return course;
  }

  // The names that only a failure to remove or to rename leaves.
  [[nodiscard]] Files without_leftovers(Files all, const std::string& call, const std::string& words) const {
    std::erase_if(all, [&](const auto& file) {
      const bool is_temporary = file.first.starts_with(".splatvol-") || file.first.starts_with("splatvol-");
      const bool is_told = call == "rename" && words.find(file.first) != std::string::npos;
      return is_temporary && (call == "unlink" || is_told);
    });
    return all;
  }

  void fail_at(const Use& use, const Course& course, std::size_t number, int error, bool in_half = false) const {
    restore(course.before);
    const Outcome outcome = run_with(use, fmt::format("SPLATVOL_FAIL_CALL={} SPLATVOL_FAIL_ERROR={}{}", number, error,
                                                      in_half ? " SPLATVOL_FAIL_HALF=1" : ""));
    ASSERT_GT(outcome.calls.size(), number) << use.name;
    const std::string& call = outcome.calls[number];
    const std::string where =
        fmt::format("{}: call {} ({}): {}: {}", use.name, number, call, std::strerror(error), outcome.text);
    const Files found = without_leftovers(files(), call, outcome.text);
    if (outcome.code == 0) {
      EXPECT_TRUE(found == course.after) << where;
      return;
    }
    EXPECT_EQ(outcome.code, 1) << where;
    EXPECT_EQ(std::ranges::count(outcome.text, '\n'), 1) << where;
    EXPECT_NE(error, EINTR) << where;
    const bool is_new = outcome.text.find("has not confirmed") != std::string::npos;
    EXPECT_TRUE(found == (is_new ? course.after : course.before)) << where;
    EXPECT_EQ(is_new, call == "fsync" && !(found == course.before)) << where;
  }
};

// Of each kind of call the first and the last ones, and some between.
std::vector<std::size_t> sample_of(const std::vector<std::string>& calls) {
  std::map<std::string, std::vector<std::size_t>> by_name;
  for (std::size_t i = 0; i < calls.size(); ++i) by_name[calls[i]].push_back(i);
  std::set<std::size_t> sample;
  for (const auto& [name, numbers] : by_name)
    for (std::size_t i = 0; i < numbers.size(); ++i)
      if (numbers.size() <= 4 || i == 0 || i + 2 >= numbers.size() || i % (numbers.size() / 3) == 0)
        sample.insert(numbers[i]);
  return {sample.begin(), sample.end()};
}

TEST_F(DiskFaults, AFailureLeavesTheOldFileOrTheNewOne) {
  std::size_t tried = 0;
  for (const Use& use : uses()) {
    const Course course = course_of(use);
    for (std::size_t call = 0; call < course.calls.size() && is_long(); ++call)
      for (const int error : errors) fail_at(use, course, call, error);
    for (const std::size_t call : sample_of(course.calls)) fail_at(use, course, call, errors[tried++ % 5]);
  }
}

// The numbers of the calls of a name, from the last one on.
std::vector<std::size_t> last_calls(const std::vector<std::string>& calls, const std::string& name) {
  std::vector<std::size_t> numbers;
  for (std::size_t i = calls.size(); i-- > 0;)
    if (calls[i] == name) numbers.push_back(i);
  return numbers;
}

// The superblock that is written in part is neither the old one nor the new one, and the steps behind it are needed.
TEST_F(DiskFaults, ASuperblockThatIsWrittenInPartIsWrittenAgain) {
  const Use& append = uses()[3];
  const Course course = course_of(append);
  fail_at(append, course, last_calls(course.calls, "pwrite").at(0), EIO, true);
  EXPECT_TRUE(files() == course.after);
}

TEST_F(DiskFaults, AnAppendThatTheDiskDoesNotConfirmIsTold) {
  const Use& append = uses()[3];
  const Course course = course_of(append);
  const std::vector<std::size_t> syncs = last_calls(course.calls, "fsync");
  ASSERT_EQ(syncs.size(), 2U);
  for (const int error : {EIO, ENOSPC, EDQUOT}) {
    restore(course.before);
    const auto outcome = run_with(append, fmt::format("SPLATVOL_FAIL_CALL={} SPLATVOL_FAIL_ERROR={}", syncs[0], error));
    EXPECT_EQ(outcome.code, 1);
    EXPECT_THAT(outcome.text, HasSubstr("the steps are in the file, though the disk has not confirmed it"));
    EXPECT_TRUE(files() == course.after) << std::strerror(error);
    expect_done("svinfo --verify out/s.svol");
    expect_done("svbuild --append d.csv -o out/s.svol");
    expect_done("svinfo --verify out/s.svol");
  }
}

// The names of a folder are not on the disk: what the new index names stays.
TEST_F(DiskFaults, AnIndexThatTheDiskDoesNotConfirmKeepsItsFiles) {
  for (const Use& use : {uses()[4], uses()[5]}) {
    const Course course = course_of(use);
    restore(course.before);
    const auto outcome = run_with(use, fmt::format("SPLATVOL_FAIL_CALL={}", last_calls(course.calls, "fsync").at(0)));
    EXPECT_EQ(outcome.code, 1) << use.name;
    EXPECT_THAT(outcome.text, HasSubstr("has the steps, though the disk has not confirmed it")) << use.name;
    EXPECT_TRUE(files() == course.after) << use.name;
    expect_done("svinfo --verify out/s.svols");
  }
}

TEST_F(DiskFaults, AppendsGoOnWithoutLocksAndWarnOnce) {
  for (const Use& use : {uses()[3], uses()[5]}) {
    const Course course = course_of(use);
    for (const int error : {ENOLCK, ENOSYS, EOPNOTSUPP}) {
      restore(course.before);
      const auto outcome =
          run_with(use, fmt::format("SPLATVOL_FAIL_ONLY=flock SPLATVOL_FAIL_EACH=1 SPLATVOL_FAIL_ERROR={}", error));
      EXPECT_EQ(outcome.code, 0) << outcome.text;
      EXPECT_TRUE(files() == course.after) << use.name;
      const std::size_t warning = outcome.text.find("has no locks");
      EXPECT_NE(warning, std::string::npos) << outcome.text;
      EXPECT_EQ(outcome.text.find("has no locks", warning + 1), std::string::npos) << outcome.text;
    }
  }
}

}  // namespace
}  // namespace splatvol::test
