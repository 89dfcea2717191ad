#include "format/cells.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <numeric>

#include "format/payload.h"

namespace splatvol::format {
namespace {

constexpr std::size_t most_width = 6;  // bytes of a rank

// In front of the planes: the lowest corner of the first cell, and the bytes of each column's numbers.
struct CellsHeader {
  std::uint64_t first;
  std::uint8_t widths[max_cell_corners];
};
static_assert(sizeof(CellsHeader) == 16);

// Behind it if the field is constant: the first point, and the bytes of the differences between points.
struct PointsHeader {
  std::uint64_t first;
  std::uint8_t width;
  std::uint8_t zero[7];
};
static_assert(sizeof(PointsHeader) == 16);

constexpr std::size_t header_bytes(CellField field) {
  return sizeof(CellsHeader) + (field == CellField::constant ? sizeof(PointsHeader) : 0);
}

std::uint8_t width_of(std::span<const std::uint64_t> numbers) {
  std::uint64_t all = 0;
  for (const std::uint64_t number : numbers) all |= number;
  return static_cast<std::uint8_t>((std::bit_width(all) + 7) / 8);
}

// Numbers of vertices do not ascend from cell to cell.
std::uint64_t first_difference(CellField field, std::uint64_t number, std::uint64_t before) {
  return field == CellField::constant ? zigzag(static_cast<std::int64_t>(number - before)) : number - before;
}
std::uint64_t after_first(CellField field, std::uint64_t before, std::uint64_t difference) {
  return before + (field == CellField::constant ? static_cast<std::uint64_t>(unzigzag(difference)) : difference);
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
  switch (shape) {
    case CellShape::tetrahedron:
      return "tetrahedron";
    case CellShape::pyramid:
      return "pyramid";
    case CellShape::wedge:
      return "wedge";
    case CellShape::hexahedron:
      return "hexahedron";
  }
  return fmt::format("shape {}", static_cast<int>(shape));
}

std::string cell_field_name(CellField field) {
  if (field == CellField::constant) return "constant";
  return field == CellField::corners ? "corners" : fmt::format("field {}", static_cast<int>(field));
}

namespace {

// Numbers ranks from `low` to `high` by a bit for each: a few times as fast as sorting.
LocalCells number_by_bits(std::span<const std::uint64_t> corners, std::uint64_t low, std::uint64_t high) {
  std::vector<std::uint64_t> words((high - low) / 64 + 1);
  std::vector<std::uint32_t> before(words.size());  // bits of the words in front
  for (const std::uint64_t corner : corners) words[(corner - low) / 64] |= std::uint64_t{1} << (corner - low) % 64;
  LocalCells cells;
  cells.ranks.reserve(corners.size() / 4);
  for (std::size_t w = 0; w < words.size(); ++w) {
    if (words[w] == 0) continue;
    before[w] = static_cast<std::uint32_t>(cells.ranks.size());
    for (std::uint64_t bits = words[w]; bits != 0; bits &= bits - 1)
      cells.ranks.push_back(low + w * 64 + static_cast<std::uint64_t>(std::countr_zero(bits)));
  }
  cells.corners.resize(corners.size());
  for (std::size_t i = 0; i < corners.size(); ++i) {
    const std::uint64_t at = corners[i] - low, lower = (std::uint64_t{1} << at % 64) - 1;
    cells.corners[i] = before[at / 64] + static_cast<std::uint32_t>(std::popcount(words[at / 64] & lower));
  }
  return cells;
}

}  // namespace

LocalCells number_corners(std::span<const std::uint64_t> corners) {
  LocalCells cells;
  if (corners.empty()) return cells;
  const auto [low, high] = std::ranges::minmax(corners);
  constexpr std::uint64_t most_words = 4;  // for each corner: then they take little more memory than a sort
  if ((high - low) / 64 < most_words * corners.size()) return number_by_bits(corners, low, high);
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

CellExtent measure_cells(const CellChunk& cells, const LocalCells& local, std::span<const dvec3> positions) {
  CellExtent extent;
  for (const dvec3& position : positions) extent.box.include(position);
  for_each_tetrahedron(cells, local, [&](const std::array<std::uint32_t, 4>& corners) {
    const dvec3& from = positions[corners[0]];
    const dvec3 a = positions[corners[1]] - from, b = positions[corners[2]] - from, c = positions[corners[3]] - from;
    const dvec3 ab = glm::cross(a, b), bc = glm::cross(b, c), ca = glm::cross(c, a);
    extent.area += (glm::length(ab) + glm::length(bc) + glm::length(ca) + glm::length(ab + bc + ca)) / 2;
  });
  return extent;
}

ValueSummary summarize_cells(const CellChunk& cells, const LocalCells& local, std::span<const float> values,
                             const ValueBins& bins) {
  // As ValueBins::between: bins ascend with values, so those of the lowest and the highest are the lowest and highest.
  constexpr std::uint64_t all_bins = ~std::uint64_t{0};
  std::vector<std::uint8_t> bin_of(values.size());
  for (std::size_t i = 0; i < values.size(); ++i)
    if (!std::isnan(values[i])) bin_of[i] = static_cast<std::uint8_t>(bins.bin(values[i]));
  ValueSummary summary;
  for_each_tetrahedron(cells, local, [&](const std::array<std::uint32_t, 4>& corners) {
    const float first = values[corners[0]];
    float low = first, high = first;
    std::uint8_t lowest = bin_of[corners[0]], highest = lowest;
    bool is_missing = false;
    for (const std::uint32_t corner : corners) {
      is_missing = is_missing || std::isnan(values[corner]);
      low = std::min(low, values[corner]);
      high = std::max(high, values[corner]);
      lowest = std::min(lowest, bin_of[corner]);
      highest = std::max(highest, bin_of[corner]);
    }
    if (!is_missing) summary.include({low, high, all_bins << lowest & all_bins >> (63 - highest)});
  });
  return summary;
}

PackedCells pack_cells(const CellChunk& cells, std::size_t points) {
  const std::size_t count = corners_of(cells.shape), size = cells.size();
  std::vector<std::uint64_t> ranks(size * count);  // ascending in a cell
  std::vector<std::uint16_t> codes, splits;
  for (std::size_t cell = 0; cell < size; ++cell) {
    const auto corners = cells.corners_at(cell);
    const auto sorted = std::span(ranks).subspan(cell * count, count);
    std::ranges::copy(corners, sorted.begin());
    sort_corners(sorted);
    if (cells.shape == CellShape::tetrahedron) continue;
    std::array<std::uint8_t, max_cell_corners> places{};
    for (std::size_t k = 0; k < count; ++k)
      places[k] = static_cast<std::uint8_t>(std::ranges::find(sorted, corners[k]) - sorted.begin());
    const CellOrder order = find_order(cells.shape, std::span(places).first(count), cells.splits[cell]);
    codes.push_back(order.code);
    splits.push_back(order.split);
  }
  CellsHeader header{ranks[0], {}};
  PointsHeader of_points{};
  Bytes payload(header_bytes(cells.field));
  std::vector<std::uint64_t> differences(size);
  if (cells.field == CellField::constant) {
    std::adjacent_difference(cells.points.begin(), cells.points.end(), differences.begin());
    of_points.first = std::exchange(differences[0], 0);
    of_points.width = width_of(differences);
    append_planes<std::uint64_t>(payload, differences, of_points.width);
    std::memcpy(payload.data() + sizeof(header), &of_points, sizeof(of_points));
  }
  for (std::size_t k = 0; k < count; ++k) {
    std::uint64_t before = header.first;
    for (std::size_t cell = 0; cell < size; ++cell) {
      const std::uint64_t rank = ranks[cell * count + k];
      differences[cell] = k > 0 ? rank - ranks[cell * count + k - 1] - 1 : first_difference(cells.field, rank, before);
      before = rank;
    }
    header.widths[k] = width_of(differences);
    append_planes<std::uint64_t>(payload, differences, header.widths[k]);
  }
  append_planes<std::uint16_t>(payload, codes);
  append_planes<std::uint16_t>(payload, splits);
  std::memcpy(payload.data(), &header, sizeof(header));
  PackedCells packed;
  packed.bytes = pack_planes(payload, header_bytes(cells.field), size);
  packed.entry.hash = hash_bytes(packed.bytes);
  packed.entry.packed_bytes = static_cast<std::uint32_t>(packed.bytes.size());
  packed.entry.unpacked_bytes = static_cast<std::uint32_t>(payload.size());
  packed.entry.cells = static_cast<std::uint32_t>(size);
  packed.entry.points = static_cast<std::uint32_t>(points);
  packed.entry.shape = cells.shape;
  packed.entry.field = cells.field;
  return packed;
}

std::uint64_t most_unpacked_bytes(const CellChunkEntry& entry) {
  std::uint64_t numbers = corners_of(entry.shape);
  if (entry.field == CellField::constant) ++numbers;
  const std::uint64_t order = entry.shape == CellShape::tetrahedron ? 0 : 2 * sizeof(std::uint16_t);
  return header_bytes(entry.field) + entry.cells * (numbers * sizeof(std::uint64_t) + order);
}

Result<CellChunk> unpack_cells(const CellChunkEntry& entry, std::span<const std::byte> packed, std::uint64_t points,
                               std::uint64_t vertices, std::string_view what) {
  SPLATVOL_TRY(check_packed(entry, packed, what));
  SPLATVOL_TRY_ASSIGN(payload, unpack_here(packed, entry.unpacked_bytes, what));
  const auto wrong = [&](const char* rule) { return fail(ErrorCode::invalid_data, "{}: {} [R24]", what, rule); };
  const std::size_t count = corners_of(entry.shape), size = entry.cells;
  const bool is_constant = entry.field == CellField::constant;
  const std::uint64_t corner_end = is_constant ? vertices : points;
  if (payload.size() < header_bytes(entry.field)) return wrong("wrong length");
  const auto header = read_record<CellsHeader>(payload, 0);
  const auto of_points = is_constant ? read_record<PointsHeader>(payload, sizeof(header)) : PointsHeader{};
  std::size_t width = std::accumulate(std::begin(header.widths), std::end(header.widths), std::size_t{of_points.width});
  if (entry.shape != CellShape::tetrahedron) width += 2 * sizeof(std::uint16_t);
  if (std::max(std::ranges::max(header.widths), of_points.width) > most_width ||
      std::any_of(header.widths + count, std::end(header.widths), [](std::uint8_t w) { return w > 0; }) ||
      payload.size() != header_bytes(entry.field) + width * size || header.first >= corner_end ||
      (is_constant && of_points.first >= points))
    return wrong("wrong length, or a corner that is not there");

  CellChunk cells{entry.shape, entry.field, std::vector<std::uint64_t>(size * count), {}, {}};
  std::vector<std::uint64_t> differences;
  std::span<const std::byte> planes = payload.subspan(header_bytes(entry.field));
  if (is_constant) {
    planes = take_planes(planes, differences, size, of_points.width);
    std::uint64_t point = of_points.first;
    for (const std::uint64_t difference : differences) {
      point += difference;
      if (point >= points) return wrong("a cell of a point that is not there");
      cells.points.push_back(point);
    }
  }
  for (std::size_t k = 0; k < count; ++k) {
    planes = take_planes(planes, differences, size, header.widths[k]);
    std::uint64_t before = header.first;
    for (std::size_t cell = 0; cell < size; ++cell) {
      // All are below 2^48, so that nothing overflows; a negative number is too large.
      const std::uint64_t rank = k == 0 ? after_first(entry.field, before, differences[cell])
                                        : cells.corners[cell * count + k - 1] + 1 + differences[cell];
      if (rank >= corner_end) return wrong("a corner that is not there");
      cells.corners[cell * count + k] = before = rank;
    }
  }
  if (entry.shape == CellShape::tetrahedron) return cells;
  std::vector<std::uint16_t> codes;
  planes = take_planes(planes, codes, size);
  take_planes(planes, cells.splits, size);
  const auto orders = orders_of(entry.shape);
  for (std::size_t cell = 0; cell < size; ++cell) {
    if (codes[cell] >= orders.size() || !is_split(entry.shape, cells.splits[cell]))
      return wrong("an order of corners, or a split, that does not exist");
    std::array<std::uint64_t, max_cell_corners> ranks{};
    const auto corners = std::span(cells.corners).subspan(cell * count, count);
    std::ranges::copy(corners, ranks.begin());
    for (std::size_t k = 0; k < count; ++k) corners[k] = ranks[orders[codes[cell]][k]];
  }
  return cells;
}

Bytes pack_rank_page(const RankPage& page, PackedPageRef& ref) {
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

Result<RankPage> unpack_rank_page(const PackedPageRef& ref, std::span<const std::byte> packed, std::uint64_t first,
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
