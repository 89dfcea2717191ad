// svgen writes the points and meshes that its library makes, whole or not at all.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "builder/opening/open_source.h"
#include "builder/sources/generator.h"
#include "builder/sources/vtk/writer.h"
#include "tests/support/programs.h"
#include "tools/refined_source.h"

namespace splatvol::test {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

using Svgen = ProgramTest;

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
    const auto outcome = run("svgen points --count 3e5 --distribution vortex --seed 7 --force -o a.npy --" + type);
    EXPECT_EQ(outcome.code, 0) << outcome.err;
    EXPECT_EQ(outcome.text, "");
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
  expect_done("svgen mesh --cells 6000 --pieces 12 -o a/");
  EXPECT_EQ(std::distance(fs::directory_iterator(path("a")), {}), 13);
  EXPECT_EQ(names().size(), 1U) << "nothing else is left";
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
  expect_done("svgen refine mesh.vtu --levels 2 -o a");
  expect_done("svgen refine mesh.vtu --attribute other -o b");
  for (const std::string& input : {path("a"), path("a/mesh.pvtu")}) {
    auto made = refine(open_source({path("mesh.vtu")}, {}).value(), 2, "");
    expect_same(*open_source({input}, {}).value(), *made);
  }
  auto made = refine(open_source({path("mesh.vtu")}, {{"other"}, {}}).value(), 1, "");
  expect_same(*open_source({path("b")}, {}).value(), *made);
}

TEST_F(Svgen, IsThereWholeOrNotAtAll) {
  expect_refusal("svgen points --count 1000 -o none/out.npy", "none/out.npy");
  const auto full = run("ulimit -f 100; svgen points --count 1e6 -o out.npy");
  EXPECT_EQ(full.code, 1);
  EXPECT_THAT(full.err, HasSubstr("cannot write"));
  EXPECT_TRUE(names().empty());
  expect_refusal("svgen mesh --cells 6000 -o none/out", "none/out");
  expect_refusal("svgen mesh --cells 48 --pieces 3 -o out", "too few for 3 x 1 x 1 parts");

  expect_refusal("svgen refine none.vtu -o out", "none.vtu");
  ASSERT_TRUE(write_tetrahedron(path("mesh.vtu")));
  expect_refusal("svgen refine mesh.vtu -o none/out", "svgen: none/out");
  expect_done("svgen points --count 100 -o points.npy");
  expect_refusal("svgen refine points.npy -o out", "points.npy: no cells");

  write("full/of", "work");
  expect_refusal("svgen mesh --cells 6000 -o full", "no empty folder");
  EXPECT_EQ(read("full/of"), "work");
}

// A .npy file has no room for a mark: svgen's own are no exception. Folders are never replaced.
TEST_F(Svgen, ReplacesByForceOnly) {
  expect_done("svgen points --count 100 -o a.npy");
  const std::string before = read("a.npy");
  expect_refusal("svgen points --count 200 -o a.npy", "a.npy: is there and may be an input of yours");
  expect_refusal("svgen points --count 200 -o a.npy", "--force");
  EXPECT_TRUE(read("a.npy") == before);
  expect_done("svgen points --count 200 --force -o a.npy");
  EXPECT_GT(fs::file_size(path("a.npy")), before.size());

  expect_done("svgen mesh --cells 6000 --pieces 1 -o m");
  expect_refusal("svgen mesh --cells 6000 --pieces 1 -o m", "no empty folder");
  EXPECT_EQ(run("svgen mesh --cells 6000 --force -o m").code, 2);
}

TEST_F(Svgen, WrongUsageIsTwo) {
  for (const char* arguments :
       {"", "points", "points --count 10", "points --count ten -o a.npy", "points --count 1.5 -o a.npy",
        "points --count 10 --distribution round -o a.npy", "points --count 10 --seed x -o a.npy", "mesh --cells 10",
        "mesh --cells 10 --pieces 0 -o a", "refine a.vtu", "refine a.vtu --levels 0 -o a",
        "refine a.vtu --levels 6 -o a", "points --count 10 -o a.npy mesh --cells 10 -o a"})
    EXPECT_EQ(run(std::string("svgen ") + arguments).code, 2) << arguments;
}

}  // namespace
}  // namespace splatvol::test
