#include "builder/sources/numpy/npy_header.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <optional>
#include <span>

namespace splatvol {
namespace {

constexpr std::uint64_t max_header_bytes = 1 << 20;
constexpr std::uint64_t max_row_bytes = 1 << 20;
constexpr std::uint64_t max_columns = 4096;
constexpr int max_depth = 8;  // of literals in literals; a structured type has 4

/// A value of the header, which is a Python literal.
struct Literal {
  enum class Kind { text, number, boolean, sequence, dictionary };
  Kind kind;
  std::string text;
  std::uint64_t number = 0;    // of a boolean too
  std::vector<Literal> items;  // of a dictionary: key, value, key, value, ...

  [[nodiscard]] const Literal* find(std::string_view key) const {
    for (std::size_t i = 0; i + 1 < items.size(); i += 2)
      if (items[i].kind == Kind::text && items[i].text == key) return &items[i + 1];
    return nullptr;
  }
};

/// Reads the literals that NumPy writes: texts without escapes, whole numbers, True, False, tuples, lists,
/// dictionaries.
class LiteralReader {
 public:
  explicit LiteralReader(std::string_view text) : text_(text) {}

  /// Reads the text's only value; empty if the text is anything else.
  std::optional<Literal> read() {
    auto value = read_value(0);
    skip_space();
    return text_.empty() ? value : std::nullopt;
  }

 private:
  void skip_space() { text_.remove_prefix(std::min(text_.find_first_not_of(" \t\r\n"), text_.size())); }

  /// Skips `word` if it comes next.
  bool accept(std::string_view word) {
    skip_space();
    if (!text_.starts_with(word)) return false;
    text_.remove_prefix(word.size());
    return true;
  }

  std::optional<Literal> read_value(int depth) {
    if (depth == max_depth) return std::nullopt;
    if (accept("'")) return read_text('\'');
    if (accept("\"")) return read_text('"');
    if (accept("(")) return read_items(Literal::Kind::sequence, ")", depth);
    if (accept("[")) return read_items(Literal::Kind::sequence, "]", depth);
    if (accept("{")) return read_items(Literal::Kind::dictionary, "}", depth);
    if (accept("True")) return Literal{Literal::Kind::boolean, {}, 1, {}};
    if (accept("False")) return Literal{Literal::Kind::boolean, {}, 0, {}};
    return read_number();
  }

  std::optional<Literal> read_text(char quote) {
    const std::size_t end = text_.find(quote);
    Literal value{Literal::Kind::text, std::string(text_.substr(0, end)), 0, {}};
    if (end == std::string_view::npos || value.text.find('\\') != std::string::npos) return std::nullopt;
    text_.remove_prefix(end + 1);
    return value;
  }

  std::optional<Literal> read_number() {
    Literal value{Literal::Kind::number, {}, 0, {}};
    const auto [end, error] = std::from_chars(text_.data(), text_.data() + text_.size(), value.number);
    if (error != std::errc{}) return std::nullopt;
    text_.remove_prefix(static_cast<std::size_t>(end - text_.data()));
    accept("L");  // Python 2 wrote such numbers
    return value;
  }

  std::optional<Literal> read_items(Literal::Kind kind, std::string_view end, int depth) {
    Literal value{kind, {}, 0, {}};
    while (!accept(end)) {
      if (!value.items.empty() && !accept(",")) return std::nullopt;
      if (!value.items.empty() && accept(end)) break;
      auto item = read_value(depth + 1);
      if (!item) return std::nullopt;
      value.items.push_back(std::move(*item));
      if (kind != Literal::Kind::dictionary) continue;
      if (!accept(":")) return std::nullopt;
      auto mapped = read_value(depth + 1);
      if (!mapped) return std::nullopt;
      value.items.push_back(std::move(*mapped));
    }
    return value;
  }

  std::string_view text_;
};

tl::unexpected<Error> fail_damaged(const ByteSource& file) {
  return fail(ErrorCode::invalid_data, "{}: the .npy header is damaged", file.name());
}

/// Returns the header's text, and sets `data_offset` to the offset behind it.
Result<std::string> read_header_text(ByteSource& file, std::uint64_t& data_offset) {
  std::array<unsigned char, 12> start{};
  const std::uint64_t available = std::min<std::uint64_t>(file.size(), start.size());
  SPLATVOL_TRY(file.read(0, std::as_writable_bytes(std::span(start)).first(available)));
  if (!std::string_view(reinterpret_cast<const char*>(start.data()), available).starts_with(npy_magic))
    return fail(ErrorCode::invalid_data, "{}: not a .npy file", file.name());
  const int major = start[6], minor = start[7];
  if (available < start.size() || major < 1) return fail_damaged(file);
  if (major > 3 || minor > 0)
    return fail(ErrorCode::unsupported, "{}: .npy version {}.{} is newer than 3.0, the newest that this version reads",
                file.name(), major, minor);

  std::uint64_t bytes = start[8] + 256u * start[9];
  if (major > 1) bytes += 65536ull * start[10] + 16777216ull * start[11];
  data_offset = major > 1 ? 12 : 10;
  if (bytes > max_header_bytes || bytes > file.size() - data_offset) return fail_damaged(file);
  std::string text(bytes, '\0');
  SPLATVOL_TRY(file.read(data_offset, std::as_writable_bytes(std::span(text))));
  data_offset += bytes;
  return text;
}

/// Reads a type such as "<f8"; empty if the text is none.
std::optional<NpyColumn> parse_type(std::string_view text) {
  if (text.size() < 3 || std::string_view("<>=|").find(text[0]) == std::string_view::npos) return std::nullopt;
  NpyColumn column;
  const char* end = text.data() + text.size();
  if (std::from_chars(text.data() + 2, end, column.bytes).ec != std::errc{} || column.bytes > max_row_bytes)
    return std::nullopt;
  column.big_endian = text[0] == '>';
  const std::uint32_t bytes = column.bytes;
  const bool is_power = bytes == 1 || bytes == 2 || bytes == 4 || bytes == 8;
  if (text[1] == 'f' && (bytes == 4 || bytes == 8)) column.kind = NpyColumn::Kind::real;
  if (text[1] == 'i' && is_power) column.kind = NpyColumn::Kind::integer;
  if (text[1] == 'u' && is_power) column.kind = NpyColumn::Kind::natural;
  if (text[1] == 'U') column.bytes *= 4;  // counts characters
  return column;
}

tl::unexpected<Error> fail_type(const ByteSource& file, const std::string& type) {
  return fail(ErrorCode::unsupported, "{}: an array of type \"{}\"; of floats of 4 or 8 bytes or integers are read",
              file.name(), type);
}

Status add_fields(const ByteSource& file, const Literal& type, NpyTable& table) {
  for (const Literal& field : type.items) {
    const std::size_t parts = field.items.size();
    if (field.kind != Literal::Kind::sequence || parts < 2 || parts > 3) return fail_damaged(file);
    // A name may come in a pair: (title, name).
    const Literal& label = field.items[0];
    const Literal& name = label.items.size() == 2 ? label.items[1] : label;
    if (name.kind != Literal::Kind::text) return fail_damaged(file);
    const std::string& code = field.items[1].text;
    if (field.items[1].kind != Literal::Kind::text || parts > 2)
      return fail(ErrorCode::unsupported, "{}: its field \"{}\" is not a single number", file.name(), name.text);
    auto column = parse_type(code);
    if (!column) return code.find('O') < 2 ? fail_type(file, code) : fail_damaged(file);
    column->name = name.text;
    column->offset = table.stride;
    table.stride += column->bytes;
    table.columns.push_back(std::move(*column));
    if (table.stride > max_row_bytes || table.columns.size() > max_columns)
      return fail(ErrorCode::unsupported, "{}: rows of more than {} columns or {} bytes", file.name(), max_columns,
                  max_row_bytes);
  }
  return {};
}

Status add_numbers(const ByteSource& file, const std::string& type, std::uint64_t count, bool fortran_order,
                   NpyTable& table) {
  const auto number = parse_type(type);
  if (!number || number->kind == NpyColumn::Kind::other) return fail_type(file, type);
  if (count > max_columns)
    return is_transposed(table.rows, count)
               ? fail_transposed(file.name(), table.rows, count)
               : fail(ErrorCode::unsupported, "{}: {} columns; at most {} are read", file.name(), count, max_columns);
  table.columns.assign(count, *number);
  table.columns_apart = fortran_order;
  table.stride = number->bytes * (fortran_order ? 1 : count);
  return {};
}

}  // namespace

bool is_transposed(std::uint64_t rows, std::uint64_t columns) { return rows >= 3 && rows <= 16 && columns > 4 * rows; }

tl::unexpected<Error> fail_transposed(const std::string& path, std::uint64_t rows, std::uint64_t columns) {
  return fail(ErrorCode::invalid_data,
              "{}: {} points with {} columns each: if these are the points, transpose the array (numpy.save(OUT, "
              "a.T)); if not, name the columns by --columns",
              path, rows, columns);
}

Result<NpyTable> read_npy_header(ByteSource& file) {
  NpyTable table;
  SPLATVOL_TRY_ASSIGN(text, read_header_text(file, table.data_offset));
  const auto header = LiteralReader(text).read();
  const Literal* type = header ? header->find("descr") : nullptr;
  const Literal* order = header ? header->find("fortran_order") : nullptr;
  const Literal* shape = header ? header->find("shape") : nullptr;
  if (!type || !order || !shape || order->kind != Literal::Kind::boolean || shape->kind != Literal::Kind::sequence ||
      !std::ranges::all_of(shape->items, [](const Literal& n) { return n.kind == Literal::Kind::number; }))
    return fail_damaged(file);

  table.structured = type->kind == Literal::Kind::sequence;
  if (shape->items.size() != (table.structured ? 1u : 2u))
    return fail(ErrorCode::invalid_data, "{}: an array of {} dimensions; a table of points has {}", file.name(),
                shape->items.size(), table.structured ? "one, of rows" : "two, points times columns");
  table.rows = shape->items[0].number;
  SPLATVOL_TRY(table.structured ? add_fields(file, *type, table)
                                : add_numbers(file, type->text, shape->items[1].number, order->number == 1, table));

  // The bytes of one row, even if its numbers lie apart (Fortran order).
  std::uint64_t row_bytes = 0;
  for (const NpyColumn& column : table.columns) row_bytes += column.bytes;
  const std::uint64_t bytes = file.size() - table.data_offset;
  if (row_bytes == 0 || bytes % row_bytes != 0 || bytes / row_bytes != table.rows)
    return fail(ErrorCode::invalid_data, "{}: {} bytes of data, and not {} rows of {}", file.name(), bytes, table.rows,
                row_bytes);
  for (std::size_t i = 0; i < table.columns.size(); ++i)
    table.columns[i].offset =
        table.data_offset + (table.structured ? table.columns[i].offset
                                              : i * table.columns[i].bytes * (table.columns_apart ? table.rows : 1));
  return table;
}

}  // namespace splatvol
