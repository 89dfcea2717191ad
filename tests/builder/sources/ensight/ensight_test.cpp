// Files of EnSight Gold, text and binary, cut off at many places: none is read as if it were whole.
#include <fmt/format.h>
#include <gmock/gmock.h>

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numeric>
#include <string>
#include <utility>
#include <vector>

#include "base/file.h"
#include "builder/opening/open_source.h"
#include "tests/builder/sources/read_input.h"
#include "tests/support/replaced.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using namespace ::testing;

enum class Encoding { text, binary, big_endian, fortran };

/// Writes lines and numbers as EnSight Gold has them.
class EnsightText {
 public:
  explicit EnsightText(Encoding encoding) : encoding_(encoding) {}

  /// Begins a geometry.
  void kind() {
    if (encoding_ != Encoding::text) line(encoding_ == Encoding::fortran ? "Fortran Binary" : "C Binary");
  }

  void line(std::string text) {
    if (encoding_ != Encoding::text) text.resize(80, ' ');
    record(encoding_ == Encoding::text ? text + "\n" : text);
  }

  /// `in_line`: numbers of a line of text.
  void ints(const std::vector<std::uint32_t>& numbers, std::size_t in_line = 1) {
    std::string body;
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      if (encoding_ == Encoding::text) {
        body += fmt::format("{:10}{}", numbers[i], (i + 1) % in_line == 0 ? "\n" : "");
      } else {
        append(numbers[i], body);
      }
    }
    record(body);
  }

  void floats(std::size_t count, const std::function<double(std::size_t)>& value) {
    std::string body;
    for (std::size_t i = 0; i < count; ++i)
      if (encoding_ == Encoding::text)
        body += fmt::format("{:12.5e}\n", value(i));
      else
        append(std::bit_cast<std::uint32_t>(static_cast<float>(value(i))), body);
    record(body);
  }

  std::string bytes;

 private:
  void append(std::uint32_t number, std::string& to) const {
    for (int i = 0; i < 4; ++i)
      to += static_cast<char>(number >> (encoding_ == Encoding::big_endian ? 24 - 8 * i : 8 * i));
  }

  void record(const std::string& body) {
    const bool marked = encoding_ == Encoding::fortran;
    if (marked) append(static_cast<std::uint32_t>(body.size()), bytes);
    bytes += body;
    if (marked) append(static_cast<std::uint32_t>(body.size()), bytes);
  }

  Encoding encoding_;
};

constexpr std::array<std::array<double, 3>, 8> corners = {
    {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}, {0, 0, 1}, {1, 0, 1}, {1, 1, 1}, {0, 1, 1}}};

/// A part of a hexahedron, a part of four tetrahedra and a polyhedron, and a block.
void put_geometry(EnsightText& file, std::uint32_t moved, bool ids) {
  file.line("three parts");
  file.line("moved");
  file.line(ids ? "node id given" : "node id assign");
  file.line(ids ? "element id given" : "element id off");
  const auto points = [&](std::uint32_t part) {
    file.line("part");
    file.ints({part});
    file.line("a part");
    file.line("coordinates");
    file.ints({8});
    if (ids) file.ints({1, 2, 3, 4, 5, 6, 7, 8});
    for (std::size_t axis = 0; axis < 3; ++axis)
      file.floats(8, [&](std::size_t i) { return corners[i][axis] + (axis == 0 ? 2 * part + 0.1 * moved : 0); });
  };
  points(1);
  file.line("hexa8");
  file.ints({1});
  if (ids) file.ints({7});
  file.ints({1, 2, 3, 4, 5, 6, 7, 8}, 8);
  points(2);
  file.line("tetra4");
  file.ints({4});
  if (ids) file.ints({8, 9, 11, 12});
  file.ints({1, 2, 3, 6, 1, 3, 4, 8, 1, 6, 5, 8, 3, 6, 7, 8}, 4);
  file.line("nfaced");
  file.ints({1});
  if (ids) file.ints({10});
  file.ints({4});
  file.ints({3, 3, 3, 3});
  file.ints({1, 3, 6, 1, 6, 8, 1, 8, 3, 3, 8, 6}, 3);
  file.line("part");
  file.ints({3});
  file.line("a block");
  file.line("block");
  file.ints({2, 2, 3}, 3);
  for (std::size_t axis = 0; axis < 3; ++axis)
    file.floats(12, [&](std::size_t i) {
      const std::array<double, 3> p = {static_cast<double>(i % 2), static_cast<double>(i / 2 % 2),
                                       static_cast<double>(i / 4)};
      return p[axis] + (axis == 0 ? 8 + 0.1 * moved : 0);
    });
}

struct Variable {
  const char* name;
  std::size_t components;
  bool per_element;
};
constexpr std::array variables = {Variable{"f", 1, false}, Variable{"U", 3, false}, Variable{"q", 1, true},
                                  Variable{"W", 3, true}};

void put_variable(EnsightText& file, const Variable& variable, std::uint32_t step) {
  const auto values = [&](const char* header, std::size_t count) {
    file.line(header);
    for (std::size_t c = 0; c < variable.components; ++c)
      file.floats(count, [&](std::size_t i) { return 1 + std::sin(static_cast<double>(7 * i + c)) + step; });
  };
  const auto part = [&](std::uint32_t number) {
    file.line("part");
    file.ints({number});
  };
  file.line(variable.name);
  part(1);
  variable.per_element ? values("hexa8", 1) : values("coordinates", 8);
  part(2);
  if (variable.per_element) {
    values("tetra4", 4);
    values("nfaced", 1);
  } else {
    values("coordinates", 8);
  }
  part(3);
  values("block", variable.per_element ? 2 : 12);
}

/// Values that can be compared, with a number for missing ones.
std::vector<std::vector<double>> with_marks(std::vector<std::vector<double>> values) {
  for (auto& attribute : values)
    for (double& value : attribute)
      if (std::isnan(value)) value = -1e9;
  return values;
}

struct EnsightTest : FolderTest {
  /// Cuts each file in turn. Expects an error, or all that the whole files hold.
  void expect_no_wrong_result(const std::string& name, const std::vector<std::string>& files) {
    const auto expected = value_of(read_input({path(name)}));
    ASSERT_EQ(expected.pieces.size(), 3u);
    for (const std::string& file : files) {
      const std::string whole = read_text_file(path(file)).value();
      for (const std::size_t part : {1, 2, 3, 5, 9, 20, 33, 47, 80, 121, 160, 243, 400, 700, 1000}) {
        if (part >= whole.size()) continue;
        write(file, whole.substr(0, whole.size() - part));
        expect_error_or(expected, name, fmt::format("{} without {} of {} bytes", file, part, whole.size()));
      }
      write(file, whole);
    }
  }

  /// Writes a case of one geometry. `lines`: what follows VARIABLE.
  void write_case_of(const std::string& lines, const std::string& type = "ensight gold") const {
    write("a.case", "FORMAT\ntype: " + type + "\nGEOMETRY\nmodel: geo\nVARIABLE\n" + lines);
  }
  void write_case_of_6(const std::string& lines) const { write_case_of(lines, "ensight"); }

  void expect_error_or(const Input& expected, const std::string& name, const std::string& what) {
    const auto input = read_input({path(name)});
    if (!input) {
      EXPECT_THAT(input.error().message, AnyOf(HasSubstr("cut off"), HasSubstr("which the geometry lacks"))) << what;
      return;
    }
    ++passed_;
    ASSERT_EQ(input->pieces.size(), expected.pieces.size()) << what;
    for (std::size_t i = 0; i < expected.pieces.size(); ++i) {
      EXPECT_EQ(input->pieces[i].points, expected.pieces[i].points) << what;
      EXPECT_EQ(with_marks(input->pieces[i].values), with_marks(expected.pieces[i].values)) << what;
      EXPECT_EQ(input->pieces[i].tetrahedra, expected.pieces[i].tetrahedra) << what;
    }
  }

  void write_case(const std::string& name, const std::string& sets, const std::string& numbers,
                  const std::string& file_sets) {
    std::string text = "FORMAT\ntype: ensight gold\nGEOMETRY\nmodel: " + sets + " geo" + numbers + "\nVARIABLE\n";
    for (const Variable& v : variables)
      text += fmt::format("{} per {}: {} {} {}{}\n", v.components == 1 ? "scalar" : "vector",
                          v.per_element ? "element" : "node", sets, v.name, v.name, numbers);
    write(name, text + "TIME\ntime set: 1\nnumber of steps: 2\nfilename start number: 0\nfilename increment: 5\n" +
                    "time values: 0.5\n2.0\n" + file_sets);
  }

  std::size_t passed_ = 0;
};

constexpr std::array encodings = {Encoding::text, Encoding::binary, Encoding::big_endian, Encoding::fortran};

TEST_F(EnsightTest, CutFilesOfSteps) {
  for (const Encoding encoding : encodings) {
    SCOPED_TRACE(static_cast<int>(encoding));
    const bool ids = encoding == Encoding::binary;
    for (const std::uint32_t step : {0, 1}) {
      EnsightText geometry(encoding);
      geometry.kind();
      put_geometry(geometry, step, ids);
      write(fmt::format("geo.{:03}", 5 * step), geometry.bytes);
      for (const Variable& variable : variables) {
        EnsightText values(encoding);
        put_variable(values, variable, step);
        write(fmt::format("{}.{:03}", variable.name, 5 * step), values.bytes);
      }
    }
    write_case("a.case", "1", ".***", "");
    expect_no_wrong_result("a.case", {"geo.005", "f.005", "U.005", "q.005", "W.005"});
    // The first step does not need the files of the second.
    write("f.005", "");
    EXPECT_EQ(error_of({path("a.case")}, {{}, {}, 0.5}), "(no error)");
    EXPECT_THAT(error_of({path("a.case")}), HasSubstr("f.005: the file is cut off: it is empty"));
  }
  // Cuts of white space only.
  EXPECT_LE(passed_, 4u);
}

TEST_F(EnsightTest, WithoutValuesGivesTheNumbersOfItsParts) {
  EnsightText geometry(Encoding::binary);
  geometry.kind();
  put_geometry(geometry, 0, false);
  write("geo", geometry.bytes);
  write("a.case", "FORMAT\ntype: ensight gold\nGEOMETRY\nmodel: geo\n");
  const auto input = value_of(read_input({path("a.case")}));
  EXPECT_THAT(input.attributes, ElementsAre("part"));
  ASSERT_EQ(input.pieces.size(), 3u);
  for (std::size_t part = 0; part < 3; ++part)
    EXPECT_THAT(input.pieces[part].values.at(0), Each(static_cast<double>(part + 1)));
}

TEST_F(EnsightTest, CutFilesOfAllSteps) {
  for (const Encoding encoding : {Encoding::text, Encoding::binary}) {
    const auto steps = [&](const std::function<void(EnsightText&, std::uint32_t)>& put) {
      EnsightText file(encoding);
      file.kind();
      for (const std::uint32_t step : {0, 1}) {
        file.line("BEGIN TIME STEP");
        put(file, step);
        file.line("END TIME STEP");
      }
      return file.bytes;
    };
    write("geo", steps([](EnsightText& file, std::uint32_t step) { put_geometry(file, step, false); }));
    for (const Variable& variable : variables)
      write(variable.name, steps([&](EnsightText& file, std::uint32_t step) { put_variable(file, variable, step); }));
    write_case("a.case", "1 1", "", "FILE\nfile set: 1\nnumber of steps: 2\n");
    expect_no_wrong_result("a.case", {"geo", "f", "U", "q", "W"});
    const std::string whole = read_text_file(path("f")).value();
    write("f", whole.substr(0, whole.find("BEGIN TIME STEP", 200)));
    EXPECT_THAT(error_of({path("a.case")}), HasSubstr("f: the file is cut off: it holds 1 of the 2 time steps"));
  }
}

/// Two cells, and a ghost before each.
std::string ghost_geometry(Encoding encoding) {
  EnsightText file(encoding);
  file.kind();
  for (const char* line : {"two cells, and a ghost before each", "", "node id assign", "element id assign", "part"})
    file.line(line);
  file.ints({5});
  for (const char* line : {"a part", "coordinates"}) file.line(line);
  file.ints({20});
  for (std::size_t axis = 0; axis < 3; ++axis)  // four layers of cells above each other
    file.floats(20, [&](std::size_t i) { return corners[i % 4][axis] + (axis == 2 ? static_cast<double>(i / 4) : 0); });
  const auto put_cell = [&](const char* type, std::uint32_t layer) {
    std::vector<std::uint32_t> points(8);
    std::iota(points.begin(), points.end(), 4 * layer + 1);
    file.line(type);
    file.ints({1});
    file.ints(points, 8);
  };
  put_cell("g_hexa8", 0), put_cell("hexa8", 1), put_cell("g_hexa8", 3), put_cell("hexa8", 2);
  return file.bytes;
}

std::string ghost_values(Encoding encoding, std::size_t components) {
  EnsightText file(encoding);
  for (const char* line : {"values", "part"}) file.line(line);
  file.ints({5});
  for (const char* type : {"g_hexa8", "hexa8"}) {
    file.line(type);
    for (std::size_t c = 0; c < components; ++c)
      file.floats(2, [&](std::size_t i) {
        return (type[0] == 'g' ? 100. : 10. * static_cast<double>(i)) + static_cast<double>(c);
      });
  }
  return file.bytes;
}

constexpr const char* ghost_variables = "scalar per element: q q\nvector per element: W W\n";

// Ghosts are left out with the points that only they use. VTK's reader fails at their values.
TEST_F(EnsightTest, GhostElements) {
  write_case_of(ghost_variables);
  for (const Encoding encoding : encodings) {
    SCOPED_TRACE(static_cast<int>(encoding));
    write("geo", ghost_geometry(encoding));
    write("q", ghost_values(encoding, 1));
    write("W", ghost_values(encoding, 3));
    const auto input = value_of(read_input({path("a.case")}, {.cells = CellValues::own}));
    EXPECT_THAT(input.attributes, ElementsAre("q", "W", "W[0]", "W[1]", "W[2]"));
    ASSERT_EQ(input.points, 2u);
    EXPECT_EQ(input.census.hidden, 2u);
    EXPECT_THAT(input.pieces[0].values[0], ElementsAre(0, 10));
    EXPECT_THAT(input.pieces[0].values[input.index_of("W[2]")], ElementsAre(2, 12));
    const auto selected = value_of(read_input({path("a.case")}, {{"W[1]"}, {}}));
    EXPECT_EQ(selected.points, 12u);
    EXPECT_NEAR(selected.volume, 2, 1e-6);
    EXPECT_EQ(selected.census.hidden_points, 8u);
    write("q", ghost_values(encoding, 1).substr(0, ghost_values(encoding, 1).size() - 8));
    EXPECT_THAT(
        error_of({path("a.case")}),
        HasSubstr(encoding == Encoding::text ? "q: no line end follows its last line" : "q: the file is cut off"));
  }
}

TEST_F(EnsightTest, ValuesBesideGhostElements) {
  write_case_of(ghost_variables);
  const std::string head = "values\npart\n         5\ng_hexa8 undef\n-9\n1\n2\nhexa8 ";
  write("geo", ghost_geometry(Encoding::text));
  write("W", ghost_values(Encoding::text, 3));
  const auto values_with = [&](const std::string& text) {
    write("q", head + text);
    const auto input = value_of(read_input({path("a.case")}, {.cells = CellValues::own}));
    EXPECT_EQ(input.census.unwritten, text.find('*') == std::string::npos ? 0u : 1u);
    return with_marks({input.pieces[0].values[0]})[0];
  };
  EXPECT_THAT(values_with("undef\n-9\n3\n-9\n"), ElementsAre(3, -1e9));
  EXPECT_THAT(values_with("partial\n1\n         2\n4\n"), ElementsAre(-1e9, 4));
  EXPECT_THAT(values_with("\n************\n+5\n"), ElementsAre(-1e9, 5));
  write("q", head + "\n3\n4,5\n");
  EXPECT_THAT(error_of({path("a.case")}), HasSubstr("\"4,5\" stands for a number"));
}

TEST_F(EnsightTest, RectilinearBlocksOfEnsight6) {
  write("geo",
        "a\nb\nnode id assign\nelement id assign\ncoordinates\n       0\npart 1\nc\nblock rectilinear\n"
        "       2       2       2\n 0.00000e+00 1.00000e+00\n 0.00000e+00 1.00000e+00\n 0.00000e+00 1.00000e+00\n");
  write("f", "f\npart 1\nblock\n" + std::string(" 1.00000e+00 1.00000e+00 1.00000e+00 1.00000e+00\n 1.00000e+00") +
                 " 1.00000e+00 1.00000e+00 1.00000e+00\n");
  write_case_of_6("scalar per node: f f\n");
  EXPECT_THAT(error_of({path("a.case")}), HasSubstr("write the case as EnSight Gold"));
}

TEST_F(EnsightTest, ValuesOfAnotherMesh) {
  EnsightText geometry(Encoding::text), values(Encoding::text);
  put_geometry(geometry, 0, false);
  put_variable(values, variables[0], 0);
  write("geo", geometry.bytes);
  write("f", replaced(values.bytes, "         2", "         4"));
  write_case_of("scalar per node: f f\n");
  EXPECT_THAT(error_of({path("a.case")}), HasSubstr("f: values of part 4, which the geometry lacks"));
}

/// Texts in which one number of a file is another word.
struct EnsightNumbers : EnsightTest {
  /// Writes the parts of the other tests, as text.
  EnsightNumbers() {
    EnsightText geometry(Encoding::text);
    put_geometry(geometry, 0, false);
    write("geo", geometry.bytes);
    std::string text;
    for (const Variable& variable : variables) {
      EnsightText values(Encoding::text);
      put_variable(values, variable, 0);
      write(variable.name, values.bytes);
      text += fmt::format("{} per {}: {} {}\n", variable.components == 1 ? "scalar" : "vector",
                          variable.per_element ? "element" : "node", variable.name, variable.name);
    }
    write_case_of(text);
  }

  /// Replaces a line of a file. Line 0 is the first.
  void replace_line(const std::string& name, std::size_t line, const std::string& by) const {
    std::string text = read_text_file(path(name)).value();
    std::size_t at = 0;
    for (; line > 0; --line) at = text.find('\n', at) + 1;
    write(name, text.replace(at, text.find('\n', at) - at, by));
  }
};

TEST_F(EnsightNumbers, ThatAreStarsAreMissing) {
  const auto whole = value_of(read_input({path("a.case")}));
  EXPECT_EQ(whole.census.unwritten, 0u);
  // A point of the first part, one of the block, and a component of a vector.
  replace_line("f", 4 + 2, "************");
  replace_line("f", 4 + 8 + 3 + 8 + 3 + 5, " -1.#IND0e+00");
  replace_line("U", 4 + 8 + 3, "************");
  const auto input = value_of(read_input({path("a.case")}));
  EXPECT_EQ(input.census.unwritten, 3u);
  const auto missing = [&](const std::string& name, std::size_t piece) {
    const std::size_t a = input.index_of(name), b = whole.index_of(name);
    std::vector<std::size_t> points;
    for (std::size_t i = 0; i < input.pieces[piece].points.size(); ++i) {
      const double value = input.pieces[piece].values[a][i];
      if (std::isnan(value))
        points.push_back(i);
      else
        EXPECT_EQ(value, whole.pieces[piece].values[b][i]) << name << i;
    }
    return points;
  };
  EXPECT_THAT(missing("f", 0), ElementsAre(2));
  EXPECT_THAT(missing("f", 1), IsEmpty());
  EXPECT_THAT(missing("f", 2), ElementsAre(5));
  EXPECT_THAT(missing("U", 0), ElementsAre(3));
  EXPECT_THAT(missing("U[0]", 0), IsEmpty());
  EXPECT_THAT(missing("U[1]", 0), ElementsAre(3));
  EXPECT_THAT(missing("U[1]", 1), IsEmpty());
}

TEST_F(EnsightNumbers, OfElementsThatAreStarsAreMissing) {
  // The third tetrahedron and the polyhedron of the second part.
  replace_line("q", 4 + 1 + 3 + 2, "************");
  replace_line("q", 4 + 1 + 3 + 4 + 1, "************");
  const auto input = value_of(read_input({path("a.case")}, {.cells = CellValues::own}));
  EXPECT_EQ(input.census.unwritten, 2u);
  const std::vector<double>& q = input.pieces.at(1).values.at(input.index_of("q"));
  ASSERT_EQ(q.size(), 5u);
  for (std::size_t cell = 0; cell < q.size(); ++cell) EXPECT_EQ(std::isnan(q[cell]), cell == 2 || cell == 4) << cell;
  EXPECT_EQ(read_input({path("a.case")}, {{"f"}, {}})->census.unwritten, 0u) << "of what was read";
}

TEST_F(EnsightNumbers, ThatAreNoneAreRefused) {
  for (const char* word : {"1,5", " 1.5D+03", " 1.5-100", "", " 1.5 2.5", " 1.5e", "x", " 1.5e+0."}) {
    for (const auto& [file, line] : {std::pair{"f", 5}, {"U", 20}, {"q", 4}, {"geo", 9}}) {
      const std::string whole = read_text_file(path(file)).value();
      replace_line(file, static_cast<std::size_t>(line), word);
      EXPECT_THAT(error_of({path("a.case")}), HasSubstr(std::string(file) + ": ")) << word;
      write(file, whole);
    }
  }
  for (const auto& [line, by] : {std::pair{9, "************"},
                                 {8, "**********"},
                                 {35, "********** 2 3 4 5 6 7 8"},
                                 {35, "1 2 3 4 5 6 78"},
                                 {35, "1 2 3 4 5 6 7 8,5"}}) {
    const std::string whole = read_text_file(path("geo")).value();
    replace_line("geo", static_cast<std::size_t>(line), by);
    EXPECT_THAT(error_of({path("a.case")}), HasSubstr("geo: ")) << line << by;
    write("geo", whole);
  }
  EXPECT_EQ(error_of({path("a.case")}), "(no error)");
}

TEST_F(EnsightNumbers, OfTheCase) {
  const std::string steps = read_text_file(path("a.case")).value() + "TIME\ntime set: 1\nnumber of steps: 1\n";
  const auto open_ends = [&](const std::string& end) {
    write("a.case", steps + end);
    const auto input = read_input({path("a.case")});
    EXPECT_TRUE(input) << end << input.error().message;
    return input ? input->census.open_ends : 99;
  };
  EXPECT_EQ(open_ends("time values: 0.5"), 1u) << "perhaps of 0.57";
  EXPECT_EQ(open_ends("time values: 0.5\n"), 0u);
  for (const char* time : {"0,5", "0.5D+00", "0.5 1,5"}) {
    write("a.case", steps + "time values: " + time + "\n");
    EXPECT_THAT(error_of({path("a.case")}), HasSubstr("is no number"));
  }
}

/// A part of one hexahedron at x.
void put_hexahedron(EnsightText& file, std::uint32_t part, double x) {
  file.line("part");
  file.ints({part});
  file.line("a part");
  file.line("coordinates");
  file.ints({8});
  for (std::size_t axis = 0; axis < 3; ++axis)
    file.floats(8, [&](std::size_t i) { return corners[i][axis] + (axis == 0 ? x : 0); });
  file.line("hexa8");
  file.ints({1});
  file.ints({1, 2, 3, 4, 5, 6, 7, 8}, 8);
}

void put_values_of(EnsightText& file, std::uint32_t part, const char* header, std::size_t count, double first) {
  file.line("part");
  file.ints({part});
  file.line(header);
  file.floats(count, [&](std::size_t i) { return first + static_cast<double>(i); });
}

/// A geometry of one hexahedron, and a value of its points.
std::string one_hexahedron(Encoding encoding) {
  EnsightText file(encoding);
  file.kind();
  for (const char* line : {"one", "cell", "node id assign", "element id assign"}) file.line(line);
  put_hexahedron(file, 1, 0);
  return file.bytes;
}
std::string one_value(Encoding encoding, double first) {
  EnsightText file(encoding);
  file.line("T");
  put_values_of(file, 1, "coordinates", 8, first);
  return file.bytes;
}

// VTK 9.1 gives no values behind a part without points.
TEST_F(EnsightTest, PartsWithoutPoints) {
  for (const Encoding encoding : {Encoding::text, Encoding::binary}) {
    EnsightText geometry(encoding), points(encoding), cells(encoding);
    geometry.kind();
    for (const char* line : {"three parts", "", "node id assign", "element id assign"}) geometry.line(line);
    put_hexahedron(geometry, 1, 0);
    geometry.line("part");
    geometry.ints({2});
    geometry.line("empty");
    geometry.line("coordinates");
    geometry.ints({0});
    for (int axis = 0; axis < 3; ++axis) geometry.floats(0, {});
    put_hexahedron(geometry, 3, 2);
    points.line("T");
    cells.line("q");
    put_values_of(points, 1, "coordinates", 8, 0);
    put_values_of(points, 2, "coordinates", 0, 0);
    put_values_of(points, 3, "coordinates", 8, 100);
    put_values_of(cells, 1, "hexa8", 1, 5);
    put_values_of(cells, 3, "hexa8", 1, 6);
    write("geo", geometry.bytes);
    write("T", points.bytes);
    write("q", cells.bytes);
    write_case_of("scalar per node: T T\nscalar per element: q q\n");
    const Input input = value_of(read_input({path("a.case")}));
    ASSERT_EQ(input.pieces.size(), 2u);
    EXPECT_THAT(input.pieces[0].values.at(0), ElementsAre(0, 1, 2, 3, 4, 5, 6, 7));
    EXPECT_THAT(input.pieces[1].values.at(0), ElementsAre(100, 101, 102, 103, 104, 105, 106, 107));
    EXPECT_THAT(input.pieces[1].values.at(1), Each(6));
    EXPECT_THAT(input.census.losses, IsEmpty());
  }
}

// As VTK's reader has them: two components of a scalar, two vectors.
TEST_F(EnsightTest, ComplexVariables) {
  write("geo", one_hexahedron(Encoding::text));
  write("re", one_value(Encoding::text, 0));
  write("im", one_value(Encoding::text, 100));
  EnsightText vectors(Encoding::text);
  vectors.line("V");
  put_values_of(vectors, 1, "coordinates", 24, 0);
  write("V", vectors.bytes);
  write_case_of(
      "complex scalar per node: c re im UNDEFINED\n"
      "complex vector per node: v V V 0.5\n");
  const Input input = value_of(read_input({path("a.case")}));
  EXPECT_THAT(input.attributes, ElementsAre("c", "c[0]", "c[1]", "v_r", "v_r[0]", "v_r[1]", "v_r[2]", "v_i", "v_i[0]",
                                            "v_i[1]", "v_i[2]"));
  EXPECT_EQ(input.pieces.at(0).values.at(input.index_of("c[0]")).at(7), 7);
  EXPECT_EQ(input.pieces.at(0).values.at(input.index_of("c[1]")).at(7), 107);
  EXPECT_EQ(input.pieces.at(0).values.at(input.index_of("v_i[2]")).at(7), 23);
  EXPECT_THAT(input.census.losses, IsEmpty());
}

// VTK 9.1 leaves out a variable where its time set has another time.
TEST_F(EnsightTest, VariablesOfSeveralTimeSets) {
  write("geo", one_hexahedron(Encoding::text));
  for (const int step : {0, 1, 2}) write(fmt::format("a{}", step), one_value(Encoding::text, 10 * step));
  for (const int step : {0, 1}) write(fmt::format("b{}", step), one_value(Encoding::text, 1000 + 10 * step));
  const auto write_case = [&](const std::string& times) {
    write_case_of(
        "scalar per node: 1 a a*\n"
        "scalar per node: 2 b b*\nTIME\ntime set: 1\nnumber of steps: 3\nfilename start number: 0\n"
        "filename increment: 1\ntime values: 0 1 2\ntime set: 2\nnumber of steps: 2\nfilename start number: 0\n"
        "filename increment: 1\ntime values: " +
        times + "\n");
  };
  const auto first_values = [&](double time) {
    const Input input = value_of(read_input({path("a.case")}, {{}, {}, time}));
    EXPECT_THAT(input.attributes, ElementsAre("a", "b"));
    return std::pair(input.pieces.at(0).values.at(0).at(0), input.pieces.at(0).values.at(1).at(0));
  };
  write_case("0 2");
  EXPECT_THAT(first_values(0), Pair(0, 1000));
  EXPECT_THAT(first_values(1), Pair(10, 1000));
  EXPECT_THAT(first_values(2), Pair(20, 1010));
  write_case("1 2");
  EXPECT_THAT(first_values(0), Pair(0, IsNan())) << "b begins later";
  EXPECT_THAT(first_values(1), Pair(10, 1000));
  write("a.case", replaced(read("a.case"), "2 b b*", "3 b b*"));
  EXPECT_THAT(error_of({path("a.case")}), HasSubstr("a.case: the case does not tell which file has b"));
}

// VTK 9.1 looks for steps in a geometry that has none, without an end.
TEST_F(EnsightTest, FileSetsOfSomeFiles) {
  write("geo", one_hexahedron(Encoding::text));
  std::string steps;
  for (const int step : {0, 1, 2})
    steps += "BEGIN TIME STEP\n" + one_value(Encoding::text, 10 * step) + "END TIME STEP\n";
  write("T", steps);
  const std::string rest =
      "TIME\ntime set: 1\nnumber of steps: 3\ntime values: 0 1 2\nFILE\nfile set: 1\nnumber of steps: 3\n";
  write_case_of("scalar per node: 1 1 T T\n" + rest);
  for (const double time : {0., 1., 2.})
    EXPECT_EQ(value_of(read_input({path("a.case")}, {{}, {}, time})).pieces.at(0).values.at(0).at(7), 10 * time + 7);
  // EnSight 6 is for VTK's reader alone.
  write_case_of_6("scalar per node: 1 1 T T\n" + rest);
  EXPECT_THAT(error_of({path("a.case")}), HasSubstr("names no file set"));
  write("a.case", "FORMAT\ntype: ensight\nGEOMETRY\nmodel: 1 1 geo\nVARIABLE\nscalar per node: 1 1 T T\n" + rest);
  EXPECT_THAT(error_of({path("a.case")}), HasSubstr("geo: has 0 of the 3 time steps"));
}

TEST_F(EnsightTest, SectionsAndListsThatVtkDoesNotKnow) {
  write("geo", one_hexahedron(Encoding::binary));
  for (const int step : {4, 6}) write(fmt::format("T.{}", step), one_value(Encoding::binary, step));
  write("times", "0.25\n0.5\n");
  write("numbers", "4 6\n");
  const std::string head = "scalar per node: 1 T T.*\n";
  write_case_of(head +
                "MATERIAL\nmaterial set number: 1 mats\nmaterial id count: 2\nmaterial id numbers: 1 2\n"
                "material id names: a b\nmaterial id per element: mid\nTIME\ntime set: 1 Model\n"
                "number of steps: 2\nfilename numbers file: numbers\ntime values file: times\n");
  const Input input = value_of(read_input({path("a.case")}, {{}, {}, 0.3}));
  ASSERT_TRUE(input.step.has_value());
  EXPECT_EQ(input.step->time, 0.25);
  EXPECT_THAT(input.pieces.at(0).values.at(0), ElementsAre(4, 5, 6, 7, 8, 9, 10, 11));
  EXPECT_THAT(input.census.losses, ElementsAre(HasSubstr("a.case: the materials of cells are left out")));
  write_case_of(head + "SURPRISE\n");
  EXPECT_THAT(error_of({path("a.case")}), HasSubstr("the line \"SURPRISE\" is of no kind"));
}

TEST_F(EnsightTest, BlocksOfMorePointsThanValuesAreRefused) {
  for (const Encoding encoding : {Encoding::text, Encoding::binary}) {
    EnsightText geometry(encoding), values(encoding);
    geometry.kind();
    for (const char* line : {"a", "b", "node id assign", "element id assign", "part"}) geometry.line(line);
    geometry.ints({1});
    for (const char* line : {"a part", "block uniform"}) geometry.line(line);
    geometry.ints({1048575, 1048575, 1048575}, 3);
    for (const double first : {0.0, 1.0}) geometry.floats(3, [&](std::size_t) { return first; });
    values.line("T");
    put_values_of(values, 1, "block", 8, 0);
    write("geo", geometry.bytes);
    write("T", values.bytes);
    write_case_of("scalar per node: T T\n");
    EXPECT_THAT(error_of({path("a.case")}), HasSubstr("T: the file is cut off, or damaged: it ends within part 1"));
  }
}

TEST_F(EnsightTest, VariablesOfOneName) {
  write("geo", one_hexahedron(Encoding::text));
  for (const char* name : {"a", "b"}) write(name, one_value(Encoding::text, 0));
  write_case_of("scalar per node: T a\nscalar per node: T b\n");
  EXPECT_THAT(error_of({path("a.case")}), HasSubstr("two arrays of its points are called \"T\""));
}

TEST_F(EnsightTest, PartsOfOneNumber) {
  for (const Encoding encoding : {Encoding::text, Encoding::binary}) {
    EnsightText values(encoding), geometry(encoding);
    values.line("T");
    for (const double first : {0.0, 10.0}) put_values_of(values, 1, "coordinates", 8, first);
    write("geo", one_hexahedron(encoding));
    write("T", values.bytes);
    write_case_of("scalar per node: T T\n");
    EXPECT_THAT(error_of({path("a.case")}), HasSubstr("T: values of part 1 twice"));
    geometry.kind();
    for (const char* line : {"two parts", "", "node id assign", "element id assign"}) geometry.line(line);
    for (const double x : {0.0, 2.0}) put_hexahedron(geometry, 1, x);
    write("geo", geometry.bytes);
    write("T", one_value(encoding, 0));
    EXPECT_THAT(error_of({path("a.case")}), HasSubstr("geo: two parts have the number 1"));
  }
}

TEST_F(EnsightTest, NamesInLatin1) {
  write("geo", one_hexahedron(Encoding::text));
  write("T", one_value(Encoding::text, 0));
  write_case_of("scalar per node: \xe9 T\n");
  for (const std::vector<std::string>& selection : {std::vector<std::string>{}, {"\u00e9"}}) {
    const Input input = value_of(read_input({path("a.case")}, {selection}));
    EXPECT_THAT(input.attributes, ElementsAre("\u00e9"));
    EXPECT_THAT(input.pieces.at(0).values.at(0), ElementsAre(0, 1, 2, 3, 4, 5, 6, 7));
  }
}

const std::string geometry_of_6 =
    "a\nb\nnode id assign\nelement id assign\ncoordinates\n       4\n 0.00000e+00 0.00000e+00 0.00000e+00\n"
    " 1.00000e+00 0.00000e+00 0.00000e+00\n 0.00000e+00 1.00000e+00 0.00000e+00\n 0.00000e+00 0.00000e+00 "
    "1.00000e+00\npart 1\nc\ntetra4\n       1\n       1       2       3       4\n";

TEST_F(EnsightTest, NumbersOfEnsight6) {
  const std::string& geometry = geometry_of_6;
  const std::string values = "f\n 1.00000e+00 2.00000e+00 3.00000e+00 4.00000e+00\n";
  write("geo", geometry);
  write("f", values);
  write_case_of_6("scalar per node: f f\n");
  const auto input = value_of(read_input({path("a.case")}));
  EXPECT_THAT(input.pieces.at(0).values.at(0), ElementsAre(1, 2, 3, 4));
  write_case_of_6("scalar per node: \xe9 f\n");
  for (const std::vector<std::string>& selection : {std::vector<std::string>{}, {"\u00e9"}}) {
    const auto in_latin = value_of(read_input({path("a.case")}, {selection}));
    EXPECT_THAT(in_latin.attributes, ElementsAre("\u00e9"));
    EXPECT_THAT(in_latin.pieces.at(0).values.at(0), ElementsAre(1, 2, 3, 4));
    EXPECT_THAT(in_latin.census.losses, IsEmpty());
  }
  write_case_of_6("scalar per node: f f\n");
  const auto error_with = [&](const std::string& file, const std::string& text, const std::string& from,
                              const std::string& to) {
    write(file, replaced(text, from, to));
    const std::string error = error_of({path("a.case")});
    write(file, text);
    return error;
  };
  EXPECT_THAT(error_with("f", values, " 3.00000e+00", "************"), HasSubstr("f: VTK's reader takes zeros"));
  EXPECT_THAT(error_with("f", values, " 3.00000e+00", " 3,00000e+00"), HasSubstr("f: VTK's reader takes zeros"));
  EXPECT_THAT(error_with("geo", geometry, " 1.00000e+00", "************"), HasSubstr("geo: VTK's reader takes zeros"));
  EXPECT_THAT(error_with("f", values, "+00\n", "+00"), HasSubstr("f: no line end follows"));
}

TEST_F(EnsightTest, PartsOfOneNumberInEnsight6) {
  const std::string cell = "tetra4\n       1\n       1       2       3       4\n";
  const std::string points = geometry_of_6.substr(0, geometry_of_6.find("part"));
  const std::string values = "part 1\ntetra4\n 1.00000e+00\n";
  write_case_of_6("scalar per element: q q\n");
  write("geo", geometry_of_6);
  write("q", "part 1\n" + values);  // a description that looks like a part
  EXPECT_THAT(value_of(read_input({path("a.case")})).pieces.at(0).values.at(0), Each(1));
  write("q", "q\n" + values + values);
  EXPECT_THAT(error_of({path("a.case")}), HasSubstr("q: two parts have the number 1"));
  write("q", "q\n" + values);
  write("geo", points + "part 1\npart 1\n" + cell);
  EXPECT_EQ(value_of(read_input({path("a.case")})).pieces.size(), 1u);
  write("geo", points + "part 1\na\n" + cell + "part 1\nb\n" + cell);
  EXPECT_THAT(error_of({path("a.case")}), HasSubstr("geo: two parts have the number 1"));
}

// VTK's reader leaves out the variable of the other time set.
TEST_F(EnsightTest, VariablesOfEnsight6ThatAreNotDeliveredAreNamed) {
  write("geo", geometry_of_6);
  for (const char* name : {"a0", "a1", "a2", "b0", "b1"})
    write(name, "f\n 1.00000e+00 2.00000e+00 3.00000e+00 4.00000e+00\n");
  const std::string numbers = "filename start number: 0\nfilename increment: 1\n";
  write_case_of_6(
      "scalar per node: 1 a a*\nscalar per node: 2 b b*\n"
      "TIME\ntime set: 1\nnumber of steps: 3\n" +
      numbers + "time values: 0 1 2\ntime set: 2\nnumber of steps: 2\n" + numbers + "time values: 0 2\n");
  EXPECT_THAT(value_of(read_input({path("a.case")}, {{}, {}, 1})).census.losses,
              ElementsAre("the reader did not deliver b of " + path("a.case")));
  auto source = value_of(open_source({path("a.case")}, {{}, {}, 1}));
  while (value_of(source->next())) {
  }
  EXPECT_THAT(source->conversions(), IsEmpty()) << "no part lacks it";
  EXPECT_THAT(value_of(read_input({path("a.case")}, {{}, {}, 2})).census.losses, IsEmpty());
}

}  // namespace
}  // namespace splatvol::test
