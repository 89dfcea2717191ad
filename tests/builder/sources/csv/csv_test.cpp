// Scattered points from .csv files.
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <cmath>

#include "builder/opening/input_files.h"
#include "builder/opening/open_own.h"
#include "builder/sources/csv/csv_table.h"
#include "builder/sources/units.h"
#include "tests/builder/sources/read_input.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using namespace ::testing;

struct CsvTest : FolderTest {
  /// The points (1, 2, 3) and (4, 5, 6) with the value 7 and a missing one.
  void expect_two_points(const std::string& text, const std::vector<std::string>& columns = {}) const {
    const auto input = read_input({write("a.csv", text)}, {{}, columns});
    ASSERT_TRUE(input) << text << input.error().message;
    EXPECT_THAT(input->attributes, ElementsAre("p")) << text;
    ASSERT_EQ(input->points, 2u) << text;
    EXPECT_THAT(input->pieces[0].points, ElementsAre(dvec3(1, 2, 3), dvec3(4, 5, 6))) << text;
    EXPECT_EQ(input->pieces[0].values[0][0], 7) << text;
    EXPECT_TRUE(std::isnan(input->pieces[0].values[0][1])) << text;
  }
};

TEST_F(CsvTest, HeadingsOfManyPrograms) {
  for (const char* heading :
       {"x,y,z,p", "X,Y,Z,p", "\"Points:0\",\"Points:1\",\"Points:2\",\"p\"", "Points_0,Points_1,Points_2,p",
        "coord x,coord y,coord z,p", "x [m],y [m],z [m],p [Pa]", " X [ m ] , Y [ m ] , Z [ m ] , p [ Pa ]",
        "x-coordinate,y-coordinate,z-coordinate,p", "CoordinateX,CoordinateY,CoordinateZ,p", "# x,y,z,p"})
    expect_two_points(std::string(heading) + "\n1,2,3,7\n4,5,6,\n");
}

TEST_F(CsvTest, Separators) {
  expect_two_points("x;y;z;p\r\n1;2;3;7\r\n4;5;6;nan\r\n");
  expect_two_points("x\ty\tz\tp\n1\t2\t3\t7\n4\t5\t6\t\n\n");
  expect_two_points("\xEF\xBB\xBFx,y,z,p\n\"1\",2,+3,7\n4.0e0,5,6.D+00,\"\"\n");
  expect_two_points("x,y,name,z,p\n1,2,\"a, \"\"b\"\"\",3,7\n4,5,c,6,NA\n");
  expect_two_points("PointID,x,y,z,p\n1,1,2,3,7\n2,4,5,6,-\n");
}

// Tables of STAR-CCM+, Fluent, COMSOL and CFX-Post.
TEST_F(CsvTest, TablesOfSimulations) {
  expect_two_points("\"p (Pa)\",\"X (m)\",\"Y (m)\",\"Z (m)\"\n7,1,2,3\nNaN,4,5,6\n");
  expect_two_points("nodenumber, x-coordinate, y-coordinate, z-coordinate, p\n1, 1, 2, 3, 7\n2, 4, 5, 6, nan\n");
  expect_two_points("x-coordinate, y-coordinate, z-coordinate, p, y-coordinate\n1, 2, 3, 7, 2\n4, 5, 6, nan, 5\n");
  expect_two_points("  cellnumber  x-coordinate  y-coordinate  z-coordinate  p\n 1  1.0 2 3\t7 \n 2  4 5 6 nan\n");
  expect_two_points(
      "% Model:    a, b.mph\n% Dimension:   3\n% Description:  Pressure\n"
      "% x                   y               z                 p (Pa)\n1   2   3   7\n4   5   6   NaN\n");
  expect_two_points("% Model,a.mph\n% X,Y,Z,p (Pa) @ freq=1\n1,2,3,7\n4,5,6,NaN\n", {"x", "y", "z", "p"});
  expect_two_points("% x y z p (Pa)\n1 2 3 7\n% half\n4 5 6 NaN\n");
  expect_two_points(
      "Node Number\tX Location (m)\tY Location (m)\tZ Location (m)\tp (Pa)\n1\t1\t2\t3\t7\n2\t4\t5\t6\t\n");
  expect_two_points("# some words\n\n# more\nx;y;z;p\n1;2;3;7\n# half\n4;5;6;\n");
  expect_two_points("# x,y,z,p,name\n1,2,3,7,a\n4,5,6,,b\n");
  expect_two_points(
      "\n[Name]\nInlet\n\n[Spatial Fields]\nX, Y, Z\n\n[Data]\nNode Number, X [ m ], Y [ m ], Z [ m ], p [ Pa ], X [ m "
      "], "
      "Y [ m ], Z [ m ]\n0, 1, 2, 3, 7, 1, 2, 3\n1, 4, 5, 6, null, 4, 5, 6\n\n[Faces]\n0, 1, 2, 3\n0, 1\n");
  const std::string part = "[Data]\nX [ m ],Y [ m ],Z [ m ],p [ Pa ]\n";
  expect_two_points("[Name]\na\n" + part + "1,2,3,7\n[Faces]\n0,1,2\n[Name]\nb\n" + part +
                    "4,5,6,null\n[Lines]\n0,1\n");
  EXPECT_THAT(error_of({write("a.csv", part + "1,2,3,7\n[Data]\nX,Y,Z,q\n4,5,6,7\n")}),
              HasSubstr("line 5: not the columns of the first section [Data]"));
  EXPECT_THAT(error_of({write("a.csv", "[Name]\na\n[Faces]\n0,1,2\n")}), HasSubstr("no line in a section [Data]"));
  EXPECT_THAT(error_of({write("a.csv", "% x y z p q\n1 2 3 4\n")}),
              HasSubstr("line 1: 5 names of columns, but line 2 has 4"));
  EXPECT_THAT(error_of({write("a.csv", "x y z p\n1 2 3 4\n1 2 3\n")}), HasSubstr("line 3: 3 fields instead of 4"));
  EXPECT_THAT(error_of({write("a.csv", "x,y,z,p\n1,2,3,4\n# half\n")}), HasSubstr("line 3: 1 fields instead of 4"));
}

// Tables of other names: those called .txt, and those that are told by their lines.
TEST_F(CsvTest, NamesOfTables) {
  for (const char* name : {"a.txt", "a.TXT", "a.tsv", "a.dat", "a-0001"}) {
    const auto input = read_input({write(name, "x y z p\n1 2 3 4\n")});
    ASSERT_TRUE(input) << name;
    EXPECT_THAT(input->attributes, ElementsAre("p"));
  }
  EXPECT_THAT(error_of({write("a.txt", "# vtk DataFile Version 3.0\nt\n")}), Not(HasSubstr("column")));
  // Readme files of a folder are no tables, and tables called .txt are named as left out.
  write("b/a.csv", "x,y,z,p\n1,2,3,4\n");
  write("b/readme.txt", "What this is.\nA folder, a table, a text.\n");
  EXPECT_THAT(files_left_out({path("b")}), ElementsAre());
  write("b/c.txt", "x,y,z,p\n1,2,3,4\n");
  EXPECT_THAT(files_left_out({path("b")}), ElementsAre(path("b/c.txt")));
  EXPECT_EQ(value_of(read_input({path("b")})).points, 1u);
}

TEST_F(CsvTest, ColumnsAreNamed) {
  expect_two_points("1,2,3,9,7\n4,5,6,9,\n", {"x", "y", "z", "_", "p"});
  expect_two_points("a,b,c,d\n3,2,1,7\n6,5,4,\n", {"z", "y", "x", "p"});
  const std::string path = write("a.csv", "1,2,3,7\n");
  EXPECT_THAT(error_of({path}), AllOf(StartsWith(path), HasSubstr("--columns x,y,z")));
  EXPECT_THAT(error_of({path}, {{}, {"x", "y", "z"}}), HasSubstr("4 columns, but 3 names"));
}

TEST_F(CsvTest, UnitsComeFromTheHeading) {
  const std::string path = write("a.csv", "x,y,z,p [Pa],T,U[0]\n1,2,3,4,5,6\n");
  const auto source = value_of(open_own({path}, {}));
  EXPECT_THAT(source->attributes(), ElementsAre("p", "T", "U[0]"));
  EXPECT_THAT(source->units(), ElementsAre("Pa", "", ""));
  const auto celsius = value_of(open_own({write("b.csv", "x,y,z,\xe9T [\xb0\x43],p [°C]\n1,2,3,4,5\n")}, {}));
  EXPECT_THAT(celsius->attributes(), ElementsAre("éT", "p"));
  EXPECT_THAT(celsius->units(), ElementsAre("°C", "°C")) << "Latin-1 and UTF-8";
}

TEST_F(CsvTest, ErrorsNameTheLine) {
  const auto message = [&](const std::string& text) { return error_of({write("a.csv", text)}); };
  EXPECT_THAT(message("x,y,z,p\n1,2,3,4\n1,2,3\n"), HasSubstr("a.csv: line 3: 3 fields instead of 4"));
  EXPECT_THAT(message("x,y,z,p\n\n1,2,3,4\n1,2,3,4,5\n"), HasSubstr("line 4: 5 fields instead of 4"));
  EXPECT_THAT(message("x,y,z,p\n1,2,3,4\n1,2,3,abc\n"), HasSubstr("line 3: \"abc\" in the column \"p\" is not"));
  EXPECT_THAT(message("x;y;z;p\n1;2;3;4\n1;2;3;4,5\n"), HasSubstr("line 3: \"4,5\" in the column \"p\" is not"));
  EXPECT_THAT(message("x,y,z,p\n1,2,3,4\n1,2,\"3,4\n"), HasSubstr("line 3: a quotation mark is not closed"));
  EXPECT_THAT(message("x,y,p\n1,2,3\n"), HasSubstr("no column is called z; there are: x, y, p"));
  EXPECT_THAT(message("x,y,z\n1,2,3\n"), HasSubstr("no values, only positions"));
  EXPECT_THAT(message("x,y,z,\n1,2,3,4\n"), HasSubstr("column 4 has no name"));
  EXPECT_THAT(message("x,y,z,p,p\n1,2,3,4,5\n"), HasSubstr("two columns are called \"p\""));
  EXPECT_THAT(message("x,y,z,p,x\n1,2,3,4,1\n2,2,3,4,7\n"),
              HasSubstr("line 3: two columns are called \"x\", with 2 and 7"));
  EXPECT_THAT(message(""), HasSubstr("empty"));
  EXPECT_THAT(message("x,y,z,p\n"), HasSubstr("no line after the names"));
  EXPECT_THAT(error_of({write("a.csv", "x,y,z,p\n1,2,3,4\n")}, {{"q"}, {}}),
              HasSubstr("no attribute \"q\"; there are: p"));
}

// Pieces of 2 MiB give the same points and line numbers as one read would.
TEST_F(CsvTest, LargeFilesComeInPieces) {
  std::string text = "x,y,z,p\n";
  constexpr std::size_t count = 300'000;
  for (std::size_t i = 0; i < count; ++i) text += fmt::format("{},{},0.5,{}\n", i, 2 * i, i % 7);
  const auto input = value_of(read_input({write("a.csv", text)}));
  EXPECT_GT(input.pieces.size(), 2u);
  ASSERT_EQ(input.points, count);
  std::size_t i = 0;
  for (const Piece& piece : input.pieces)
    for (std::size_t k = 0; k < piece.points.size(); ++k, ++i) {
      ASSERT_EQ(piece.points[k], dvec3(static_cast<double>(i), 2 * static_cast<double>(i), 0.5));
      ASSERT_EQ(piece.values[0][k], static_cast<double>(i % 7));
    }
  EXPECT_THAT(error_of({write("b.csv", text + "1,2\n")}), HasSubstr(fmt::format("line {}: 2 fields", count + 2)));
}

// A cut can only shorten the last line: the rest is refused, or is the same.
TEST_F(CsvTest, Truncated) {
  const std::string whole = "x,y,z,p [Pa]\n1,2,3,40\n5,6,7,80\n9,10,11,120\n";
  const auto all = value_of(read_input({write("a.csv", whole)}));
  for (std::size_t bytes = 0; bytes < whole.size(); ++bytes) {
    const auto input = read_input({write("a.csv", whole.substr(0, bytes))});
    if (!input) continue;
    for (std::size_t i = 0; i + 1 < input->points; ++i) {
      EXPECT_EQ(input->pieces[0].points[i], all.pieces[0].points[i]) << bytes;
      EXPECT_EQ(input->pieces[0].values[0][i], all.pieces[0].values[0][i]) << bytes;
    }
  }
}

// A cut within the last number gives another number: only what follows it tells that it is whole.
TEST_F(CsvTest, OpenEnds) {
  const auto open_ends = [&](const std::string& text) {
    const auto input = read_input({write("a.csv", text)});
    EXPECT_TRUE(input) << text;
    return input ? input->census.open_ends : 99;
  };
  const std::string head = "x,y,z,p\n1,2,3,4\n";
  for (const char* last : {"5,6,7,80", "5,6,7,8", "5,6,7,", "5,6,7,1e5"}) EXPECT_EQ(open_ends(head + last), 1u) << last;
  for (const char* last : {"", "5,6,7,8\n", "5,6,7,8\r\n", "5,6,7,8 ", "5,6,7,\"8\"", "5,6,7,8\n\n"})
    EXPECT_EQ(open_ends(head + last), 0u) << last;
  EXPECT_EQ(open_ends("x\ty\tz\tp\n1\t2\t3\t4\n5\t6\t7\t"), 1u);
  EXPECT_EQ(open_ends("p,x,y,z\n1,2,3,40"), 1u);
  EXPECT_EQ(open_ends("x,y,z,p,name\n1,2,3,4,five"), 0u) << "no number";
  const auto two = value_of(read_input({write("b.csv", head + "5,6,7,8"), write("a.csv", head + "9,6,7,8")}));
  EXPECT_EQ(two.census.open_ends, 2u);
}

TEST(Units, Texts) {
  const auto text = [](double kg, double m, double s) {
    const std::array<UnitPower, 3> powers = {{{"kg", kg}, {"m", m}, {"s", s}}};
    return unit_text(powers);
  };
  EXPECT_EQ(text(0, 2, -2), "m^2/s^2");
  EXPECT_EQ(text(1, -1, -2), "Pa");
  EXPECT_EQ(text(1, -1, -1), "kg/(m s)");
  EXPECT_EQ(text(0, 0, -1), "1/s");
  EXPECT_EQ(text(0, 0.5, 0), "m^0.5");
  EXPECT_EQ(text(0, 0, 0), "");
  std::string heading = "U[1]";
  EXPECT_EQ(cut_unit(heading), "");
  EXPECT_EQ(heading, "U[1]");
  heading = "Heat Flux [ W m^-2 ]";
  EXPECT_EQ(cut_unit(heading), "W m^-2");
  EXPECT_EQ(heading, "Heat Flux");
  heading = "Velocity (m/s) @ t=1";
  EXPECT_EQ(cut_unit(heading), "m/s");
  EXPECT_EQ(heading, "Velocity @ t=1");
  for (const auto& [whole, unit] :
       std::vector<std::pair<std::string, std::string>>{{"k (J/kg)", "J/kg"},
                                                        {"h (W/(m^2 K))", "W/(m^2 K)"},
                                                        {"T (\xC2\xB0\x43)", "\xC2\xB0\x43"},
                                                        {"w (/s)", "/s"},
                                                        {"mu (Pa-s)", "Pa-s"},
                                                        {"cp (-)", ""}}) {
    heading = whole;
    EXPECT_EQ(cut_unit(heading), unit);
    EXPECT_EQ(heading, whole.substr(0, whole.find(' ')));
  }
  for (const char* whole : {"p (cells)", "U (x)", "f(t)", "Mean (1)", "(m)", "U (magnitude)", "a (", ")"}) {
    heading = whole;
    EXPECT_EQ(cut_unit(heading), "") << whole;
    EXPECT_EQ(heading, whole);
  }
}

}  // namespace
}  // namespace splatvol::test
