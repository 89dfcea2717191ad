// Programs without a standard output or error, or with one that takes nothing: each ends with its exit code.
#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "tests/support/programs.h"

namespace splatvol::test {
namespace {

namespace fs = std::filesystem;

struct Streams : ProgramTest {
  Streams() {
    write("a.csv", "x,y,z,f\n0,0,0,1\n1,0,0,2\n0,1,0,3\n0,0,1,4\n");
    expect_done("svbuild a.csv -o a.svol");
    expect_done("svinfo a.svol --scene a.json");
    expect_done("svrender a.svol --scene a.json --device cpu --size 32x32 -o a.exr");
    expect_done("svgen flow --points 1000 -o mesh.vtu --scene mesh.json");
  }

  int code(const std::string& command, const std::string& streams) const { return run(command + streams).code; }
};

// A program that succeeds, of each kind. `speaks`: it prints a result.
struct Use {
  const char* command;
  bool speaks;
};
constexpr Use uses[] = {
    {"svbuild a.csv -o b.svol", true},
    {"svinfo a.svol", true},
    {"svrender a.svol --scene a.json --device cpu --size 32x32 -o b.exr", true},
    {"svexport a.svol -o b.vtu", true},
    {"svtruth mesh.vtu --scene mesh.json --size 8x8 -o c.exr", true},
    {"svdiff a.exr a.exr", true},
    {"svgen points --count 100 -o b.npy", false},
    {"svgen flow --points 1000 -o b.vtu", false},
};

TEST_F(Streams, ClosedOnesChangeNothing) {
  for (const Use& use : uses) EXPECT_EQ(code(use.command, " >&- 2>&- <&-"), 0) << use.command;
}

TEST_F(Streams, AFullOutputIsAnError) {
  for (const Use& use : uses)
    EXPECT_EQ(code(use.command, " > /dev/full 2> /dev/null"), use.speaks ? 1 : 0) << use.command;
}

TEST_F(Streams, ErrorsNeedNoStandardError) {
  for (const Use& use : uses) {
    const std::string name = std::string(use.command).substr(0, std::string(use.command).find(' '));
    const std::string wrong = name + (name == "svgen" ? " points --count 100" : " missing") + " -o no/such/file";
    for (const char* streams : {" 2>&- > /dev/null", " 2> /dev/full > /dev/null"})
      EXPECT_GT(code(wrong, streams), 0) << wrong << streams;
  }
}

TEST_F(Streams, TheVersionIsToldOrItIsAnError) {
  for (const std::string name : {"svbuild", "svinfo", "svrender", "svexport", "svtruth", "svdiff", "svgen", "svview"}) {
    if (!fs::exists(fs::path(SPLATVOL_BIN) / name)) continue;  // svview needs OpenGL
    for (const char* option : {" --version", " --help"}) {
      const Outcome told = run(name + option);
      EXPECT_EQ(told.code, 0) << name << option;
      EXPECT_THAT(told.out, testing::HasSubstr(name)) << option;
      EXPECT_EQ(code(name + option, " > /dev/full 2> /dev/null"), 1) << name << option;
      EXPECT_EQ(code(name + option, " >&- 2>&- <&-"), 0) << name << option;
    }
  }
}

}  // namespace
}  // namespace splatvol::test
