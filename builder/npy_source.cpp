#include "builder/npy_source.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <span>
#include <utility>

#include "base/file.h"
#include "base/names.h"
#include "builder/npy_header.h"
#include "builder/piece_ahead.h"

namespace splatvol {
namespace {

constexpr std::uint64_t max_read_bytes = 16 << 20;
constexpr double infinity = std::numeric_limits<double>::infinity();

/// A file, and which of its columns are what.
struct NpyFile {
  std::string path;
  NpyTable table;
  std::array<NpyColumn, 3> position;
  std::vector<NpyColumn> values;  // [attribute]

  /// Of all columns that are read.
  [[nodiscard]] bool single_precision() const {
    const auto exact = [](const NpyColumn& column) {
      return column.bytes < 4 || (column.bytes == 4 && column.kind == NpyColumn::Kind::real);
    };
    return std::ranges::all_of(position, exact) && std::ranges::all_of(values, exact);
  }
};

/// Rows that are read at once.
struct Block {
  std::size_t file;
  std::uint64_t first;
  std::size_t rows;
};

/// Numbers that lie `stride` bytes apart, to ones `step` numbers apart.
template <class T>
void convert(const std::byte* from, std::size_t stride, bool swap, std::size_t count, double* to, std::size_t step) {
  std::array<std::byte, sizeof(T)> raw;
  for (std::size_t i = 0; i < count; ++i, from += stride, to += step) {
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

/// The bytes of a block, and numbers from them.
class BlockReader {
 public:
  /// Fails where the file cannot be opened any more.
  static Result<BlockReader> open(const NpyFile& file, const Block& block) {
    SPLATVOL_TRY_ASSIGN(bytes, open_file(file.path));
    BlockReader reader(std::move(bytes), file.table, block);
    if (!file.table.columns_apart) SPLATVOL_TRY(reader.read(file.table.data));
    return reader;
  }

  Status get(const NpyColumn& column, double* to, std::size_t step) {
    if (table_.columns_apart) SPLATVOL_TRY(read(column.offset));
    const std::uint64_t within = table_.columns_apart ? 0 : column.offset - table_.data;
    converter(column)(buffer_.data() + within, table_.stride, column.big_endian, block_.rows, to, step);
    return {};
  }

  Status get_points(const std::array<NpyColumn, 3>& columns, std::span<dvec3> points) {
    for (std::size_t axis = 0; axis < 3; ++axis) SPLATVOL_TRY(get(columns[axis], &points[0].x + axis, 3));
    return {};
  }

 private:
  BlockReader(std::unique_ptr<ByteSource> file, const NpyTable& table, const Block& block)
      : file_(std::move(file)), table_(table), block_(block), buffer_(block.rows * table.stride) {}

  /// The block's part of what begins at `offset`.
  Status read(std::uint64_t offset) { return file_->read(offset + block_.first * table_.stride, buffer_); }

  std::unique_ptr<ByteSource> file_;
  const NpyTable& table_;
  const Block& block_;
  std::vector<std::byte> buffer_;
};

std::vector<Block> divide(const std::vector<NpyFile>& files) {
  std::vector<Block> blocks;
  for (std::size_t f = 0; f < files.size(); ++f) {
    const NpyTable& table = files[f].table;
    const std::uint64_t rows = std::clamp<std::uint64_t>(max_read_bytes / table.stride, 1, max_piece_points);
    for (std::uint64_t first = 0; first < table.rows; first += rows)
      blocks.push_back({f, first, static_cast<std::size_t>(std::min(rows, table.rows - first))});
  }
  return blocks;
}

class NpySource final : public Source {
 public:
  NpySource(std::vector<NpyFile> files, std::vector<std::string> attributes)
      : files_(std::move(files)),
        attributes_(std::move(attributes)),
        blocks_(divide(files_)),
        pieces_(blocks_.size(), [this](std::size_t piece) { return make_piece(blocks_[piece]); }) {}

  const std::vector<std::string>& attributes() const override { return attributes_; }
  std::size_t piece_count() const override { return pieces_.count(); }
  Result<std::unique_ptr<Piece>> next() override { return pieces_.next(); }
  bool single_precision() const override { return std::ranges::all_of(files_, &NpyFile::single_precision); }
  bool may_have_cells() const override { return false; }

  std::optional<std::uint64_t> point_count() const override {
    std::uint64_t count = 0;
    for (const NpyFile& file : files_) count += file.table.rows;
    return count;
  }

  Result<std::optional<Box>> bounds() override {
    std::vector<Result<Box>> boxes(blocks_.size(), Box{});
    tbb::parallel_for(std::size_t{0}, blocks_.size(), [&](std::size_t b) { boxes[b] = find_box(blocks_[b]); });
    Box all{dvec3(infinity), dvec3(-infinity)};
    for (const Result<Box>& box : boxes) {
      SPLATVOL_TRY(box);
      all = {glm::min(all.low, box->low), glm::max(all.high, box->high)};
    }
    return all.low.x <= all.high.x ? std::optional(all) : std::nullopt;
  }

 private:
  Result<std::unique_ptr<Piece>> make_piece(const Block& block) const {
    const NpyFile& file = files_[block.file];
    SPLATVOL_TRY_ASSIGN(reader, BlockReader::open(file, block));
    auto piece = std::make_unique<Piece>();
    piece->points.resize(block.rows);
    SPLATVOL_TRY(reader.get_points(file.position, piece->points));
    for (const NpyColumn& column : file.values) {
      std::vector<double>& values = piece->values.emplace_back(block.rows);
      SPLATVOL_TRY(reader.get(column, values.data(), 1));
      for (double& value : values) value = std::isfinite(value) ? value : std::numeric_limits<double>::quiet_NaN();
    }
    return piece;
  }

  /// Empty where no point is finite.
  Result<Box> find_box(const Block& block) const {
    const NpyFile& file = files_[block.file];
    SPLATVOL_TRY_ASSIGN(reader, BlockReader::open(file, block));
    std::vector<dvec3> points(block.rows);
    SPLATVOL_TRY(reader.get_points(file.position, points));
    Box box{dvec3(infinity), dvec3(-infinity)};
    for (const dvec3& p : points) {
      if (!std::isfinite(p.x) || !std::isfinite(p.y) || !std::isfinite(p.z)) continue;
      box = {glm::min(box.low, p), glm::max(box.high, p)};
    }
    return box;
  }

  std::vector<NpyFile> files_;
  std::vector<std::string> attributes_;
  std::vector<Block> blocks_;
  PieceAhead pieces_;
};

bool is_position(const std::string& name) { return name == "x" || name == "y" || name == "z"; }
bool is_skipped(const std::string& name) { return name.empty() || name == "_"; }

/// Gives every column its name.
Status name_columns(const std::string& path, const std::vector<std::string>& names, NpyTable& table) {
  const std::size_t count = table.columns.size();
  if (!names.empty() && names.size() != count)
    return fail(ErrorCode::invalid_argument, "{}: {} columns, but {} names for them", path, count, names.size());
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

Result<NpyColumn> find_column(const NpyFile& file, const std::string& name) {
  const auto& columns = file.table.columns;
  const auto column = std::ranges::find(columns, name, &NpyColumn::name);
  if (column != columns.end() && column->kind != NpyColumn::Kind::other) return *column;
  if (column != columns.end())
    return fail(ErrorCode::unsupported, "{}: column \"{}\" holds neither floats of 4 or 8 bytes nor integers",
                file.path, name);
  if (is_position(name)) return fail(ErrorCode::invalid_data, "{}: no column \"{}\"", file.path, name);
  return fail_no_attribute(file.path, name, attributes_of(file.table));
}

Result<NpyFile> open_table(const std::string& path, const std::vector<std::string>& names) {
  SPLATVOL_TRY_ASSIGN(bytes, open_file(path));
  SPLATVOL_TRY_ASSIGN(table, read_npy_header(*bytes));
  SPLATVOL_TRY(name_columns(path, names, table));
  NpyFile file{path, std::move(table), {}, {}};
  for (std::size_t axis = 0; axis < 3; ++axis) {
    SPLATVOL_TRY_ASSIGN(column, find_column(file, std::string(1, "xyz"[axis])));
    file.position[axis] = column;
  }
  return file;
}

}  // namespace

Result<std::unique_ptr<Source>> open_npy_files(const std::vector<std::string>& paths, const SourceOptions& options) {
  std::vector<NpyFile> files;
  std::vector<std::string> attributes = options.selection;
  std::uint64_t points = 0;
  for (const std::string& path : paths) {
    SPLATVOL_TRY_ASSIGN(file, open_table(path, options.columns));
    if (attributes.empty()) attributes = attributes_of(file.table);
    if (attributes.empty()) return fail(ErrorCode::invalid_data, "{}: the points have no values, only positions", path);
    for (const std::string& name : attributes) {
      SPLATVOL_TRY_ASSIGN(column, find_column(file, name));
      file.values.push_back(column);
    }
    points += file.table.rows;
    files.push_back(std::move(file));
  }
  if (points == 0) return fail(ErrorCode::invalid_data, "{}: no points", paths[0]);
  return std::make_unique<NpySource>(std::move(files), std::move(attributes));
}

}  // namespace splatvol
