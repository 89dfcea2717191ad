#include "builder/sources/csv/csv_source.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string_view>
#include <unordered_map>
#include <utility>

#include "base/file.h"
#include "base/names.h"
#include "builder/sources/array_union.h"
#include "builder/sources/csv/csv_table.h"
#include "builder/sources/far_points.h"
#include "builder/sources/piece_ahead.h"
#include "builder/sources/read_text.h"

namespace splatvol {
namespace {

/// A line of values has 8 bytes at least, so this is a piece at most.
constexpr std::uint64_t chunk_bytes = 8 * max_piece_points;

struct CsvFile {
  std::string path;
  std::uint64_t bytes = 0;
  CsvTable table;
  std::vector<std::optional<std::size_t>> values;  // [attribute]: its column; none: the file lacks it
};

/// A line of values, and its number in the file.
struct CsvLine {
  std::string_view text;
  std::uint64_t number = 0;
};

/// The place up to which a file has been read.
struct Progress {
  enum class Section { values, heading, other };

  std::size_t file = 0;
  std::uint64_t offset = 0;
  std::uint64_t line = 1;
  Section section = Section::values;  // what the next line holds
};

/// Reads the values of some lines.
class LineReader {
 public:
  LineReader(const CsvFile& file, std::span<const CsvLine> lines, Piece& piece)
      : file_(file), lines_(lines), piece_(piece) {
    piece_.points.resize(lines.size());
    piece_.values.assign(file.values.size(), std::vector<double>(lines.size(), missing_value));
  }

  /// Fails with the first line that cannot be read.
  Status read() {
    std::vector<Status> failures(lines_.size() / lines_at_once + 1);
    tbb::parallel_for(std::size_t{0}, failures.size(), [&](std::size_t block) {
      std::vector<std::string_view> fields;
      const std::size_t first = block * lines_at_once, end = std::min(first + lines_at_once, lines_.size());
      for (std::size_t i = first; i < end && failures[block]; ++i) failures[block] = read_line(i, fields);
    });
    for (const Status& failure : failures) SPLATVOL_TRY(failure);
    return {};
  }

 private:
  static constexpr std::size_t lines_at_once = 4096;

  Status read_line(std::size_t i, std::vector<std::string_view>& fields) {
    const CsvLine& line = lines_[i];
    const std::size_t width = file_.table.columns.size();
    if (!split_csv_line(line.text, file_.table.separator, fields))
      return fail(ErrorCode::invalid_data, "{}: line {}: a quotation mark is not closed in its line", file_.path,
                  line.number);
    if (fields.size() != width)
      return fail(ErrorCode::invalid_data, "{}: line {}: {} fields instead of {}", file_.path, line.number,
                  fields.size(), width);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const std::size_t column = file_.table.position[axis];
      SPLATVOL_TRY_ASSIGN(value, number(line, fields[column], column));
      piece_.points[i][static_cast<int>(axis)] = value;
    }
    for (const auto& [column, axis] : file_.table.repeated)
      if (fields[column] != fields[axis])
        return fail(ErrorCode::invalid_data, "{}: line {}: two columns are called \"{}\", with {} and {}", file_.path,
                    line.number, file_.table.columns[axis].name, fields[axis].substr(0, 40),
                    fields[column].substr(0, 40));
    for (std::size_t a = 0; a < file_.values.size(); ++a) {
      if (!file_.values[a]) continue;
      SPLATVOL_TRY_ASSIGN(value, number(line, fields[*file_.values[a]], *file_.values[a]));
      piece_.values[a][i] = value;
    }
    return {};
  }

  Result<double> number(const CsvLine& line, std::string_view field, std::size_t column) const {
    if (const auto value = csv_number(field)) return *value;
    if (is_missing_field(field)) return missing_value;
    return fail(ErrorCode::invalid_data, "{}: line {}: \"{}\" in the column \"{}\" is not a number", file_.path,
                line.number, field.substr(0, 40), file_.table.columns[column].name);
  }

  const CsvFile& file_;
  std::span<const CsvLine> lines_;
  Piece& piece_;
};

class CsvSource final : public Source {
 public:
  CsvSource(std::vector<CsvFile> files, std::vector<std::string> attributes, std::vector<std::string> units,
            const MissingValues& missing)
      : files_(std::move(files)),
        attributes_(std::move(attributes)),
        units_(std::move(units)),
        missing_(missing),
        pieces_(std::numeric_limits<std::size_t>::max(), [this](std::size_t) { return make_piece(); }) {
    start_file();
  }

  const std::vector<std::string>& attributes() const override { return attributes_; }
  bool may_have_cells() const override { return false; }

  std::vector<std::string> units() const override { return units_; }

  std::vector<std::string> conversions() const override {
    std::vector<std::string> lacking;
    for (std::size_t a = 0; a < attributes_.size(); ++a)
      if (std::ranges::any_of(files_, [a](const CsvFile& file) { return !file.values[a]; }))
        lacking.push_back(attributes_[a]);
    return lacking.empty() ? lacking : std::vector{describe_lacking(lacking)};
  }

  std::size_t piece_count() const override {
    std::size_t count = 0;
    for (const CsvFile& file : files_) count += file.bytes / chunk_bytes + 1;
    return std::max(count, returned_);
  }

  Result<std::unique_ptr<Piece>> next() override {
    if (ended_) return std::unique_ptr<Piece>();
    SPLATVOL_TRY_ASSIGN(piece, pieces_.next());
    ended_ = !piece;
    returned_ += piece ? 1 : 0;
    return piece;
  }

 private:
  void start_file() {
    if (at_.file < files_.size())
      at_ = {at_.file, files_[at_.file].table.data_offset, files_[at_.file].table.data_line};
  }

  /// Makes the next piece, one call after the other; null after the last.
  Result<std::unique_ptr<Piece>> make_piece() {
    while (at_.file < files_.size()) {
      const CsvFile& file = files_[at_.file];
      SPLATVOL_TRY_ASSIGN(bytes, open_file(file.path));
      SPLATVOL_TRY_ASSIGN(text, read_lines(file, *bytes));
      SPLATVOL_TRY_ASSIGN(lines, split_lines(file, text));
      auto piece = std::make_unique<Piece>();
      SPLATVOL_TRY(LineReader(file, lines, *piece).read());
      drop_far_points(piece->points);
      for (std::vector<double>& values : piece->values) piece->fills.push_back(missing_.replace(values));
      if (at_.offset >= file.bytes) {
        piece->census.open_ends = at_.section == Progress::Section::values && ends_openly(file, text) ? 1 : 0;
        ++at_.file;
        start_file();
      }
      if (!lines.empty()) return piece;
    }
    return std::unique_ptr<Piece>();
  }

  /// Whether the last number of a file, whose text is the last one, may be cut off. White space behind it, or a
  /// quotation mark, tells that it is whole.
  static bool ends_openly(const CsvFile& file, std::string_view text) {
    const char last = text.empty() ? '\n' : text.back();
    const bool is_empty_field = last == file.table.separator && last != ' ';
    const bool is_closed = !is_empty_field && (last == '"' || std::isspace(static_cast<unsigned char>(last)));
    const std::size_t column = file.table.columns.size() - 1;
    const bool is_read = std::ranges::find(file.values, column) != file.values.end() ||
                         std::ranges::find(file.table.position, column) != file.table.position.end();
    return !is_closed && is_read;
  }

  /// Reads whole lines.
  Result<std::string> read_lines(const CsvFile& file, ByteSource& bytes) {
    SPLATVOL_TRY_ASSIGN(text, read_text(bytes, at_.offset, chunk_bytes));
    if (at_.offset + text.size() < file.bytes) {
      const std::size_t last = text.rfind('\n');
      if (last == std::string::npos)
        return fail(ErrorCode::invalid_data, "{}: line {} is longer than {} bytes", file.path, at_.line, chunk_bytes);
      text.resize(last + 1);
    } else if (text.empty()) {
      at_.offset = file.bytes;  // a file that has been cut meanwhile
    }
    at_.offset += text.size();
    return text;
  }

  /// Splits a text into the lines that hold values, and moves on by them.
  Result<std::vector<CsvLine>> split_lines(const CsvFile& file, std::string_view text) {
    std::vector<CsvLine> lines;
    for (std::size_t begin = 0; begin < text.size(); ++at_.line) {
      const std::size_t end = std::min(text.find('\n', begin), text.size());
      std::string_view line = text.substr(begin, end - begin);
      begin = end + 1;
      if (line.ends_with('\r')) line.remove_suffix(1);
      SPLATVOL_TRY_ASSIGN(is_value, holds_values(file, line));
      if (is_value) lines.push_back({line, at_.line});
    }
    return lines;
  }

  /// Whether a line is neither empty nor a comment, nor in a section that holds no values. Moves on by sections.
  Result<bool> holds_values(const CsvFile& file, std::string_view line) {
    using Section = Progress::Section;
    const std::string_view text = trimmed(line);
    if (text.empty() || (file.table.comment != 0 && text.front() == file.table.comment)) return false;
    if (!file.table.has_sections) return true;
    if (is_csv_section(line)) {
      at_.section = is_csv_data_section(line) ? Section::heading : Section::other;
      return false;
    }
    const Section section = at_.section;
    if (section != Section::heading) return section == Section::values;
    at_.section = Section::values;
    if (text != trimmed(file.table.heading))
      return fail(ErrorCode::invalid_data, "{}: line {}: not the columns of the first section [Data]", file.path,
                  at_.line);
    return false;
  }

  std::vector<CsvFile> files_;
  std::vector<std::string> attributes_, units_;
  MissingValues missing_;
  Progress at_;  // of make_piece()
  std::size_t returned_ = 0;
  bool ended_ = false;
  PieceAhead pieces_;
};

Result<CsvFile> open_table(const std::string& path, const std::vector<std::string>& names) {
  SPLATVOL_TRY_ASSIGN(bytes, open_file(path));
  SPLATVOL_TRY_ASSIGN(table, read_csv_table(*bytes, names));
  return CsvFile{path, bytes->size(), std::move(table), {}};
}

tl::unexpected<Error> fail_no_values(const std::string& path, const CsvTable& table) {
  const auto nameless = [](const CsvColumn& column) { return column.name.empty() && !column.is_text; };
  const auto column = std::ranges::find_if(table.columns, nameless);
  if (column == table.columns.end())
    return fail(ErrorCode::invalid_data, "{}: the points have no values, only positions: add a column with one", path);
  return fail(ErrorCode::invalid_data, "{}: column {} has no name; name all of them: --columns x,y,z,...", path,
              column - table.columns.begin() + 1);
}

Result<std::vector<CsvFile>> open_tables(const std::vector<std::string>& paths, const SourceOptions& options) {
  std::vector<CsvFile> files;
  for (const std::string& path : paths) {
    SPLATVOL_TRY_ASSIGN(file, open_table(path, options.columns));
    files.push_back(std::move(file));
  }
  return files;
}

Result<ArrayUnion> unite(const std::vector<CsvFile>& files) {
  std::vector<TableColumns> tables;
  for (const CsvFile& file : files) {
    TableColumns& columns = tables.emplace_back(TableColumns{file.path, {}});
    for (const std::size_t column : attribute_columns(file.table)) {
      columns.names.push_back(file.table.columns[column].name);
      columns.units.push_back(file.table.columns[column].unit);
    }
  }
  return unite_columns(tables);
}

/// Finds the columns of the attributes. A column of texts is none of them.
Status find_columns(const std::vector<std::string>& attributes, CsvFile& file) {
  std::unordered_map<std::string_view, std::size_t> column_of;
  for (const std::size_t column : attribute_columns(file.table))
    column_of.emplace(file.table.columns[column].name, column);
  for (const std::string& name : attributes) {
    const auto found = column_of.find(name);
    file.values.push_back(found == column_of.end() ? std::nullopt : std::optional(found->second));
    const auto has_texts = [&](const CsvColumn& column) { return column.name == name && column.is_text; };
    if (found == column_of.end() && std::ranges::any_of(file.table.columns, has_texts))
      return fail(ErrorCode::invalid_data, "{}: the column \"{}\" holds texts here, and numbers in another file",
                  file.path, name);
  }
  return {};
}

}  // namespace

Result<std::unique_ptr<Source>> open_csv_files(const std::vector<std::string>& paths, const SourceOptions& options) {
  SPLATVOL_TRY_ASSIGN(files, open_tables(paths, options));
  SPLATVOL_TRY_ASSIGN(columns, unite(files));
  SPLATVOL_TRY_ASSIGN(attributes, choose_columns(paths[0], columns, options));
  if (attributes.empty()) return fail_no_values(paths[0], files[0].table);
  std::vector<std::string> units;
  for (const std::string& name : attributes) units.push_back(columns.unit(name));
  for (CsvFile& file : files) SPLATVOL_TRY(find_columns(attributes, file));
  return std::make_unique<CsvSource>(std::move(files), std::move(attributes), std::move(units),
                                     MissingValues(options.missing));
}

Result<std::vector<ArrayShape>> list_csv_arrays(const std::vector<std::string>& paths, const SourceOptions& options) {
  SPLATVOL_TRY_ASSIGN(files, open_tables(paths, options));
  SPLATVOL_TRY_ASSIGN(columns, unite(files));
  return columns.arrays();
}

}  // namespace splatvol
