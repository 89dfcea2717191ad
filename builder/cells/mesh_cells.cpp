#include "builder/cells/mesh_cells.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstring>
#include <limits>
#include <utility>

#include "base/interruption.h"
#include "format/codec.h"
#include "format/layout.h"

namespace splatvol {
namespace {

constexpr std::uint64_t no_rank = std::numeric_limits<std::uint64_t>::max();
constexpr std::size_t joined_cells = 4096;  // most cells of a chunk that joins index leaves

struct TagRecord {
  PointTag tag;
  std::uint64_t rank;
};

// The corners, and in the highest bits of the last the sign: 0 none, 1 positive, 2 negative.
using CellRecord = std::array<std::uint64_t, 4>;
constexpr int sign_shift = 62;

template <class Record>
Record record_at(std::span<const std::byte> records, std::size_t number) {
  Record record;
  std::memcpy(&record, records.data() + number * sizeof(Record), sizeof(Record));
  return record;
}

// Sorts the corners. The sign is that of the volume before: it turns with each exchange.
CellRecord record_of(std::array<std::uint64_t, 4> corners, bool is_flat) {
  bool is_odd = false;
  for (std::size_t i = 1; i < corners.size(); ++i)
    for (std::size_t k = i; k > 0 && corners[k] < corners[k - 1]; --k) {
      std::swap(corners[k], corners[k - 1]);
      is_odd = !is_odd;
    }
  corners[3] |= std::uint64_t{is_flat ? 0u : is_odd ? 2u : 1u} << sign_shift;
  return corners;
}

RankedCell cell_of(CellRecord record) {
  const std::uint64_t code = record[3] >> sign_shift;
  record[3] &= (std::uint64_t{1} << sign_shift) - 1;
  return {record, code == 0 ? 0 : code == 1 ? 1 : -1};
}

// Cells of a block with their ranks.
struct RankedBlock {
  std::vector<CellRecord> records;
  std::uint64_t collapsed = 0;
  std::uint64_t hash = 0;  // sum of those of the cells
  bool lacks_point = false;
};

// `ranks`: [point of the piece].
void rank_cells(const CellBlock& block, std::span<const std::uint64_t> ranks, RankedBlock& ranked) {
  std::vector<SpooledCell> cells;
  unpack(block, cells);
  ranked.records.reserve(cells.size());
  for (const SpooledCell& cell : cells) {
    std::array<std::uint64_t, 4> corners{};
    for (std::size_t k = 0; k < corners.size(); ++k) corners[k] = ranks[cell.corners[k]];
    ranked.lacks_point = ranked.lacks_point || std::ranges::find(corners, no_rank) != corners.end();
    const CellRecord record = record_of(corners, cell.is_flat);
    const std::array<std::uint64_t, 4> sorted = cell_of(record).corners;
    if (std::ranges::adjacent_find(sorted) != sorted.end()) {
      ++ranked.collapsed;
      continue;
    }
    ranked.hash += format::hash_bytes(std::as_bytes(std::span(sorted)));
    ranked.records.push_back(record);
  }
}

// Cells of one key are in the order of the input.
MortonKey key_of(const std::array<std::uint64_t, 4>& corners) { return {corners[0], corners[1]}; }

Result<ExternalSorter> start_sort(std::size_t record_bytes, KeyFunction key, std::uint64_t memory,
                                  const std::string& folder) {
  const std::size_t bytes = std::max<std::size_t>(memory, ExternalSorter::least_memory(record_bytes));
  return ExternalSorter::create({record_bytes, std::move(key), bytes, bytes, folder});
}

}  // namespace

Result<std::unique_ptr<MeshCells>> MeshCells::create(std::uint64_t memory, const std::string& folder) {
  const auto key = [](std::span<const std::byte> records, std::span<MortonKey> keys) {
    for (std::size_t i = 0; i < keys.size(); ++i) keys[i] = {record_at<TagRecord>(records, i).tag, 0};
  };
  SPLATVOL_TRY_ASSIGN(tags, start_sort(sizeof(TagRecord), key, memory / 8, folder));
  return std::unique_ptr<MeshCells>(new MeshCells(std::move(tags), memory, folder));
}

Status MeshCells::add_rank(PointTag tag, std::uint64_t rank) {
  const TagRecord record{tag, rank};
  return tags_.add(std::as_bytes(std::span(&record, 1)));
}

Status MeshCells::add_stay(std::size_t level, std::uint64_t rank) {
  while (stays_.size() <= level) stays_.push_back(std::make_unique<NumberQueue>(folder_));
  return stays_[level]->add(rank);
}

Status MeshCells::add_leaf(std::uint64_t points) { return leaves_.add(points); }

Result<std::optional<std::uint64_t>> MeshCells::NumberQueue::next() {
  if (left_.empty()) {
    SPLATVOL_TRY_ASSIGN(more, spool_.next());
    left_ = more;
  }
  if (left_.empty()) return std::optional<std::uint64_t>();
  const auto number = record_at<std::uint64_t>(left_, 0);
  left_ = left_.subspan(sizeof(number));
  return std::optional(number);
}

Status MeshCells::sort() {
  SPLATVOL_TRY(tags_.finish());
  const auto key = [](std::span<const std::byte> records, std::span<MortonKey> keys) {
    for (std::size_t i = 0; i < keys.size(); ++i) keys[i] = key_of(record_at<CellRecord>(records, i));
  };
  SPLATVOL_TRY_ASSIGN(cells, start_sort(sizeof(CellRecord), key, memory_, folder_));
  cells_.emplace(std::move(cells));
  const auto add = [&](std::span<const CellBlock> blocks) -> Status {
    if (piece_ != blocks[0].piece) SPLATVOL_TRY(load_ranks(blocks[0].piece, blocks[0].piece_points));
    return add_ranked(blocks);
  };
  SPLATVOL_TRY(spool_.read(add));
  ranks_ = {};
  return cells_->finish();
}

// Tags of pieces without cells are passed over.
Status MeshCells::load_ranks(std::uint32_t piece, std::uint32_t points) {
  piece_ = piece;
  ranks_.assign(points, no_rank);
  for (;;) {
    for (; next_tag_ < sorted_tags_.keys.size(); ++next_tag_) {
      const auto record = record_at<TagRecord>(sorted_tags_.records, next_tag_);
      if (record.tag >> 32 > piece) return {};
      if (record.tag >> 32 == piece) ranks_[static_cast<std::uint32_t>(record.tag)] = record.rank;
    }
    SPLATVOL_TRY_ASSIGN(more, tags_.next());
    if (more.keys.empty()) return {};
    sorted_tags_ = more;
    next_tag_ = 0;
  }
}

Status MeshCells::add_ranked(std::span<const CellBlock> blocks) {
  std::vector<RankedBlock> ranked(blocks.size());
  tbb::parallel_for(std::size_t{0}, blocks.size(), [&](std::size_t b) { rank_cells(blocks[b], ranks_, ranked[b]); });
  for (const RankedBlock& block : ranked) {
    if (block.lacks_point) return fail(ErrorCode::invalid_data, "a cell has a corner that is no point of the file");
    collapsed_ += block.collapsed;
    hash_ += block.hash;
    if (!block.records.empty()) SPLATVOL_TRY(cells_->add(std::as_bytes(std::span(block.records))));
  }
  return check_interruption();
}

// Returns the next cell, null after the last. Equal keys are put in order: the sort knows two corners only.
Result<const RankedCell*> MeshCells::peek() {
  if (next_ready_ < ready_.size()) return &ready_[next_ready_];
  ready_.clear();
  next_ready_ = 0;
  const auto by_corners = [](const RankedCell& a, const RankedCell& b) {
    return std::pair(a.corners, a.sign) < std::pair(b.corners, b.sign);
  };
  while (ready_.empty() && !ended_) {
    SPLATVOL_TRY_ASSIGN(more, cells_->next());
    ended_ = more.keys.empty();
    for (std::size_t i = 0; i < more.keys.size(); ++i)
      behind_.push_back(cell_of(record_at<CellRecord>(more.records, i)));
    std::size_t whole = behind_.size();
    while (!ended_ && whole > 0 && key_of(behind_[whole - 1].corners) == key_of(behind_.back().corners)) --whole;
    const auto end = behind_.begin() + static_cast<std::ptrdiff_t>(whole);
    ready_.assign(behind_.begin(), end);
    behind_.erase(behind_.begin(), end);
    for (auto run = ready_.begin(); run != ready_.end();) {
      const auto run_end = std::find_if(
          run, ready_.end(), [&](const RankedCell& cell) { return key_of(cell.corners) != key_of(run->corners); });
      std::sort(run, run_end, by_corners);
      run = run_end;
    }
  }
  return ready_.empty() ? nullptr : &ready_[0];
}

// Gathers the cells of the next index leaf that has some; of a leaf with too many for a chunk, the next of them.
Status MeshCells::gather_leaf() {
  while (leaf_cells_.size() < format::max_chunk_cells) {
    SPLATVOL_TRY_ASSIGN(cell, peek());
    if (!cell) return {};
    while (cell->corners[0] >= leaf_end_) {
      if (!leaf_cells_.empty()) return {};
      SPLATVOL_TRY_ASSIGN(points, leaves_.next());
      if (!points) return fail(ErrorCode::invalid_data, "a cell has a corner that is in no leaf of the index");
      leaf_end_ += *points;
    }
    leaf_cells_.push_back(*cell);
    ++next_ready_;
  }
  return {};
}

Result<bool> MeshCells::next_chunk(std::vector<RankedCell>& cells) {
  cells.clear();
  for (;;) {
    if (leaf_cells_.empty()) SPLATVOL_TRY(gather_leaf());
    if (leaf_cells_.empty()) return !cells.empty();
    if (!cells.empty() && cells.size() + leaf_cells_.size() > joined_cells) return true;
    cells.insert(cells.end(), leaf_cells_.begin(), leaf_cells_.end());
    leaf_cells_.clear();
    if (cells.size() >= joined_cells) return true;
  }
}

Status MeshCells::next_segments(std::size_t count, std::size_t levels, std::vector<std::uint8_t>& segments) {
  segments.assign(count, static_cast<std::uint8_t>(levels - 1));
  next_stays_.resize(stays_.size());
  const std::uint64_t end = next_rank_ + count;
  for (std::size_t level = 1; level < stays_.size(); ++level) {
    std::optional<std::uint64_t>& next = next_stays_[level];
    if (!next) SPLATVOL_TRY_SET(next, stays_[level]->next());
    while (next && *next < end) {
      segments[*next - next_rank_] = static_cast<std::uint8_t>(levels - 1 - level);
      SPLATVOL_TRY_SET(next, stays_[level]->next());
    }
  }
  next_rank_ = end;
  return {};
}

}  // namespace splatvol
