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

// In front of the planes: the lowest corner of the first cell, and the bytes of each column's numbers. Polyhedra have
// two columns: their first corners, and all others.
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
    const auto digit = [&](const Corner& corner) {
      return static_cast<std::size_t>(corner.rank >> shift & ((1u << digit_bits) - 1));
    };
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
    case CellShape::polyhedron:
      return "polyhedron";
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
  std::vector<std::uint64_t> words(static_cast<std::size_t>((high - low) / 64 + 1));
  std::vector<std::uint32_t> before(words.size());  // bits of the words in front
  for (const std::uint64_t corner : corners)
    words[static_cast<std::size_t>((corner - low) / 64)] |= std::uint64_t{1} << (corner - low) % 64;
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
    const auto word = static_cast<std::size_t>(at / 64);
    cells.corners[i] = before[word] + static_cast<std::uint32_t>(std::popcount(words[word] & lower));
  }
  return cells;
}

}  // namespace

LocalCells number_corners(std::span<const std::uint64_t> corners) {
  LocalCells cells;
  if (corners.empty()) return cells;
  std::uint64_t low = corners[0], high = low;
  for (const std::uint64_t corner : corners) low = std::min(low, corner), high = std::max(high, corner);
  constexpr std::uint64_t most_words = 4;  // for each corner: then they take little more memory than a sort
  if ((high - low) / 64 < most_words * corners.size()) return number_by_bits(corners, low, high);
  std::vector<Corner> sorted;
  sorted.reserve(corners.size());
  for (const std::uint64_t corner : corners)
    sorted.push_back({corner - low, static_cast<std::uint32_t>(sorted.size())});
  sort_by_rank(sorted, static_cast<int>(std::bit_width(high - low)));
  cells.corners.resize(corners.size());
  for (const Corner& corner : sorted) {
    if (cells.ranks.empty() || cells.ranks.back() != low + corner.rank) cells.ranks.push_back(low + corner.rank);
    cells.corners[corner.at] = static_cast<std::uint32_t>(cells.ranks.size() - 1);
  }
  return cells;
}

namespace {

// Adds up the areas of the faces of tetrahedra, several at a time, in their order.
class Areas {
 public:
  explicit Areas(double& sum) : sum_(sum) {}

  // Adds a tetrahedron, by its edges from one corner.
  void add(const dvec3& a, const dvec3& b, const dvec3& c) {
    for (int axis = 0; axis < 3; ++axis) {
      edges_[axis][count_] = a[axis];
      edges_[3 + axis][count_] = b[axis];
      edges_[6 + axis][count_] = c[axis];
    }
    if (++count_ == lanes) finish();
  }

  void finish() {
    const auto& [ax, ay, az, bx, by, bz, cx, cy, cz] = edges_;
    std::array<double, lanes> areas;
    for (std::size_t l = 0; l < lanes; ++l) {
      const dvec3 a(ax[l], ay[l], az[l]), b(bx[l], by[l], bz[l]), c(cx[l], cy[l], cz[l]);
      const dvec3 ab = glm::cross(a, b), bc = glm::cross(b, c), ca = glm::cross(c, a);
      areas[l] = (glm::length(ab) + glm::length(bc) + glm::length(ca) + glm::length(ab + bc + ca)) / 2;
    }
    for (std::size_t l = 0; l < count_; ++l) sum_ += areas[l];
    count_ = 0;
  }

 private:
  static constexpr std::size_t lanes = 8;
  double& sum_;
  std::size_t count_ = 0;
  std::array<std::array<double, lanes>, 9> edges_{};
};

}  // namespace

CellExtent measure_cells(const CellChunk& cells, const LocalCells& local, std::span<const dvec3> positions) {
  CellExtent extent;
  for (const dvec3& position : positions) extent.box.include(position);
  Areas areas(extent.area);
  for_each_tetrahedron(cells, local, [&](const std::array<std::uint32_t, 4>& corners) {
    const dvec3& from = positions[corners[0]];
    areas.add(positions[corners[1]] - from, positions[corners[2]] - from, positions[corners[3]] - from);
  });
  areas.finish();
  return extent;
}

ValueSummary summarize_cells(const CellChunk& cells, const LocalCells& local, std::span<const float> values,
                             const ValueBins& bins) {
  // Bins ascend with values. So each value's bin is found once, and not for each tetrahedron.
  std::vector<std::uint8_t> bin_of(values.size());
  for (std::size_t i = 0; i < values.size(); ++i)
    if (!std::isnan(values[i])) bin_of[i] = static_cast<std::uint8_t>(bins.bin(values[i]));
  const bool has_missing = std::ranges::any_of(values, [](float value) { return std::isnan(value); });
  ValueSummary summary;
  for_each_tetrahedron(cells, local, [&](const std::array<std::uint32_t, 4>& corners) {
    const float first = values[corners[0]];
    float low = first, high = first;
    std::uint8_t lowest = bin_of[corners[0]], highest = lowest;
    if (has_missing && std::ranges::any_of(corners, [&](std::uint32_t corner) { return std::isnan(values[corner]); }))
      return;
    for (const std::uint32_t corner : corners) {
      low = std::min(low, values[corner]);
      high = std::max(high, values[corner]);
      lowest = std::min(lowest, bin_of[corner]);
      highest = std::max(highest, bin_of[corner]);
    }
    summary.include({low, high, ValueBins::between_bins(lowest, highest)});
  });
  return summary;
}

namespace {

std::uint8_t add_narrow(const std::vector<std::uint64_t>& numbers, Payload& payload) {
  const std::uint8_t width = width_of(numbers);
  payload.add(numbers, width);
  return width;
}

// Returns the headers' part.
PointsHeader add_points(const CellChunk& cells, Payload& payload) {
  PointsHeader header{};
  std::vector<std::uint64_t> differences(cells.size());
  std::adjacent_difference(cells.points.begin(), cells.points.end(), differences.begin());
  header.first = std::exchange(differences[0], 0);
  header.width = add_narrow(differences, payload);
  return header;
}

CellsHeader add_polyhedra(const CellChunk& cells, Payload& payload) {
  CellsHeader header{cells.corners[0], {}};
  std::vector<std::uint64_t> first, others;
  std::vector<std::uint8_t> counts, apexes;
  std::vector<std::byte> codes;
  std::uint64_t before = header.first;
  for (std::size_t cell = 0; cell < cells.size(); ++cell) {
    const auto corners = cells.corners_at(cell);
    first.push_back(first_difference(cells.field, corners[0], before));
    before = corners[0];
    counts.push_back(static_cast<std::uint8_t>(corners.size()));
    apexes.push_back(static_cast<std::uint8_t>(cells.splits[cell]));
    for (std::size_t k = 1; k < corners.size(); ++k) others.push_back(corners[k] - corners[k - 1] - 1);
    [[maybe_unused]] const SurfaceCoding coding = encode_surface(cells.triangles_at(cell), corners.size(), codes);
  }
  header.widths[0] = add_narrow(first, payload);
  payload.end_block();
  payload.add(counts);
  payload.add(apexes);
  payload.end_block();
  header.widths[1] = width_of(others);
  payload.add(others, header.widths[1], 1);
  payload.end_block();
  payload.add(codes);
  return header;
}

// Cells whose shape has a number of corners.
CellsHeader add_cells(const CellChunk& cells, std::span<const Permutation> permutations, Payload& payload) {
  const std::size_t count = corners_of(cells.shape), size = cells.size();
  const std::uint64_t* const ranks = cells.corners.data();
  CellsHeader header{ranks[0], {}};
  std::vector<std::uint64_t> differences(size);
  for (std::size_t k = 0; k < count; ++k) {
    std::uint64_t before = header.first;
    for (std::size_t cell = 0; cell < size; ++cell) {
      const std::uint64_t rank = ranks[cell * count + k];
      differences[cell] = k > 0 ? rank - ranks[cell * count + k - 1] - 1 : first_difference(cells.field, rank, before);
      before = rank;
    }
    header.widths[k] = add_narrow(differences, payload);
    if (k == 0) payload.end_block();
  }
  payload.end_block();
  if (cells.shape == CellShape::tetrahedron) return header;
  std::vector<std::uint16_t> codes, splits;
  for (std::size_t cell = 0; cell < size; ++cell) {
    const CellOrder order = find_order(cells.shape, permutations[cell], cells.splits[cell]);
    codes.push_back(order.code);
    splits.push_back(order.split);
  }
  payload.add(codes);
  payload.end_block();
  payload.add(splits);
  return header;
}

}  // namespace

PackedCells pack_cells(const CellChunk& cells, std::size_t points, std::span<const Permutation> permutations) {
  Payload payload{Bytes(header_bytes(cells.field))};
  if (cells.field == CellField::constant) {
    const PointsHeader of_points = add_points(cells, payload);
    std::memcpy(payload.bytes.data() + sizeof(CellsHeader), &of_points, sizeof(of_points));
  }
  const CellsHeader header =
      cells.shape == CellShape::polyhedron ? add_polyhedra(cells, payload) : add_cells(cells, permutations, payload);
  std::memcpy(payload.bytes.data(), &header, sizeof(header));
  PackedCells packed;
  packed.bytes = pack_blocks(payload.bytes, payload.ends);
  packed.entry.hash = hash_bytes(packed.bytes);
  packed.entry.packed_bytes = static_cast<std::uint32_t>(packed.bytes.size());
  packed.entry.unpacked_bytes = static_cast<std::uint32_t>(payload.bytes.size());
  packed.entry.cells = static_cast<std::uint32_t>(cells.size());
  packed.entry.points = static_cast<std::uint32_t>(points);
  packed.entry.shape = cells.shape;
  packed.entry.field = cells.field;
  return packed;
}

std::uint64_t most_corners(const CellChunkEntry& entry) {
  if (entry.shape != CellShape::polyhedron) return entry.cells * std::uint64_t{corners_of(entry.shape)};
  return std::min<std::uint64_t>(entry.cells * std::uint64_t{max_polyhedron_corners}, max_chunk_corners);
}

std::uint64_t most_unpacked_bytes(const CellChunkEntry& entry) {
  const std::uint64_t corners = most_corners(entry);
  std::uint64_t bytes = header_bytes(entry.field) + corners * sizeof(std::uint64_t);
  if (entry.field == CellField::constant) bytes += entry.cells * sizeof(std::uint64_t);
  if (entry.shape == CellShape::polyhedron) return bytes + 2 * corners;  // codes, counts and apexes
  return entry.shape == CellShape::tetrahedron ? bytes : bytes + entry.cells * 2 * sizeof(std::uint16_t);
}

namespace {

// Takes a chunk apart. Its bytes are untrusted.
class CellUnpacker {
 public:
  // `points`, `vertices`: of the file.
  CellUnpacker(const CellChunkEntry& entry, std::span<const std::byte> payload, std::uint64_t points,
               std::uint64_t vertices, std::string_view what)
      : cells_{entry.shape, entry.field, {}, {}, {}},
        size_(entry.cells),
        payload_(payload),
        points_(points),
        corner_end_(entry.field == CellField::constant ? vertices : points),
        what_(what) {}

  Result<CellChunk> run() {
    SPLATVOL_TRY(take_headers());
    if (cells_.field == CellField::constant) SPLATVOL_TRY(take_points());
    if (cells_.shape == CellShape::polyhedron)
      SPLATVOL_TRY(take_polyhedra());
    else
      SPLATVOL_TRY(take_cells());
    return std::move(cells_);
  }

 private:
  [[nodiscard]] tl::unexpected<Error> wrong(const char* rule) const {
    return fail(ErrorCode::invalid_data, "{}: {} [R24]", what_, rule);
  }
  [[nodiscard]] tl::unexpected<Error> wrong_length() const {
    return wrong("wrong length, or a corner that is not there");
  }

  // Checks the length of the payload; of polyhedra, as far as headers tell it.
  Status take_headers() {
    const bool is_constant = cells_.field == CellField::constant, are_polyhedra = cells_.shape == CellShape::polyhedron;
    const std::size_t headers = header_bytes(cells_.field);
    if (payload_.size() < headers) return wrong("wrong length");
    header_ = read_record<CellsHeader>(payload_, 0);
    if (is_constant) of_points_ = read_record<PointsHeader>(payload_, sizeof(CellsHeader));
    const std::size_t columns = are_polyhedra ? 2 : corners_of(cells_.shape);
    std::size_t width = std::accumulate(header_.widths, header_.widths + columns, std::size_t{of_points_.width});
    if (are_polyhedra) width += 2 - header_.widths[1];
    if (!are_polyhedra && cells_.shape != CellShape::tetrahedron) width += 2 * sizeof(std::uint16_t);
    const std::size_t length = headers + width * size_;
    if (std::max(std::ranges::max(header_.widths), of_points_.width) > most_width ||
        std::any_of(header_.widths + columns, std::end(header_.widths), [](std::uint8_t w) { return w > 0; }) ||
        (are_polyhedra ? payload_.size() < length : payload_.size() != length) || header_.first >= corner_end_ ||
        (is_constant && of_points_.first >= points_))
      return wrong_length();
    planes_ = payload_.subspan(headers);
    return {};
  }

  Status take_points() {
    planes_ = take_planes(planes_, differences_, size_, of_points_.width);
    std::uint64_t point = of_points_.first;
    for (const std::uint64_t difference : differences_) {
      point += difference;
      if (point >= points_) return wrong("a cell of a point that is not there");
      cells_.points.push_back(point);
    }
    return {};
  }

  Status take_cells() {
    const std::size_t count = corners_of(cells_.shape);
    std::vector<std::uint64_t>& corners = cells_.corners;
    corners.resize(size_ * count);
    for (std::size_t k = 0; k < count; ++k) {
      planes_ = take_planes(planes_, differences_, size_, header_.widths[k]);
      std::uint64_t before = header_.first;
      for (std::size_t cell = 0; cell < size_; ++cell) {
        // All are below 2^48, so that nothing overflows; a negative number is too large.
        const std::uint64_t rank = k == 0 ? after_first(cells_.field, before, differences_[cell])
                                          : corners[cell * count + k - 1] + 1 + differences_[cell];
        if (rank >= corner_end_) return wrong("a corner that is not there");
        corners[cell * count + k] = before = rank;
      }
    }
    return cells_.shape == CellShape::tetrahedron ? Status{} : take_orders();
  }

  Status take_orders() {
    const std::size_t count = corners_of(cells_.shape);
    std::vector<std::uint16_t> codes;
    planes_ = take_planes(planes_, codes, size_);
    take_planes(planes_, cells_.splits, size_);
    const auto orders = orders_of(cells_.shape);
    for (std::size_t cell = 0; cell < size_; ++cell) {
      if (codes[cell] >= orders.size() || !is_split(cells_.shape, cells_.splits[cell]))
        return wrong("an order of corners, or a split, that does not exist");
      std::array<std::uint64_t, max_cell_corners> ranks{};
      const auto corners = std::span(cells_.corners).subspan(cell * count, count);
      std::ranges::copy(corners, ranks.begin());
      for (std::size_t k = 0; k < count; ++k) corners[k] = ranks[orders[codes[cell]][k]];
    }
    return {};
  }

  Status take_polyhedra() {
    std::vector<std::uint8_t> counts, apexes;
    planes_ = take_planes(planes_, differences_, size_, header_.widths[0]);
    planes_ = take_planes(planes_, counts, size_);
    planes_ = take_planes(planes_, apexes, size_);
    std::size_t corners = 0;
    for (std::size_t cell = 0; cell < size_; ++cell) {
      if (counts[cell] < least_polyhedron_corners || apexes[cell] >= counts[cell])
        return wrong("a polyhedron with too few corners, or without its apex");
      cells_.ends.push_back(static_cast<std::uint32_t>(corners += counts[cell]));
    }
    cells_.splits.assign(apexes.begin(), apexes.end());
    std::size_t code_bytes = 0;
    for (const std::uint8_t count : counts) code_bytes += surface_code_bytes(count);
    if (corners > max_chunk_corners || planes_.size() != header_.widths[1] * (corners - size_) + code_bytes)
      return wrong_length();
    std::vector<std::uint64_t> others;
    planes_ = take_planes(planes_, others, corners - size_, header_.widths[1]);
    SPLATVOL_TRY(take_corners(others));
    return take_surfaces();
  }

  // `others`: differences of all corners but first ones, which differences_ has.
  Status take_corners(std::span<const std::uint64_t> others) {
    std::uint64_t first = header_.first;
    for (std::size_t cell = 0; cell < size_; ++cell) {
      std::uint64_t rank = first = after_first(cells_.field, first, differences_[cell]);
      const std::size_t end = cells_.ends[cell];
      if (rank >= corner_end_) return wrong("a corner that is not there");
      cells_.corners.push_back(rank);
      for (; cells_.corners.size() < end; others = others.subspan(1)) {
        rank += 1 + others[0];
        if (rank >= corner_end_) return wrong("a corner that is not there");
        cells_.corners.push_back(rank);
      }
    }
    return {};
  }

  // The planes end with the codes.
  Status take_surfaces() {
    cells_.triangles.resize(2 * cells_.corners.size() - 4 * size_);
    const auto all = std::span(cells_.triangles);
    std::size_t triangles = 0;
    for (std::size_t cell = 0; cell < size_; ++cell) {
      const std::size_t corners = cells_.corners_at(cell).size(), bytes = surface_code_bytes(corners);
      const auto surface = all.subspan(triangles, surface_triangles(corners));
      if (!decode_surface(planes_.first(bytes), corners, surface))
        return wrong("a polyhedron without a closed surface");
      planes_ = planes_.subspan(bytes);
      triangles += surface.size();
    }
    return {};
  }

  CellChunk cells_;
  std::size_t size_;
  std::span<const std::byte> payload_, planes_;  // planes: those that are left
  std::uint64_t points_, corner_end_;
  std::string_view what_;
  CellsHeader header_{};
  PointsHeader of_points_{};
  std::vector<std::uint64_t> differences_;
};

}  // namespace

Result<CellChunk> unpack_cells(const CellChunkEntry& entry, std::span<const std::byte> packed, std::uint64_t points,
                               std::uint64_t vertices, std::string_view what) {
  SPLATVOL_TRY(check_packed(entry, packed, what));
  SPLATVOL_TRY_ASSIGN(payload, unpack_here(packed, entry.unpacked_bytes, what));
  return CellUnpacker(entry, payload, points, vertices, what).run();
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
