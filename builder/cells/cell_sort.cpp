#include "builder/cells/cell_sort.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <utility>

namespace splatvol {
namespace {

// A rank has 48 bits. Above those of the first corner is the split, above those of the last one the sign.
constexpr int rank_bits = 48;
constexpr std::uint64_t rank_mask = (std::uint64_t{1} << rank_bits) - 1;

// The corners of a record in ascending order, behind the point of a constant field.
CellSort::Record order_of(std::span<const std::uint64_t> record, std::size_t corners) {
  CellSort::Record order{};
  if (record.size() > corners) order[0] = record[corners];
  for (std::size_t k = 0; k < corners; ++k) order[1 + k] = record[k] & rank_mask;
  format::sort_corners(std::span(order).subspan(1, corners));
  return order;
}

constexpr int key_bits = 126, half_key_bits = 63;
constexpr std::uint64_t half_key = (std::uint64_t{1} << half_key_bits) - 1;
constexpr std::size_t key_corners = 4;  // most in a key: all shapes have as many

// Makes keys: as many of the lowest corners as fit, behind the point of a constant field. A rank takes no more bits
// than the largest one, so that keys differ in their first bits: that is quickest to sort by.
class Keys {
 public:
  Keys(std::size_t corners, std::size_t words, int bits)
      : corners_(corners),
        corner_bits_(words > corners ? rank_bits : bits),
        point_bits_(words > corners ? bits : 0),
        in_key_(std::min(key_corners, static_cast<std::size_t>((key_bits - point_bits_) / corner_bits_))) {}

  [[nodiscard]] MortonKey of(const std::uint64_t* record) const {
    std::array<std::uint64_t, key_corners> lowest;
    for (std::size_t k = 0; k < key_corners; ++k) lowest[k] = record[k] & rank_mask;
    format::sort_corners(lowest);
    for (std::size_t k = key_corners; k < corners_; ++k) {
      std::uint64_t rank = record[k] & rank_mask;
      for (std::uint64_t& low : lowest) {
        const std::uint64_t higher = std::max(low, rank);
        low = std::min(low, rank);
        rank = higher;
      }
    }
    __extension__ using Wide = unsigned __int128;
    Wide key = point_bits_ > 0 ? record[corners_] : 0;
    for (std::size_t k = 0; k < in_key_; ++k) key = key << corner_bits_ | lowest[k];
    key <<= key_bits - point_bits_ - static_cast<int>(in_key_) * corner_bits_;
    return {static_cast<std::uint64_t>(key >> half_key_bits), static_cast<std::uint64_t>(key) & half_key};
  }

 private:
  std::size_t corners_;
  int corner_bits_, point_bits_;
  std::size_t in_key_;
};

}  // namespace

void SortedCells::add(const SortedCells& others, std::size_t begin, std::size_t end) {
  chunk.append(others.chunk, begin, end);
  const auto first = others.signs.begin();
  signs.insert(signs.end(), first + static_cast<std::ptrdiff_t>(begin), first + static_cast<std::ptrdiff_t>(end));
}

Result<CellSort> CellSort::create(format::CellShape shape, format::CellField field, std::uint64_t rank_end,
                                  std::uint64_t memory, const std::string& folder) {
  const std::size_t words = words_of(shape, field), bytes = words * sizeof(std::uint64_t);
  const int bits = std::clamp(static_cast<int>(std::bit_width(rank_end)), 1, rank_bits);
  const auto key = [bytes, keys_of = Keys(format::corners_of(shape), words, bits)](std::span<const std::byte> records,
                                                                                   std::span<MortonKey> keys) {
    Record record{};
    for (std::size_t i = 0; i < keys.size(); ++i) {
      std::memcpy(record.data(), records.data() + i * bytes, bytes);
      keys[i] = keys_of.of(record.data());
    }
  };
  const auto key_of_part = [bits](std::span<const std::byte> records, std::span<MortonKey> keys) {
    constexpr std::size_t record_bytes = polyhedron_record_words * sizeof(std::uint64_t);
    for (std::size_t i = 0; i < keys.size(); ++i) {
      std::array<std::uint64_t, 2> head;
      std::memcpy(head.data(), records.data() + i * record_bytes, sizeof(head));
      keys[i] = {head[0] << (half_key_bits - bits), head[1] & half_key};
    }
  };
  const std::size_t held = std::max<std::size_t>(memory, ExternalSorter::least_memory(bytes));
  SPLATVOL_TRY_ASSIGN(
      sorter, ExternalSorter::create({bytes, shape == format::CellShape::polyhedron ? KeyFunction(key_of_part) : key,
                                      held, held, folder}));
  return CellSort(shape, field, bits, std::move(sorter));
}

CellSort::Record CellSort::record_of(format::CellShape shape, const RankedCell& cell) {
  const std::size_t count = format::corners_of(shape);
  Record record{};
  std::ranges::copy(cell.corners, record.begin());
  record[0] |= std::uint64_t{cell.split} << rank_bits;
  record[count - 1] |= static_cast<std::uint64_t>(cell.sign + 1) << rank_bits;
  record[count] = cell.point;
  return record;
}

Status CellSort::add(std::span<const std::uint64_t> records) {
  if (are_polyhedra()) {
    for (auto left = records; !left.empty(); left = left.subspan(record_count(left) * words_)) ++count_;
  } else {
    count_ += records.size() / words_;
  }
  return records.empty() ? Status{} : sorter_.add(std::as_bytes(records));
}

// The first bits of a key are a rank.
std::uint64_t CellSort::rank_at(std::size_t number) const { return keys_[number].high >> (half_key_bits - rank_bits_); }

Result<std::optional<std::uint64_t>> CellSort::next_rank() {
  if (next_ == whole_) SPLATVOL_TRY(read());
  if (next_ == whole_) return std::optional<std::uint64_t>();
  return std::optional(rank_at(next_));
}

void CellSort::take(std::uint64_t rank_end, std::size_t most, SortedCells& cells) {
  if (are_polyhedra()) {
    for (; most > 0 && next_ < whole_ && rank_at(next_) < rank_end && cells.has_room(); --most) {
      const std::size_t count = record_count(record(next_));
      add_polyhedron_to(cells, std::span(records_).subspan(next_ * words_, count * words_));
      next_ += count;
    }
    return;
  }
  const std::size_t end = std::min(whole_, next_ + most);
  for (; next_ < end && rank_at(next_) < rank_end; ++next_) add_to(cells, record(next_));
}

void CellSort::add_polyhedron_to(SortedCells& cells, std::span<const std::uint64_t> records) {
  read_records(records, polyhedron_);
  format::CellChunk& chunk = cells.chunk;
  chunk.corners.insert(chunk.corners.end(), polyhedron_.corners.begin(), polyhedron_.corners.end());
  chunk.ends.push_back(static_cast<std::uint32_t>(chunk.corners.size()));
  chunk.splits.push_back(polyhedron_.apex);
  chunk.triangles.insert(chunk.triangles.end(), polyhedron_.triangles.begin(), polyhedron_.triangles.end());
  if (field_ == format::CellField::constant) chunk.points.push_back(polyhedron_.point);
  cells.signs.push_back(static_cast<std::int8_t>(polyhedron_.sign));
}

// Whether the sort does not tell two records apart, or they may be of one polyhedron.
bool CellSort::is_one_run(std::size_t first, std::size_t second) const {
  if (!are_polyhedra()) return keys_[first] == keys_[second];
  return keys_[first].high == keys_[second].high && keys_[first].low >> 8 == keys_[second].low >> 8;
}

void CellSort::add_to(SortedCells& cells, std::span<const std::uint64_t> record) const {
  const std::size_t count = format::corners_of(shape_);
  for (const std::uint64_t word : record.first(count)) cells.chunk.corners.push_back(word & rank_mask);
  if (shape_ != format::CellShape::tetrahedron)
    cells.chunk.splits.push_back(static_cast<format::CellSplit>(record[0] >> rank_bits));
  if (record.size() > count) cells.chunk.points.push_back(record[count]);
  cells.signs.push_back(static_cast<std::int8_t>(static_cast<int>(record[count - 1] >> rank_bits) - 1));
}

// Reads until at least one run of equal keys is whole, or to the end. Requires that all whole runs were taken.
Status CellSort::read() {
  records_.erase(records_.begin(), records_.begin() + static_cast<std::ptrdiff_t>(whole_ * words_));
  keys_.erase(keys_.begin(), keys_.begin() + static_cast<std::ptrdiff_t>(whole_));
  next_ = whole_ = 0;
  while (whole_ == 0 && !ended_) {
    SPLATVOL_TRY_ASSIGN(more, sorter_.next());
    ended_ = more.keys.empty();
    const std::size_t had = records_.size();
    records_.resize(had + more.records.size() / sizeof(std::uint64_t));
    if (!more.records.empty()) std::memcpy(records_.data() + had, more.records.data(), more.records.size());
    keys_.insert(keys_.end(), more.keys.begin(), more.keys.end());
    whole_ = keys_.size();
    if (ended_) break;
    while (whole_ > 0 && is_one_run(whole_ - 1, keys_.size() - 1)) --whole_;
  }
  order_runs();
  return {};
}

void CellSort::order_runs() {
  for (std::size_t begin = 0, end = 0; begin < whole_; begin = end) {
    for (end = begin + 1; end < whole_ && is_one_run(begin, end);) ++end;
    if (end - begin == 1) continue;
    if (!are_polyhedra())
      order_run(begin, end);
    else if (end - begin > record_count(record(begin)))
      order_polyhedra(begin, end);
  }
}

// The sort knows a few corners only, and leaves equal keys in the order of the input.
void CellSort::order_run(std::size_t begin, std::size_t end) {
  std::vector<std::pair<Record, Record>> run;  // in order, record
  for (std::size_t i = begin; i < end; ++i) {
    Record whole{};
    std::ranges::copy(record(i), whole.begin());
    run.emplace_back(order_of(record(i), format::corners_of(shape_)), whole);
  }
  std::ranges::sort(run);
  for (std::size_t i = begin; i < end; ++i) std::copy_n(run[i - begin].second.begin(), words_, record(i).begin());
}

// Polyhedra of one hash, mostly copies: their first records, then their second ones. Each has those of one number in
// the order in which the cells were added.
void CellSort::order_polyhedra(std::size_t begin, std::size_t end) {
  std::vector<std::vector<std::uint64_t>> cells;
  for (std::size_t i = begin, cell = 0, had = 0; i < end; ++i) {
    const std::uint64_t number = record(i)[1] & 0xff;
    if (number != had) had = number, cell = 0;
    if (number == 0)
      cell = cells.size(), cells.emplace_back();
    else
      while (record_count(cells[cell]) <= number) ++cell;
    const auto words = record(i);
    cells[cell].insert(cells[cell].end(), words.begin(), words.end());
    ++cell;
  }
  std::ranges::sort(cells);
  auto to = records_.begin() + static_cast<std::ptrdiff_t>(begin * words_);
  for (const std::vector<std::uint64_t>& words : cells) to = std::ranges::copy(words, to).out;
}

}  // namespace splatvol
