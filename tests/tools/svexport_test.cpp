// svexport: exit codes, messages and output.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "tests/support/program_json.h"
#include "tests/support/test_volume.h"

namespace splatvol::test {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

struct Svexport : test::ProgramTest {
  Svexport() { EXPECT_TRUE(write_test_volume(volume_of_x(200, 3), path("in.svol"))); }

  Outcome run(const std::string& output, const std::string& arguments) const {
    return ProgramTest::run("svexport in.svol -o " + output + " " + arguments);
  }
};

TEST_F(Svexport, WritesVoxelsAndPoints) {
  const auto voxels = document_of(run("out.vdb", "--voxel 0.1 --json"));
  EXPECT_NEAR(voxels["voxel_mass"].get<double>(), voxels["splat_mass"].get<double>(),
              1e-9 * voxels["splat_mass"].get<double>());
  EXPECT_EQ(voxels["file_bytes"], fs::file_size(path("out.vdb")));
  const auto points = document_of(run("out.vtu", "--resolution 0 --json"));
  EXPECT_EQ(points["file_bytes"], fs::file_size(path("out.vtu")));
  EXPECT_THAT(run("out.vtu", "--box 0,0,0,0.5,0.5,0.5 --attribute a0").out, HasSubstr("points"));
}

TEST_F(Svexport, TellsWhatGotAnotherName) {
  TestVolume volume = make_test_volume(random_points(200, 3), {std::vector<double>(200, 1.0)});
  for (const auto& [name, output] :
       {std::pair<std::string, std::string>{"mass", "out.vtu"}, {"volume_fraction", "out.vdb --voxel 0.1"}}) {
    volume.info.attributes[0].name = name;
    ASSERT_TRUE(write_test_volume(volume, path("in.svol")));
    EXPECT_THAT(run(output, "").text, HasSubstr("what svexport calls so is \"" + name + " (splat)\""));
    EXPECT_EQ(document_of(run(output, "--json"))["renamed"][name], name + " (splat)");
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
                                                        {"out.vtu", "--cells --resolution 1"},
                                                        {"out.vtu", "--cells --voxel 1"},
                                                        {"out.vtu", "--cells --memory 1G"},
                                                        {"out.vtp", "--streamlines U"},
                                                        {"out.vtp", "--contour 1 --seeds 0,0,0"},
                                                        {"out.vtu", "--streamlines U --seeds 0,0,0"},
                                                        {"out.vtp", "--streamlines U --seeds 0,0"},
                                                        {"out.vtp", "--streamlines U --seeds 0,0,0:1,0,0"},
                                                        {"out.vtp", "--streamlines U --seeds 0,0,0:1,0,0:0,1,0:3"},
                                                        {"out.vtp", "--streamlines U --seeds 0,0,0 --length 0"},
                                                        {"out.csv", "--streamlines U --seeds 0,0,0 --box 0,0,0,1,1,1"},
                                                        {"out.vdb", "--cells --voxel 1"},
                                                        {"out.stl", ""},
                                                        {"out.vtu", "--contour 0.5"},
                                                        {"out.stl", "--contour inf"},
                                                        {"out.stl", "--contour 0.5 --resolution 1"},
                                                        {"out.glb", "--contour 1 --attribute a --attribute b"},
                                                        {"out.csv", ""},
                                                        {"out.csv", "--line 0,0,0"},
                                                        {"out.csv", "--line 0,0,0:1,0"},
                                                        {"out.csv", "--line 0,0,0:1,0,nan"},
                                                        {"out.csv", "--line 0,0,0:1,0,0:"},
                                                        {"out.csv", "--line 0,0,0:1,0,0 --samples 1"},
                                                        {"out.csv", "--line 0,0,0:1,0,0 --box 0,0,0,1,1,1"},
                                                        {"out.vtu", "--line 0,0,0:1,0,0"},
                                                        {"out.vtu", "--samples 5"},
                                                        {"out.vtu", "--resolution -1"},
                                                        {"out.vtu", "--resolution 18446744073709551616"}})
    EXPECT_EQ(run(output, arguments).code, 2) << output << " " << arguments;
}

TEST_F(Svexport, WhatCannotBeIsOneLine) {
  for (const auto& [arguments, reason] :
       std::vector<std::pair<std::string, std::string>>{{"--voxel 0.1 --attribute b", "no attribute \"b\""},
                                                        {"--voxel 0.1 --resolution 9", "no resolution 9"},
                                                        {"--voxel 0.001 --memory 1M", "--memory"},
                                                        {"--voxel 1e-5 --box 0.5,0,0,0.5,1,1", "--box"}}) {
    expect_refusal("svexport in.svol -o out.vdb " + arguments, reason);
  }
}

TEST_F(Svexport, WritesContours) {
  expect_done("svbuild gen:mesh:cells=6000 -o mesh.svol");
  const auto stl = document_of(ProgramTest::run("svexport mesh.svol -o out.stl --contour 0.5 --json"));
  const auto vtp =
      document_of(ProgramTest::run("svexport mesh.svol -o out.vtp --contour 0.5 --attribute value --json"));
  const auto glb = document_of(ProgramTest::run("svexport mesh.svol -o out.glb --contour 0.5 --memory 16M --json"));
  for (const auto& report : {stl, vtp, glb}) {
    EXPECT_EQ(report["closed"], true);
    EXPECT_EQ(report["area"], stl["area"]);
    EXPECT_EQ(report["volume"], stl["volume"]);
    EXPECT_GT(report["volume"].get<double>(), 0);
    EXPECT_EQ(report["file_bytes"], fs::file_size(path(report["output"].get<std::string>())));
  }
  EXPECT_EQ(vtp["vertices"], glb["vertices"]);
  EXPECT_THAT(ProgramTest::run("svexport mesh.svol -o out.stl --contour 0.5").out,
              ::testing::MatchesRegex("out.stl: [0-9]+ triangles, area [^\n]*, closed round a volume of [^\n]*\n"
                                      "  largest errors: of a coordinate [^\n]*, value [^\n]*\n"));
  EXPECT_THAT(ProgramTest::run("svexport mesh.svol -o out.stl --contour 0.2 --box -1.2,-1.25,-0.1,-1.18,-1.2,0").out,
              HasSubstr("open"));
  expect_refusal("svexport mesh.svol -o out.stl --contour 9", "mesh.svol: \"value\" has values from");
  expect_refusal("svexport in.svol -o out.stl --contour 0.5", "keeps no cells");
  ASSERT_TRUE(write_test_volume(make_test_volume(random_points(20, 3), {std::vector(20, 1.0), std::vector(20, 2.0)}),
                                path("in.svol")));
  expect_refusal("svexport in.svol -o out.stl --contour 0.5", "in.svol: has several attributes");
  expect_done("svexport mesh.svol -o out.glb --contour 0.5");  // its own
  std::ofstream(path("mine.stl")) << "solid mine";
  expect_refusal("svexport mesh.svol -o mine.stl --contour 0.5", "--force");
}

TEST_F(Svexport, WritesLines) {
  expect_done("svbuild gen:mesh:cells=6000 --exact -o mesh.svol");
  const auto report = document_of(ProgramTest::run("svexport mesh.svol -o out.csv --line -3,0,0.1:3,0.2,0 --json"));
  EXPECT_GT(report["rows"], 20);
  EXPECT_GT(report["inside"].get<double>(), 3.9);
  EXPECT_LT(report["inside"].get<double>(), 4.1);
  EXPECT_THAT(read("out.csv"), ::testing::StartsWith("arc_length,x,y,z,value\n0,-3,0,0.1,nan\n1.0"));
  const std::string even = "svexport mesh.svol -o out.csv --line -3,0,0.1:3,0.2,0 --samples 3";
  expect_refusal(even, "--force");
  EXPECT_THAT(ProgramTest::run(even + " --force").out, HasSubstr("out.csv: 3 rows, length 6.0"));
  EXPECT_THAT(read("out.csv"), ::testing::MatchesRegex("arc_length,x,y,z,value\n0,-3,0,0.1,nan\n"
                                                       "[0-9.]+,0,0.1,0.05,[0-9.e-]+\n[0-9.]+,3,0.2,0,nan\n"));
  expect_refusal("svexport in.svol -o none.csv --line 0,0,0:1,0,0", "keeps no cells");
  expect_refusal("svexport mesh.svol -o none.csv --line 1,0,0:1,0,0", "the line has no length");
  expect_refusal("svexport mesh.svol -o none.csv --line 5,5,5:6,6,6", "the line has no values");
}

// A cube with velocities along x, which grow with x.
constexpr const char* moving_cube = R"(# vtk DataFile Version 3.0
cube
ASCII
DATASET UNSTRUCTURED_GRID
POINTS 8 double
0 0 0 1 0 0 0 1 0 1 1 0 0 0 1 1 0 1 0 1 1 1 1 1
CELLS 1 9
8 0 1 3 2 4 5 7 6
CELL_TYPES 1
12
POINT_DATA 8
VECTORS U double
1 0 0 2 0 0 1 0 0 2 0 0 1 0 0 2 0 0 1 0 0 2 0 0
)";

TEST_F(Svexport, WritesStreamlines) {
  std::ofstream(path("cube.vtk")) << moving_cube;
  expect_done("svbuild cube.vtk --exact -o cube.svol");
  const std::string some = "svexport cube.svol -o out.vtp --streamlines U --seeds 0.5,0.1,0.5:0.5,2,0.5:3 ";
  const auto report = document_of(ProgramTest::run(some + "--json"));
  EXPECT_EQ(report["seeds"], 3);
  EXPECT_EQ(report["lines"], 1);
  EXPECT_EQ(report["ends"]["mesh"], 2);
  EXPECT_EQ(report["file_bytes"], fs::file_size(path("out.vtp")));
  EXPECT_THAT(ProgramTest::run(some).out, ::testing::StartsWith("out.vtp: 1 streamlines of 3 seeds, "));
  const std::string table = "svexport cube.svol -o out.csv --streamlines U --seeds 0,0.2,0.3 --attribute U[0] ";
  expect_done(table + "--direction forward --memory 1M");
  EXPECT_THAT(read("out.csv"),
              ::testing::MatchesRegex("seed,time,x,y,z,U\\[0\\]\n0,0,0,0.2,0.3,1\n(.*\n)*"
                                      "0,0.69314[0-9]*,(1|0.9999999[0-9]*),0.2,0.3,(2|1.9999999[0-9]*)\n"));
  expect_refusal(table, "--force");
  expect_done(table + "--force --length 0.1 --steps 5");
  expect_refusal("svexport cube.svol -o out.vtp --streamlines V --seeds 0,0,0", "vectors: U");
  expect_refusal("svexport cube.svol -o out.vtp --streamlines U --seeds 7,0,0", "no seed has a streamline");
  expect_refusal("svexport cube.svol -o out.vtp --streamlines U --seeds inlet:5", "svbuild --boundary");
  expect_done("svbuild cube.vtk --exact --boundary -o walls.svol");
  const auto walls =
      document_of(ProgramTest::run("svexport walls.svol -o out.vtp --streamlines U --seeds \"*:24\" --json"));
  EXPECT_EQ(walls["lines"], 24) << "from all sides of the cube";
  expect_refusal("svexport in.svol -o out.vtp --streamlines U --seeds 0,0,0", "is no vector");
}

TEST_F(Svexport, WritesCells) {
  expect_done("svbuild gen:mesh:cells=6000 --exact -o mesh.svol");
  const auto all = document_of(ProgramTest::run("svexport mesh.svol -o all.vtu --cells --json"));
  EXPECT_EQ(all["cells"], 6000);
  EXPECT_EQ(all["points"], 11 * 11 * 11);
  EXPECT_EQ(all["left_out"], 0);
  EXPECT_NEAR(all["volume"].get<double>(), 32, 1e-12);
  EXPECT_EQ(all["position_error"], 0);
  EXPECT_EQ(all["value_errors"]["value"], 0);
  EXPECT_EQ(all["file_bytes"], fs::file_size(path("all.vtu")));
  const std::string text = ProgramTest::run("svexport mesh.svol -o part.vtu --cells --box 0,0,0,0.1,0.1,0.1").out;
  EXPECT_THAT(text, ::testing::MatchesRegex("part.vtu: [0-9]+ cells with [0-9]+ points, volume [^\n]*\n"
                                            "  positions and values as they were given\n"));
  EXPECT_LT(fs::file_size(path("part.vtu")), fs::file_size(path("all.vtu")) / 10);
  for (const auto& [arguments, reason] : std::vector<std::pair<std::string, std::string>>{
           {"mesh.svol --box 5,5,5,6,6,6", "mesh.svol: no cells in the box"},
           {"in.svol",
            "in.svol: keeps no cells: build it from a mesh, or from points by --connectivity delaunay, without "
            "--drop-cells"},
           {"mesh.svol --attribute b", "no attribute \"b\""}})
    expect_refusal("svexport " + arguments + " -o out.vtu --cells", reason);
  write("mine.vtu", "<VTKFile/>");
  expect_refusal("svexport mesh.svol -o mine.vtu --cells", "--force");
  expect_done("svexport mesh.svol -o mine.vtu --cells --force");
  EXPECT_EQ(read("mine.vtu"), read("all.vtu"));
}

// A limit on file sizes, of 4 units of 512 or 1024 bytes, acts like a full disk.
TEST_F(Svexport, WhatCannotBeWrittenIsNotThere) {
  expect_done("svbuild gen:mesh:cells=6000 -o mesh.svol");
  for (const std::string arguments :
       {"in.svol -o out.vdb --voxel 0.01", "in.svol -o out.vtu", "mesh.svol -o out.vtu --cells"}) {
    EXPECT_EQ(ProgramTest::run("ulimit -f 4; svexport " + arguments).code, 1) << arguments;
    EXPECT_EQ(names().size(), 2U) << arguments;
  }
}

}  // namespace
}  // namespace splatvol::test
