#include "builder/distributed/joint_cells.h"

#include <array>
#include <limits>
#include <numeric>
#include <span>
#include <utility>

#include "builder/distributed/record_exchange.h"
#include "builder/output/byte_streams.h"
#include "builder/pipeline/store_cells.h"

namespace splatvol {
namespace {

struct TagRank {
  PointTag tag;
  std::uint64_t rank;
};

struct Stay {
  std::uint64_t level, rank;
};

template <class Record>
std::span<const std::byte> bytes_of(const Record& record) {
  return std::as_bytes(std::span(&record, 1));
}

// The sort of tags knows 63 bits of them.
std::uint32_t pieces_of_rank(const Ranks& ranks) {
  return static_cast<std::uint32_t>(std::numeric_limits<std::int32_t>::max() / ranks.size());
}

}  // namespace

Result<std::unique_ptr<JointCells>> JointCells::create(Ranks& ranks, const Source& source, const BuildOptions& options,
                                                       const std::string& folder) {
  SPLATVOL_TRY_ASSIGN(cells, start_cells(source, options, folder));
  if (!cells) return nullptr;
  std::unique_ptr<JointCells> joint(new JointCells(ranks, std::move(cells), options.memory, folder));
  joint->cells_->spool().number_pieces(joint->first_piece());
  return joint;
}

std::uint32_t JointCells::first_piece() const {
  return static_cast<std::uint32_t>(ranks_.rank()) * pieces_of_rank(ranks_);
}

Status JointCells::add_rank(PointTag tag, std::uint64_t rank) { return tags_.append(bytes_of(TagRank{tag, rank})); }

Status JointCells::add_stay(std::size_t level, std::uint64_t rank) {
  return stays_.append(bytes_of(Stay{level, rank}));
}

CellSpool::Counts JointCells::sum_counts() {
  CellSpool::Counts counts = cells_->spool().counts();
  ranks_.sum(counts);
  return counts;
}

Status JointCells::give_to_first() {
  const CellSpool::Counts counts = sum_counts();
  CellSpool& spool = cells_->spool();
  SPLATVOL_TRY(ranks_.gather_in_order(
      [&](const Ranks::Emit& emit) { return ranks_.is_first() ? Status{} : spool.read_packed(emit); },
      [&](std::size_t, std::span<const std::byte> bytes) { return spool.add_packed(bytes); }));
  if (ranks_.is_first()) spool.set_counts(counts);
  return {};
}

Status JointCells::sort() {
  SPLATVOL_TRY(send_tags());
  SPLATVOL_TRY(send_cells());
  return send_stays();
}

Status JointCells::send_tags() {
  const auto next = [&]() -> Result<OwnedRecords> {
    SPLATVOL_TRY_ASSIGN(bytes, tags_.next());
    OwnedRecords owned{bytes, {}};
    for (ByteReader in(bytes); !in.at_end();) {
      TagRank record{};
      in.get(record);
      owned.owners.push_back(static_cast<std::uint32_t>(record.tag >> 32) / pieces_of_rank(ranks_));
    }
    return owned;
  };
  return exchange_records(ranks_, sizeof(TagRank), memory_ / 32, next, [&](std::span<const std::byte> bytes) -> Status {
    for (ByteReader in(bytes); !in.at_end();) {
      TagRank record{};
      in.get(record);
      SPLATVOL_TRY(cells_->add_rank(record.tag, record.rank));
    }
    return {};
  });
}

// Each rank translates its cells at the same time as the others. Then rank 0 gets them.
Status JointCells::send_cells() {
  std::array<std::uint64_t, 1> rank_end = {cells_->rank_end()};
  ranks_.sum(rank_end);
  cells_->set_rank_end(rank_end[0]);
  BlockSpool translated(folder_);
  const auto keep = [&](format::CellShape shape, std::span<const CellWord> records) -> Status {
    if (records.empty()) return {};
    ByteWriter out;
    out.put(shape);
    out.put(std::uint64_t{records.size()});
    out.append(std::as_bytes(records));
    return translated.append(out.bytes());
  };
  const auto translate = [&]() -> Status {
    SPLATVOL_TRY(cells_->number_corners());
    return cells_->translate(keep);
  };
  SPLATVOL_TRY(ranks_.agree(translate()));
  std::array<std::uint64_t, 2> sums = {cells_->collapsed(), cells_->hash()};
  ranks_.sum(sums);
  cells_->set_sums(sums[0], sums[1]);
  const CellSpool::Counts counts = sum_counts();
  SPLATVOL_TRY(ranks_.agree(ranks_.is_first() ? cells_->start_sorts(counts) : Status{}));
  std::vector<CellWord> records;
  const auto add = [&](std::size_t, std::span<const std::byte> bytes) -> Status {
    for (ByteReader in(bytes); !in.at_end();) {
      format::CellShape shape{};
      in.get(shape);
      in.get(records);
      SPLATVOL_TRY(cells_->add_records(shape, records));
    }
    return {};
  };
  SPLATVOL_TRY(ranks_.gather_in_order([&](const Ranks::Emit& emit) { return translated.read(emit); }, add));
  return ranks_.agree(ranks_.is_first() ? cells_->finish_sorts() : Status{});
}

// A level's points come from ranges that follow each other, or all from rank 0.
Status JointCells::send_stays() {
  const auto add = [&](std::size_t, std::span<const std::byte> bytes) -> Status {
    for (ByteReader in(bytes); !in.at_end();) {
      Stay stay{};
      in.get(stay);
      SPLATVOL_TRY(cells_->add_stay(stay.level, stay.rank));
    }
    return {};
  };
  return ranks_.gather_in_order([&](const Ranks::Emit& emit) { return stays_.read(emit); }, add);
}

Status JointCells::add_leaf(const IndexLeaf& leaf) {
  return cells_->add_leaf(std::accumulate(leaf.counts.begin(), leaf.counts.end(), std::uint64_t{0}));
}

format::WriteCells JointCells::writer(const BuildProgress& progress) {
  return [this, &progress](const std::shared_ptr<const format::ChunkSource>& chunks,
                           const format::AppendBytes& append) -> Status {
    const auto write = [&](double fraction) { progress("writing cells", fraction); };
    SPLATVOL_TRY_SET(report_, write_cells(*cells_, chunks, memory_ / 4, folder_, append, write));
    return {};
  };
}

}  // namespace splatvol
