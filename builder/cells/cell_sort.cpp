#include "builder/cells/cell_sort.h"

#include <algorithm>
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
  std::sort(order.begin() + 1, order.begin() + 1 + static_cast<std::ptrdiff_t>(corners));
  return order;
}

// The two lowest corners; the point and the lowest corner.
MortonKey key_of(std::span<const std::uint64_t> record, std::size_t corners) {
  std::uint64_t first = rank_mask, second = rank_mask;
  for (const std::uint64_t word : record.first(corners)) {
    const std::uint64_t rank = word & rank_mask;
    second = std::min(second, std::max(first, rank));
    first = std::min(first, rank);
  }
  if (record.size() > corners) return {record[corners], first};
  return {first, second};
}

}  // namespace

void SortedCells::add(const RankedCell& cell) {
  const std::size_t count = format::corners_of(chunk.shape);
  chunk.corners.insert(chunk.corners.end(), cell.corners.begin(),
                       cell.corners.begin() + static_cast<std::ptrdiff_t>(count));
  if (chunk.shape != format::CellShape::tetrahedron) chunk.splits.push_back(cell.split);
  if (chunk.field == format::CellField::constant) chunk.points.push_back(cell.point);
  signs.push_back(static_cast<std::int8_t>(cell.sign));
}

void SortedCells::add(const SortedCells& others) {
  chunk.corners.insert(chunk.corners.end(), others.chunk.corners.begin(), others.chunk.corners.end());
  chunk.splits.insert(chunk.splits.end(), others.chunk.splits.begin(), others.chunk.splits.end());
  chunk.points.insert(chunk.points.end(), others.chunk.points.begin(), others.chunk.points.end());
  signs.insert(signs.end(), others.signs.begin(), others.signs.end());
}

Result<CellSort> CellSort::create(format::CellShape shape, format::CellField field, std::uint64_t memory,
                                  const std::string& folder) {
  const std::size_t words = words_of(shape, field), bytes = words * sizeof(std::uint64_t);
  const auto key = [words, bytes, shape](std::span<const std::byte> records, std::span<MortonKey> keys) {
    Record record{};
    for (std::size_t i = 0; i < keys.size(); ++i) {
      std::memcpy(record.data(), records.data() + i * bytes, bytes);
      keys[i] = key_of(std::span(record).first(words), format::corners_of(shape));
    }
  };
  const std::size_t held = std::max<std::size_t>(memory, ExternalSorter::least_memory(bytes));
  SPLATVOL_TRY_ASSIGN(sorter, ExternalSorter::create({bytes, key, held, held, folder}));
  return CellSort(shape, field, std::move(sorter));
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

MortonKey CellSort::key_at(std::span<const std::uint64_t> record) const {
  return key_of(record, format::corners_of(shape_));
}

Status CellSort::add(std::span<const std::uint64_t> records) {
  return records.empty() ? Status{} : sorter_.add(std::as_bytes(records));
}

Result<std::optional<std::uint64_t>> CellSort::next_rank() {
  if (next_ * words_ == ready_.size()) SPLATVOL_TRY(read());
  if (ready_.empty()) return std::optional<std::uint64_t>();
  return std::optional(key_at(record(next_)).high);
}

RankedCell CellSort::take() {
  RankedCell cell;
  const auto words = record(next_++);
  const std::size_t count = format::corners_of(shape_);
  for (std::size_t k = 0; k < count; ++k) cell.corners[k] = words[k] & rank_mask;
  cell.split = static_cast<format::CellSplit>(words[0] >> rank_bits);
  cell.sign = static_cast<int>(words[count - 1] >> rank_bits) - 1;
  if (words_ > count) cell.point = words[count];
  return cell;
}

// Reads until at least one run of equal keys is whole, or to the end.
Status CellSort::read() {
  ready_.clear();
  next_ = 0;
  while (ready_.empty() && !ended_) {
    SPLATVOL_TRY_ASSIGN(more, sorter_.next());
    ended_ = more.keys.empty();
    const std::size_t had = behind_.size();
    behind_.resize(had + more.records.size() / sizeof(std::uint64_t));
    if (!more.records.empty()) std::memcpy(behind_.data() + had, more.records.data(), more.records.size());
    std::size_t whole = behind_.size() / words_;
    const auto key = [&](std::size_t i) { return key_at(std::span(behind_).subspan(i * words_, words_)); };
    if (!ended_) {
      const MortonKey last = key(whole - 1);
      while (whole > 0 && key(whole - 1) == last) --whole;
    }
    const auto end = behind_.begin() + static_cast<std::ptrdiff_t>(whole * words_);
    ready_.assign(behind_.begin(), end);
    behind_.erase(behind_.begin(), end);
  }
  order_runs();
  return {};
}

// The sort knows two corners only, and leaves equal keys in the order of the input.
void CellSort::order_runs() {
  const std::size_t count = ready_.size() / words_;
  std::vector<std::pair<Record, Record>> run;  // in order, record
  for (std::size_t begin = 0, end = 0; begin < count; begin = end) {
    const MortonKey key = key_at(record(begin));
    for (end = begin + 1; end < count && key_at(record(end)) == key;) ++end;
    if (end - begin == 1) continue;
    run.clear();
    for (std::size_t i = begin; i < end; ++i) {
      Record whole{};
      std::ranges::copy(record(i), whole.begin());
      run.emplace_back(order_of(record(i), format::corners_of(shape_)), whole);
    }
    std::ranges::sort(run);
    for (std::size_t i = begin; i < end; ++i) std::copy_n(run[i - begin].second.begin(), words_, record(i).begin());
  }
}

}  // namespace splatvol
