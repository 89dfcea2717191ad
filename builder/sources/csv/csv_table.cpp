#include "builder/sources/csv/csv_table.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <span>
#include <unordered_map>

#include "base/names.h"
#include "base/printable.h"
#include "builder/sources/read_text.h"
#include "builder/sources/units.h"

namespace splatvol {
namespace {

constexpr std::uint64_t largest_heading = 1 << 20;

/// Letters and digits only, in lower case.
std::string plain_name(std::string_view name) {
  std::string plain;
  for (const char c : name)
    if (std::isalnum(static_cast<unsigned char>(c))) plain += static_cast<char>(std::tolower(c));
  return plain;
}

/// The separator that appears most often outside of quotation marks: tab, ; or ,
char find_separator(std::string_view line) {
  char best = ',';
  std::size_t most = 0;
  for (const char separator : {'\t', ';', ','}) {
    std::vector<std::string_view> fields;
    if (split_csv_line(line, separator, fields) && fields.size() > most + 1) {
      most = fields.size() - 1;
      best = separator;
    }
  }
  return best;
}

/// The lines at the beginning of a file that are not empty.
class Heading {
 public:
  explicit Heading(std::string_view text) : text_(text), at_(text.size() - without_byte_order_mark(text).size()) {}

  /// Returns the next line that is not empty; nothing after the last.
  std::optional<std::string_view> next() {
    while (at_ < text_.size()) {
      line_offset_ = at_;
      const std::size_t end = std::min(text_.find('\n', at_), text_.size());
      std::string_view line = text_.substr(at_, end - at_);
      if (line.ends_with('\r')) line.remove_suffix(1);
      at_ = end + 1;
      ++line_;
      if (!trimmed(line).empty()) return line;
    }
    return std::nullopt;
  }
  /// Offset and number of the line that next() has returned.
  [[nodiscard]] std::size_t line_offset() const { return line_offset_; }
  [[nodiscard]] std::uint64_t line() const { return line_; }

 private:
  std::string_view text_;
  std::size_t at_;
  std::size_t line_offset_ = 0;
  std::uint64_t line_ = 0;
};

bool is_value(std::string_view field) { return is_missing_field(field) || csv_number(field).has_value(); }

bool is_comment(std::string_view line) { return trimmed(line).starts_with('#') || trimmed(line).starts_with('%'); }

/// Whether a line holds nothing but values, whatever separates them.
bool holds_values(std::string_view line) {
  std::vector<std::string_view> fields;
  return std::ranges::any_of(std::string_view(",;\t "), [&](char separator) {
    return split_csv_line(line, separator, fields) && std::ranges::all_of(fields, is_value);
  });
}

/// Whether a line behind a comment holds values, and texts perhaps: a line of names has no three numbers.
bool holds_numbers(std::string_view line) {
  std::vector<std::string_view> fields;
  return std::ranges::any_of(std::string_view(",;\t "), [&](char separator) {
    return split_csv_line(line, separator, fields) &&
           std::ranges::count_if(fields, [](std::string_view field) { return csv_number(field).has_value(); }) >= 3;
  });
}

/// Splits names at two spaces or more.
std::vector<std::string_view> split_at_gaps(std::string_view line) {
  std::vector<std::string_view> names;
  for (line = trimmed(line); !line.empty();) {
    const std::size_t gap = std::min({line.find("  "), line.find('\t'), line.size()});
    names.push_back(trimmed(line.substr(0, gap)));
    line = trimmed(line.substr(gap));
  }
  return names;
}

/// Splits names at spaces that no bracket follows: a unit belongs to its name.
std::vector<std::string_view> split_at_names(std::string_view line) {
  std::vector<std::string_view> names;
  for (line = trimmed(line); !line.empty();) {
    std::size_t end = line.find_first_of(" \t");
    const std::size_t next = std::min(line.find_first_not_of(" \t", end), line.size());
    if (next < line.size() && (line[next] == '(' || line[next] == '['))
      end = line.find(line[next] == '(' ? ')' : ']', next);
    end = std::min(line.find_first_of(" \t", end), line.size());
    names.push_back(line.substr(0, end));
    line = trimmed(line.substr(end));
  }
  return names;
}

/// Splits the line of names above values between spaces: the names may hold spaces, or commas may separate them.
void split_names(std::string_view heading, std::size_t columns, std::vector<std::string_view>& names) {
  if (split_csv_line(heading, find_separator(heading), names) && names.size() == columns) return;
  if (split_csv_line(heading, ' ', names) && names.size() == columns) return;
  names = split_at_gaps(heading);
  if (names.size() != columns) names = split_at_names(heading);
}

/// Moves to the first line that may hold names or values. Notes the sections and comments before it; returns the last
/// comment.
Result<std::optional<std::string_view>> skip_comments(const std::string& path, Heading& heading,
                                                      std::optional<std::string_view>& line, CsvTable& table) {
  if (is_csv_section(*line)) {
    table.has_sections = true;
    while (line && !is_csv_data_section(*line)) line = heading.next();
    if (line) line = heading.next();
    if (!line) return fail(ErrorCode::invalid_data, "{}: no line in a section [Data]", path);
  }
  std::optional<std::string_view> last;
  for (; line && is_comment(*line); line = heading.next()) {
    last = trimmed(*line);
    table.comment = last->front();
    last->remove_prefix(1);
  }
  return last;
}

std::string list_names(const CsvTable& table) {
  std::vector<std::string> names;
  for (const CsvColumn& column : table.columns) names.push_back(column.name);
  return fmt::format("{}", fmt::join(names, ", "));
}

/// The column of an axis: the first of the usual names that some column has. `columns`: the first of each plain name.
std::optional<std::size_t> find_axis(const std::unordered_map<std::string, std::size_t>& columns, std::size_t axis) {
  const std::string a(1, "xyz"[axis]), i = std::to_string(axis);
  for (const std::string& usual : {a, "points" + i, "coord" + a, a + "coord", "coordinate" + a, a + "coordinate",
                                   "coordinates" + i, "coords" + i, "coordinates" + a, "position" + a, a + "position",
                                   "pos" + a, a + "pos", "point" + a, "points" + a, "centroid" + a, a + "location"})
    if (const auto column = columns.find(usual); column != columns.end()) return column->second;
  return std::nullopt;
}

Status find_position(const std::string& path, CsvTable& table) {
  std::unordered_map<std::string, std::size_t> columns;
  for (std::size_t c = 0; c < table.columns.size(); ++c) columns.emplace(plain_name(table.columns[c].name), c);
  for (std::size_t c = 0; c < table.columns.size(); ++c) {  // any unit
    const std::string& name = table.columns[c].name;
    columns.emplace(plain_name(name.substr(0, name.find_last_of("(["))), c);
  }
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto column = find_axis(columns, axis);
    if (!column)
      return fail(ErrorCode::invalid_data,
                  "{}: no column is called {}; there are: {}. Name them all in order: --columns x,y,z,...", path,
                  "xyz"[axis], list_names(table));
    if (table.columns[*column].is_text)
      return fail(ErrorCode::invalid_data, "{}: line {}: the column \"{}\" holds no numbers", path, table.data_line,
                  table.columns[*column].name);
    table.position[axis] = *column;
  }
  return {};
}

/// Takes the names from the heading, with their units.
void name_columns(std::span<const std::string_view> fields, CsvTable& table) {
  for (std::string_view field : fields) {
    CsvColumn column;
    for (std::size_t i = 0; i < field.size(); ++i) {
      if (field.substr(i, 2) == "\"\"") ++i;  // a quotation mark between quotation marks
      column.name += field[i];
    }
    column.name = as_utf8(column.name);
    column.unit = cut_unit(column.name);
    table.columns.push_back(std::move(column));
  }
}

/// CFX-Post and Fluent write the position twice if it is among the chosen variables.
void find_repeated_positions(CsvTable& table) {
  for (std::size_t c = 0; c < table.columns.size(); ++c)
    for (const std::size_t axis : table.position)
      if (c != axis && table.columns[c].name == table.columns[axis].name) table.repeated.emplace_back(c, axis);
  for (const auto& [column, axis] : table.repeated) table.columns[column].name.assign(1, '_');
}

Status check_names(const std::string& path, const CsvTable& table) {
  std::vector<std::string> names;
  for (const CsvColumn& column : table.columns)
    if (!column.name.empty() && column.name != "_") names.push_back(column.name);
  if (const auto duplicate = find_duplicate(std::move(names)))
    return fail(ErrorCode::invalid_data, "{}: two columns are called \"{}\"", path, *duplicate);
  return {};
}

Status use_names(const std::string& path, const std::vector<std::string>& names, CsvTable& table) {
  if (names.size() != table.columns.size())
    return fail(ErrorCode::invalid_argument, "{}: {} columns, but {} names for them", path, table.columns.size(),
                names.size());
  for (std::size_t c = 0; c < names.size(); ++c) table.columns[c].name = names[c];
  return {};
}

}  // namespace

bool split_csv_line(std::string_view line, char separator, std::vector<std::string_view>& fields) {
  fields.clear();
  if (separator == ' ') line = trimmed(line);
  const auto find = [&](std::size_t from) {
    return separator == ' ' ? line.find_first_of(" \t", from) : line.find(separator, from);
  };
  for (std::size_t at = 0;;) {
    std::size_t begin = at;
    while (begin < line.size() && line[begin] != separator && is_white_space(line[begin])) ++begin;
    if (begin < line.size() && line[begin] == '"') {
      std::size_t end = line.find('"', begin + 1);
      while (end != std::string_view::npos && line.substr(end, 2) == "\"\"") end = line.find('"', end + 2);
      if (end == std::string_view::npos) return false;
      fields.push_back(trimmed(line.substr(begin + 1, end - begin - 1)));
      at = find(end);
    } else {
      at = find(begin);
      fields.push_back(trimmed(line.substr(begin, at == std::string_view::npos ? at : at - begin)));
    }
    if (at == std::string_view::npos) return true;
    at = separator == ' ' ? line.find_first_not_of(" \t", at) : at + 1;
  }
}

bool is_missing_field(std::string_view field) {
  if (field.empty() || field == "-") return true;
  if (field.size() > 4) return false;
  const std::string plain = plain_name(field);
  return is_one_of(plain, {"nan", "na", "null", "none"});
}

std::optional<double> csv_number(std::string_view field) {
  if (field.starts_with('+')) field.remove_prefix(1);
  double number = 0;
  const char* end = field.data() + field.size();
  const auto [stop, error] = std::from_chars(field.data(), end, number);
  if (error == std::errc{} && stop == end) return number;
  // Numbers too small or too large for a double: 0, or not finite.
  if (error == std::errc::result_out_of_range && stop == end) return std::strtod(std::string(field).c_str(), nullptr);
  if (stop == end || error != std::errc{} || (*stop != 'D' && *stop != 'd')) return std::nullopt;
  std::string text(field);
  text[static_cast<std::size_t>(stop - field.data())] = 'e';
  return csv_number(text);
}

bool is_csv_section(std::string_view line) {
  line = trimmed(line);
  return line.starts_with('[') && line.ends_with(']');
}

bool is_csv_data_section(std::string_view line) { return is_csv_section(line) && plain_name(line) == "data"; }

Result<CsvTable> read_csv_table(ByteSource& file, const std::vector<std::string>& names) {
  const std::string& path = file.name();
  SPLATVOL_TRY_ASSIGN(text, read_text(file, 0, largest_heading));
  Heading heading(text);
  auto line = heading.next();
  if (!line) return fail(ErrorCode::invalid_data, "{}: empty", path);
  CsvTable table;
  std::uint64_t heading_line = heading.line();
  SPLATVOL_TRY_ASSIGN(names_line, skip_comments(path, heading, line, table));
  if (line && !holds_values(*line) && !(names_line && holds_numbers(*line))) {
    names_line = line;
    heading_line = heading.line();
    line = heading.next();
    while (line && table.comment != 0 && trimmed(*line).starts_with(table.comment)) line = heading.next();
  }
  if (!names_line && names.empty())
    return fail(ErrorCode::invalid_data, "{}: its first line holds no names of columns; give them: --columns x,y,z,...",
                path);
  if (!line) return fail(ErrorCode::invalid_data, "{}: no line after the names of the columns", path);
  table.heading = names_line.value_or("");
  table.data_offset = heading.line_offset();
  table.data_line = heading.line();

  table.separator = find_separator(names_line.value_or(*line));
  std::vector<std::string_view> fields, titles;
  const bool is_split = split_csv_line(*line, table.separator, fields);
  if (is_split && fields.size() == 1 && fields[0].find_first_of(" \t") != std::string_view::npos &&
      holds_values(*line)) {
    table.separator = ' ';
    (void)split_csv_line(*line, ' ', fields);
    split_names(names_line.value_or(*line), fields.size(), titles);
    if (names.empty() && titles.size() != fields.size())
      return fail(ErrorCode::invalid_data, "{}: line {}: {} names of columns, but line {} has {}; --columns x,y,z,...",
                  path, heading_line, titles.size(), table.data_line, fields.size());
    titles.resize(fields.size());
  } else if (!split_csv_line(names_line.value_or(*line), table.separator, titles)) {
    return fail(ErrorCode::invalid_data, "{}: line {}: a quotation mark is not closed in its line", path, heading_line);
  }
  name_columns(titles, table);
  if (!names.empty()) SPLATVOL_TRY(use_names(path, names, table));
  if (is_split)
    for (std::size_t c = 0; c < std::min(fields.size(), table.columns.size()); ++c)
      table.columns[c].is_text = !is_value(fields[c]);
  SPLATVOL_TRY(find_position(path, table));
  if (names.empty()) find_repeated_positions(table);
  SPLATVOL_TRY(check_names(path, table));
  return table;
}

std::vector<std::size_t> attribute_columns(const CsvTable& table) {
  std::vector<std::size_t> columns;
  for (std::size_t c = 0; c < table.columns.size(); ++c) {
    const CsvColumn& column = table.columns[c];
    const std::string plain = plain_name(column.name);
    const bool is_id = is_one_of(plain, {"pointid", "cellid", "nodeid", "nodenumber", "cellnumber", "vtkghosttype"}) ||
                       plain.starts_with("vtkoriginal");
    const bool is_position = std::ranges::find(table.position, c) != table.position.end();
    if (!column.name.empty() && column.name != "_" && !column.is_text && !is_id && !is_position) columns.push_back(c);
  }
  return columns;
}

}  // namespace splatvol
