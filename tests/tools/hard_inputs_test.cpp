// Inputs at the edges of what numbers can hold: svbuild writes what svinfo --verify accepts.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <array>
#include <cstdint>
#include <limits>
#include <string>

#include "tests/support/openfoam_files.h"
#include "tests/support/programs.h"

namespace splatvol::test {
namespace {

struct HardInputs : ProgramTest {
  void expect_verified(const std::string& input, const std::string& options = "") {
    EXPECT_EQ(run("svbuild " + input + " -o out.svol " + options).code, 0);
    expect_done("svinfo --verify out.svol");
  }
};

std::string table(const std::string& scale) {
  std::string text = "x,y,z,v\n";
  for (const char* point : {"0,0,0,1", "1,0,0,2", "0,1,0,3", "0,0,1,4", "1,1,0,5", "1,0,1,6", "0,1,1,7", "1,1,1,8"}) {
    std::string line = point;
    for (const std::size_t at : {4, 2, 0})
      if (line[at] == '1') line.replace(at, 1, scale);
    text += line + "\n";
  }
  return text;
}

TEST_F(HardInputs, ExactCoordinatesOfVeryDifferentSizes) {
  expect_verified(write("a.csv", "x,y,z,v\n-0.3,0,0,1\n1e-17,0,0,2\n0.1,0.2,-0.3,3\n-0.3,1e-17,1e-17,4\n"), "--exact");
}

TEST_F(HardInputs, APointOfNoCellFarAway) {
  expect_verified(
      write("a.vtk",
            "# vtk DataFile Version 3.0\nt\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS 5 double\n0 0 0\n1 0 0\n"
            "0 1 0\n0 0 1\n1e16 0 0\nCELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n10\nPOINT_DATA 5\n"
            "SCALARS f float 1\nLOOKUP_TABLE default\n1 2 3 4 5\n"));
}

TEST_F(HardInputs, APointWithoutAPlaceIsLeftOut) {
  std::string values;
  const std::array<float, 12> numbers = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, std::numeric_limits<float>::infinity()};
  const std::uint32_t bytes = sizeof(numbers);
  values.append(reinterpret_cast<const char*>(&bytes), 4);
  values.append(reinterpret_cast<const char*>(numbers.data()), bytes);
  const std::string file = write(
      "a.vtp",
      "<VTKFile type=\"PolyData\" version=\"0.1\" byte_order=\"LittleEndian\"><PolyData><Piece NumberOfPoints=\"4\" "
      "NumberOfVerts=\"4\" NumberOfLines=\"0\" NumberOfStrips=\"0\" NumberOfPolys=\"0\"><PointData><DataArray "
      "type=\"Float32\" Name=\"f\" format=\"ascii\">1 2 3 4</DataArray></PointData><Points><DataArray type=\"Float32\" "
      "NumberOfComponents=\"3\" format=\"appended\" offset=\"0\"/></Points><Verts><DataArray type=\"Int32\" "
      "Name=\"connectivity\" format=\"ascii\">0 1 2 3</DataArray><DataArray type=\"Int32\" Name=\"offsets\" "
      "format=\"ascii\">1 2 3 4</DataArray></Verts></Piece></PolyData><AppendedData encoding=\"raw\">_" +
          values + "</AppendedData></VTKFile>");
  expect_verified(file);
  EXPECT_THAT(run("svinfo out.svol").out, testing::HasSubstr("3 points"));
}

TEST_F(HardInputs, ScatteredPointsFarApart) {
  expect_verified(write("a.csv", table("1e50")));
  // Beyond what a file can hold, an input is refused in one line; it never becomes a file that is not valid.
  for (const char* scale : {"1e78", "1e103", "1e300"}) {
    const std::string input = write("b.csv", table(scale));
    if (run("svbuild " + input + " -o out.svol").code == 0)
      expect_done("svinfo --verify out.svol");
    else
      expect_refusal("svbuild " + input + " -o out.svol", "b.csv");
  }
}

// No tetrahedron joins them: boxes have a thickness.
TEST_F(HardInputs, PointsInAPlaneAreSeen) {
  const std::string input = write("plane.csv", "x,y,z,v\n0,0,1,1\n1,0,1,2\n0,1,1,3\n1,1,1,4\n.3,.4,1,5\n");
  expect_refusal("svbuild " + input + " --connectivity delaunay -o out.svol", "in a plane");
  EXPECT_EQ(run("svbuild " + input + " --connectivity boxes -o out.svol").code, 0);
  const Outcome drawn = run("svrender --device cpu out.svol -o out.png");
  EXPECT_EQ(drawn.code, 0);
  EXPECT_EQ(drawn.err, "") << "it is not empty";
}

TEST_F(HardInputs, ANameWithControlCharactersIsSaidOnce) {
  const std::string input = write("a\x1b[31m.vtu", "<VTKFile");
  const std::string text = run("svbuild '" + input + "' -o out.svol").err;
  EXPECT_THAT(text, testing::StartsWith("svbuild: " + path("a?[31m.vtu: ")));
  EXPECT_EQ(text.find(".vtu"), text.rfind(".vtu")) << text;
}

// Attributes are looked up by their names: the time grows with their number, not with its square.
TEST_F(HardInputs, TablesOfManyColumns) {
  std::string names = "x,y,z", lines;
  for (int i = 0; i < 20000; ++i) names += ",a" + std::to_string(i);
  for (const char* point : {"0,0,0", "1,0,0", "0,1,0", "0,0,1"}) {
    lines += point;
    for (int i = 0; i < 20000; ++i) lines += ",1";
    lines += "\n";
  }
  expect_verified(write("wide.csv", names + "\n" + lines));
}

// Files of a case with noise in the last bits of its points are those of the case without, unless all bits are wanted.
// An append does as its series.
TEST_F(HardInputs, NoiseInLastBitsOfOpenFoam) {
  const auto write_case = [&](bool noise) {
    for (const auto& [name, text] : openfoam_files()) FolderTest::write("flow/" + name, text);
    FolderTest::write("flow/0/p", read("flow/0.5/p"));
    std::string points = read("flow/constant/polyMesh/points");
    for (std::size_t at = 0; noise && (at = points.find("(1 ", at)) != std::string::npos;)
      points.replace(at, 3, "(1.0000000000000002 ");
    FolderTest::write("flow/constant/polyMesh/points", points);
  };
  const auto file = [&](bool noise, const std::string& options) {
    write_case(noise);
    expect_done("svbuild flow --attribute p -o out.svol " + options);
    return read("out.svol");
  };
  EXPECT_TRUE(file(true, "") == file(false, ""));
  EXPECT_FALSE(file(true, "--exact") == file(false, "--exact"));
  EXPECT_THAT(run("svinfo out.svol").out, testing::ContainsRegex("largest error +0 "));

  write_case(true);
  for (const char* first : {"", "--exact"})
    for (const char* then : {"", "--exact"}) {
      expect_done(fmt::format("svbuild flow --attribute p --times 0:0 -o series.svol {}", first));
      expect_done(fmt::format("svbuild flow --attribute p --times 0.5: --append -o series.svol {}", then));
    }
}

}  // namespace
}  // namespace splatvol::test
