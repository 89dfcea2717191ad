// Small files that have crashed VTK's readers, filled the memory, or taken minutes: each is refused in one line.
#include <gmock/gmock.h>
#include <vtk_cgns.h>

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include VTK_CGNS(cgnslib.h)

#include "base/file.h"
#include "builder/opening/open_source.h"
#include "tests/builder/sources/read_input.h"
#include "tests/builder/sources/vtk_text.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using namespace ::testing;

constexpr const char* sound = "(no error)";

/// The parts of a .vtu of one cell.
struct Vtu {
  std::string root, points = "0 0 0 1 0 0 0 1 0 0 0 1", point_count = "4", before, values = "1 2 3 4",
                    value_attributes = "format=\"ascii\"", type = "10", more_cells;
};

std::string text_of(const Vtu& file) {
  return "<VTKFile type=\"UnstructuredGrid\" version=\"0.1\" " + file.root +
         "><UnstructuredGrid><Piece NumberOfPoints=\"" + file.point_count + "\" NumberOfCells=\"1\"><PointData>" +
         file.before + "<DataArray type=\"Float32\" Name=\"f\" " + file.value_attributes + ">" + file.values +
         "</DataArray></PointData><Points><DataArray type=\"Float32\" NumberOfComponents=\"3\" format=\"ascii\">" +
         file.points +
         "</DataArray></Points><Cells><DataArray type=\"Int32\" Name=\"connectivity\" format=\"ascii\">0 1 2 "
         "3</DataArray><DataArray type=\"Int32\" Name=\"offsets\" format=\"ascii\">4</DataArray><DataArray "
         "type=\"UInt8\" Name=\"types\" format=\"ascii\">" +
         file.type + "</DataArray>" + file.more_cells + "</Cells></Piece></UnstructuredGrid></VTKFile>";
}

/// A legacy file of four points, with what follows them.
std::string legacy(const std::string& rest) {
  return legacy_file("UNSTRUCTURED_GRID\nPOINTS 4 float\n0 0 0 1 0 0 0 1 0 0 0 1\n" + rest);
}
const std::string legacy_cells = "CELLS 1 5\n4 0 1 2 3\nCELL_TYPES 1\n10\nPOINT_DATA 4\n";
const std::string legacy_values = "SCALARS g float 1\nLOOKUP_TABLE default\n1 2 3 4\n";

/// An image of 2 x 1 x 1 cells in pieces of 1 cell, with these extents along x.
std::string image(const std::vector<std::string>& extents, const std::string& attributes = "Spacing=\"1 1 1\"") {
  const std::string values = data_arrays({{"f", {1, 2, 3, 4, 5, 6, 7, 8}}});
  std::string pieces;
  for (const std::string& extent : extents)
    pieces += fmt::format("<Piece Extent=\"{} 0 1 0 1\"><PointData>{}</PointData></Piece>", extent, values);
  return vtk_file("ImageData", pieces, "WholeExtent=\"0 2 0 1 0 1\" " + attributes);
}

struct HostileFilesTest : FolderTest {
  std::string error_of(const std::string& name, const std::string& text) const {
    const std::string error = test::error_of({write(name, text)});
    if (error != sound) {
      EXPECT_THAT(error, StartsWith(path(name) + ": "));
    }
    return error;
  }
  std::string error_of(const Vtu& file) const { return error_of("a.vtu", text_of(file)); }
};

TEST_F(HostileFilesTest, SoundFilesAreRead) {
  EXPECT_EQ(error_of(Vtu{}), sound);
  EXPECT_EQ(error_of("a.vtk", legacy(legacy_cells + legacy_values)), sound);
  EXPECT_EQ(error_of("a.vti", image({"0 1", "1 2"})), sound);
}

// The last array of a file may end with METADATA, without an empty line behind it.
TEST_F(HostileFilesTest, LegacyFilesThatEndWithMetadata) {
  const auto error_with = [&](const std::string& metadata) {
    return error_of("a.vtk", legacy(legacy_cells + legacy_values + "METADATA\n" + metadata));
  };
  const std::string range = "NAME L2_NORM_RANGE LOCATION vtkDataArray\nDATA 2 1 4\n";
  for (const std::string& whole : {std::string("INFORMATION 0\n"), "INFORMATION 1\n" + range,
                                   "INFORMATION 1\n" + range + "\n", std::string("COMPONENT_NAMES\na\n")})
    EXPECT_EQ(error_with(whole), sound) << whole;
  for (const std::string& part : {std::string(), std::string("INFORMATION 0"), std::string("INFORMATION 1\n"),
                                  "INFORMATION 2\n" + range, std::string("INFORMATION 99999999999\n")})
    EXPECT_THAT(error_with(part), HasSubstr("it ends within its section METADATA")) << part;
}

TEST_F(HostileFilesTest, LegacyCellsThatAreNotThere) {
  EXPECT_NE(error_of("a.vtk", legacy("CELLS 2 0\nCELL_TYPES 1\n10\nPOINT_DATA 4\n" + legacy_values)), sound);
  EXPECT_NE(error_of("a.vtk", legacy("CELLS 2 0\n\nCELL_TYPES 2\n10 10\nPOINT_DATA 4\n" + legacy_values)), sound);
  EXPECT_NE(error_of("a.vtk", legacy("CELLS 2 1000000\nCELL_TYPES 1\n10\nPOINT_DATA 4\n" + legacy_values)), sound);
}

TEST_F(HostileFilesTest, ComponentsWithoutEnd) {
  const auto field = [&](const std::string& shape) {
    return error_of("a.vtk", legacy(legacy_cells + "FIELD more 1\nf " + shape + " float\n\n" + legacy_values));
  };
  EXPECT_THAT(field("2147483647 0"), HasSubstr("more than 65535 attributes"));
  EXPECT_THAT(field("1000000000 0"), HasSubstr("more than 65535 attributes"));
  EXPECT_THAT(field("65535 0"), HasSubstr("more than 65535 attributes")) << "with its magnitude, they are one too many";
  EXPECT_THAT(error_of("a.vtk", legacy(legacy_cells + "FIELD more 2147483647\n")), HasSubstr("more than 65535"));
  for (const char* count : {"2147483648", "2147483647", "65536", "-1"}) {
    Vtu empty;
    empty.before = "<DataArray type=\"Float32\" Name=\"g\" format=\"ascii\" NumberOfComponents=\"" +
                   std::string(count) + "\"></DataArray>";
    EXPECT_THAT(error_of(empty), HasSubstr("components that is not 1 to 65535")) << count;
    empty.point_count = "0";
    empty.points = empty.values = "";
    EXPECT_THAT(error_of(empty), HasSubstr("no points")) << count;
  }
}

TEST_F(HostileFilesTest, MoreArraysThanAFileCanHold) {
  std::string fields = "FIELD more 65536\n", arrays;
  for (int i = 0; i < 65536; ++i) {
    fields += "a" + std::to_string(i) + " 1 0 float\n\n";
    arrays += "<DataArray type=\"Float32\" Name=\"a" + std::to_string(i) + "\" format=\"ascii\">1 2 3 4</DataArray>";
  }
  EXPECT_THAT(error_of("a.vtk", legacy(legacy_cells + fields)), HasSubstr("more than 65535 attributes"));
  Vtu many;
  many.before = arrays;
  EXPECT_THAT(error_of(many), HasSubstr("more than 16384 arrays")) << "VTK's reader would take minutes";
  std::string table = "x,y,z", line = "0,0,0";
  for (int i = 0; i < 65536; ++i) {
    table += ",a" + std::to_string(i);
    line += ",1";
  }
  EXPECT_THAT(error_of("a.csv", table + "\n" + line + "\n"), HasSubstr("more than 65535 attributes"));
}

TEST_F(HostileFilesTest, FacesThatContradictThemselves) {
  const auto faces = [&](const std::string& stream, const std::string& offset) {
    Vtu file;
    file.type = "42";
    file.more_cells = "<DataArray type=\"Int32\" Name=\"faces\" format=\"ascii\">" + stream +
                      "</DataArray><DataArray type=\"Int32\" Name=\"faceoffsets\" format=\"ascii\">" + offset +
                      "</DataArray>";
    return error_of(file);
  };
  const std::string good = " 3 0 2 1 3 0 1 3 3 1 2 3 3 0 3 2";
  EXPECT_EQ(faces("4" + good, "17"), sound);
  EXPECT_NE(faces("1000000" + good, "17"), sound);
  EXPECT_NE(faces("-4" + good, "17"), sound);
  EXPECT_NE(faces("4 3000000 0 2 1 3 0 1 3 3 1 2 3 3 0 3 2", "17"), sound);
  EXPECT_NE(faces("4 -3 0 2 1 3 0 1 3 3 1 2 3 3 0 3 2", "17"), sound);
  EXPECT_NE(faces("4 3 0 2 99 3 0 1 3 3 1 2 3 3 0 3 2", "17"), sound);
  EXPECT_NE(faces("4" + good, "100000000"), sound);
  EXPECT_NE(faces("4" + good, "-17"), sound);
  EXPECT_NE(faces("4 3 0 2 1 3 0 1", "8"), sound);
}

/// A block of compressed values that claims to be 2 GB long, in base64.
constexpr const char* too_long = "/////////38AAAAAAQAAAA==eA==";

TEST_F(HostileFilesTest, CompressedBlocksAreCheckedWhereverTheTagEnds) {
  Vtu file;
  file.root = "compressor=\"vtkZLibDataCompressor\" byte_order=\"LittleEndian\" header_type=\"UInt32\"";
  file.values = too_long;
  for (const char* attributes :
       {"format=\"binary\"", "format=\"binary\" offset=\"0\"", "offset=\"0\" format=\"binary\"",
        "format=\"binary\" title=\"a>b\"", "title='>' format=\"binary\""}) {
    file.value_attributes = attributes;
    EXPECT_NE(error_of(file), sound) << attributes;
  }
  file.value_attributes = "format=\"binary\" title=\"" + std::string(5000, 'a') + "\"";
  EXPECT_NE(error_of(file), sound);
  file.value_attributes = "format=\"ascii\" offset=\"0\"";
  EXPECT_NE(error_of(file), sound);
}

TEST_F(HostileFilesTest, PiecesOfAnImageFillIt) {
  EXPECT_THAT(error_of("a.vti", image({"0 1", "0 1"})), HasSubstr("overlap"));
  EXPECT_THAT(error_of("a.vti", image({"0 1", "2 3"})), HasSubstr("reach out of"));
  EXPECT_THAT(error_of("a.vti", image({"0 1", "1 1"})), HasSubstr("1 cells, and its WholeExtent 2"));
  EXPECT_THAT(error_of("a.vti", image({"0 1", "1 1", "1 2", "2 2"})), Not(HasSubstr("WholeExtent")));
  EXPECT_THAT(error_of("a.vti", image({"0 1"})), HasSubstr("1 cells, and its WholeExtent 2"));
  EXPECT_THAT(error_of("a.vti", image({"0 1", "-9223372036854775807 9223372036854775807"})), HasSubstr("damaged"));
}

TEST_F(HostileFilesTest, TheFrameOfAnImageIsFinite) {
  const auto with = [&](const char* attributes) { return error_of("a.vti", image({"0 1", "1 2"}, attributes)); };
  EXPECT_EQ(with("Origin=\"0 -1 2.5e3\" Spacing=\"1 1 1\" Direction=\"1 0 0 0 1 0 0 0 1\""), sound);
  EXPECT_THAT(with("Spacing=\"nan 1 1\""), HasSubstr("the Spacing of its ImageData is not 3 finite numbers"));
  EXPECT_THAT(with("Spacing=\"1 1\""), HasSubstr("not 3 finite numbers"));
  EXPECT_THAT(with("Spacing=\"1 1 x\""), HasSubstr("not 3 finite numbers"));
  EXPECT_THAT(with("Origin=\"0 inf 0\""), HasSubstr("the Origin of its ImageData"));
  EXPECT_THAT(with("Direction=\"1 0 0 0 1e999 0 0 0 1\""), HasSubstr("not 9 finite numbers"));
}

TEST_F(HostileFilesTest, NumbersThatVtkDoesNotReadAreNamed) {
  Vtu file;
  file.points = "0 0 0 1 0 0 0 1 0 0 0 nan";
  EXPECT_THAT(error_of(file), HasSubstr("VTK's reader does not take \"nan\" in the array \"Points\""));
  file = {};
  for (const char* values : {"1 2 3 -inf", "1 2 1e39 4", "1 infinity 3 4"}) {
    file.values = values;
    EXPECT_THAT(error_of(file), HasSubstr("VTK's reader does not take")) << values;
  }
  for (const char* values : {"1 2 3 nan ", "1 nan 3 4", "1 -nan -inf 4", "1 2 1e-60 4"}) {
    file.values = values;
    EXPECT_EQ(error_of(file), sound) << values;
  }
}

TEST_F(HostileFilesTest, Plot3dCountsThatOverflow) {
  const auto words = [](const std::vector<std::int32_t>& numbers) {
    return std::string(reinterpret_cast<const char*>(numbers.data()), numbers.size() * 4);
  };
  for (const std::vector<std::int32_t>& sides : {std::vector<std::int32_t>{2147483647, 2147483647, 2147483647},
                                                 {65536, 65536, 1},
                                                 {-2, -2, 2},
                                                 {1625, 1625, 1626}}) {
    const std::string grid = write("a.xyz", words(sides) + std::string(96, '\0'));
    const std::string solution = write("a.q", words(sides) + std::string(176, '\0'));
    EXPECT_NE(test::error_of({grid, solution}), sound) << sides[0];
  }
}

/// A tetrahedron in a file of CGNS's older kind.
void write_adf(const std::string& path) {
  int file = 0, base = 0, zone = 0, solution = 0, ignored = 0;
  cg_set_file_type(CG_FILE_ADF);
  ASSERT_EQ(cg_open(path.c_str(), CG_MODE_WRITE, &file), 0) << cg_get_error();
  cg_base_write(file, "Base", 3, 3, &base);
  const std::array<cgsize_t, 3> size = {4, 1, 0};
  cg_zone_write(file, base, "Zone", size.data(), CGNS_ENUMV(Unstructured), &zone);
  const std::array<std::array<double, 4>, 3> points = {{{0, 1, 0, 0}, {0, 0, 1, 0}, {0, 0, 0, 1}}};
  constexpr std::array<const char*, 3> axes = {"CoordinateX", "CoordinateY", "CoordinateZ"};
  for (std::size_t axis = 0; axis < 3; ++axis)
    cg_coord_write(file, base, zone, CGNS_ENUMV(RealDouble), axes[axis], points[axis].data(), &ignored);
  const std::array<cgsize_t, 4> corners = {1, 2, 3, 4};
  cg_section_write(file, base, zone, "Cells", CGNS_ENUMV(TETRA_4), 1, 1, 0, corners.data(), &ignored);
  cg_sol_write(file, base, zone, "Solution", CGNS_ENUMV(Vertex), &solution);
  const std::array<double, 4> values = {293, 294, 295, 296};
  cg_field_write(file, base, zone, solution, CGNS_ENUMV(RealDouble), "f", values.data(), &ignored);
  ASSERT_EQ(cg_close(file), 0) << cg_get_error();
  cg_set_file_type(CG_FILE_HDF5);
}

TEST_F(HostileFilesTest, CutOffAdfFilesAreRefusedOrWhole) {
  write_adf(path("whole.cgns"));
  const std::string whole = read_text_file(path("whole.cgns")).value();
  ASSERT_THAT(whole.substr(0, 32), HasSubstr("ADF Database"));
  const auto expected = value_of(read_input({path("whole.cgns")}));
  std::size_t refused = 0;
  for (std::size_t size = 40; size < whole.size(); size += 201) {
    const std::string cut = write("cut.cgns", whole.substr(0, size));
    const auto input = read_input({cut});
    if (!input) {
      ++refused;
      EXPECT_THAT(input.error().message, StartsWith(cut)) << size;
      continue;
    }
    EXPECT_EQ(input->pieces[0].points, expected.pieces[0].points) << size;
    EXPECT_EQ(input->pieces[0].values, expected.pieces[0].values) << size;
  }
  EXPECT_GT(refused, 25u);
}

/// The older numbers of ADF, as hexadecimal digits.
TEST_F(HostileFilesTest, AdfFilesWithTextNumbersStateTheirEndToo) {
  std::string header = "@(#)ADF Database Version A02011>";
  header.resize(256, ' ');
  header.replace(146, 12, "000000010987");
  EXPECT_THAT(error_of("a.cgns", header), HasSubstr("its header states 6536 bytes, and there are 256"));
  header.replace(146, 12, "0000000Z0987");
  EXPECT_THAT(error_of("a.cgns", header), HasSubstr("damaged"));
  EXPECT_THAT(error_of("a.cgns", header.substr(0, 100)), HasSubstr("damaged"));
}

}  // namespace
}  // namespace splatvol::test
