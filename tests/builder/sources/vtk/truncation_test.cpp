// Files of VTK's own formats, cut off or damaged at many places: none is read as if it were whole.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <vtkCellArray.h>
#include <vtkDataSetWriter.h>
#include <vtkDoubleArray.h>
#include <vtkFloatArray.h>
#include <vtkImageData.h>
#include <vtkNew.h>
#include <vtkPointData.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <vtkRectilinearGrid.h>
#include <vtkSmartPointer.h>
#include <vtkStructuredGrid.h>
#include <vtkUnstructuredGrid.h>
#include <vtkXMLDataSetWriter.h>

#include <array>
#include <cmath>
#include <random>

#include "base/file.h"
#include "tests/builder/sources/read_input.h"
#include "tests/support/replaced.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using namespace ::testing;

constexpr int side = 4;  // points along an edge
constexpr std::array legacy_versions = {vtkDataWriter::VTK_LEGACY_READER_VERSION_4_2,
                                        vtkDataWriter::VTK_LEGACY_READER_VERSION_5_1};

void add_fields(vtkDataSet& data) {
  const vtkNew<vtkFloatArray> f;
  const vtkNew<vtkDoubleArray> u;
  f->SetName("f");
  u->SetName("U");
  u->SetNumberOfComponents(3);
  for (vtkIdType i = 0; i < data.GetNumberOfPoints(); ++i) {
    const double value = 1 + std::sin(7.0 * static_cast<double>(i));
    f->InsertNextValue(static_cast<float>(value));
    u->InsertNextTuple3(value, 2 * value, -value);
  }
  data.GetPointData()->AddArray(f);
  data.GetPointData()->AddArray(u);
}

vtkSmartPointer<vtkPoints> bent_points(vtkImageData& image) {
  auto points = vtkSmartPointer<vtkPoints>::New();
  for (vtkIdType i = 0; i < image.GetNumberOfPoints(); ++i) {
    const double* p = image.GetPoint(i);
    points->InsertNextPoint(p[0] + 0.02 * p[1] * p[2], p[1] + 0.01 * p[2], p[2]);
  }
  return points;
}

struct Sample {
  std::string extension;  // of the XML file
  vtkSmartPointer<vtkDataSet> data;
};

/// The same points in each kind of data set.
std::vector<Sample> samples() {
  auto image = vtkSmartPointer<vtkImageData>::New();
  image->SetDimensions(side, side, side);
  auto rectilinear = vtkSmartPointer<vtkRectilinearGrid>::New();
  rectilinear->SetDimensions(side, side, side);
  const vtkNew<vtkDoubleArray> coordinates;
  for (int i = 0; i < side; ++i) coordinates->InsertNextValue(0.3 * i + 0.01 * i * i);
  rectilinear->SetXCoordinates(coordinates);
  rectilinear->SetYCoordinates(coordinates);
  rectilinear->SetZCoordinates(coordinates);
  const auto points = bent_points(*image);
  auto structured = vtkSmartPointer<vtkStructuredGrid>::New();
  structured->SetDimensions(side, side, side);
  structured->SetPoints(points);
  auto unstructured = vtkSmartPointer<vtkUnstructuredGrid>::New();
  unstructured->SetPoints(points);
  for (vtkIdType cell = 0; cell < structured->GetNumberOfCells(); ++cell)
    unstructured->InsertNextCell(VTK_HEXAHEDRON, structured->GetCell(cell)->GetPointIds());
  auto vertices = vtkSmartPointer<vtkPolyData>::New();
  vertices->SetPoints(points);
  const vtkNew<vtkCellArray> cells;
  for (vtkIdType i = 0; i < points->GetNumberOfPoints(); ++i) cells->InsertNextCell(1, &i);
  vertices->SetVerts(cells);
  std::vector<Sample> all = {
      {"vti", image}, {"vtr", rectilinear}, {"vts", structured}, {"vtu", unstructured}, {"vtp", vertices}};
  for (const Sample& sample : all) add_fields(*sample.data);
  return all;
}

struct TruncationTest : FolderTest {
  /// Cuts a file at its last bytes and at random places. Expects an error, or all that the whole file holds.
  void expect_no_wrong_result(const std::string& name) {
    const std::string whole = read_text_file(path(name)).value();
    const auto expected = value_of(read_input({path(name)}));
    std::vector<std::size_t> sizes;
    for (const std::size_t missing : {1, 2, 3, 5, 9, 20, 40, 80, 160}) sizes.push_back(whole.size() - missing);
    for (int i = 0; i < 16; ++i) sizes.push_back(random_() % whole.size());
    for (const std::size_t size : sizes) {
      const std::string cut = write("cut" + name.substr(name.find('.')), whole.substr(0, size));
      const auto input = read_input({cut});
      ++cuts_;
      if (!input) {
        ++refused_;
        EXPECT_THAT(input.error().message, StartsWith(cut)) << name;
        for (const char* internal : {"0x", ".cxx", "ERROR", "vtkX", "vtkD"})
          EXPECT_EQ(input.error().message.find(internal, cut.size()), std::string::npos) << input.error().message;
        continue;
      }
      EXPECT_EQ(input->attributes, expected.attributes) << name << " of " << size;
      ASSERT_EQ(input->pieces.size(), 1u);
      EXPECT_EQ(input->pieces[0].points, expected.pieces[0].points) << name << " of " << size;
      EXPECT_EQ(input->pieces[0].values, expected.pieces[0].values) << name << " of " << size;
      EXPECT_EQ(input->pieces[0].tetrahedra, expected.pieces[0].tetrahedra) << name << " of " << size;
    }
  }

  void write_legacy(const std::string& name, vtkDataSet& data, bool binary, int version) const {
    const vtkNew<vtkDataSetWriter> writer;
    writer->SetFileName(path(name).c_str());
    writer->SetInputData(&data);
    binary ? writer->SetFileTypeToBinary() : writer->SetFileTypeToASCII();
    writer->SetFileVersion(version);
    ASSERT_TRUE(writer->Write());
  }

  std::mt19937 random_{7};
  std::size_t cuts_ = 0;
  std::size_t refused_ = 0;
};

struct Encoding {
  int mode;  // of vtkXMLWriter
  bool base64;
  int compressor;
  bool wide;
};

TEST_F(TruncationTest, XmlFiles) {
  constexpr std::array encodings = {
      Encoding{vtkXMLWriter::Ascii, false, vtkXMLWriter::NONE, true},
      Encoding{vtkXMLWriter::Binary, false, vtkXMLWriter::NONE, true},
      Encoding{vtkXMLWriter::Binary, false, vtkXMLWriter::ZLIB, false},
      Encoding{vtkXMLWriter::Appended, false, vtkXMLWriter::NONE, true},
      Encoding{vtkXMLWriter::Appended, false, vtkXMLWriter::NONE, false},
      Encoding{vtkXMLWriter::Appended, false, vtkXMLWriter::ZLIB, true},
      Encoding{vtkXMLWriter::Appended, false, vtkXMLWriter::LZ4, true},
      Encoding{vtkXMLWriter::Appended, false, vtkXMLWriter::LZMA, false},
      Encoding{vtkXMLWriter::Appended, true, vtkXMLWriter::NONE, true},
      Encoding{vtkXMLWriter::Appended, true, vtkXMLWriter::NONE, false},
      Encoding{vtkXMLWriter::Appended, true, vtkXMLWriter::ZLIB, true},
  };
  for (const Sample& sample : samples())
    for (std::size_t e = 0; e < encodings.size(); ++e) {
      const std::string name = fmt::format("whole{}.{}", e, sample.extension);
      const vtkNew<vtkXMLDataSetWriter> writer;
      writer->SetFileName(path(name).c_str());
      writer->SetInputData(sample.data);
      writer->SetDataMode(encodings[e].mode);
      writer->SetEncodeAppendedData(encodings[e].base64);
      writer->SetCompressorType(encodings[e].compressor);
      writer->SetBlockSize(512);
      encodings[e].wide ? writer->SetHeaderTypeToUInt64() : writer->SetHeaderTypeToUInt32();
      ASSERT_TRUE(writer->Write());
      expect_no_wrong_result(name);
    }
  EXPECT_GE(refused_, cuts_ * 3 / 4) << "of " << cuts_;
}

TEST_F(TruncationTest, LegacyFiles) {
  for (const Sample& sample : samples())
    for (const bool binary : {false, true})
      for (const int version : legacy_versions) {
        const std::string name = fmt::format("{}{}{}.vtk", sample.extension, binary, version);
        write_legacy(name, *sample.data, binary, version);
        expect_no_wrong_result(name);
      }
  EXPECT_GE(refused_, cuts_ * 3 / 4) << "of " << cuts_;
}

/// Sections that VTK's writer makes of active arrays, or not at all.
TEST_F(TruncationTest, LegacySections) {
  const std::string head =
      "# vtk DataFile Version 3.0\ntitle\nASCII\nDATASET STRUCTURED_POINTS\nDIMENSIONS 2 2 2\n"
      "ORIGIN 0 0 0\nSPACING 1 1 1\nFIELD about 1\nTIME 1 1 double\n0.5\nPOINT_DATA 8\n";
  const auto numbers = [](std::size_t count) {
    std::string text;
    for (std::size_t i = 0; i < count; ++i) text += fmt::format("{} ", 0.125 * static_cast<double>(i));
    return text + "\n";
  };
  const std::vector<std::string> sections = {
      "SCALARS s float 1\nLOOKUP_TABLE default\n" + numbers(8),
      "SCALARS s2 double 2\nLOOKUP_TABLE default\n" + numbers(16),
      "VECTORS v float\n" + numbers(24),
      "NORMALS n float\n" + numbers(24),
      "TENSORS t float\n" + numbers(72),
      "TEXTURE_COORDINATES c 2 float\n" + numbers(16),
      "COLOR_SCALARS rgb 3\n" + numbers(24),
      "FIELD more 2\na 1 8 float\n" + numbers(8) + "b 2 8 float\n" + numbers(16),
  };
  for (const std::string& section : sections) {
    const std::string whole = head + section;
    ASSERT_EQ(message_of(read_input({write("whole.vtk", whole)})), "") << section;
    // Without the last space, which follows the last number, the line end does; without both it may be cut.
    for (std::size_t size = head.size() + 1; size + 2 < whole.size(); ++size)
      EXPECT_NE(error_of({write("cut.vtk", whole.substr(0, size))}), "(no error)") << whole.substr(0, size);
    EXPECT_THAT(error_of({write("cut.vtk", whole.substr(0, whole.size() - 2))}), HasSubstr("add a line end"));
    EXPECT_EQ(error_of({write("cut.vtk", whole.substr(0, whole.size() - 1))}), "(no error)");
  }
}

// Damage: a byte of a small file is another. VTK's reader must not see what would end the program.

TEST_F(TruncationTest, DamagedLegacyFilesAreSurvived) {
  for (const Sample& sample : samples())
    for (const bool binary : {false, true})
      for (const int version : legacy_versions) {
        write_legacy("whole.vtk", *sample.data, binary, version);
        const std::string whole = read_text_file(path("whole.vtk")).value();
        for (int i = 0; i < 24; ++i) {
          std::string damaged = whole;
          damaged[random_() % whole.size()] ^= static_cast<char>(1 << random_() % 8);
          const std::string error = error_of({write("damaged.vtk", damaged)});
          EXPECT_THAT(error, AnyOf(StartsWith(path("damaged.vtk") + ": "), "(no error)"));
        }
      }
}

TEST_F(TruncationTest, LegacyCellsMustFitTogether) {
  const std::string head = "# vtk DataFile Version 3.0\ntitle\nASCII\nDATASET UNSTRUCTURED_GRID\n";
  const std::string points = "POINTS 6 float\n1 0 0\n-1 0 0\n0 1 0\n0 -1 0\n0 0 1\n0 0 -1\n";
  const std::string data = "POINT_DATA 6\nSCALARS s float 1\nLOOKUP_TABLE default\n0 1 2 3 4 5\n";
  // An octahedron has more faces than points.
  const std::string octahedron =
      "CELLS 1 34\n33 8 3 0 2 4 3 2 1 4 3 1 3 4 3 3 0 4 3 2 0 5 3 1 2 5 3 3 1 5 3 0 3 5\nCELL_TYPES 1\n42\n";
  const std::string tetrahedron = "CELLS 1 5\n4 0 2 4 1\nCELL_TYPES 1\n10\n";
  const auto error_with = [&](const std::string& from, const std::string& to) {
    return error_of({write("a.vtk", replaced(head + points + tetrahedron + data, from, to))});
  };
  EXPECT_EQ(error_with("title", "any"), "(no error)");
  EXPECT_EQ(error_of({write("a.vtk", head + points + octahedron + data)}), "(no error)");
  EXPECT_THAT(error_with("4 0 2 4 1", "4 0 2 4 6"), HasSubstr("a cell that names a point which is not there"));
  EXPECT_THAT(error_with("4 0 2 4 1", "5 0 2 4 1"), HasSubstr("cells that are longer than the section"));
  EXPECT_THAT(error_with("4 0 2 4 1", "3 0 2 4 1"), HasSubstr("cells that are shorter than the section"));
  EXPECT_THAT(error_with("CELLS 1 5", "CELLS -1 5"), HasSubstr("a negative count"));
  EXPECT_THAT(error_with("CELL_TYPES 1", "CELL_TYPES 2"), HasSubstr("2 types for 1 cells"));
  EXPECT_THAT(error_with("\n10\n", "\n42\n"), HasSubstr("a polyhedron whose faces are damaged"));
  EXPECT_THAT(error_with("\n10\n", "\n300\n"), HasSubstr("a cell of type 300"));
  EXPECT_THAT(error_with("CELL_TYPES", "CELL_TIPS"), HasSubstr("an unknown section"));
  EXPECT_THAT(error_with("0 1 2 3", "0 x 2 3"), HasSubstr("a word instead of a number"));
  EXPECT_THAT(error_with("6 float", "6 floot"), HasSubstr("numbers of an unknown type"));
}

TEST_F(TruncationTest, XmlArraysMustFitTheirPiece) {
  const auto all = samples();
  const auto error_with = [&](const Sample& sample, const std::string& from, const std::string& to) {
    const std::string name = path("a." + sample.extension);
    const vtkNew<vtkXMLDataSetWriter> writer;
    writer->SetFileName(name.c_str());
    writer->SetInputData(sample.data);
    EXPECT_TRUE(writer->Write());
    return error_of({write("a." + sample.extension, replaced(read_text_file(name).value(), from, to))});
  };
  EXPECT_EQ(error_with(all[3], "NumberOfCells=\"27\"", "NumberOfCells=\"27\""), "(no error)");
  EXPECT_THAT(error_with(all[3], "NumberOfCells=\"27\"", "NumberOfCells=\"22\""),
              HasSubstr("has 27 numbers instead of 22"));
  EXPECT_THAT(error_with(all[3], "NumberOfCells=\"27\"", "NumberOfCells=\"-7\""),
              HasSubstr("a number of points or cells that is wrong"));
  EXPECT_THAT(error_with(all[3], "NumberOfPoints=\"64\"", "NumberOfPoints=\"34\""),
              HasSubstr("has 64 numbers instead of 34"));
  EXPECT_THAT(error_with(all[3], "NumberOfComponents", "NumberOfIngredients"),
              HasSubstr("has 192 numbers instead of 64"));
  EXPECT_THAT(error_with(all[0], "WholeExtent=\"0 3", "WholeExtent=\"0 7"),
              HasSubstr("its pieces have 27 cells, and its WholeExtent 63"));
}

}  // namespace
}  // namespace splatvol::test
