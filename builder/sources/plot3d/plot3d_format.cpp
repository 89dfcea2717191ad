#include "builder/sources/plot3d/plot3d_format.h"

#include <fmt/format.h>

#include <bit>
#include <filesystem>
#include <optional>
#include <string_view>
#include <system_error>

#include "base/names.h"
#include "base/printable.h"
#include "base/replaceable.h"
#include "builder/sources/array_attributes.h"
#include "builder/sources/read_text.h"

namespace splatvol {
namespace {

constexpr std::uint64_t most_blocks = 1 << 20;

/// The header of a grid or solution.
struct Header {
  std::vector<std::uint64_t> points;      // of each block
  std::vector<std::uint32_t> dimensions;  // of all blocks, one after the other
  std::vector<std::uint64_t> functions;   // of each block, in a file of functions
  std::uint64_t bytes = 0;
  bool more_variables = false;  // Overflow's solutions: the header has two more numbers
  std::uint64_t variables = 0;  // the first of these
};

/// Reads the numbers of a header one by one; all are 0 past the end.
class HeaderReader {
 public:
  HeaderReader(ByteSource& file, bool big_endian) : file_(file), big_endian_(big_endian) {}

  std::uint32_t next() {
    const auto raw = read_text(file_, offset_, 4);
    if (!raw || raw->size() < 4) return 0;
    offset_ += raw->size();
    return static_cast<std::uint32_t>(number_in(*raw, big_endian_));
  }
  [[nodiscard]] std::uint64_t offset() const { return offset_; }

 private:
  ByteSource& file_;
  bool big_endian_;
  std::uint64_t offset_ = 0;
};

/// Empty if the file's first bytes are no header of this variant. `of_functions`: each block has their number, too.
std::optional<Header> read_header(ByteSource& file, const Plot3dFormat& format, bool of_functions = false) {
  HeaderReader reader(file, format.big_endian);
  const auto record = [&](std::uint32_t bytes) { return !format.record_marks || reader.next() == bytes; };
  std::uint32_t blocks = 1;
  if (format.multi_grid) {
    if (!record(4)) return std::nullopt;
    blocks = reader.next();
    if (!record(4) || blocks == 0 || blocks > most_blocks) return std::nullopt;
  }

  Header header;
  const auto numbers = blocks * (static_cast<std::uint32_t>(format.dimensions) + (of_functions ? 1 : 0));
  const std::uint32_t mark = format.record_marks ? reader.next() : 0;
  header.more_variables = format.record_marks && mark == 4 * (numbers + 2);
  if (format.record_marks && mark != 4 * numbers && !header.more_variables) return std::nullopt;
  for (std::uint32_t block = 0; block < blocks; ++block) {
    std::uint64_t points = 1;
    for (int axis = 0; axis < format.dimensions; ++axis) {
      header.dimensions.push_back(reader.next());
      points *= header.dimensions.back();
      if (points == 0 || points > file.size()) return std::nullopt;
    }
    header.points.push_back(points);
    if (!of_functions) continue;
    header.functions.push_back(reader.next());
    if (header.functions.back() == 0 || header.functions.back() > AttributeCount::most) return std::nullopt;
  }
  if (header.more_variables) header.variables = reader.next(), reader.next();
  if (!record(mark)) return std::nullopt;
  header.bytes = reader.offset();
  return header;
}

std::uint64_t grid_bytes(const Header& header, const Plot3dFormat& format) {
  const auto per_point = static_cast<std::uint64_t>(format.dimensions * format.precision + (format.blanking ? 4 : 0));
  std::uint64_t bytes = header.bytes;
  for (const std::uint64_t points : header.points) bytes += points * per_point + (format.record_marks ? 8 : 0);
  return bytes;
}

/// Four numbers about the flow, then density, momentum and energy of all points.
std::uint64_t solution_bytes(const Header& header, const Plot3dFormat& format) {
  const auto precision = static_cast<std::uint64_t>(format.precision);
  const auto variables = static_cast<std::uint64_t>(format.dimensions) + 2;
  std::uint64_t bytes = header.bytes;
  for (const std::uint64_t points : header.points)
    bytes += (4 + points * variables) * precision + (format.record_marks ? 16 : 0);
  return bytes;
}

bool fits(std::uint64_t size, std::uint64_t expected, bool padded) {
  return size == (padded ? (expected + 511) / 512 * 512 : expected);
}

std::vector<Plot3dFormat> variants() {
  std::vector<Plot3dFormat> all;
  for (const int dimensions : {3, 2})
    for (const int precision : {4, 8})
      for (unsigned flags = 0; flags < 16; ++flags)
        all.push_back({(flags & 1) != 0, (flags & 2) != 0, (flags & 4) != 0, (flags & 8) != 0, dimensions, precision});
  return all;
}

/// Whether a solution of Overflow's has room for its variables. VTK's reader does not check their number.
bool holds_variables(ByteSource& solution, const Header& header, const Plot3dFormat& format) {
  if (header.variables < static_cast<std::uint64_t>(format.dimensions) + 2 || header.variables > AttributeCount::most)
    return false;
  std::uint64_t bytes = header.bytes;
  for (const std::uint64_t points : header.points)
    bytes += points * header.variables * static_cast<std::uint64_t>(format.precision);
  return bytes <= solution.size();
}

bool solution_agrees(ByteSource& solution, const Header& grid_header, const Plot3dFormat& format) {
  const auto header = read_header(solution, format);
  if (!header || header->dimensions != grid_header.dimensions) return false;
  if (header->more_variables) return holds_variables(solution, *header, format);
  const std::uint64_t expected = solution_bytes(*header, format);
  return fits(solution.size(), expected, false) || fits(solution.size(), expected, true);
}

/// The functions of each block; empty if the file has none on this grid.
std::vector<Plot3dFormat::Functions> find_functions(ByteSource& file, const Header& grid_header,
                                                    const Plot3dFormat& format) {
  const auto header = read_header(file, format, true);
  if (!header || header->more_variables || header->dimensions != grid_header.dimensions) return {};
  const std::uint64_t mark = format.record_marks ? 4 : 0;
  std::vector<Plot3dFormat::Functions> functions;
  std::uint64_t end = header->bytes;
  for (std::size_t block = 0; block < header->points.size(); ++block) {
    const std::uint64_t points = header->points[block], count = header->functions[block];
    functions.push_back({count, points, end + mark});
    end += 2 * mark + points * count * static_cast<std::uint64_t>(format.precision);
    if (end > file.size()) return {};
  }
  return fits(file.size(), end, false) || fits(file.size(), end, true) ? functions
                                                                       : std::vector<Plot3dFormat::Functions>();
}

}  // namespace

Result<Plot3dFormat> detect_plot3d(ByteSource& grid, ByteSource& values) {
  const bool is_named_as_solution = has_extension(values.name(), ".q") || has_extension(values.name(), ".sol");
  bool grid_found = false;
  for (const bool padded : {false, true})
    for (Plot3dFormat& format : variants()) {
      const auto header = read_header(grid, format);
      if (!header || header->more_variables || !fits(grid.size(), grid_bytes(*header, format), padded)) continue;
      grid_found = true;
      if (!is_named_as_solution) format.functions = find_functions(values, *header, format);
      if (!format.functions.empty() || solution_agrees(values, *header, format)) return format;
    }
  if (grid_found)
    return fail(ErrorCode::invalid_data,
                "{}: not a PLOT3D solution, nor functions, on the grid {}: dimensions or size differ", values.name(),
                grid.name());
  return fail(ErrorCode::invalid_data, "{}: neither a VTK file nor a binary PLOT3D grid (or it is truncated)",
              grid.name());
}

Result<std::vector<std::string>> plot3d_function_names(const std::string& path, std::size_t count) {
  std::vector<std::string> names;
  const std::string of_names = std::filesystem::path(path).replace_extension(".nam").string();
  std::error_code error;
  if (!std::filesystem::exists(of_names, error)) {
    for (std::size_t i = 0; i < count; ++i) names.push_back(fmt::format("f{}", i + 1));
    return names;
  }
  SPLATVOL_TRY_ASSIGN(text, read_text_file(of_names));
  for (std::string_view rest = without_byte_order_mark(text); !rest.empty();) {
    const std::string_view line = take_line(rest), name = trimmed(line.substr(0, line.find(';')));
    if (!name.empty()) names.push_back(as_utf8(name));
  }
  if (const auto duplicate = find_duplicate(names))
    return fail(ErrorCode::invalid_data, "{}: two functions are called \"{}\": rename one", of_names, *duplicate);
  if (names.size() == count) return names;
  return fail(ErrorCode::invalid_data, "{}: names {} functions, and {} has {}", of_names, names.size(), path, count);
}

Result<std::vector<double>> read_plot3d_function(ByteSource& file, const Plot3dFormat& format, std::size_t block,
                                                 std::size_t function) {
  const Plot3dFormat::Functions& functions = format.functions[block];
  const auto bytes = static_cast<std::size_t>(format.precision);
  SPLATVOL_TRY_ASSIGN(
      text, read_text(file, functions.offset + function * functions.points * bytes, functions.points * bytes));
  std::vector<double> values;
  values.reserve(functions.points);
  for (std::string_view rest = text; rest.size() >= bytes; rest.remove_prefix(bytes)) {
    const std::uint64_t raw = number_in(rest.substr(0, bytes), format.big_endian);
    values.push_back(bytes == 8 ? std::bit_cast<double>(raw)
                                : double{std::bit_cast<float>(static_cast<std::uint32_t>(raw))});
  }
  return values;
}

}  // namespace splatvol
