// svgen writes the points and meshes that its library makes, whole or not at all.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "base/file.h"
#include "builder/opening/open_source.h"
#include "builder/sources/generator.h"
#include "builder/sources/vtk/writer.h"
#include "tools/refined_source.h"

namespace splatvol {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

class Svgen : public testing::Test {
 protected:
  Svgen() {
    std::string pattern = (fs::path(testing::TempDir()) / "splatvol-svgen-XXXXXX").string();
    folder_ = ::mkdtemp(pattern.data());
  }
  ~Svgen() override { fs::remove_all(folder_); }

  std::string path(const std::string& name) const { return (folder_ / name).string(); }

  /// Runs svgen and returns the exit code. The output is in message_.
  int run(const std::string& arguments, const std::string& before = "") {
    const std::string out = path("message");
    const int status = std::system((before + SPLATVOL_BIN "/svgen " + arguments + " > " + out + " 2>&1").c_str());
    message_ = *read_text_file(out);
    fs::remove(out);
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

  void expect_refused(const std::string& arguments, const std::string& reason, const std::string& before = "") {
    EXPECT_EQ(run(arguments, before), 1) << arguments;
    EXPECT_THAT(message_, HasSubstr(reason));
    EXPECT_EQ(std::ranges::count(message_, '\n'), 1) << message_;
    for (const auto& entry : fs::directory_iterator(folder_))
      EXPECT_FALSE(entry.path().filename().string().starts_with("out")) << entry.path();
  }

  fs::path folder_;
  std::string message_;
};

/// Expects the same pieces in the same order.
void expect_same(Source& a, Source& b) {
  EXPECT_EQ(a.attributes(), b.attributes());
  for (;;) {
    const auto piece_a = a.next().value(), piece_b = b.next().value();
    ASSERT_EQ(piece_a == nullptr, piece_b == nullptr);
    if (!piece_a) return;
    EXPECT_TRUE(piece_a->points == piece_b->points);
    EXPECT_TRUE(piece_a->values == piece_b->values);
    EXPECT_TRUE(piece_a->tetrahedra == piece_b->tetrahedra);
  }
}

TEST_F(Svgen, PointsAreThoseOfTheLibrary) {
  for (const std::string type : {"float32", "float64"}) {
    const std::string recipe = "count=3e5,distribution=vortex,seed=7,type=" + type;
    ASSERT_EQ(run("points --count 3e5 --distribution vortex --seed 7 --force -o " + path("a.npy") + " --" + type), 0);
    EXPECT_EQ(message_, "");
    auto file = open_source({path("a.npy")}, {}).value();
    auto made = open_source({"gen:points:" + recipe}, {}).value();
    EXPECT_EQ(file->point_count(), 300000u);
    EXPECT_EQ(file->single_precision(), made->single_precision());
    EXPECT_EQ(file->bounds().value()->low, made->bounds().value()->low);
    EXPECT_EQ(file->bounds().value()->high, made->bounds().value()->high);
    expect_same(*file, *made);
  }
  EXPECT_EQ(fs::file_size(path("a.npy")), 128 + 300000u * 32);
}

TEST_F(Svgen, MeshesAreThoseOfTheLibrary) {
  ASSERT_EQ(run("mesh --cells 6000 --pieces 12 -o " + path("a") + "/"), 0);
  EXPECT_EQ(message_, "");
  EXPECT_EQ(std::distance(fs::directory_iterator(path("a")), {}), 13);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), {}), 1) << "nothing else is left";
  for (const std::string& input : {path("a"), path("a/mesh.pvtu")}) {
    auto files = open_source({input}, {}).value();
    auto made = open_source({"gen:mesh:cells=6000,pieces=12"}, {}).value();
    EXPECT_EQ(files->piece_count(), 12u);
    expect_same(*files, *made);
  }
}

/// One tetrahedron with two attributes.
Status write_tetrahedron(const std::string& path) {
  const std::vector<dvec3> points = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  const std::vector<std::array<std::uint32_t, 4>> tetrahedra = {{0, 1, 2, 3}};
  const std::vector<PointArray> arrays = {{"U[0]", 1, {1, 2, 3, 4}}, {"other", 1, {5, 6, 7, 8}}};
  return write_vtu(path, points, tetrahedra, arrays);
}

TEST_F(Svgen, RefinedMeshesAreThoseOfTheLibrary) {
  ASSERT_TRUE(write_tetrahedron(path("mesh.vtu")));
  ASSERT_EQ(run("refine " + path("mesh.vtu") + " --levels 2 -o " + path("a")), 0) << message_;
  ASSERT_EQ(run("refine " + path("mesh.vtu") + " --attribute other -o " + path("b")), 0) << message_;
  for (const std::string& input : {path("a"), path("a/mesh.pvtu")}) {
    auto made = refine(open_source({path("mesh.vtu")}, {}).value(), 2, "");
    expect_same(*open_source({input}, {}).value(), *made);
  }
  auto made = refine(open_source({path("mesh.vtu")}, {{"other"}, {}}).value(), 1, "");
  expect_same(*open_source({path("b")}, {}).value(), *made);
}

TEST_F(Svgen, IsThereWholeOrNotAtAll) {
  expect_refused("points --count 1000 -o " + path("none/out.npy"), "none/out.npy");
  expect_refused("points --count 1e6 -o " + path("out.npy"), "cannot write", "ulimit -f 100; ");
  expect_refused("mesh --cells 6000 -o " + path("none/out"), "none/out");
  expect_refused("mesh --cells 48 --pieces 3 -o " + path("out"), "too few for 3 x 1 x 1 parts");

  expect_refused("refine " + path("none.vtu") + " -o " + path("out"), "none.vtu");
  ASSERT_TRUE(write_tetrahedron(path("mesh.vtu")));
  expect_refused("refine " + path("mesh.vtu") + " -o " + path("none/out"), "svgen: " + path("none/out"));
  ASSERT_EQ(run("points --count 100 -o " + path("points.npy")), 0);
  expect_refused("refine " + path("points.npy") + " -o " + path("out"), "points.npy: no cells");

  fs::create_directory(path("full"));
  std::ofstream(path("full/of")) << "work";
  expect_refused("mesh --cells 6000 -o " + path("full"), "no empty folder");
  EXPECT_EQ(*read_text_file(path("full/of")), "work");
}

// A .npy file has no room for a mark: svgen's own are no exception. Folders are never replaced.
TEST_F(Svgen, ReplacesByForceOnly) {
  ASSERT_EQ(run("points --count 100 -o " + path("a.npy")), 0) << message_;
  const std::string before = *read_text_file(path("a.npy"));
  expect_refused("points --count 200 -o " + path("a.npy"), "a.npy: is there and may be an input of yours");
  EXPECT_THAT(message_, HasSubstr("--force"));
  EXPECT_TRUE(*read_text_file(path("a.npy")) == before);
  EXPECT_EQ(run("points --count 200 --force -o " + path("a.npy")), 0) << message_;
  EXPECT_GT(fs::file_size(path("a.npy")), before.size());

  ASSERT_EQ(run("mesh --cells 6000 --pieces 1 -o " + path("m")), 0) << message_;
  expect_refused("mesh --cells 6000 --pieces 1 -o " + path("m"), "no empty folder");
  EXPECT_EQ(run("mesh --cells 6000 --force -o " + path("m")), 2);
}

TEST_F(Svgen, WrongUsageIsTwo) {
  for (const char* arguments :
       {"", "points", "points --count 10", "points --count ten -o a.npy", "points --count 1.5 -o a.npy",
        "points --count 10 --distribution round -o a.npy", "points --count 10 --seed x -o a.npy", "mesh --cells 10",
        "mesh --cells 10 --pieces 0 -o a", "refine a.vtu", "refine a.vtu --levels 0 -o a",
        "refine a.vtu --levels 6 -o a", "points --count 10 -o a.npy mesh --cells 10 -o a"})
    EXPECT_EQ(run(arguments), 2) << arguments << message_;
  EXPECT_EQ(run("--help"), 0);
  EXPECT_EQ(run("--version"), 0);
}

}  // namespace
}  // namespace splatvol
