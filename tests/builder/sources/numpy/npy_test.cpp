// Scattered points from .npy files.
#include "builder/sources/numpy/npy_source.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <random>

#include "base/file.h"
#include "builder/opening/open_own.h"
#include "builder/sources/numpy/npy_header.h"
#include "tests/support/memory_source.h"
#include "tests/support/results.h"
#include "tests/support/temp_folder.h"

namespace splatvol::test {
namespace {

using namespace ::testing;

constexpr double inf = std::numeric_limits<double>::infinity();
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

/// A .npy file with this header, padded to 64 bytes like NumPy's.
std::string npy(std::string header, const std::string& data, int major = 1) {
  const std::size_t start = major == 1 ? 10 : 12;
  header.resize((start + header.size() + 64) / 64 * 64 - start - 1, ' ');
  header += '\n';
  std::string file = std::string(npy_magic) + static_cast<char>(major) + '\0';
  for (std::size_t i = 0; i < start - 8; ++i) file += static_cast<char>(header.size() >> 8 * i & 255);
  return file + header + data;
}

std::string header(const std::string& type, std::size_t rows, std::size_t columns, bool fortran = false) {
  return fmt::format("{{'descr': '{}', 'fortran_order': {}, 'shape': ({}, {}), }}", type, fortran ? "True" : "False",
                     rows, columns);
}

template <class T>
std::string number(double value, bool big_endian = false) {
  auto raw = std::bit_cast<std::array<char, sizeof(T)>>(static_cast<T>(value));
  if (big_endian) std::ranges::reverse(raw);
  return {raw.data(), raw.size()};
}

template <class T>
std::string numbers(const std::vector<double>& values, bool big_endian = false) {
  std::string bytes;
  for (const double value : values) bytes += number<T>(value, big_endian);
  return bytes;
}

/// Reorders [row][column] to [column][row].
std::vector<double> transposed(const std::vector<double>& values, std::size_t columns) {
  std::vector<double> result;
  for (std::size_t c = 0; c < columns; ++c)
    for (std::size_t i = c; i < values.size(); i += columns) result.push_back(values[i]);
  return result;
}

struct NpyTest : FolderTest {
  /// All points of an input: x, y, z and values, row by row.
  struct Table {
    std::vector<std::string> attributes;
    std::vector<double> numbers;
    bool single_precision;
    std::optional<Box> bounds;
  };

  static Result<Table> read(const std::vector<std::string>& paths, const SourceOptions& options = {}) {
    SPLATVOL_TRY_ASSIGN(source, open_own(paths, options));
    Table table{source->attributes(), {}, source->single_precision(), {}};
    std::size_t pieces = 0, points = 0;
    for (;; ++pieces) {
      SPLATVOL_TRY_ASSIGN(piece, source->next());
      if (!piece) break;
      EXPECT_LE(piece->points.size(), max_piece_points);
      EXPECT_EQ(piece->values.size(), table.attributes.size());
      for (std::size_t i = 0; i < piece->points.size(); ++i) {
        const dvec3& p = piece->points[i];
        table.numbers.insert(table.numbers.end(), {p.x, p.y, p.z});
        for (const auto& values : piece->values) table.numbers.push_back(values.at(i));
      }
      points += piece->points.size();
    }
    EXPECT_FALSE((*source->next())) << "nothing comes after the end";
    EXPECT_EQ(source->piece_count(), pieces);
    EXPECT_EQ(source->point_count(), points);
    SPLATVOL_TRY_ASSIGN(bounds, source->bounds());
    table.bounds = bounds;
    return table;
  }

  static std::string error_of(const std::vector<std::string>& paths, const SourceOptions& options = {}) {
    const auto table = read(paths, options);
    if (table) return "(no error)";
    EXPECT_EQ(table.error().message.find('\n'), std::string::npos) << table.error().message;
    return table.error().message;
  }
};

const std::vector<double> rows = {0, 1, 2, 10, -3, 4, 5.5, 20, 6, 7, -8.25, 30};  // x, y, z, value

TEST_F(NpyTest, EveryLayoutOfTheSameNumbersIsRead) {
  const std::vector<std::pair<std::string, std::string>> files = {
      {header("<f4", 3, 4), numbers<float>(rows)},
      {header(">f4", 3, 4), numbers<float>(rows, true)},
      {header("<f8", 3, 4), numbers<double>(rows)},
      {header(">f8", 3, 4), numbers<double>(rows, true)},
      {header("<f8", 3, 4, true), numbers<double>(transposed(rows, 4))},
      {header(">f4", 3, 4, true), numbers<float>(transposed(rows, 4), true)},
      {"{'descr': [('x', '<f8'), ('y', '<f8'), ('z', '<f8'), ('value', '<f8')], 'fortran_order': False, 'shape': (3,)}",
       numbers<double>(rows)},
      {"{\"shape\":(3L,4L),\"fortran_order\":False,\"descr\":\"<f8\"}", numbers<double>(rows)}};
  for (const auto& [text, data] : files)
    for (const int version : {1, 2, 3}) {
      SCOPED_TRACE(text);
      const auto table = value_of(read({write("a.npy", npy(text, data, version))}));
      EXPECT_THAT(table.attributes, ElementsAre("value"));
      EXPECT_EQ(table.numbers, rows);
      EXPECT_EQ(table.single_precision, text.find("f4") != std::string::npos);
      EXPECT_EQ(table.bounds->low, dvec3(-3, 1, -8.25));
      EXPECT_EQ(table.bounds->high, dvec3(6, 7, 5.5));
    }
}

TEST_F(NpyTest, FillValuesAreMissing) {
  const std::vector<double> values = {5,  9.969209968386869e36, -2147483647, -9999, 1e20, 255, 9.96e36, 1e51, 1e101,
                                      nan};
  std::vector<double> numbers_in_file;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const auto x = static_cast<double>(i);
    numbers_in_file.insert(numbers_in_file.end(), {x, x * x, -x, values[i]});
  }
  const std::string path = write("a.npy", npy(header("<f8", values.size(), 4), numbers<double>(numbers_in_file)));
  const auto missing = [&](const std::vector<double>& given, std::uint64_t fills) {
    const auto piece = open_own({path}, {.missing = given}).value()->next().value();
    EXPECT_THAT(piece->fills, ElementsAre(fills));
    std::vector<std::size_t> indices;
    for (std::size_t i = 0; i < values.size(); ++i)
      if (std::isnan(piece->values[0][i])) indices.push_back(i);
    return indices;
  };
  EXPECT_THAT(missing({}, 3), ElementsAre(1, 2, 8, 9));
  EXPECT_THAT(missing({-9999, 255}, 5), ElementsAre(1, 2, 3, 5, 8, 9));
  EXPECT_THAT(missing({1e20}, 4), ElementsAre(1, 2, 4, 8, 9));
  EXPECT_TRUE(MissingValues({1e20}).has(static_cast<double>(1e20F))) << "as single precision has it";
}

TEST_F(NpyTest, PointsFarBeyondAllOthersAreDropped) {
  std::vector<double> table;
  for (int i = 0; i < 100; ++i) table.insert(table.end(), {0.1 * i, std::sin(i), std::cos(i), 1});
  const auto expect = [&](double far, double high) {
    std::vector<double> changed = table;
    changed[4 * 40] = far;
    const auto read_back = read({write("a.npy", npy(header("<f8", 100, 4), numbers<double>(changed)))});
    EXPECT_EQ(read_back->bounds->high.x, high);
    EXPECT_EQ(std::isnan(read_back->numbers[4 * 40]), far != high);
  };
  expect(1e12, 1e12);
  expect(1e15, 0.1 * 99);
  expect(1e30, 0.1 * 99);
}

TEST_F(NpyTest, IntegersAreRead) {
  const std::vector<double> whole = {0, 1, 2, 100, 3, 4, 5, 127};
  const auto expect = [&](const std::string& type, const std::string& data, bool single_precision) {
    const auto table = value_of(read({write("a.npy", npy(header(type, 2, 4), data))}));
    EXPECT_EQ(table.numbers, whole) << type;
    EXPECT_EQ(table.single_precision, single_precision) << type;
  };
  expect("|u1", numbers<std::uint8_t>(whole), true);
  expect("|i1", numbers<std::int8_t>(whole), true);
  expect(">i2", numbers<std::int16_t>(whole, true), true);
  expect("<u2", numbers<std::uint16_t>(whole), true);
  expect(">u4", numbers<std::uint32_t>(whole, true), false);
  expect("<i4", numbers<std::int32_t>(whole), false);
  expect("<i8", numbers<std::int64_t>(whole), false);
  expect(">u8", numbers<std::uint64_t>(whole, true), false);
}

TEST_F(NpyTest, ColumnsHaveTheNamesThatTheyAreGiven) {
  const std::vector<double> wide = {1, 2, 3, 4, 5, 6, 10, 20, 30, 40, 50, 60};
  const std::string path = write("a.npy", npy(header("<f4", 2, 6), numbers<float>(wide)));
  const auto by_default = value_of(read({path}));
  EXPECT_THAT(by_default.attributes, ElementsAre("value0", "value1", "value2"));

  const auto named = value_of(read({path}, {{}, {"z", "heat", "_", "x", "_", "y"}}));
  EXPECT_THAT(named.attributes, ElementsAre("heat"));
  EXPECT_THAT(named.numbers, ElementsAre(4, 6, 1, 2, 40, 60, 10, 20));

  const auto selected = value_of(read({path}, {{"b", "a"}, {"x", "y", "z", "a", "b", "c"}}));
  EXPECT_THAT(selected.numbers, ElementsAre(1, 2, 3, 5, 4, 10, 20, 30, 50, 40));

  EXPECT_THAT(error_of({path}, {{"d"}, {}}), AllOf(StartsWith(path), HasSubstr("value0, value1, value2")));
  EXPECT_THAT(error_of({path}, {{}, {"x", "y", "z", "a"}}), HasSubstr("6 columns, but 4 names"));
  EXPECT_THAT(error_of({path}, {{}, {"x", "y", "y", "a", "b", "c"}}), HasSubstr("two columns are called \"y\""));
  EXPECT_THAT(error_of({path}, {{}, {"x", "y", "a", "b", "c", "d"}}), HasSubstr("no column \"z\""));
  EXPECT_THAT(error_of({path}, {{}, {"x", "y", "z", "_", "_", "_"}}), HasSubstr("no values"));
}

TEST_F(NpyTest, FieldsThatAreNoNumbersAreSkipped) {
  const std::string text =
      "{'descr': [('id', '|S3'), ('heat', '>f4'), ('z', '<f8'), ('', '|V5'), (('a title', 'y'), '<i2'), ('x', '<f4'), "
      "('on', '|b1'), ('name', '<U2')], 'fortran_order': False, 'shape': (2,), }";
  std::string data;
  for (const double i : {1.0, 2.0})
    data += "abc" + number<float>(10 * i, true) + number<double>(3 * i) + "....." + number<std::int16_t>(2 * i) +
            number<float>(i) + "\1" + "12345678";
  const std::string path = write("a.npy", npy(text, data));
  const auto table = value_of(read({path}));
  EXPECT_THAT(table.attributes, ElementsAre("heat"));
  EXPECT_THAT(table.numbers, ElementsAre(1, 2, 3, 10, 2, 4, 6, 20));
  EXPECT_THAT(error_of({path}, {{"on"}, {}}), HasSubstr("neither floats"));
}

TEST_F(NpyTest, WhatIsNotFiniteIsMissingAndOutOfTheBounds) {
  const std::vector<double> odd = {0, 0, 0, inf, 1, 2, 3, nan, nan, 50, 50, 1, 50, -inf, 50, 2};
  const auto table = value_of(read({write("a.npy", npy(header("<f4", 4, 4), numbers<float>(odd)))}));
  EXPECT_TRUE(std::isnan(table.numbers[3]) && std::isnan(table.numbers[7]));
  EXPECT_TRUE(std::isnan(table.numbers[8])) << "points stay, whatever their position";
  EXPECT_EQ(table.numbers[13], -inf);
  EXPECT_EQ(table.bounds->high, dvec3(1, 2, 3));

  const std::vector<double> none = {nan, 0, 0, 1};
  const auto nowhere = value_of(read({write("b.npy", npy(header("<f4", 1, 4), numbers<float>(none)))}));
  EXPECT_FALSE(nowhere.bounds);
}

TEST_F(NpyTest, PiecesAreBoundedAndInOrder) {
  const std::size_t count = 2 * max_piece_points + 12345;
  std::vector<double> values;
  for (std::size_t i = 0; i < count; ++i)
    for (const int k : {1, 2, 3, 4}) values.push_back(static_cast<double>(i) * k);
  for (const bool fortran : {false, true}) {
    const auto data = numbers<double>(fortran ? transposed(values, 4) : values);
    const auto table = value_of(read({write("a.npy", npy(header("<f8", count, 4, fortran), data))}));
    EXPECT_TRUE(table.numbers == values);
    EXPECT_EQ(table.bounds->high, static_cast<double>(count - 1) * dvec3(1, 2, 3));
  }
}

TEST_F(NpyTest, SeveralFilesAreOnePointSet) {
  std::vector<double> others = rows;
  others[0] = 0.25;
  const std::string a = write("a.npy", npy(header("<f4", 3, 4), numbers<float>(rows)));
  const std::string b = write("b.npy", npy(header("<f8", 3, 4, true), numbers<double>(transposed(others, 4))));
  const std::string empty = write("c.npy", npy(header("<f4", 0, 4), ""));
  std::vector<double> twice = rows;
  twice.insert(twice.end(), others.begin(), others.end());
  const auto table = value_of(read({a, empty, b}));
  EXPECT_EQ(table.numbers, twice);
  EXPECT_FALSE(table.single_precision) << "the second is not";
  EXPECT_TRUE(read({a, empty})->single_precision);

  const std::string series = write("e.npy", npy(header("<f4", 3, 4), numbers<float>(rows)));
  EXPECT_THAT(error_of({a, series}), AllOf(StartsWith(series), HasSubstr("--series")));
  EXPECT_THAT(error_of({empty}), AllOf(StartsWith(empty), HasSubstr("no points")));
  const std::string wide = write("d.npy", npy(header("<f4", 1, 5), numbers<float>({1, 2, 3, 4, 5})));
  EXPECT_THAT(error_of({a, wide}), AllOf(StartsWith(wide), HasSubstr("5 columns, and 4 in " + a)));
}

TEST_F(NpyTest, ColumnsThatOnlySomeFilesHave) {
  const auto table_of = [](const std::string& names, const std::vector<double>& row) {
    std::string fields;
    for (const char name : names) fields += fmt::format("('{}', '<f8'), ", name);
    return npy(fmt::format("{{'descr': [{}], 'fortran_order': False, 'shape': (1,), }}", fields), numbers<double>(row));
  };
  const std::string a = write("a.npy", table_of("xyzp", {0, 0, 0, 1}));
  const std::string b = write("b.npy", table_of("xyqzp", {1, 0, 2, 0, 3}));
  const auto source = open_npy_files({a, b}, {}).value();
  EXPECT_THAT(source->attributes(), ElementsAre("p", "q"));
  EXPECT_THAT(source->conversions(), ElementsAre("q: missing where a part of the input lacks it"));
  const auto first = source->next().value(), second = source->next().value();
  EXPECT_EQ(first->values[0][0], 1);
  EXPECT_TRUE(std::isnan(first->values[1][0]));
  EXPECT_THAT(second->values, ElementsAre(ElementsAre(3), ElementsAre(2)));
  EXPECT_THAT(open_npy_files({b, a}, {{"q"}, {}}).value()->attributes(), ElementsAre("q"));
  EXPECT_THAT(error_of({a, b}, {{"r"}, {}}), HasSubstr("no attribute \"r\"; there are: p, q"));
}

TEST_F(NpyTest, BadFilesAreOneClearLine) {
  const std::string data = numbers<float>(rows);
  const auto refusal = [&](const std::string& text, const std::string& bytes) {
    const std::string path = write("a.npy", npy(text, bytes));
    const std::string message = error_of({path});
    EXPECT_THAT(message, StartsWith(path));
    return message;
  };
  EXPECT_THAT(refusal(header("|O", 3, 4), data), HasSubstr("type \"|O\""));
  EXPECT_THAT(refusal(header("<f2", 3, 4), data), HasSubstr("type \"<f2\""));
  EXPECT_THAT(refusal(header("<c8", 3, 4), data), HasSubstr("type \"<c8\""));
  EXPECT_THAT(refusal(header("<f4", 3, 4), data.substr(1)), HasSubstr("47 bytes of data, and not 3 rows of 16"));
  EXPECT_THAT(refusal(header("<f4", 3, 4), data + "x"), HasSubstr("49 bytes of data, and not 3 rows of 16"));
  EXPECT_THAT(refusal(header("<f4", std::uint64_t{1} << 62, 4), ""), HasSubstr("0 bytes of data, and not 46116860"));
}

// NumPy's users keep x, y, z and values in rows.
TEST_F(NpyTest, TransposedArraysAreRefused) {
  for (const std::size_t columns : {27, 1000, 5000}) {
    const std::string data = numbers<double>(std::vector<double>(4 * columns, 1));
    EXPECT_THAT(
        error_of({write("a.npy", npy(header("<f8", 4, columns), data))}),
        AllOf(HasSubstr("a.npy"), HasSubstr(fmt::format("4 points with {} columns", columns)), HasSubstr("transpose")));
  }
  std::vector<double> few = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1};
  std::vector<double> values;
  for (std::size_t row = 0; row < 4; ++row) {
    values.insert(values.end(), few.begin() + 3 * row, few.begin() + 3 * row + 3);
    values.resize(values.size() + 12, 5);
  }
  EXPECT_EQ(error_of({write("b.npy", npy(header("<f8", 4, 15), numbers<double>(values)))}), "(no error)");
}

TEST_F(NpyTest, WrongShapesAndHeadersAreOneClearLine) {
  const auto refusal = [&](const std::string& text) {
    return error_of({write("a.npy", npy(text, numbers<float>(rows)))});
  };
  EXPECT_THAT(refusal(header("<f4", 4, 3)), HasSubstr("no values"));
  EXPECT_THAT(refusal(header("<f4", 6, 2)), HasSubstr("no column \"z\""));
  EXPECT_THAT(refusal(header("<f4", 0, 0)), HasSubstr("48 bytes of data"));
  EXPECT_THAT(refusal(header("<f4", 1, 5000)), HasSubstr("5000 columns"));
  EXPECT_THAT(refusal("{'descr': '<f4', 'fortran_order': False, 'shape': (12,)}"), HasSubstr("1 dimensions"));
  EXPECT_THAT(refusal("{'descr': '<f4', 'fortran_order': False, 'shape': ()}"), HasSubstr("0 dimensions"));
  EXPECT_THAT(refusal("{'descr': [('x', '<f4', (3,))], 'fortran_order': False, 'shape': (4,)}"),
              HasSubstr("\"x\" is not a single number"));
  EXPECT_THAT(refusal("{'descr': [('x', '|O')], 'fortran_order': False, 'shape': (4,)}"), HasSubstr("type \"|O\""));
  EXPECT_THAT(refusal("{'descr': [('x', '<f4'), ('x', '<f4')], 'fortran_order': False, 'shape': (6,)}"),
              HasSubstr("two columns are called \"x\""));
  for (const std::string text : {"", "{}", "{", "{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4)", "[",
                                 "((((((((((((((((((((((1", "{'descr': '<f4', 'fortran_order': 1, 'shape': (3, 4)}",
                                 "{'descr': '<f4', 'fortran_order': False, 'shape': (-3, 4)}",
                                 "{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999999999999999, 4)}",
                                 "{'descr': '<f4', 'fortran_order': False, 'shape': (3, 4)} more",
                                 "{'descr': '<f4', 'fortran_order': False, 'shape': (3 4)}",
                                 "{'descr': [('x',)], 'fortran_order': False, 'shape': (3,)}"})
    EXPECT_THAT(refusal(text), HasSubstr("header is damaged")) << text;
  EXPECT_THAT(error_of({write("a.npy", npy(header("<f4", 3, 4), numbers<float>(rows), 4))}), HasSubstr("version 4.0"));
  EXPECT_THAT(error_of({write("a.npy", "no array")}), HasSubstr("not a .npy file"));
  EXPECT_THAT(error_of({write("a.npy", "")}), HasSubstr("not a .npy file"));
  EXPECT_THAT(error_of({folder_ + "none.npy"}), HasSubstr("No such file"));
}

/// Expects the columns of a table to lie within the file.
void expect_within(const NpyTable& table, std::uint64_t size) {
  for (const NpyColumn& column : table.columns) {
    if (table.rows == 0) continue;
    ASSERT_LE(column.offset, size);
    ASSERT_LE(column.bytes, size - column.offset);
    ASSERT_LE((table.rows - 1) * table.stride, size - column.offset - column.bytes);
  }
}

TEST(NpyHeader, SurvivesEveryTruncationAndRandomDamage) {
  const std::vector<std::string> files = {
      npy(header("<f8", 3, 4, true), numbers<double>(rows)),
      npy("{'descr': [('x', '<f8'), ('y', '<f8'), ('z', '<f8'), (('t', 'v'), '<f8')], 'fortran_order': False, 'shape': "
          "(3,)}",
          numbers<double>(rows), 2)};
  const auto survives = [](const std::string& bytes) {
    const auto source = memory_source(std::as_bytes(std::span(bytes)), "damaged");
    const auto table = read_npy_header(*source);
    if (table)
      expect_within(*table, bytes.size());
    else
      EXPECT_THAT(table.error().message, StartsWith("damaged: "));
    return table.has_value();
  };
  std::mt19937 random(1);
  const std::string syntax = "()[]{}':,\"0123456789<>|fiuOTFL \xff";
  for (const std::string& whole : files) {
    ASSERT_TRUE(survives(whole));
    for (std::size_t size = 0; size < whole.size(); ++size) {
      const std::string cut = whole.substr(0, size);
      EXPECT_FALSE(survives(cut)) << size;
    }
    for (int round = 0; round < 20000; ++round) {
      std::string damaged = whole;
      for (unsigned k = 0; k <= random() % 3; ++k) {
        char& byte = damaged[random() % (round % 2 ? 128 : damaged.size())];
        byte = random() % 4 ? syntax[random() % syntax.size()] : static_cast<char>(random());
      }
      survives(damaged);
    }
  }
}

TEST_F(NpyTest, FoldersAreReadInTheOrderOfNamesAndNumbers) {
  for (const int i : {10, 2, 1, 0})
    write(fmt::format("part{}.npy", i), npy(header("<f4", 1, 4), numbers<float>({1.0 * i, 0, 0, 0})));
  write("readme.txt", "not a point set");
  write(".hidden.npy", "nor this");
  const auto table = value_of(read({folder_}));
  EXPECT_THAT(table.numbers, ElementsAre(0, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 10, 0, 0, 0));
}

}  // namespace
}  // namespace splatvol::test
