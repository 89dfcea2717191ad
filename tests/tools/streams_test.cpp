// Programs without a standard output or error, or with one that takes nothing: each ends with its exit code.
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

namespace splatvol {
namespace {

namespace fs = std::filesystem;

class Streams : public testing::Test {
 protected:
  Streams() {
    std::string pattern = (fs::path(testing::TempDir()) / "splatvol-streams-XXXXXX").string();
    folder_ = ::mkdtemp(pattern.data());
    std::ofstream(folder_ / "a.csv") << "x,y,z,f\n0,0,0,1\n1,0,0,2\n0,1,0,3\n0,0,1,4\n";
    EXPECT_EQ(code("svbuild $D/a.csv -o $D/a.svol", " > /dev/null"), 0);
    EXPECT_EQ(code("svinfo $D/a.svol --scene $D/a.json", " > /dev/null"), 0);
    EXPECT_EQ(code("svrender $D/a.svol --scene $D/a.json --device cpu --size 32x32 -o $D/a.exr", " > /dev/null"), 0);
    EXPECT_EQ(code("svdemo --points 1000 -o $D/mesh.vtu --scene $D/mesh.json", " > /dev/null"), 0);
  }
  ~Streams() override { fs::remove_all(folder_); }

  // $D is the test's folder.
  int code(const std::string& command, const std::string& streams) const {
    const int status = std::system(("D=" + folder_.string() + "; " SPLATVOL_BIN "/" + command + streams).c_str());
    return WIFEXITED(status) && WEXITSTATUS(status) < 128 ? WEXITSTATUS(status) : -1;
  }

  fs::path folder_;
};

// A program that succeeds, of each kind. `speaks`: it prints a result.
struct Use {
  const char* command;
  bool speaks;
};
constexpr Use uses[] = {
    {"svbuild $D/a.csv -o $D/b.svol", true},
    {"svinfo $D/a.svol", true},
    {"svrender $D/a.svol --scene $D/a.json --device cpu --size 32x32 -o $D/b.exr", true},
    {"svexport $D/a.svol -o $D/b.vtu", true},
    {"svtruth $D/mesh.vtu --scene $D/mesh.json --size 8x8 -o $D/c.exr", true},
    {"svdiff $D/a.exr $D/a.exr", true},
    {"svgen points --count 100 -o $D/b.npy", false},
    {"svdemo --points 1000 -o $D/b.vtu", false},
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
    const std::string wrong = name + (name == "svgen" ? " points --count 100" : " $D/missing") + " -o $D/no/such/file";
    for (const char* streams : {" 2>&- > /dev/null", " 2> /dev/full > /dev/null"})
      EXPECT_GT(code(wrong, streams), 0) << wrong << streams;
  }
}

TEST_F(Streams, TheVersionIsToldOrItIsAnError) {
  for (const std::string name :
       {"svbuild", "svinfo", "svrender", "svexport", "svtruth", "svdiff", "svgen", "svdemo", "svview"}) {
    if (!fs::exists(fs::path(SPLATVOL_BIN) / name)) continue;  // svview needs OpenGL
    for (const char* option : {" --version", " --help"}) {
      EXPECT_EQ(code(name + option, " > /dev/null"), 0) << name << option;
      EXPECT_EQ(code(name + option, " > /dev/full 2> /dev/null"), 1) << name << option;
      EXPECT_EQ(code(name + option, " >&- 2>&- <&-"), 0) << name << option;
    }
  }
}

}  // namespace
}  // namespace splatvol
