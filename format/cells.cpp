#include "format/cells.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <numeric>

#include "format/payload.h"

namespace splatvol::format {
namespace {

constexpr std::size_t most_corners = 8;
constexpr std::size_t most_width = 6;  // bytes of a rank

// In front of the planes: the lowest rank, and the bytes of each column's numbers.
struct CellsHeader {
  std::uint64_t first;
  std::uint8_t widths[most_corners];
};
static_assert(sizeof(CellsHeader) == 16);

std::uint8_t width_of(std::span<const std::uint64_t> numbers) {
  std::uint64_t all = 0;
  for (const std::uint64_t number : numbers) all |= number;
  return static_cast<std::uint8_t>((std::bit_width(all) + 7) / 8);
}

struct Corner {
  std::uint64_t rank;
  std::uint32_t at;
};

// Sorts by the lowest `bits` bits of the ranks, digit by digit: several times as fast as comparing.
void sort_by_rank(std::vector<Corner>& corners, int bits) {
  constexpr int digit_bits = 11;
  std::vector<Corner> other(corners.size());
  for (int shift = 0; shift < bits; shift += digit_bits) {
    const auto digit = [&](const Corner& corner) { return corner.rank >> shift & ((1u << digit_bits) - 1); };
    std::array<std::uint32_t, (1u << digit_bits) + 1> begin{};
    for (const Corner& corner : corners) ++begin[digit(corner) + 1];
    std::partial_sum(begin.begin(), begin.end(), begin.begin());
    for (const Corner& corner : corners) other[begin[digit(corner)]++] = corner;
    corners.swap(other);
  }
}

}  // namespace

std::string cell_shape_name(CellShape shape) {
  return shape == CellShape::tetrahedron ? "tetrahedron" : fmt::format("shape {}", static_cast<int>(shape));
}

std::string cell_field_name(CellField field) {
  return field == CellField::corners ? "corners" : fmt::format("field {}", static_cast<int>(field));
}

LocalCells number_corners(std::span<const std::uint64_t> corners) {
  LocalCells cells;
  if (corners.empty()) return cells;
  const auto [low, high] = std::ranges::minmax(corners);
  std::vector<Corner> sorted;
  sorted.reserve(corners.size());
  for (const std::uint64_t corner : corners)
    sorted.push_back({corner - low, static_cast<std::uint32_t>(sorted.size())});
  sort_by_rank(sorted, std::bit_width(high - low));
  cells.corners.resize(corners.size());
  for (const Corner& corner : sorted) {
    if (cells.ranks.empty() || cells.ranks.back() != low + corner.rank) cells.ranks.push_back(low + corner.rank);
    cells.corners[corner.at] = static_cast<std::uint32_t>(cells.ranks.size() - 1);
  }
  return cells;
}

CellExtent measure_cells(CellShape shape, std::span<const std::uint32_t> corners, std::span<const dvec3> positions) {
  CellExtent extent;
  for (const dvec3& position : positions) extent.box.include(position);
  const std::size_t count = corners_of(shape);
  for (; !corners.empty(); corners = corners.subspan(count)) {
    const dvec3& from = positions[corners[0]];
    const dvec3 a = positions[corners[1]] - from, b = positions[corners[2]] - from, c = positions[corners[3]] - from;
    const dvec3 ab = glm::cross(a, b), bc = glm::cross(b, c), ca = glm::cross(c, a);
    extent.area += (glm::length(ab) + glm::length(bc) + glm::length(ca) + glm::length(ab + bc + ca)) / 2;
  }
  return extent;
}

ValueSummary summarize_cells(CellShape shape, std::span<const std::uint32_t> corners, std::span<const float> values,
                             const ValueBins& bins) {
  ValueSummary summary;
  const std::size_t count = corners_of(shape);
  for (; !corners.empty(); corners = corners.subspan(count)) {
    float low = values[corners[0]], high = low;
    bool is_missing = false;
    for (const std::uint32_t corner : corners.first(count)) {
      is_missing = is_missing || std::isnan(values[corner]);
      low = std::min(low, values[corner]);
      high = std::max(high, values[corner]);
    }
    if (!is_missing) summary.include({low, high, bins.between(low, high)});
  }
  return summary;
}

PackedCells pack_cells(CellShape shape, CellField field, std::span<const std::uint64_t> corners, std::size_t points) {
  const std::size_t count = corners_of(shape), cells = corners.size() / count;
  CellsHeader header{corners[0], {}};
  std::vector<std::uint64_t> differences(cells);
  Bytes planes;
  for (std::size_t k = 0; k < count; ++k) {
    std::uint64_t before = header.first;
    for (std::size_t cell = 0; cell < cells; ++cell) {
      const std::uint64_t rank = corners[cell * count + k];
      differences[cell] = k == 0 ? rank - before : rank - corners[cell * count + k - 1] - 1;
      before = rank;
    }
    header.widths[k] = width_of(differences);
    append_planes<std::uint64_t>(planes, differences, header.widths[k]);
  }
  Bytes payload;
  append_record(payload, header);
  payload.insert(payload.end(), planes.begin(), planes.end());
  PackedCells packed;
  packed.bytes = pack_planes(payload, sizeof(header), cells);
  packed.entry.hash = hash_bytes(packed.bytes);
  packed.entry.packed_bytes = static_cast<std::uint32_t>(packed.bytes.size());
  packed.entry.unpacked_bytes = static_cast<std::uint32_t>(payload.size());
  packed.entry.cells = static_cast<std::uint32_t>(cells);
  packed.entry.points = static_cast<std::uint32_t>(points);
  packed.entry.shape = shape;
  packed.entry.field = field;
  return packed;
}

Result<std::vector<std::uint64_t>> unpack_cells(const CellChunkEntry& entry, std::span<const std::byte> packed,
                                                std::uint64_t points, std::string_view what) {
  SPLATVOL_TRY(check_packed(entry, packed, what));
  SPLATVOL_TRY_ASSIGN(payload, unpack_here(packed, entry.unpacked_bytes, what));
  const auto wrong = [&](const char* rule) { return fail(ErrorCode::invalid_data, "{}: {} [R24]", what, rule); };
  const std::size_t count = corners_of(entry.shape), cells = entry.cells;
  if (payload.size() < sizeof(CellsHeader)) return wrong("wrong length");
  const auto header = read_record<CellsHeader>(payload, 0);
  const std::size_t width = std::accumulate(std::begin(header.widths), std::end(header.widths), std::size_t{0});
  if (std::ranges::max(header.widths) > most_width ||
      std::any_of(header.widths + count, std::end(header.widths), [](std::uint8_t w) { return w > 0; }) ||
      payload.size() != sizeof(header) + width * cells || header.first >= points)
    return wrong("wrong length, or a corner that is not there");

  std::vector<std::uint64_t> corners(cells * count), differences(cells);
  std::span<const std::byte> planes = payload.subspan(sizeof(header));
  for (std::size_t k = 0; k < count; ++k) {
    read_planes<std::uint64_t>(planes, differences, header.widths[k]);
    planes = planes.subspan(header.widths[k] * cells);
    std::uint64_t before = header.first;
    for (std::size_t cell = 0; cell < cells; ++cell) {
      // Both are below 2^48 and the difference too, so that nothing overflows.
      const std::uint64_t rank = (k == 0 ? before : corners[cell * count + k - 1] + 1) + differences[cell];
      if (rank >= points) return wrong("a corner that is not there");
      corners[cell * count + k] = before = rank;
    }
  }
  return corners;
}

Bytes pack_rank_page(const RankPage& page, RankPageRef& ref) {
  Bytes payload;
  for (const std::uint64_t before : page.before) append_record(payload, before);
  const auto segments = std::as_bytes(std::span(page.segments));
  payload.insert(payload.end(), segments.begin(), segments.end());
  Bytes packed = pack(payload);
  ref.packed_bytes = static_cast<std::uint32_t>(packed.size());
  ref.unpacked_bytes = static_cast<std::uint32_t>(payload.size());
  ref.hash = hash_bytes(packed);
  return packed;
}

Result<RankPage> unpack_rank_page(const RankPageRef& ref, std::span<const std::byte> packed, std::uint64_t first,
                                  std::size_t ranks, std::span<const std::uint64_t> counts, std::string_view what) {
  SPLATVOL_TRY_ASSIGN(payload, unpack_checked(ref, packed, what));
  const auto wrong = [&] {
    return fail(ErrorCode::invalid_data, "{}: its counts are not those of the points [R24]", what);
  };
  const std::size_t table = counts.size() * sizeof(std::uint64_t);
  if (payload.size() != table + ranks) return wrong();
  RankPage page{first, {}, std::vector<std::uint8_t>(ranks)};
  std::uint64_t sum = 0;
  for (std::size_t s = 0; s < counts.size(); ++s) {
    page.before.push_back(read_record<std::uint64_t>(payload, s * sizeof(std::uint64_t)));
    if (page.before[s] > counts[s]) return wrong();
    sum += page.before[s];
  }
  if (sum != first) return wrong();
  std::memcpy(page.segments.data(), payload.data() + table, ranks);
  std::vector<std::uint64_t> left(counts.begin(), counts.end());
  for (std::size_t s = 0; s < counts.size(); ++s) left[s] -= page.before[s];
  for (const std::uint8_t segment : page.segments)
    if (segment >= counts.size() || left[segment]-- == 0) return wrong();
  return page;
}

}  // namespace splatvol::format
