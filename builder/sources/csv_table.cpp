#include "builder/sources/csv_table.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <span>
#include <unordered_map>

#include "base/names.h"
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
  explicit Heading(std::string_view text) : text_(text) {}

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
  std::size_t at_ = 0;
  std::size_t line_offset_ = 0;
  std::uint64_t line_ = 0;
};

bool is_value(std::string_view field) { return is_missing_field(field) || csv_number(field).has_value(); }

std::string list_names(const CsvTable& table) {
  std::vector<std::string> names;
  for (const CsvColumn& column : table.columns) names.push_back(column.name);
  return fmt::format("{}", fmt::join(names, ", "));
}

/// The column of an axis: the first of the usual names that some column has. `columns`: the first of each plain name.
std::optional<std::size_t> find_axis(const std::unordered_map<std::string, std::size_t>& columns, std::size_t axis) {
  const std::string a(1, "xyz"[axis]), i = std::to_string(axis);
  for (const std::string& usual :
       {a, "points" + i, "coord" + a, a + "coord", "coordinate" + a, a + "coordinate", "coordinates" + i, "coords" + i,
        "coordinates" + a, "position" + a, a + "position", "pos" + a, a + "pos", "point" + a, "points" + a})
    if (const auto column = columns.find(usual); column != columns.end()) return column->second;
  return std::nullopt;
}

Status find_position(const std::string& path, CsvTable& table) {
  std::unordered_map<std::string, std::size_t> columns;
  for (std::size_t c = 0; c < table.columns.size(); ++c) columns.emplace(plain_name(table.columns[c].name), c);
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
    column.unit = cut_unit(column.name);
    table.columns.push_back(std::move(column));
  }
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
  for (std::size_t at = 0;;) {
    std::size_t begin = at;
    while (begin < line.size() && line[begin] != separator && is_white_space(line[begin])) ++begin;
    if (begin < line.size() && line[begin] == '"') {
      std::size_t end = line.find('"', begin + 1);
      while (end != std::string_view::npos && line.substr(end, 2) == "\"\"") end = line.find('"', end + 2);
      if (end == std::string_view::npos) return false;
      fields.push_back(trimmed(line.substr(begin + 1, end - begin - 1)));
      at = line.find(separator, end);
    } else {
      at = line.find(separator, at);
      fields.push_back(trimmed(line.substr(begin, at == std::string_view::npos ? at : at - begin)));
    }
    if (at == std::string_view::npos) return true;
    ++at;
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

Result<CsvTable> read_csv_table(ByteSource& file, const std::vector<std::string>& names) {
  const std::string& path = file.name();
  SPLATVOL_TRY_ASSIGN(text, read_text(file, 0, largest_heading));
  Heading heading(text);
  const std::size_t mark = text.starts_with("\xEF\xBB\xBF") ? 3 : 0;  // of UTF-8
  auto line = heading.next();
  if (line) line->remove_prefix(heading.line_offset() == 0 ? mark : 0);
  if (!line) return fail(ErrorCode::invalid_data, "{}: empty", path);
  CsvTable table;
  table.separator = find_separator(*line);
  std::vector<std::string_view> fields;
  if (!split_csv_line(line->substr(line->starts_with('#') ? 1 : 0), table.separator, fields))
    return fail(ErrorCode::invalid_data, "{}: line {}: a quotation mark is not closed in its line", path,
                heading.line());
  const bool has_heading = !std::ranges::all_of(fields, is_value);
  if (!has_heading && names.empty())
    return fail(ErrorCode::invalid_data, "{}: its first line holds no names of columns; give them: --columns x,y,z,...",
                path);
  name_columns(fields, table);
  if (!names.empty()) SPLATVOL_TRY(use_names(path, names, table));
  SPLATVOL_TRY(check_names(path, table));

  if (has_heading) line = heading.next();
  if (!line) return fail(ErrorCode::invalid_data, "{}: no line after the names of the columns", path);
  table.data_offset = heading.line_offset() + (has_heading ? 0 : mark);
  table.data_line = heading.line();
  if (split_csv_line(*line, table.separator, fields))
    for (std::size_t c = 0; c < std::min(fields.size(), table.columns.size()); ++c)
      table.columns[c].is_text = !is_value(fields[c]);
  SPLATVOL_TRY(find_position(path, table));
  return table;
}

std::vector<std::size_t> attribute_columns(const CsvTable& table) {
  std::vector<std::size_t> columns;
  for (std::size_t c = 0; c < table.columns.size(); ++c) {
    const CsvColumn& column = table.columns[c];
    const std::string plain = plain_name(column.name);
    const bool is_id = is_one_of(plain, {"pointid", "cellid", "nodeid", "nodenumber", "vtkghosttype"}) ||
                       plain.starts_with("vtkoriginal");
    const bool is_position = std::ranges::find(table.position, c) != table.position.end();
    if (!column.name.empty() && column.name != "_" && !column.is_text && !is_id && !is_position) columns.push_back(c);
  }
  return columns;
}

}  // namespace splatvol
