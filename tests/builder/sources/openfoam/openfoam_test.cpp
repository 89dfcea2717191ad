// Our reader of OpenFOAM: every layout of its files, and what it refuses.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "builder/sources/openfoam/foam_case.h"
#include "builder/sources/openfoam/foam_dimensions.h"
#include "builder/sources/openfoam/foam_rounding.h"
#include "builder/sources/openfoam/foam_up.h"
#include "builder/sources/reader_error.h"
#include "tests/support/openfoam_files.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using namespace ::testing;

/// What is read of a case, of all its parts and regions together.
struct Read {
  std::size_t points = 0, cells = 0;
  double volume = 0;
  std::map<std::string, std::vector<double>> values;
  std::map<std::string, std::string> units;
  std::map<std::string, std::uint64_t> patches;  // faces
  std::set<std::string> left_out;                // lines
};

/// The volume of a mesh, by its faces.
double volume_of(const FoamMesh& mesh) {
  double volume = 0;
  for (std::size_t face = mesh.neighbour.size(); face < mesh.faces.size(); ++face) {
    const auto corner = [&](std::size_t i) { return mesh.points[mesh.faces.values[mesh.faces.starts[face] + i]]; };
    for (std::size_t i = 2; i < mesh.faces.starts[face + 1] - mesh.faces.starts[face]; ++i)
      volume += glm::dot(corner(0), glm::cross(corner(i - 1), corner(i))) / 6;
  }
  return volume;
}

class OpenFoam : public FolderTest {
 protected:
  void write_case(const FoamLayout& layout) const {
    for (const auto& [name, text] : openfoam_files(layout)) write(name, text);
  }

  /// Reads all of a case. Throws what the reader throws.
  [[nodiscard]] Read read_case() const {
    const FoamCase foam(path("case.foam"));
    Read read;
    const std::optional<double> time = foam.times().empty() ? std::nullopt : std::optional(foam.times().back());
    foam.check_parts(time);
    for (std::size_t part = 0; part < std::max<std::size_t>(1, foam.processor_count()); ++part)
      for (const std::string& region : foam.regions()) add(foam, part, region, time, read);
    return read;
  }

  /// The message with which a case is refused.
  [[nodiscard]] std::string refusal() const {
    try {
      static_cast<void>(read_case());
    } catch (const ReaderError& error) {
      return error.what();
    }
    return "(no error)";
  }

  /// The values of a field of one value for each of the cells.
  [[nodiscard]] std::vector<double> values_of(const std::string& body) const {
    write("0.5/p", foam_file("volScalarField", body + "boundaryField {}\n"));
    return read_case().values.at("p");
  }
  [[nodiscard]] std::string refusal_of(const std::string& body) const {
    write("0.5/p", foam_file("volScalarField", body + "boundaryField {}\n"));
    return refusal();
  }

  /// Expects that each beginning of a file is refused, with a message that names the file. `least`: so many of the last
  /// bytes do not matter.
  void expect_refused_cuts(const std::string& name, std::size_t least) const {
    const std::string whole = read(name);
    ASSERT_FALSE(whole.empty()) << name;
    for (std::size_t size = 0; size + least < whole.size(); size += 1 + size / 97) {
      write(name, whole.substr(0, size));
      EXPECT_THAT(refusal(), HasSubstr(name)) << size << " of " << whole.size();
    }
    write(name, whole);
  }

 private:
  static void add(const FoamCase& foam, std::size_t part, const std::string& region, std::optional<double> time,
                  Read& read) {
    const auto find = [&](const char* name) { return foam.mesh_file(part, region, time, name); };
    const std::vector<FoamPatch> patches = read_foam_patches(find("boundary"));
    const FoamMesh mesh = read_foam_mesh(find);
    check_foam_patches(mesh, patches, "boundary");
    EXPECT_EQ(faces_of_cells(mesh).size(), mesh.cell_count);
    read.points += mesh.points.size();
    read.cells += mesh.cell_count;
    read.volume += volume_of(mesh);
    for (const FoamPatch& patch : patches)
      if (!patch.is_between_processors()) read.patches[patch.name] += patch.face_count;
    const auto all = [](const std::string&) { return true; };
    read.left_out.merge(foam.left_out(part, time, all));
    for (const FoamFieldFile& file : foam.fields(part, region, time, all, &read.left_out)) {
      const std::uint64_t count = file.kind.of_cells ? mesh.cell_count : mesh.points.size();
      const FoamField field = read_foam_field(file.place, file.kind, count);
      std::vector<double>& values = read.values[file.name];
      values.insert(values.end(), field.values.begin(), field.values.end());
      read.units[file.name] = field.unit;
    }
  }
};

class OpenFoamLayouts : public OpenFoam, public ::testing::WithParamInterface<FoamLayout> {};

TEST_P(OpenFoamLayouts, AreReadAlike) {
  const FoamLayout& layout = GetParam();
  write_case(layout);
  const Read read = read_case();
  EXPECT_EQ(read.cells, foam_cells);
  EXPECT_NEAR(read.volume, foam_cells, 1e-12);
  EXPECT_EQ(read.patches.at("left"), 1u);
  EXPECT_EQ(read.patches.at("right"), 1u);
  EXPECT_EQ(read.patches.at("sides"), 4 * foam_cells);
  const auto stored = [&](double value) { return layout.scalar_bytes == 4 ? static_cast<float>(value) : value; };
  ASSERT_EQ(read.values.at("p").size(), foam_cells);
  ASSERT_EQ(read.values.at("U").size(), 3 * foam_cells);
  ASSERT_EQ(read.values.at("S").size(), 6 * foam_cells);
  constexpr std::array<std::size_t, 6> order = {0, 3, 5, 1, 4, 2};  // VTK's
  for (std::size_t i = 0; i < foam_cells; ++i) {
    EXPECT_EQ(read.values.at("p")[i], stored(foam_value(i)));
    EXPECT_EQ(read.values.at("U")[3 * i + 1], stored(foam_value(i)));
    for (std::size_t c = 0; c < 6; ++c) EXPECT_EQ(read.values.at("S")[6 * i + c], stored(foam_value(6 * i + order[c])));
  }
  EXPECT_EQ(read.values.at("h").size(), read.points);
  EXPECT_EQ(read.units.at("p"), "Pa");
  EXPECT_EQ(read.units.at("U"), "m/s");
  EXPECT_EQ(read.units.at("S"), "");
}

INSTANTIATE_TEST_SUITE_P(
    All, OpenFoamLayouts,
    ::testing::Values(FoamLayout{}, FoamLayout{.binary = true}, FoamLayout{.binary = true, .label_bytes = 8},
                      FoamLayout{.binary = true, .scalar_bytes = 4}, FoamLayout{.binary = true, .big_endian = true},
                      FoamLayout{.packed = true}, FoamLayout{.binary = true, .packed = true},
                      FoamLayout{.processors = 3}, FoamLayout{.binary = true, .processors = 2, .region = "fluid"},
                      FoamLayout{.processors = 3, .collated = {3}},
                      FoamLayout{.binary = true, .processors = 3, .collated = {2, 1}},
                      FoamLayout{.binary = true, .packed = true, .processors = 3, .collated = {3}}));

// splitMeshRegions leaves the mesh that it splits where it was.
TEST_F(OpenFoam, AMeshThatWasSplitIntoRegionsIsLeftOut) {
  write_case({});
  write_case({.region = "fluid"});
  EXPECT_EQ(read_case().cells, 2 * foam_cells);
  write("constant/regionProperties", foam_file("dictionary", "regions (fluid (fluid));\n"));
  EXPECT_EQ(FoamCase(path("case.foam")).regions(), std::vector<std::string>{"fluid"});
  EXPECT_EQ(read_case().cells, foam_cells);
}

// No file may end early: neither its lists, nor its boundaryField, nor its packed bytes.
TEST_F(OpenFoam, CutFilesAreRefused) {
  for (const bool binary : {false, true}) {
    write_case({.binary = binary});
    for (const char* name : {"points", "faces", "owner", "neighbour", "boundary"})
      expect_refused_cuts(std::string("constant/polyMesh/") + name, 2);
    expect_refused_cuts("0.5/U", 2);
  }
  std::filesystem::remove_all(path("constant"));
  std::filesystem::remove_all(path("0.5"));
  write_case({.packed = true});
  expect_refused_cuts("0.5/U.gz", 0);
  expect_refused_cuts("constant/polyMesh/points.gz", 0);
}

TEST_F(OpenFoam, ChangedBytesAreReadOrRefused) {
  for (const FoamLayout& layout : {FoamLayout{}, FoamLayout{.binary = true}, FoamLayout{.packed = true}}) {
    write_case(layout);
    for (const char* name : {"constant/polyMesh/faces", "constant/polyMesh/owner", "0.5/p"}) {
      const std::string file = std::string(name) + (layout.packed ? ".gz" : ""), whole = read(file);
      for (std::size_t i = 0; i < whole.size(); i += 3)
        for (const char byte : {'\0', '9', '(', '{', '\xff'}) {
          std::string changed = whole;
          changed[i] = byte;
          write(file, changed);
          static_cast<void>(refusal());
        }
      write(file, whole);
    }
    for (const char* folder : {"constant", "0.5"}) std::filesystem::remove_all(path(folder));
  }
}

// A count that a file states is compared with its bytes before there is room for it.
TEST_F(OpenFoam, CountsThatDoNotFitAreRefused) {
  write_case({});
  const std::string mesh = "constant/polyMesh/";
  for (const auto& [name, class_name] :
       {std::pair("points", "vectorField"), {"faces", "faceList"}, {"owner", "labelList"}}) {
    const std::string whole = read(mesh + name);
    for (const char* list :
         {"4000000000(1 2 3)", "99999999999999(0 0 0)", "99999999999999999999(1)", "-1()", "3{0}", "5"}) {
      write(mesh + name, foam_file(class_name, list));
      EXPECT_THAT(refusal(), HasSubstr(mesh + name)) << list;
    }
    write(mesh + name, whole);
  }
  EXPECT_THAT(refusal_of("internalField nonuniform List<scalar> 4(1 2 3);\n"),
              AllOf(HasSubstr("0.5/p: line 2"), HasSubstr("ends after 3 of its 4 elements")));
  EXPECT_THAT(refusal_of("internalField nonuniform List<scalar> 3(1 2 3);\n"), HasSubstr("3 values, and not 4"));
  EXPECT_THAT(refusal_of("internalField nonuniform List<scalar> 4(1 2 3 4 5);\n"), HasSubstr("0.5/p: line 2"));
  EXPECT_THAT(refusal_of("internalField nonuniform List<scalar> 0();\n"), HasSubstr("0 values, and not 4"));
}

TEST_F(OpenFoam, NumbersOutOfRangeAreRefused) {
  write_case({});
  const std::string mesh = "constant/polyMesh/";
  const auto refusal_with = [&](const std::string& name, const std::string& class_name, const std::string& list) {
    const std::string whole = read(mesh + name);
    write(mesh + name, foam_file(class_name, list));
    const std::string message = refusal();
    write(mesh + name, whole);
    return message;
  };
  EXPECT_THAT(refusal_with("faces", "faceList", "1(3(0 1 99))"), HasSubstr("faces: a face names point 99 of 20"));
  EXPECT_THAT(refusal_with("faces", "faceList", "1(2(0 1))"), HasSubstr("fewer than 3 points"));
  EXPECT_THAT(refusal_with("faces", "faceCompactList", "3(0 4 3) 4(0 1 2 3)"), HasSubstr("do not fit together"));
  EXPECT_THAT(refusal_with("owner", "labelList", "21{77}"), HasSubstr("owner: a face is of cell 77"));
  EXPECT_THAT(refusal_with("owner", "labelList", "21{0}"), HasSubstr("cell 1 has 1 faces"));
  EXPECT_THAT(refusal_with("owner", "labelList", "20{0}"), HasSubstr("owner: it has 20 faces, and the mesh 21"));
  EXPECT_THAT(refusal_with("boundary", "polyBoundaryMesh", "1(a { type wall; nFaces 30; startFace 3; })"),
              HasSubstr("the patch \"a\""));
  EXPECT_THAT(refusal_with("boundary", "polyBoundaryMesh", "2(a { type wall; nFaces 3; startFace 3; })"),
              HasSubstr("1 patches, and not 2"));
}

TEST_F(OpenFoam, WritersMayWriteListsOtherwise) {
  write_case({});
  EXPECT_THAT(values_of("internalField uniform 2.5;\n"), ElementsAre(2.5, 2.5, 2.5, 2.5));
  EXPECT_THAT(values_of("internalField nonuniform 4(1 2 3 4);\n"), ElementsAre(1, 2, 3, 4));
  EXPECT_THAT(values_of("internalField nonuniform List<scalar> (1 2 3 4);\n"), ElementsAre(1, 2, 3, 4));
  EXPECT_THAT(values_of("internalField nonuniform List<scalar> 4{7};\n"), ElementsAre(7, 7, 7, 7));
  EXPECT_THAT(values_of("internalField nonuniform List<scalar> 4 ( +1 /* one */ -2e400 // two\n 1e-999 3.0E+0 );\n"),
              ElementsAre(1, -std::numeric_limits<double>::infinity(), 0, 3));
  write("0.5/I", foam_file("volSphericalTensorField::Internal",
                           "dimensions [0 0 1 0 0]; value nonuniform List<sphericalTensor> 4((1)(2)(3)(4));"));
  const Read read = read_case();
  EXPECT_THAT(read.values.at("I"), ElementsAre(1, 2, 3, 4));
  EXPECT_EQ(read.units.at("I"), "s");
}

TEST_F(OpenFoam, UnitsOfValuesAreApplied) {
  write_case({});
  EXPECT_THAT(values_of("dimensions [pressure]; internalField uniform 2 [bar];\n"), ElementsAre(2e5, 2e5, 2e5, 2e5));
  EXPECT_THAT(values_of("internalField uniform [kPa] 3;\n"), ElementsAre(3e3, 3e3, 3e3, 3e3));
  EXPECT_THAT(values_of("internalField nonuniform [mm] List<scalar> 4(1 2 3 4);\n"),
              ElementsAre(.001, .002, .003, .004));
  EXPECT_THAT(values_of("internalField nonuniform List<scalar> 4(1 2 3 4) [ m ];\n"), ElementsAre(1, 2, 3, 4));
  EXPECT_THAT(values_of("internalField uniform 1 [];\n"), ElementsAre(1, 1, 1, 1));
  EXPECT_THAT(refusal_of("internalField uniform 1 [parsec];\n"),
              HasSubstr("the unit \"[ parsec]\" of the values is not known"));
}

TEST(OpenFoamDimensions, AreNumbersNamesAndProducts) {
  const auto unit = [](std::string_view text) {
    const auto dimensions = read_dimensions(text);
    return dimensions ? unit_of(*dimensions) : "(none)";
  };
  EXPECT_EQ(unit("1 -1 -2 0 0 0 0"), "Pa");
  EXPECT_EQ(unit(" 0 2 -2 0 0 "), "m^2/s^2");
  EXPECT_EQ(unit(""), "");
  EXPECT_EQ(unit("pressure"), "Pa");
  EXPECT_EQ(unit("kg m^-1 s^-2"), "Pa");
  EXPECT_EQ(unit("kg/(m s^2)"), "Pa");
  EXPECT_EQ(unit("kg/m/s^2"), "Pa");
  EXPECT_EQ(unit("length*velocity"), "m^2/s");
  EXPECT_EQ(unit("volume^-1"), "1/m^3");
  EXPECT_EQ(unit("W/m^2/K"), "kg/(s^3 K)");
  EXPECT_EQ(unit("J/K"), "J/K");
  EXPECT_EQ(unit("(Pa/density)^0.5"), "m/s");
  for (const char* bad : {"1 2", "nonsense", "kg/", "(kg", "kg)", "^2", "kg^", "1 2 3 4 5 6 x"})
    EXPECT_TRUE(!read_dimensions(bad) || read_dimensions(bad)->factor != 1) << bad;
  EXPECT_EQ(read_dimensions("rpm")->factor, read_dimensions("rot/min")->factor);
  EXPECT_NEAR(read_dimensions("psi")->factor, 6894.757, 1e-3);
  EXPECT_FALSE(read_dimensions(std::string(100000, '(')));
}

// Every name that the tutorials of OpenFOAM 14 have.
TEST(OpenFoamDimensions, OfTheTutorialsAreKnown) {
  for (const char* name : {"velocity",
                           "pressure",
                           "temperature",
                           "turbulentViscosity",
                           "turbulentKineticEnergy",
                           "acceleration",
                           "turbulentEpsilon",
                           "dynamicDiffusivity",
                           "kinematicPressure",
                           "turbulentOmega",
                           "length",
                           "heatFluxDensity",
                           "kineticEnergyDensity",
                           "kinematicStress",
                           "density",
                           "momentumDensity",
                           "kinematicViscosity",
                           "moles",
                           "rate",
                           "electricPotential",
                           "magneticFluxPressure",
                           "magneticFluxDensity",
                           "chargeDensity",
                           "ReynoldsStress"})
    EXPECT_NE(unit_of(read_dimensions(name).value()), "") << name;
}

TEST_F(OpenFoam, MacrosStandForWhatIsKnown) {
  write_case({});
  EXPECT_THAT(values_of("a 3; internalField uniform $a;\n"), ElementsAre(3, 3, 3, 3));
  EXPECT_THAT(values_of("a 3; b $a; a 4; internalField uniform ${b};\n"), ElementsAre(3, 3, 3, 3));
  EXPECT_THAT(values_of("in { p 5; q { r 6; } } internalField uniform $:in.q.r;\n"), ElementsAre(6, 6, 6, 6));
  EXPECT_THAT(values_of("in { p 5; } internalField uniform $!in/p;\n"), ElementsAre(5, 5, 5, 5));
  EXPECT_THAT(values_of("in { p 5; } $in; all uniform $p; internalField $all;\n"), ElementsAre(5, 5, 5, 5));
  EXPECT_THAT(values_of("internalField { p 8; } internalField uniform $internalField.p;\n"), ElementsAre(8, 8, 8, 8));
  EXPECT_THAT(values_of("#includeEtc \"caseDicts/any\"\n#inputMode merge\ninternalField uniform 1;\n#remove (a b)\n"),
              ElementsAre(1, 1, 1, 1));
  EXPECT_THAT(refusal_of("\n\ninternalField uniform $a;\n"),
              AllOf(HasSubstr("0.5/p: line 4: nothing is known of $a"), HasSubstr("foamDictionary -expand")));
  EXPECT_THAT(refusal_of("internalField uniform #calc \"1 + 1\";\n"), HasSubstr("#calc is computed by OpenFOAM"));
  EXPECT_THAT(refusal_of("#if 1\ninternalField uniform 1;\n#endif\n"), HasSubstr("#if may change what follows"));
  EXPECT_THAT(refusal_of("internalField uniform 1; internalField uniform 2;\n"),
              HasSubstr("internalField is there twice"));
  EXPECT_THAT(refusal_of("a 1;\n"), HasSubstr("0.5/p: it has no internalField"));
  // Each entry would be eight times as long as the last one.
  std::string laughs = "a0 1;\n";
  for (int i = 0; i < 40; ++i) {
    laughs += fmt::format("a{}", i + 1);
    for (int k = 0; k < 8; ++k) laughs += fmt::format(" $a{}", i);
    laughs += ";\n";
  }
  EXPECT_THAT(refusal_of(laughs + "internalField uniform $a40;\n"), HasSubstr("too many values"));
}

TEST_F(OpenFoam, IncludedFilesLieInTheCase) {
  write_case({});
  const auto include = [](const std::string& name) { return "#include \"" + name + "\"\ninternalField uniform $a;\n"; };
  write("0.5/include/settings", "#include \"more\"\n");
  write("0.5/include/more", "a 3; // more\n");
  write("constant/settings", "a 4;");
  EXPECT_THAT(values_of(include("include/settings")), ElementsAre(3, 3, 3, 3));
  EXPECT_THAT(values_of(include("$FOAM_CASE/constant/settings")), ElementsAre(4, 4, 4, 4));
  EXPECT_THAT(values_of(include("<constant>/settings")), ElementsAre(4, 4, 4, 4));
  EXPECT_THAT(values_of("#includeIfPresent \"none\"\ninternalField uniform 1;\n"), ElementsAre(1, 1, 1, 1));
  EXPECT_THAT(refusal_of(include("none")),
              HasSubstr("0.5/p: line 2: the file \"none\", which it includes, is missing"));
  EXPECT_THAT(refusal_of(include("/etc/hostname")), HasSubstr("outside of the case"));
  EXPECT_THAT(refusal_of(include("$HOME/file")), HasSubstr("named by a variable"));
  EXPECT_THAT(refusal_of(include("p")), HasSubstr("it includes \"p\", which includes it"));
  write("0.5/include/more", "#include \"settings\"\n");
  EXPECT_THAT(refusal_of(include("include/settings")), HasSubstr("which includes it"));
  for (int i = 0; i < 20; ++i) write(fmt::format("0.5/d{}", i), fmt::format("#include \"d{}\"\n", i + 1));
  write("0.5/d20", "a 1;");
  EXPECT_THAT(refusal_of(include("d0")), HasSubstr("more than 16 deep"));
  EXPECT_THAT(values_of(include("d10")), ElementsAre(1, 1, 1, 1));
  std::string many;
  for (int i = 0; i < 1001; ++i) many += "#include \"d20\"\n";
  EXPECT_THAT(refusal_of(many + "internalField uniform $a;\n"), HasSubstr("more than 1000 files"));
}

TEST_F(OpenFoam, MissingPartsAreNamed) {
  write_case({.processors = 3});
  const auto move = [&](const std::string& from, const std::string& to) {
    std::filesystem::rename(path(from), path(to));
  };
  move("processor2", "away");
  EXPECT_THAT(refusal(),
              HasSubstr("processor2 of the decomposed case is missing: processor1/constant/polyMesh/boundary"));
  move("away", "processor2");
  move("processor1", "away");
  EXPECT_THAT(refusal(), HasSubstr("the folder processor1 of the decomposed case is missing"));
  move("away", "processor1");
  move("processor1/0.5", "away");
  EXPECT_THAT(refusal(), HasSubstr("processor1 has no time step 0.5, which others have"));
  move("away", "processor1/0.5");
  for (const char* name : {"points", "faces", "owner", "neighbour", "boundary"}) {
    const std::string file = std::string("processor1/constant/polyMesh/") + name;
    move(file, "away");
    EXPECT_THAT(refusal(), HasSubstr(file + ": the file is missing"));
    move("away", file);
  }
  write("processor2/0.5/p", "");
  EXPECT_THAT(refusal(), HasSubstr("processor2/0.5/p: the file is empty"));
  for (const char* start : {"/*---", "Foam", "// only\n", "FoamFile { version 2.0; class vol"}) {
    write("processor2/0.5/p", start);
    EXPECT_THAT(refusal(), HasSubstr("processor2/0.5/p: the file is cut off")) << start;
  }
}

TEST_F(OpenFoam, MissingCollatedPartsAreNamed) {
  write_case({.processors = 3, .collated = {2, 1}});
  std::filesystem::rename(path("processors3_2-2"), path("away"));
  EXPECT_THAT(refusal(), HasSubstr("the folder of processor 2 of 3 is missing"));
  std::filesystem::rename(path("away"), path("processors3_2-2"));
  const std::string points = "processors3_0-1/constant/polyMesh/points", whole = read(points);
  write(points, whole.substr(0, whole.find("// Processor1")));
  EXPECT_THAT(refusal(), AllOf(HasSubstr(points), HasSubstr("processor 1 is missing")));
  expect_refused_cuts(points, 2);
}

TEST_F(OpenFoam, OtherFilesOfAStepAreLeftOut) {
  write_case({});
  for (const char* name : {"0.5/p.orig", "0.5/p~", "0.5/.p.swp", "0.5/p.bak"}) write(name, "");
  write("0.5/notes", "not a field");
  write("0.5/phi", foam_file("surfaceScalarField", "internalField uniform 1;"));
  write("0.5/uniform/time", "");
  std::vector<std::string> names;
  for (const auto& [name, values] : read_case().values) names.push_back(name);
  EXPECT_THAT(names, ElementsAre("S", "U", "h", "p"));
}

// A field that is there is read, refused or named.
TEST_F(OpenFoam, FieldsThatAreNotReadAreNamed) {
  write_case({});
  EXPECT_THAT(read_case().left_out, IsEmpty());
  const std::string field = read("0.5/p");
  write("0.5/headless", field.substr(field.find("internalField")));
  write("0.5/misspelt", foam_file("volScalarFeild", "internalField uniform 1;\n"));
  write("0.5/phi", foam_file("surfaceScalarField", "internalField uniform 1;\n"));
  write("0.5/settings", foam_file("dictionary", "a 1;\n"));
  write("0.5/solid/T", field);
  write("0.5/lagrangian/cloud/d", "");
  ASSERT_EQ(::mkfifo(path("0.5/pipe").c_str(), 0600), 0);
  std::filesystem::create_symlink(path("gone"), path("0.5/dangling"));
  std::filesystem::create_symlink(path("gone"), path("1"));
  write("0.5/U.gz", gzipped(field));
  write("linked", field);
  std::filesystem::create_symlink(path("linked"), path("0.5/q"));
  const Read read = read_case();
  EXPECT_THAT(read.left_out, UnorderedElementsAre(HasSubstr("0.5/headless: left out: it has no header"),
                                                  HasSubstr("0.5/misspelt: left out: its class \"volScalarFeild\""),
                                                  HasSubstr("0.5/U.gz: left out: there is a file U, too"),
                                                  HasSubstr("phi: left out: surfaceScalarField"),
                                                  HasSubstr("0.5/solid/T: left out: its region has no mesh"),
                                                  HasSubstr("lagrangian: left out: particles"),
                                                  HasSubstr("0.5/pipe: left out: not a regular file"),
                                                  HasSubstr("0.5/dangling: left out: a link that leads nowhere"),
                                                  HasSubstr("1: a time step, left out: a link that leads nowhere")));
  EXPECT_TRUE(read.values.contains("q"));
  std::set<std::string> left_out;
  const FoamCase foam(path("case.foam"));
  const auto only_p = [](const std::string& name) { return name == "p"; };
  EXPECT_EQ(foam.fields(0, "", 0.5, only_p, &left_out).size(), 1u);
  EXPECT_THAT(left_out, IsEmpty());
}

// What a disk leaves of a file that was not written to its end.
TEST_F(OpenFoam, FilesOfZerosAreRefused) {
  write_case({});
  std::string zeros = read("0.5/p");
  zeros.replace(0, 64, 64, '\0');
  write("0.5/p", zeros);
  EXPECT_THAT(refusal(), AllOf(HasSubstr("0.5/p: "), HasSubstr("begins with zeros")));
  std::filesystem::remove(path("0.5/p"));
  write("0.5/p.gz", gzipped(std::string(1000, '\0')));
  EXPECT_THAT(refusal(), AllOf(HasSubstr("0.5/p.gz: "), HasSubstr("begins with zeros")));
}

TEST_F(OpenFoam, ZonesAndSetsAreNamed) {
  const std::string mesh = "constant/polyMesh/";
  write_case({});
  write(mesh + "cellZones", foam_file("regIOobject",
                                      "2(rotor { type cellZone; cellLabels List<label> 1(0); }\n"
                                      "stator { type cellZone; cellLabels List<label> 1(1); })\n"));
  write(mesh + "pointZones", foam_file("regIOobject", "0()\n"));
  write(mesh + "sets/inlet.gz", gzipped(foam_file("faceSet", "1(0)")));
  EXPECT_THAT(read_case().left_out,
              ElementsAre(HasSubstr("cellZones (rotor, stator): left out"), HasSubstr("sets/inlet: left out")));
  write(mesh + "cellZones", std::string(100, '\0'));
  write(mesh + "faceZones", foam_file("regIOobject", "1(baffle { type"));
  std::filesystem::create_symlink(path("gone"), path(mesh + "sets/outlet"));
  EXPECT_THAT(
      read_case().left_out,
      UnorderedElementsAre(HasSubstr(mesh + "cellZones: the file is damaged: it begins with zeros"),
                           HasSubstr(mesh + "faceZones: the file is cut off"), HasSubstr("sets/inlet: left out"),
                           AllOf(HasSubstr("sets/outlet"), HasSubstr("left out"))));
}

// The mesh of an earlier step must not stand for one that cannot be read.
TEST_F(OpenFoam, MeshFilesThatLeadNowhereAreRefused) {
  write_case({});
  for (const char* name : {"p", "U", "S", "h"}) write(std::string("1/") + name, read(std::string("0.5/") + name));
  std::filesystem::create_directories(path("1/polyMesh"));
  std::filesystem::create_symlink(path("gone"), path("1/polyMesh/points"));
  EXPECT_THAT(refusal(), HasSubstr("1/polyMesh/points"));
  std::filesystem::remove_all(path("1/polyMesh"));
  std::filesystem::create_symlink(path("gone"), path("1/polyMesh"));
  EXPECT_THAT(refusal(), HasSubstr("1/polyMesh: a link that leads nowhere"));
}

TEST_F(OpenFoam, AByteOrderMarkMeansNothing) {
  write_case({});
  for (const char* name : {"0.5/p", "constant/polyMesh/boundary"}) write(name, "\xef\xbb\xbf" + read(name));
  EXPECT_EQ(read_case().values.at("p").size(), foam_cells);
  EXPECT_THAT(read_case().left_out, IsEmpty());
}

// A mesh that moves has new points in its steps, one that changes has all its files there.
TEST_F(OpenFoam, TheLastMeshUpToATimeIsRead) {
  write_case({});
  for (const char* time : {"1", "2"})
    for (const char* name : {"p", "U", "S"}) write(std::string(time) + "/" + name, read(std::string("0.5/") + name));
  write("1/polyMesh/points", read("constant/polyMesh/points"));
  const FoamCase foam(path("case.foam"));
  EXPECT_THAT(foam.times(), ElementsAre(0.5, 1, 2));
  EXPECT_EQ(foam.mesh_file(0, "", 0.5, "points").name, "constant/polyMesh/points");
  EXPECT_EQ(foam.mesh_file(0, "", 1, "points").name, "1/polyMesh/points");
  EXPECT_EQ(foam.mesh_file(0, "", 2, "points").name, "1/polyMesh/points");
  EXPECT_EQ(foam.mesh_file(0, "", 2, "owner").name, "constant/polyMesh/owner");
  EXPECT_THAT(foam.fields(0, "", 1, [](const std::string& name) { return name == "none"; }), IsEmpty());
}

// A triangle with a short edge, far from the origin.
FoamMesh triangle(double far, double edge) {
  FoamMesh mesh;
  mesh.points = {{far, 0, 0}, {far, edge, 0}, {far, 0, 1}};
  mesh.faces.starts = {0, 3};
  mesh.faces.values = {0, 1, 2};
  return mesh;
}

double step_of(const FoamMesh& mesh) {
  PointRounding rounding;
  rounding.include(mesh);
  return rounding.step();
}

TEST(FoamRounding, KeepsFortyBitsOfTheLargestCoordinate) {
  EXPECT_EQ(step_of(triangle(1, 1)), 0x1p-39);
  EXPECT_EQ(step_of(triangle(-1.9, 1)), 0x1p-39);
  EXPECT_EQ(step_of(triangle(2, 1)), 0x1p-38);
  EXPECT_EQ(step_of(triangle(1e-9, 0.5)), 0x1p-39) << "1 is the largest";
  EXPECT_EQ(PointRounding().step(), 0);
}

TEST(FoamRounding, NeedsAShortestEdgeOf4096Steps) {
  EXPECT_EQ(step_of(triangle(1, 4096 * 0x1p-39)), 0x1p-39);
  EXPECT_EQ(step_of(triangle(1, 4095 * 0x1p-39)), 0);
  EXPECT_EQ(step_of(triangle(1, 0)), 0x1p-39) << "an edge without length has nothing to lose";
  EXPECT_EQ(step_of(triangle(0x1p28, 1)), 0);
  // All meshes decide together, in any order.
  for (const bool first : {true, false}) {
    PointRounding rounding;
    if (first) rounding.include(triangle(1, 1e-9));
    rounding.include(triangle(1, 1));
    if (!first) rounding.include(triangle(1, 1e-9));
    EXPECT_EQ(rounding.step(), 0);
  }
}

TEST(FoamRounding, IgnoresPointsThatCannotBeUsed) {
  const double infinity = std::numeric_limits<double>::infinity(), nan = std::nan("");
  for (const double bad : {infinity, nan, 1e60}) {
    FoamMesh mesh = triangle(1, 1);
    mesh.points.push_back({bad, 0, 0});
    mesh.points.push_back({1e30, 0, 0});  // of no face
    mesh.faces = {{0, 3, 6}, {0, 1, 2, 0, 1, 3}};
    EXPECT_EQ(step_of(mesh), 0x1p-39) << bad;
    std::vector<dvec3> points = mesh.points;
    round_points(0x1p-39, points);
    EXPECT_EQ(points[4].x, 1e30);
    EXPECT_TRUE(points[3].x == bad || std::isnan(bad));
  }
}

TEST(FoamRounding, MovesACoordinateByHalfAStepAtMost) {
  std::vector<dvec3> points = {{0.1, -0.1, 0.25}, {std::nextafter(0.1, 1), std::nextafter(-0.1, 0), -1e-17}};
  round_points(0x1p-39, points);
  EXPECT_EQ(points[0], dvec3(points[1].x, points[1].y, 0.25));
  EXPECT_NEAR(points[0].x, 0.1, 0x1p-40);
  EXPECT_EQ(points[0].y, -points[0].x);
  EXPECT_EQ(points[1].z, 0);
  EXPECT_FALSE(std::signbit(points[1].z));
}

struct UsualUp : test::FolderTest {
  void SetUp() override { write("case/system/controlDict", ""); }
  [[nodiscard]] int up() const { return usual_up({path("case")}); }
};

TEST_F(UsualUp, IsThatOfGravityElseOfAFlatCaseElseZ) {
  EXPECT_EQ(up(), 2);
  write("case/constant/polyMesh/boundary", "1 ( front // type empty;\n { type wall; nFaces 4; startFace 0; } )");
  EXPECT_EQ(up(), 2);
  write("case/constant/polyMesh/boundary", "1 ( front { type empty; nFaces 4; startFace 0; } )");
  EXPECT_EQ(up(), 1);
  write("case/constant/g", "/* value (1 0 0) */ dimensions [0 1 -2 0 0 0 0]; value (0 0 -9.81);");
  EXPECT_EQ(up(), 2);
  write("case/constant/g", "value ( 0 -9.81 0 );");
  EXPECT_EQ(up(), 1);
  EXPECT_EQ(usual_up({path("case/case.foam")}), 1);
  EXPECT_EQ(usual_up({path("case/system/controlDict")}), 1);
  write("case/constant/g", "size -9.81; value ($size 0 0);");
  EXPECT_EQ(up(), 0);
  for (const char* none : {"value (0 0 0);", "value (a 0 1);", "value", "", "value (0 0 inf);", "value (0 -9.81 0)",
                           "value (0 0 -9.81 0);", "value (0 #calc \"1\" 0);"}) {
    write("case/constant/g", none);
    EXPECT_EQ(up(), 1) << none;
  }
  EXPECT_EQ(usual_up({"mesh.vtu"}), -1);
}

}  // namespace
}  // namespace splatvol::test
