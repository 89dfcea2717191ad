// svexport: exit codes, messages and output.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "base/file.h"
#include "tests/support/test_volume.h"

namespace splatvol {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

class Svexport : public testing::Test {
 protected:
  Svexport() {
    std::string pattern = (fs::path(testing::TempDir()) / "splatvol-svexport-XXXXXX").string();
    folder_ = ::mkdtemp(pattern.data());
    const auto points = test::random_points(200, 3);
    std::vector<double> values;
    for (const dvec3& p : points) values.push_back(p.x);
    EXPECT_TRUE(test::write_test_volume(test::make_test_volume(points, {values}), path("in.svol")));
  }
  ~Svexport() override { fs::remove_all(folder_); }

  std::string path(const std::string& name) const { return (folder_ / name).string(); }

  /// Runs svexport and returns the exit code. The output is in message_.
  int run(const std::string& output, const std::string& arguments) {
    const std::string command = SPLATVOL_BIN "/svexport " + path("in.svol") + " -o " + path(output) + " " + arguments;
    const int status = std::system((command + " > " + path("message") + " 2>&1").c_str());
    message_ = *read_text_file(path("message"));
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

  fs::path folder_;
  std::string message_;
};

TEST_F(Svexport, WritesVoxelsAndPoints) {
  ASSERT_EQ(run("out.vdb", "--voxel 0.1 --json"), 0) << message_;
  const auto voxels = nlohmann::json::parse(message_);
  EXPECT_NEAR(voxels["voxel_mass"].get<double>(), voxels["splat_mass"].get<double>(),
              1e-9 * voxels["splat_mass"].get<double>());
  EXPECT_EQ(voxels["file_bytes"], fs::file_size(path("out.vdb")));
  ASSERT_EQ(run("out.vtu", "--resolution 0 --json"), 0) << message_;
  EXPECT_EQ(nlohmann::json::parse(message_)["file_bytes"], fs::file_size(path("out.vtu")));
  ASSERT_EQ(run("out.vtu", "--box 0,0,0,0.5,0.5,0.5 --attribute a0"), 0) << message_;
  EXPECT_THAT(message_, HasSubstr("points"));
}

TEST_F(Svexport, TellsWhatGotAnotherName) {
  test::TestVolume volume = test::make_test_volume(test::random_points(200, 3), {std::vector<double>(200, 1.0)});
  for (const auto& [name, output] :
       {std::pair<std::string, std::string>{"mass", "out.vtu"}, {"volume_fraction", "out.vdb --voxel 0.1"}}) {
    volume.info.attributes[0].name = name;
    ASSERT_TRUE(test::write_test_volume(volume, path("in.svol")));
    ASSERT_EQ(run(output, ""), 0) << message_;
    EXPECT_THAT(message_, HasSubstr("what svexport calls so is \"" + name + " (splat)\""));
    ASSERT_EQ(run(output, "--json"), 0) << message_;
    EXPECT_EQ(nlohmann::json::parse(message_)["renamed"][name], name + " (splat)");
  }
}

TEST_F(Svexport, WrongUsageIsTwo) {
  for (const auto& [output, arguments] :
       std::vector<std::pair<std::string, std::string>>{{"out.vdb", ""},
                                                        {"out.txt", ""},
                                                        {"out.vdb", "--voxel 0"},
                                                        {"out.vdb", "--voxel nan"},
                                                        {"out.vtu", "--voxel 1"},
                                                        {"out.vtu", "--memory 1G"},
                                                        {"out.vtu", "--box 1,0,0,0,1,1"},
                                                        {"out.vtu", "--box 1,2,3"},
                                                        {"out.vdb", "--voxel 1 --memory lots"},
                                                        {"out.vtu", "--resolution -1"},
                                                        {"out.vtu", "--resolution 18446744073709551616"}})
    EXPECT_EQ(run(output, arguments), 2) << output << " " << arguments << ": " << message_;
}

TEST_F(Svexport, WhatCannotBeIsOneLine) {
  for (const auto& [arguments, reason] :
       std::vector<std::pair<std::string, std::string>>{{"--voxel 0.1 --attribute b", "no attribute \"b\""},
                                                        {"--voxel 0.1 --resolution 9", "no resolution 9"},
                                                        {"--voxel 0.001 --memory 1M", "--memory"},
                                                        {"--voxel 1e-5 --box 0.5,0,0,0.5,1,1", "--box"}}) {
    EXPECT_EQ(run("out.vdb", arguments), 1) << arguments;
    EXPECT_THAT(message_, HasSubstr(reason));
    EXPECT_EQ(std::ranges::count(message_, '\n'), 1) << message_;
    EXPECT_FALSE(fs::exists(path("out.vdb")));
  }
}

// A limit on file sizes, of 4 units of 512 or 1024 bytes, acts like a full disk.
TEST_F(Svexport, WhatCannotBeWrittenIsNotThere) {
  for (const std::string output : {"out.vdb --voxel 0.01", "out.vtu"}) {
    const std::string command = "ulimit -f 4; " SPLATVOL_BIN "/svexport " + path("in.svol") + " -o " + path(output);
    const int status = std::system((command + " 2> /dev/null > /dev/null").c_str());
    EXPECT_EQ(WEXITSTATUS(status), 1) << output;
    EXPECT_FALSE(fs::exists(path("out.vdb")) || fs::exists(path("out.vtu")));
  }
}

}  // namespace
}  // namespace splatvol
