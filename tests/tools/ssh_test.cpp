// The programs on a file that ssh reaches. OpenSSH's server of files stands in for ssh.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "pictures/image.h"
#include "tests/support/programs.h"
#include "tests/support/sftp_server.h"
#include "tests/support/test_volume.h"

namespace splatvol::test {
namespace {

using namespace ::testing;

struct ProgramsOverSsh : ProgramTest {
  void SetUp() override {
    if (!has_sftp_server()) GTEST_SKIP() << no_sftp_server;
    write_ssh(*this);
    ASSERT_TRUE(write_test_volume(volume_of_x(1000), path("v.svol")));
  }

  [[nodiscard]] std::string url(const std::string& name) const { return "ssh://host" + path(name); }

  // `program` and what follows, with our ssh.
  [[nodiscard]] Outcome run_far(const std::string& words) const { return run("PATH=$PWD/bin:$PATH " + words); }
  void expect_far(const std::string& words) const {
    const Outcome outcome = run_far(words);
    EXPECT_EQ(outcome.code, 0) << words << ": " << outcome.text;
    EXPECT_EQ(outcome.err, "") << words;
  }
};

TEST_F(ProgramsOverSsh, DrawThePictureOfTheFile) {
  expect_done("svbuild gen:mesh:cells=1e5 -o mesh.svol");
  for (const std::string how : {"--tolerance 0", "--exact"}) {
    expect_done("svrender mesh.svol -o near.exr --size 64x64 " + how);
    expect_far(fmt::format("svrender ssh://me@host:22{} -o far.exr --size 64x64 {} --stats stats.json",
                           path("mesh.svol"), how));
    EXPECT_EQ(read_exr(path("far.exr")).value().pixels, read_exr(path("near.exr")).value().pixels) << how;
    const nlohmann::json stats = nlohmann::json::parse(read("stats.json"));
    EXPECT_GT(stats["requests"], 0) << how;
    EXPECT_LE(stats["requests"], 60) << how;
    EXPECT_EQ(stats["file"], "ssh://host:22" + path("mesh.svol"));
  }
  EXPECT_THAT(read("ssh.txt"), HasSubstr(" -p 22 -l me -s -- host sftp\n"));
}

TEST_F(ProgramsOverSsh, SayWhatIsInIt) {
  std::string near = run("svinfo v.svol").out;
  near.replace(near.find("v.svol"), 6, url("v.svol"));
  EXPECT_EQ(run_far(fmt::format("svinfo {} --verify", url("v.svol"))).text, near + "\nevery byte checked\n");
  EXPECT_EQ(run_far("svinfo ssh://host/~/v.svol").code, 0);
  EXPECT_EQ(run_far(fmt::format("svinfo {}", url("missing.svol"))).text,
            fmt::format("svinfo: {}: not found\n", url("missing.svol")));
}

// The files of a series lie beside its index.
TEST_F(ProgramsOverSsh, PlaySeriesOfFiles) {
  write("f.svols", R"({"steps": [{"time": 2.5, "file": "v.svol"}],
    "attributes": [{"name": "a0", "unit": "", "min": 0, "max": 1}]})");
  EXPECT_THAT(run_far(fmt::format("svinfo {} --time 2", url("f.svols"))).out, HasSubstr(url("v.svol")));
  EXPECT_THAT(run_far("svinfo ssh://me@host/~/f.svols --time 2").out, HasSubstr("ssh://host/~/v.svol"));
}

TEST_F(ProgramsOverSsh, ExportCellsOfABox) {
  expect_done("svbuild gen:mesh:cells=1e5 -o mesh.svol");
  expect_done("svexport mesh.svol -o near.vtu --cells --box 0.5,0.5,0.5,0.52,0.52,0.52");
  expect_far(fmt::format("svexport {} -o far.vtu --cells --box 0.5,0.5,0.5,0.52,0.52,0.52", url("mesh.svol")));
  EXPECT_TRUE(read("far.vtu") == read("near.vtu"));
}

// A terminal that nobody looks at is none.
TEST_F(ProgramsOverSsh, AskAtATerminalOnly) {
  ::unsetenv("SSH_ASKPASS");
  expect_far(fmt::format("setsid -w svinfo {} > out.txt", url("v.svol")));
  EXPECT_THAT(read("ssh.txt"), HasSubstr("-oBatchMode=yes"));
  if (run("command -v script").code != 0) GTEST_SKIP() << "no script on this machine (package bsdutils)";
  std::filesystem::remove(path("ssh.txt"));
  expect_far(fmt::format("script -qec 'svinfo {}' /dev/null > out.txt", url("v.svol")));
  EXPECT_THAT(read("ssh.txt"), HasSubstr(" -s -- host sftp"));
  EXPECT_THAT(read("ssh.txt"), Not(HasSubstr("BatchMode")));
}

TEST_F(ProgramsOverSsh, WithoutSshNameItsPackage) {
  std::filesystem::create_directory(path("none"));
  const Outcome outcome = run(fmt::format("svinfo=$(command -v svinfo); PATH=$PWD/none; $svinfo {}", url("v.svol")));
  EXPECT_EQ(outcome.code, 1);
  EXPECT_THAT(outcome.err,
              AllOf(StartsWith("svinfo: " + url("v.svol")), EndsWith("install the package openssh-client\n")));
}

// Of a mesh, too little is known before all of it is read.
TEST(FarMeshes, AreToBeBuiltThere) {
  for (const std::string scheme : {"ssh", "http", "https"})
    for (const std::string command : {"svinfo", "svrender -o no.png", "svexport -o no.vtu", "svbuild -o no.svol"}) {
      const std::size_t blank = std::min(command.find(' '), command.size());
      const std::string address = " " + scheme + "://host.invalid/mesh.vtu";
      const Outcome outcome = run_in("/tmp", command.substr(0, blank) + address + command.substr(blank));
      EXPECT_EQ(outcome.code, 1);
      EXPECT_EQ(outcome.err, fmt::format("{}:{}: meshes are read from disks: run svbuild there, or download it first\n",
                                         command.substr(0, blank), address));
    }
}

}  // namespace
}  // namespace splatvol::test
