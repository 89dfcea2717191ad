// svbuild --cached: the file is that of a build, and is built again exactly when something has changed.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <csignal>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "tests/builder/sources/hdf5/hdf5_arrays.h"
#include "tests/support/child.h"
#include "tests/support/openfoam_files.h"
#include "tests/support/program_json.h"
#include "tests/support/sanitizers.h"

namespace splatvol::test {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::ElementsAre;
using testing::EndsWith;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;
using testing::StartsWith;

struct Cached : ProgramTest {
  void SetUp() override { ::setenv("SPLATVOL_CACHE", path("cache").c_str(), 1); }
  void TearDown() override { ::unsetenv("SPLATVOL_CACHE"); }

  void make_mesh(int cells = 3000) const {
    expect_done(
        fmt::format("svgen mesh --cells {} --pieces 1 -o pieces/ && mv pieces/*.vtu mesh.vtu && rm -r pieces", cells));
  }

  // What a call with --json or the last line of --progress tells.
  [[nodiscard]] json result_of(const std::string& words) const {
    return document_of(run("svbuild --json --cached " + words));
  }

  [[nodiscard]] static std::vector<json> lines_of(const std::string& text) {
    std::vector<json> lines;
    for (std::size_t at = 0; at < text.size();) {
      const std::size_t end = std::min(text.find('\n', at), text.size());
      lines.push_back(json::parse(text.substr(at, end - at), nullptr, false));
      at = end + 1;
    }
    return lines;
  }

  // Reads what a child prints, up to its result. It still holds the file then.
  [[nodiscard]] static json wait_for_result(Child& child) {
    while (const auto line = child.line()) {
      const json value = json::parse(*line, nullptr, false);
      if (value.contains("result")) return value["result"];
    }
    ADD_FAILURE() << "there is no result";
    return {};
  }

  // The entries and places in the cache.
  [[nodiscard]] std::vector<std::string> folders_of_cache() const {
    std::vector<std::string> found;
    if (fs::exists(path("cache")))
      for (const auto& entry : fs::directory_iterator(path("cache")))
        if (entry.is_directory()) found.push_back(entry.path().filename());
    return found;
  }

  void expect_built(const std::string& words, bool built, const std::string& why) const {
    const json result = result_of(words);
    EXPECT_EQ(result.value("built", !built), built) << why;
    EXPECT_FALSE(result.value("temporary", true)) << why << result;
  }
};

TEST_F(Cached, TheFileIsThatOfABuildAndTheSecondCallDoesNotBuild) {
  make_mesh();
  expect_done("svbuild mesh.vtu --boundary -o mesh.svol --json > /dev/null");
  const json first = result_of("mesh.vtu"), second = result_of("./mesh.vtu");
  EXPECT_TRUE(first["built"]);
  EXPECT_FALSE(second["built"]);
  EXPECT_EQ(first["file"], second["file"]);
  EXPECT_THAT(first["file"].get<std::string>(), EndsWith("/mesh.svol"));
  expect_done("cmp mesh.svol " + first["file"].get<std::string>());
  const Outcome plain = run("svbuild mesh.vtu --cached");
  EXPECT_EQ(plain.out, first["file"].get<std::string>() + "\n");
  expect_built("mesh.vtu --exact", true, "another option");
  expect_built("mesh.vtu --memory 1G", false, "it changes nothing in the file");
}

TEST_F(Cached, PointsHaveNoBoundaryAndNeedNone) {
  write("a.csv", "x,y,z,v\n0,0,0,1\n1,0,0,2\n0,1,0,3\n0,0,1,4\n1,1,1,5\n");
  expect_done("svbuild a.csv -o a.svol > /dev/null");
  expect_done("cmp a.svol " + result_of("a.csv")["file"].get<std::string>());
}

TEST_F(Cached, AChangedFileIsBuiltAgain) {
  make_mesh();
  expect_built("mesh.vtu", true, "it is new");
  expect_built("mesh.vtu", false, "it is there");
  expect_done("cp mesh.vtu b.vtu && touch -r mesh.vtu b.vtu && cp -p b.vtu mesh.vtu");
  expect_built("mesh.vtu", true, "it was written, though it looks as before");
  expect_done("touch other.txt");
  expect_built("mesh.vtu", false, "nobody reads what lies beside it");
}

TEST_F(Cached, ANewTimeStepIsBuilt) {
  const auto files = openfoam_files();
  for (const auto& [name, text] : files) write("case/" + name, text);
  expect_built("case", true, "it is new");
  expect_built("case", false, "it is there");
  expect_built("case/system/controlDict", true, "it is another input");
  for (const auto& [name, text] : files)
    if (name.starts_with("0.5/")) write("case/0.75/" + name.substr(4), text);
  expect_built("case", true, "there is a new step");
  const json times = document_of(run("svinfo --json " + result_of("case --times all")["file"].get<std::string>()));
  EXPECT_THAT(times.dump(), HasSubstr("0.75"));
  expect_built("case --times all", false, "it is there");
  expect_built("case", false, "it is there");
  write("case/0.75/p", files.at("0.5/p") + "\n");
  expect_built("case", true, "a field has changed");
}

TEST_F(Cached, StepsMayBeFiles) {
  for (int step = 0; step < 2; ++step)
    write(fmt::format("s{}.csv", step), fmt::format("x,y,z,v\n0,0,0,1\n1,0,0,2\n0,1,0,3\n0,0,1,{}\n", step));
  const json first = result_of("s0.csv s1.csv --series-of-files");
  EXPECT_THAT(first["file"].get<std::string>(), EndsWith(".svols"));
  expect_done("svinfo --verify " + first["file"].get<std::string>());
  expect_built("s0.csv s1.csv --series-of-files", false, "it is there");
}

// HDF5 opens the other file by itself.
TEST_F(Cached, AChangedFileThatALinkNamesIsBuiltAgain) {
  const auto write_values = [&](const std::vector<double>& values) {
    const hid_t file = H5Fcreate(path("values.h5").c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    put_array<double>(file, "f", values);
    H5Fclose(file);
  };
  write_values({1, 2, 3, 4});
  const hid_t file = H5Fcreate(path("mesh.vtkhdf").c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT),
              root = make_group(file, "VTKHDF"), points = make_group(root, "PointData");
  put_tetrahedron(root);
  H5Lcreate_external("values.h5", "/f", points, "f", H5P_DEFAULT, H5P_DEFAULT);
  for (const hid_t group : {points, root}) H5Gclose(group);
  H5Fclose(file);

  const auto largest = [&] {
    const std::string svol = result_of("mesh.vtkhdf")["file"];
    return document_of(run("svinfo --json " + svol))["attributes"][0]["max"].get<double>();
  };
  EXPECT_EQ(largest(), 4);
  expect_built("mesh.vtkhdf", false, "it is there");
  write_values({1, 2, 3, 5});
  EXPECT_EQ(largest(), 5);
}

TEST_F(Cached, OfTwoCallersOneBuilds) {
  make_mesh(100000);
  Child a(folder_, "exec svbuild mesh.vtu --cached --progress"),
      b(folder_, "exec svbuild mesh.vtu --cached --progress");
  std::vector<json> results;
  for (Child* child : {&a, &b}) {
    results.push_back(wait_for_result(*child));
    child->end_input();
    EXPECT_EQ(child->status(), 0);
  }
  ASSERT_THAT(results, SizeIs(2));
  EXPECT_NE(results[0]["built"], results[1]["built"]);
  EXPECT_EQ(results[0]["file"], results[1]["file"]);
}

TEST_F(Cached, ProgressGrowsAndEndsWithTheResult) {
  make_mesh(300000);
  const Outcome outcome = run("svbuild mesh.vtu --cached --progress");
  EXPECT_EQ(outcome.code, 0) << outcome.text;
  const std::vector<json> lines = lines_of(outcome.out);
  ASSERT_GE(lines.size(), 3u);
  EXPECT_TRUE(lines.back().contains("result")) << lines.back();
  double before = 0;
  std::set<std::string> stages;
  for (std::size_t i = 0; i + 1 < lines.size(); ++i) {
    ASSERT_TRUE(lines[i].contains("share")) << lines[i];
    EXPECT_TRUE(lines[i]["seconds_left"].is_null() || lines[i]["seconds_left"] >= 0);
    EXPECT_GE(lines[i]["share"], before);
    before = lines[i]["share"];
    stages.insert(lines[i]["stage"].get<std::string>());
  }
  EXPECT_LE(before, 1);
  EXPECT_GT(before, 0);
  EXPECT_TRUE(stages.contains("reading"));
}

TEST_F(Cached, ThePreviewComesBeforeTheResult) {
  const std::string input = "gen:points:count=200000,distribution=vortex";
  const Outcome outcome = run("svbuild " + input + " --connectivity boxes --cached --progress --preview p.svol");
  EXPECT_EQ(outcome.code, 0) << outcome.text;
  const std::vector<json> lines = lines_of(outcome.out);
  const auto is_preview = [](const json& line) { return line.contains("preview"); };
  EXPECT_EQ(std::ranges::count_if(lines, is_preview), 1);
  EXPECT_EQ((*std::ranges::find_if(lines, is_preview))["preview"], "p.svol");
  const auto of = [&](const std::string& file) { return document_of(run("svinfo --json " + file)); };
  const json preview = of("p.svol"), whole = of(lines.back()["result"]["file"]);
  for (const char* end : {"low", "high"})
    for (int axis = 0; axis < 3; ++axis)
      EXPECT_NEAR(preview["bounds"][end][axis].get<double>(), whole["bounds"][end][axis].get<double>(), 1e-3);
  for (const char* end : {"min", "max"})
    EXPECT_NEAR(preview["attributes"][0][end].get<double>(), whole["attributes"][0][end].get<double>(), 1e-3);
  EXPECT_EQ(preview["attributes"].size(), whole["attributes"].size());
  expect_done("svbuild " + input + " --connectivity boxes --cached --preview q.svol > /dev/null");
  EXPECT_FALSE(fs::exists(path("q.svol"))) << "the file is there already";
}

TEST_F(Cached, ErrorsAreALineOfJson) {
  const Outcome outcome = run("svbuild no.vtu --cached --progress");
  EXPECT_EQ(outcome.code, 1);
  const std::vector<json> lines = lines_of(outcome.out);
  ASSERT_FALSE(lines.empty());
  EXPECT_EQ("svbuild: " + lines.back()["error"].get<std::string>() + "\n", outcome.err);
  EXPECT_THAT(folders_of_cache(), IsEmpty());
}

TEST_F(Cached, InputsThatAreNoMeshesAreRefused) {
  expect_refusal("svbuild a.svol --cached", "a.svol: is built already: open it as it is");
  expect_refusal("svbuild https://host/a.vtu --cached", "download it first");
  expect_refusal("svbuild a.vtu --progress -o a.svol", "--progress: goes with --cached", 2);
  expect_refusal("svbuild a.vtu --cached -o a.svol", "--output: goes with no file of the cache", 2);
}

TEST_F(Cached, AFileIsHeldUntilTheInputEnds) {
  write("a.csv", "x,y,z,v\n0,0,0,1\n1,0,0,2\n0,1,0,3\n0,0,1,4\n");
  Child child(folder_, "exec svbuild a.csv --cached --progress");
  const json result = wait_for_result(child);
  EXPECT_THAT(run("svbuild --forget").out, StartsWith("is open, and stays: "));
  EXPECT_THAT(run("svbuild --cache").out, HasSubstr(", open: " + result["file"].get<std::string>()));
  child.end_input();
  EXPECT_EQ(child.status(), 0);
  EXPECT_THAT(run("svbuild --forget b.csv").out, IsEmpty());
  EXPECT_THAT(run("svbuild --forget a.csv").out, StartsWith("removed: "));
  EXPECT_EQ(run("svbuild --cache").out, "");
}

TEST_F(Cached, WithoutACacheTheFileIsTemporary) {
  write("a.csv", "x,y,z,v\n0,0,0,1\n1,0,0,2\n0,1,0,3\n0,0,1,4\n");
  write("file", "not a folder");
  fs::create_directory(path("tmp"));
  for (const std::string cache : {"SPLATVOL_CACHE= ", "SPLATVOL_CACHE=file/cache "}) {
    Child child(folder_, cache + "TMPDIR=tmp exec svbuild a.csv --cached --progress");
    const json result = wait_for_result(child);
    EXPECT_TRUE(result["temporary"]);
    EXPECT_THAT(result["notes"].dump(), HasSubstr("the file is temporary"));
    const std::string file = result["file"];
    expect_done("svinfo " + file + " > /dev/null");
    child.end_input();
    EXPECT_EQ(child.status(), 0);
    EXPECT_EQ(std::distance(fs::recursive_directory_iterator(path("tmp")), {}), 2) << "a folder with a lock is left";
    const Outcome plain = run(cache + "svbuild a.csv --cached");
    EXPECT_EQ(plain.code, 1);
    EXPECT_THAT(plain.err, HasSubstr("give -o OUT.svol, or another folder in SPLATVOL_CACHE"));
  }
}

TEST_F(Cached, AFullDiskLeavesNothing) {
  make_mesh(20000);
  const Outcome outcome = run("ulimit -f 100 && svbuild mesh.vtu --cached");
  EXPECT_EQ(outcome.code, 1);
  EXPECT_THAT(outcome.err, EndsWith("; give -o OUT.svol, or another folder in SPLATVOL_CACHE\n"));
  EXPECT_THAT(folders_of_cache(), IsEmpty());
}

TEST_F(Cached, AFileThatIsTooLargeForTheCacheIsToldAndTemporary) {
  if (run("unshare -rm mount -t tmpfs none .").code != 0) GTEST_SKIP() << "needs a file system of its own";
  make_mesh(20000);
  const std::uint64_t bytes = fs::file_size(result_of("mesh.vtu")["file"].get<std::string>());
  // The cache may hold half of its file system.
  const auto build_on_small_disk = [&](const std::string& options) {
    return run(
        fmt::format("unshare -rm sh -c 'mount -t tmpfs -o size={} none cache && svbuild mesh.vtu --cached "
                    "--temp . {}'",
                    bytes + bytes / 2, options));
  };
  const Outcome plain = build_on_small_disk("");
  EXPECT_EQ(plain.code, 1);
  EXPECT_THAT(plain.err, AllOf(HasSubstr(fmt::format("the file has {} bytes, and the cache may hold ", bytes)),
                               EndsWith("; give -o OUT.svol, or another folder in SPLATVOL_CACHE\n")));
  const Outcome watched = build_on_small_disk("--progress");
  EXPECT_EQ(watched.code, 0) << watched.text;
  const json result = lines_of(watched.out).back()["result"];
  EXPECT_TRUE(result["temporary"]);
  EXPECT_THAT(result["notes"].dump(), HasSubstr("the cache may hold"));
}

// Processes that a process has started, and theirs.
std::set<pid_t> descendants_of(pid_t process) {
  std::set<pid_t> found;
  std::error_code error;
  for (const auto& task : fs::directory_iterator(fmt::format("/proc/{}/task", process), error)) {
    std::ifstream children(task.path() / "children");
    for (pid_t child = 0; children >> child;) {
      found.insert(child);
      found.merge(descendants_of(child));
    }
  }
  return found;
}

bool is_running(pid_t process) {
  std::ifstream stat(fmt::format("/proc/{}/stat", process));
  std::string text;
  std::getline(stat, text);
  const std::size_t name_end = text.rfind(')');
  return name_end != std::string::npos && text[name_end + 2] != 'Z';
}

struct CachedEnds : Cached {
  void SetUp() override {
    Cached::SetUp();
    make_mesh(300000);
    fs::create_directory(path("tmp"));
  }

  // Starts a build, and waits until it reads.
  std::set<pid_t> wait_for_reader(const Child& child, std::size_t processes) const {
    std::set<pid_t> found;
    EXPECT_TRUE(becomes([&] { return (found = descendants_of(child.process())).size() >= processes; }));
    return found;
  }

  void expect_gone(const std::set<pid_t>& processes) const {
    EXPECT_TRUE(becomes([&] { return std::ranges::none_of(processes, is_running); }));
    EXPECT_THAT(folders_of_cache(), IsEmpty());
    EXPECT_TRUE(fs::is_empty(path("tmp")));
  }
};

TEST_F(CachedEnds, WithAParentThatIsKilled) {
  if (is_sanitized) GTEST_SKIP() << "sanitizers have handlers of their own";
  for (const std::string preloaded : {"", "LD_PRELOAD=" SPLATVOL_NO_TMPFILE " "}) {
    Child shell(folder_, preloaded + "TMPDIR=tmp svbuild mesh.vtu --cached --progress; true");
    const std::set<pid_t> processes = wait_for_reader(shell, 2);
    shell.send(SIGKILL);
    expect_gone(processes);
  }
}

TEST_F(CachedEnds, ByAnInterrupt) {
  if (is_sanitized) GTEST_SKIP() << "sanitizers have handlers of their own";
  Child child(folder_, "TMPDIR=tmp exec svbuild mesh.vtu --cached --progress");
  const std::set<pid_t> processes = wait_for_reader(child, 1);
  child.send(SIGINT);
  std::string last;
  while (const auto line = child.line()) last = *line;
  EXPECT_EQ(last, R"({"error":"interrupted"})");
  const int status = child.status();
  EXPECT_TRUE(WIFSIGNALED(status) && WTERMSIG(status) == SIGINT);
  expect_gone(processes);
}

TEST_F(CachedEnds, WhatAKilledBuildLeavesGoesWithTheNextCall) {
  Child child(folder_, "TMPDIR=tmp exec svbuild mesh.vtu --cached --progress");
  const std::set<pid_t> processes = wait_for_reader(child, 1);
  child.send(SIGKILL);
  EXPECT_TRUE(becomes([&] { return std::ranges::none_of(processes, is_running); }));
  EXPECT_EQ(run("svbuild --cache").out, "");
  EXPECT_THAT(folders_of_cache(), IsEmpty());
}

}  // namespace
}  // namespace splatvol::test
