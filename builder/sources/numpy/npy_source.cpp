#include "builder/sources/numpy/npy_source.h"

#include <fmt/format.h>
#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <optional>
#include <span>
#include <utility>

#include "base/file.h"
#include "base/names.h"
#include "builder/sources/array_union.h"
#include "builder/sources/far_points.h"
#include "builder/sources/numpy/npy_header.h"
#include "builder/sources/piece_ahead.h"
#include "builder/sources/repeated_pieces.h"

namespace splatvol {
namespace {

constexpr std::uint64_t max_read_bytes = 16 << 20;

/// A file, with its columns by their use.
struct NpyFile {
  std::string path;
  NpyTable table;
  std::array<NpyColumn, 3> position;
  std::vector<std::optional<NpyColumn>> values;  // [attribute]; none: the file lacks it

  /// Whether single precision holds every number of the columns that are read.
  [[nodiscard]] bool single_precision() const {
    const auto exact = [](const NpyColumn& column) {
      return column.bytes < 4 || (column.bytes == 4 && column.kind == NpyColumn::Kind::real);
    };
    return std::ranges::all_of(position, exact) &&
           std::ranges::all_of(values, [&](const auto& column) { return !column || exact(*column); });
  }
};

/// Rows that are read at once: a piece.
struct RowRange {
  std::size_t file;
  std::uint64_t first;
  std::size_t count;
};

/// Converts numbers that lie `stride` bytes apart to doubles that lie `to_stride` doubles apart.
template <class T>
void convert(const std::byte* from, std::size_t stride, bool swap, std::size_t count, double* to,
             std::size_t to_stride) {
  std::array<std::byte, sizeof(T)> raw;
  for (std::size_t i = 0; i < count; ++i, from += stride, to += to_stride) {
    T value;
    std::memcpy(&raw, from, sizeof(T));
    if (swap) std::ranges::reverse(raw);
    std::memcpy(&value, &raw, sizeof(T));
    *to = static_cast<double>(value);
  }
}

auto converter(const NpyColumn& column) {
  switch (column.kind) {
    case NpyColumn::Kind::real:
      return column.bytes == 4 ? convert<float> : convert<double>;
    case NpyColumn::Kind::integer:
      return column.bytes == 1   ? convert<std::int8_t>
             : column.bytes == 2 ? convert<std::int16_t>
             : column.bytes == 4 ? convert<std::int32_t>
                                 : convert<std::int64_t>;
    default:
      return column.bytes == 1   ? convert<std::uint8_t>
             : column.bytes == 2 ? convert<std::uint16_t>
             : column.bytes == 4 ? convert<std::uint32_t>
                                 : convert<std::uint64_t>;
  }
}

/// Where the numbers of a column go: `stride` doubles apart.
struct Target {
  NpyColumn column;
  double* to;
  std::size_t stride;
};

void add_points(const NpyFile& file, std::span<dvec3> points, std::vector<Target>& targets) {
  for (std::size_t axis = 0; axis < 3; ++axis) targets.push_back({file.position[axis], &points[0].x + axis, 3});
}

/// Reads columns of a range of rows, in parts that stay in the cache. Fails if the file can no longer be opened.
Status read_rows(const NpyFile& file, const RowRange& rows, std::span<const Target> targets) {
  constexpr std::size_t most_bytes = 1 << 17;
  SPLATVOL_TRY_ASSIGN(bytes, open_file(file.path));
  const std::size_t stride = file.table.stride, most = std::max<std::size_t>(most_bytes / stride, 1);
  std::vector<std::byte> part;
  const auto read = [&](std::uint64_t offset, std::span<const Target> columns) -> Status {
    for (std::size_t first = 0; first < rows.count; first += most) {
      const std::size_t count = std::min(most, rows.count - first);
      part.resize(count * stride);
      SPLATVOL_TRY(bytes->read(offset + (rows.first + first) * stride, part));
      for (const auto& [column, to, to_stride] : columns)
        converter(column)(part.data() + (column.offset - offset), stride, column.big_endian, count,
                          to + first * to_stride, to_stride);
    }
    return {};
  };
  if (!file.table.columns_apart) return read(file.table.data_offset, targets);
  for (const Target& target : targets) SPLATVOL_TRY(read(target.column.offset, {&target, 1}));
  return {};
}

std::vector<RowRange> divide(const std::vector<NpyFile>& files) {
  std::vector<RowRange> ranges;
  for (std::size_t f = 0; f < files.size(); ++f) {
    const NpyTable& table = files[f].table;
    const std::uint64_t most = std::clamp<std::uint64_t>(max_read_bytes / table.stride, 1, max_piece_points);
    for (std::uint64_t first = 0; first < table.rows; first += most)
      ranges.push_back({f, first, static_cast<std::size_t>(std::min(most, table.rows - first))});
  }
  return ranges;
}

class NpySource final : public Source {
 public:
  NpySource(std::vector<NpyFile> files, std::vector<std::string> attributes, const MissingValues& missing)
      : files_(std::move(files)),
        attributes_(std::move(attributes)),
        missing_(missing),
        ranges_(divide(files_)),
        may_be_far_(ranges_.size(), true),
        pieces_(ranges_.size(), [this](std::size_t piece) { return make_piece(piece); }) {}

  const std::vector<std::string>& attributes() const override { return attributes_; }
  std::size_t piece_count() const override { return pieces_.count(); }

  std::vector<std::uint64_t> part_sizes() override {
    std::vector<std::uint64_t> rows;
    for (const RowRange& range : ranges_) rows.push_back(range.count);
    return rows;
  }
  Status select(const std::vector<std::uint64_t>& parts) override {
    pieces_.select(parts);
    return {};
  }
  PieceNumber piece_number() const override {
    return {static_cast<std::uint32_t>(ranges_[pieces_.last()].file), static_cast<std::uint32_t>(pieces_.last())};
  }

  Result<std::unique_ptr<Piece>> next() override {
    SPLATVOL_TRY_ASSIGN(piece, pieces_.next());
    if (piece && files_.size() > 1) SPLATVOL_TRY(repeats_.add(files_[ranges_[pieces_.last()].file].path, *piece));
    return piece;
  }

  bool single_precision() const override { return std::ranges::all_of(files_, &NpyFile::single_precision); }
  bool may_have_cells() const override { return false; }

  std::optional<std::uint64_t> point_count() const override {
    std::uint64_t count = 0;
    for (const NpyFile& file : files_) count += file.table.rows;
    return count;
  }

  std::vector<std::string> conversions() const override {
    std::vector<std::string> lacking;
    for (std::size_t a = 0; a < attributes_.size(); ++a)
      if (std::ranges::any_of(files_, [a](const NpyFile& file) { return !file.values[a]; }))
        lacking.push_back(attributes_[a]);
    return lacking.empty() ? lacking : std::vector{describe_lacking(lacking)};
  }

  Result<std::optional<Box>> bounds() override {
    std::vector<Result<NearPoints>> found(ranges_.size(), NearPoints{});
    tbb::parallel_for(std::size_t{0}, ranges_.size(), [&](std::size_t r) { found[r] = find_near_points(ranges_[r]); });
    Box all;
    for (std::size_t r = 0; r < found.size(); ++r) {
      SPLATVOL_TRY(found[r]);
      all.include(found[r]->box);
      may_be_far_[r] = found[r]->dropped > 0;
    }
    return all.low.x <= all.high.x ? std::optional(all) : std::nullopt;
  }

 private:
  Result<std::unique_ptr<Piece>> make_piece(std::size_t number) const {
    const RowRange& rows = ranges_[number];
    const NpyFile& file = files_[rows.file];
    auto piece = std::make_unique<Piece>();
    piece->points.resize(rows.count);
    std::vector<Target> targets;
    add_points(file, piece->points, targets);
    for (const std::optional<NpyColumn>& column : file.values) {
      std::vector<double>& values = piece->values.emplace_back(rows.count, missing_value);
      if (column) targets.push_back({*column, values.data(), 1});
    }
    SPLATVOL_TRY(read_rows(file, rows, targets));
    if (may_be_far_[number]) drop_far_points(piece->points);
    for (std::vector<double>& values : piece->values) piece->fills.push_back(missing_.replace(values));
    return piece;
  }

  Result<NearPoints> find_near_points(const RowRange& rows) const {
    const NpyFile& file = files_[rows.file];
    std::vector<dvec3> points(rows.count);
    std::vector<Target> targets;
    add_points(file, points, targets);
    SPLATVOL_TRY(read_rows(file, rows, targets));
    return drop_far_points(points);
  }

  std::vector<NpyFile> files_;
  std::vector<std::string> attributes_;
  MissingValues missing_;
  std::vector<RowRange> ranges_;
  std::vector<bool> may_be_far_;  // [range]: whether it may have far points; bounds() finds out
  PieceAhead pieces_;
  RepeatedPieces repeats_;
};

bool is_position(const std::string& name) { return name == "x" || name == "y" || name == "z"; }
bool is_skipped(const std::string& name) { return name.empty() || name == "_"; }

Status name_columns(const std::string& path, const std::vector<std::string>& names, NpyTable& table) {
  const std::size_t count = table.columns.size();
  if (!names.empty() && names.size() != count)
    return fail(ErrorCode::invalid_argument, "{}: {} columns, but {} names for them", path, count, names.size());
  if (names.empty() && !table.structured && is_transposed(table.rows, count))
    return fail_transposed(path, table.rows, count);
  for (std::size_t i = 0; i < count; ++i) {
    std::string& name = table.columns[i].name;
    if (!names.empty())
      name = names[i];
    else if (!table.structured)
      name = i < 3 ? std::string(1, "xyz"[i]) : count == 4 ? "value" : fmt::format("value{}", i - 3);
  }
  std::vector<std::string> read;
  for (const NpyColumn& column : table.columns)
    if (!is_skipped(column.name)) read.push_back(column.name);
  if (const auto duplicate = find_duplicate(std::move(read)))
    return fail(ErrorCode::invalid_argument, "{}: two columns are called \"{}\"", path, *duplicate);
  return {};
}

std::vector<std::string> attributes_of(const NpyTable& table) {
  std::vector<std::string> names;
  for (const NpyColumn& column : table.columns)
    if (column.kind != NpyColumn::Kind::other && !is_position(column.name) && !is_skipped(column.name))
      names.push_back(column.name);
  return names;
}

/// None if there is no such column.
Result<std::optional<NpyColumn>> find_column(const NpyFile& file, const std::string& name) {
  const auto& columns = file.table.columns;
  const auto column = std::ranges::find(columns, name, &NpyColumn::name);
  if (column != columns.end() && column->kind != NpyColumn::Kind::other) return std::optional(*column);
  if (column != columns.end())
    return fail(ErrorCode::unsupported, "{}: column \"{}\" holds neither floats of 4 or 8 bytes nor integers",
                file.path, name);
  return std::nullopt;
}

Result<NpyFile> open_table(const std::string& path, const std::vector<std::string>& names) {
  SPLATVOL_TRY_ASSIGN(bytes, open_file(path));
  SPLATVOL_TRY_ASSIGN(table, read_npy_header(*bytes));
  SPLATVOL_TRY(name_columns(path, names, table));
  NpyFile file{path, std::move(table), {}, {}};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::string name(1, "xyz"[axis]);
    SPLATVOL_TRY_ASSIGN(column, find_column(file, name));
    if (!column) return fail(ErrorCode::invalid_data, "{}: no column \"{}\"", path, name);
    file.position[axis] = *column;
  }
  return file;
}

Result<std::vector<NpyFile>> open_tables(const std::vector<std::string>& paths, const SourceOptions& options) {
  std::vector<NpyFile> files;
  for (const std::string& path : paths) {
    SPLATVOL_TRY_ASSIGN(file, open_table(path, options.columns));
    files.push_back(std::move(file));
  }
  return files;
}

/// Columns without names are known by their order: all files need as many.
Status check_unnamed(const std::vector<NpyFile>& files) {
  const NpyFile* first = nullptr;
  for (const NpyFile& file : files) {
    if (file.table.structured) continue;
    if (!first) first = &file;
    if (file.table.columns.size() != first->table.columns.size())
      return fail(ErrorCode::invalid_data,
                  "{}: {} columns, and {} in {}, and nothing tells which are the same: write them with names (a "
                  "structured type)",
                  file.path, file.table.columns.size(), first->table.columns.size(), first->path);
  }
  return {};
}

Result<ArrayUnion> unite(const std::vector<NpyFile>& files) {
  SPLATVOL_TRY(check_unnamed(files));
  std::vector<TableColumns> tables;
  for (const NpyFile& file : files) tables.push_back({file.path, attributes_of(file.table)});
  return unite_columns(tables);
}

}  // namespace

Result<std::unique_ptr<Source>> open_npy_files(const std::vector<std::string>& paths, const SourceOptions& options) {
  SPLATVOL_TRY_ASSIGN(files, open_tables(paths, options));
  // Fails if a selected column holds no numbers.
  for (const std::string& name : options.selection) SPLATVOL_TRY(find_column(files[0], name));
  SPLATVOL_TRY_ASSIGN(columns, unite(files));
  SPLATVOL_TRY_ASSIGN(attributes, choose_columns(paths[0], columns, options));
  if (attributes.empty())
    return fail(ErrorCode::invalid_data, "{}: the points have no values, only positions: add a column with one",
                paths[0]);
  std::uint64_t points = 0;
  for (NpyFile& file : files) {
    for (const std::string& name : attributes) {
      SPLATVOL_TRY_ASSIGN(column, find_column(file, name));
      file.values.push_back(column);
    }
    points += file.table.rows;
  }
  if (points == 0) return fail(ErrorCode::invalid_data, "{}: no points", paths[0]);
  return std::make_unique<NpySource>(std::move(files), std::move(attributes), MissingValues(options.missing));
}

Result<std::vector<ArrayShape>> list_npy_arrays(const std::vector<std::string>& paths, const SourceOptions& options) {
  SPLATVOL_TRY_ASSIGN(files, open_tables(paths, options));
  SPLATVOL_TRY_ASSIGN(columns, unite(files));
  return columns.arrays();
}

}  // namespace splatvol
