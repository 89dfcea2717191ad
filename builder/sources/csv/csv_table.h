// The layout of tables (.csv, .tsv, .txt), and their lines.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/error.h"
#include "base/file.h"

namespace splatvol {

struct CsvColumn {
  std::string name;  // without the unit; empty or "_": left out
  std::string unit;
  bool is_text = false;  // in the first line of values
};

/// The columns of a .csv file, and where its values begin.
struct CsvTable {
  char separator = ',';       // ' ': runs of spaces and tabs
  char comment = 0;           // lines that begin with it are left out; 0: none are
  bool has_sections = false;  // as CFX-Post's: lines such as [Data] begin them, and those of [Data] hold values
  std::string heading;        // the line of names; each section [Data] begins with it
  std::vector<CsvColumn> columns;
  std::array<std::size_t, 3> position{};                      // the columns x, y and z
  std::vector<std::pair<std::size_t, std::size_t>> repeated;  // columns with the values of a position, and its column
  std::uint64_t data_offset = 0;
  std::uint64_t data_line = 1;  // the number of the line at data_offset, from 1
};

/// Splits a line at its separators into `fields`, without white space and quotation marks round them. The separator ' '
/// stands for runs of white space. A separator between quotation marks belongs to the field. Returns false if a
/// quotation mark is not closed.
[[nodiscard]] bool split_csv_line(std::string_view line, char separator, std::vector<std::string_view>& fields);

/// Whether a field says that there is no value: empty, "nan", "NA", "null", "none" or "-".
[[nodiscard]] bool is_missing_field(std::string_view field);

/// Reads a number, also with a Fortran exponent such as 1.5D+03. Empty if the field is not one.
[[nodiscard]] std::optional<double> csv_number(std::string_view field);

/// Whether a line begins a section, and whether that is [Data].
[[nodiscard]] bool is_csv_section(std::string_view line);
[[nodiscard]] bool is_csv_data_section(std::string_view line);

/// Reads the heading of a file: the line of names, behind comments (# or %) or as the last of them. `names` are the
/// names of its columns, in place of those in the heading; the file may have no heading then. Without them, finds the
/// position by common names: x, Points:0, coord x, X [m], X (m). Safe on untrusted bytes.
[[nodiscard]] Result<CsvTable> read_csv_table(ByteSource& file, const std::vector<std::string>& names);

/// The columns that are attributes: all but positions, texts, ids, ghost flags and those without a name.
[[nodiscard]] std::vector<std::size_t> attribute_columns(const CsvTable& table);

}  // namespace splatvol
