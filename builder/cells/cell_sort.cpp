#include "builder/cells/cell_sort.h"

#include <algorithm>
#include <array>
#include <cstring>

namespace splatvol {

Result<CellSort> CellSort::create(const CellForm& form, std::uint64_t memory, const std::string& folder) {
  const std::size_t bytes = form.words() * sizeof(CellWord);
  // Half a key has 63 bits. No record has fewer than three words.
  const auto key = [bytes](std::span<const std::byte> records, std::span<MortonKey> keys) {
    std::array<CellWord, 4> head{};
    for (std::size_t i = 0; i < keys.size(); ++i) {
      const std::byte* const record = records.data() + i * bytes;
      std::memcpy(head.data(), record, 3 * sizeof(CellWord));
      if (bytes > 3 * sizeof(CellWord)) std::memcpy(&head[3], record + 3 * sizeof(CellWord), sizeof(CellWord));
      const std::uint64_t high = std::uint64_t{head[0]} << 32 | head[1], low = std::uint64_t{head[2]} << 32 | head[3];
      keys[i] = {high >> 1, (high << 63 | low >> 1) >> 1};
    }
  };
  const std::size_t held = std::max<std::size_t>(memory, ExternalSorter::least_memory(bytes));
  SPLATVOL_TRY_ASSIGN(sorter, ExternalSorter::create({bytes, key, held, held, folder}));
  return CellSort(form, std::move(sorter));
}

Status CellSort::add(std::span<const CellWord> records) {
  for (std::size_t at = 0; at < records.size(); at += form_.records_of(&records[at]) * form_.words()) ++count_;
  return records.empty() ? Status{} : sorter_.add(std::as_bytes(records));
}

Result<std::optional<std::uint64_t>> CellSort::next_rank() {
  if (next_ == whole_) SPLATVOL_TRY(read());
  if (next_ == whole_) return std::optional<std::uint64_t>();
  return std::optional(form_.rank_of(record(next_)));
}

void CellSort::take(std::uint64_t rank_end, SortedCells& cells) {
  const CellWord* const first = record(next_);
  for (; next_ < whole_ && has_room(cells); ++cells.cells) {
    const CellWord* const next = record(next_);
    if (form_.rank_of(next) >= rank_end) break;
    cells.corners += form_.corners_of(next);
    next_ += form_.records_of(next);
  }
  cells.records.insert(cells.records.end(), first, record(next_));
}

// Reads until at least one run is whole, or to the end. Requires that all whole runs were taken.
Status CellSort::read() {
  records_.erase(records_.begin(), records_.begin() + static_cast<std::ptrdiff_t>(whole_ * form_.words()));
  next_ = whole_ = 0;
  while (whole_ == 0 && !ended_) {
    SPLATVOL_TRY_ASSIGN(more, sorter_.next());
    ended_ = more.keys.empty();
    const std::size_t had = records_.size();
    records_.resize(had + more.keys.size() * form_.words());
    if (!ended_) std::memcpy(records_.data() + had, more.records.data(), more.records.size());
    const std::size_t count = whole_ = records_.size() / form_.words();
    while (!ended_ && whole_ > 0 && form_.are_alike(record(whole_ - 1), record(count - 1))) --whole_;
  }
  for (std::size_t begin = 0, end = 0; begin < whole_; begin = end) {
    for (end = begin + 1; end < whole_ && form_.are_alike(record(begin), record(end));) ++end;
    if (end - begin > form_.records_of(record(begin))) order_run(begin, end);
  }
  return {};
}

// The sort knows the first words only, and leaves equal keys in the order of the input. Of polyhedra of one hash,
// mostly copies, first records come first, then second ones: each in the order in which the cells were added.
void CellSort::order_run(std::size_t begin, std::size_t end) {
  std::vector<std::vector<CellWord>> cells;
  for (std::size_t i = begin, cell = 0, had = 0; i < end; ++i) {
    const std::size_t place = form_.place_of(record(i));
    if (place != had) had = place, cell = 0;
    if (place == 0)
      cell = cells.size(), cells.emplace_back();
    else
      while (form_.records_of(cells[cell].data()) <= place) ++cell;
    cells[cell].insert(cells[cell].end(), record(i), record(i + 1));
    ++cell;
  }
  std::ranges::sort(cells);
  auto to = records_.begin() + static_cast<std::ptrdiff_t>(begin * form_.words());
  for (const std::vector<CellWord>& words : cells) to = std::ranges::copy(words, to).out;
}

}  // namespace splatvol
