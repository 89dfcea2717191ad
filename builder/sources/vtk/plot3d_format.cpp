#include "builder/sources/vtk/plot3d_format.h"

#include <cstdint>
#include <optional>
#include <vector>

#include "builder/sources/read_text.h"

namespace splatvol {
namespace {

constexpr std::uint64_t most_blocks = 1 << 20;

/// The header of a grid or solution.
struct Header {
  std::vector<std::uint64_t> points;      // of each block
  std::vector<std::uint32_t> dimensions;  // of all blocks, one after the other
  std::uint64_t bytes = 0;
  bool more_variables = false;  // Overflow's solutions: the header has two more numbers
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

/// Empty if the file's first bytes are no header of this variant.
std::optional<Header> read_header(ByteSource& file, const Plot3dFormat& format) {
  HeaderReader reader(file, format.big_endian);
  const auto record = [&](std::uint32_t bytes) { return !format.record_marks || reader.next() == bytes; };
  std::uint32_t blocks = 1;
  if (format.multi_grid) {
    if (!record(4)) return std::nullopt;
    blocks = reader.next();
    if (!record(4) || blocks == 0 || blocks > most_blocks) return std::nullopt;
  }

  Header header;
  const auto numbers = blocks * static_cast<std::uint32_t>(format.dimensions);
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
  }
  if (header.more_variables) reader.next(), reader.next();
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

bool solution_agrees(ByteSource& solution, const Header& grid_header, const Plot3dFormat& format) {
  const auto header = read_header(solution, format);
  if (!header || header->dimensions != grid_header.dimensions) return false;
  if (header->more_variables) return true;
  const std::uint64_t expected = solution_bytes(*header, format);
  return fits(solution.size(), expected, false) || fits(solution.size(), expected, true);
}

}  // namespace

Result<Plot3dFormat> detect_plot3d(ByteSource& grid, ByteSource& solution) {
  bool grid_found = false;
  for (const bool padded : {false, true})
    for (const Plot3dFormat& format : variants()) {
      const auto header = read_header(grid, format);
      if (!header || header->more_variables || !fits(grid.size(), grid_bytes(*header, format), padded)) continue;
      grid_found = true;
      if (solution_agrees(solution, *header, format)) return format;
    }
  if (grid_found)
    return fail(ErrorCode::invalid_data, "{}: not a PLOT3D solution on the grid {}: dimensions or size differ",
                solution.name(), grid.name());
  return fail(ErrorCode::invalid_data, "{}: neither a VTK file nor a binary PLOT3D grid (or it is truncated)",
              grid.name());
}

}  // namespace splatvol
