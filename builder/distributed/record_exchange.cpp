#include "builder/distributed/record_exchange.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cstring>
#include <numeric>
#include <utility>

#include "base/interruption.h"

namespace splatvol {
namespace {

// The part of a piece that goes in one round.
struct PiecePart {
  std::size_t owner;
  std::uint64_t count;
};

// The parts of the records [begin, end) of all pieces.
class PartCursor {
 public:
  explicit PartCursor(const PieceTurns& pieces) : pieces_(pieces) {}

  std::vector<PiecePart> next(std::uint64_t count) {
    std::vector<PiecePart> parts;
    while (count > 0 && piece_ < pieces_.turns().size()) {
      const PieceTurns::Turn& turn = pieces_.turns()[piece_];
      const std::uint64_t part = std::min(turn.records - taken_, count);
      if (part > 0) parts.push_back({turn.owner, part});
      count -= part;
      taken_ += part;
      if (taken_ < turn.records) break;
      ++piece_;
      taken_ = 0;
    }
    return parts;
  }

 private:
  const PieceTurns& pieces_;
  std::size_t piece_ = 0;
  std::uint64_t taken_ = 0;  // records of that piece
};

// A round of exchange_pieces. The message to a rank begins with the number of records in each part, then come these.
class Round {
 public:
  Round(Ranks& ranks, PieceTurns& pieces, const PointRecords& layout, const Cube& cube, const RangeBegins& begins,
        bool leaves_out)
      : ranks_(ranks), pieces_(pieces), layout_(layout), cube_(cube), begins_(begins), leaves_out_(leaves_out) {}

  Status pack(std::span<const PiecePart> parts) {
    records_.clear();
    part_ends_.clear();
    for (const PiecePart& part : parts) {
      if (part.owner != ranks_.rank()) continue;
      SPLATVOL_TRY(pieces_.take(part.count, records_));
      part_ends_.push_back(records_.size() / layout_.bytes());
    }
    find_owners();
    fill_messages();
    return check_interruption();
  }

  Status send(std::span<const PiecePart> parts, const VisitRecords& visit) {
    const std::vector<std::uint64_t> counts = ranks_.exchange(messages_, message_bytes_, received_);
    std::vector<std::uint64_t> parts_of(ranks_.size()), heads(ranks_.size()), records(ranks_.size());
    for (const PiecePart& part : parts) ++parts_of[part.owner];
    for (std::size_t r = 0, at = 0; r < ranks_.size(); at += counts[r++]) {
      heads[r] = at;
      records[r] = at + parts_of[r] * sizeof(std::uint64_t);
    }
    for (const PiecePart& part : parts) {
      if (counts[part.owner] == 0) continue;  // to a rank without a range
      std::uint64_t count = 0;
      std::memcpy(&count, received_.data() + heads[part.owner], sizeof count);
      heads[part.owner] += sizeof count;
      const std::uint64_t bytes = count * layout_.bytes();
      if (bytes > 0) SPLATVOL_TRY(visit(std::span(received_).subspan(records[part.owner], bytes)));
      records[part.owner] += bytes;
    }
    return {};
  }

 private:
  static constexpr std::uint32_t nobody = std::numeric_limits<std::uint32_t>::max();

  void find_owners() {
    const std::size_t count = records_.size() / layout_.bytes();
    owners_.resize(count);
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, count, 4096), [&](const auto& range) {
      for (std::size_t i = range.begin(); i < range.end(); ++i) {
        const MortonKey key = morton_key(layout_.position(records_.data() + i * layout_.bytes()), cube_);
        owners_[i] = static_cast<std::uint32_t>(range_of(begins_, key));
      }
    });
    for (std::size_t i = 0; leaves_out_ && i < count; ++i)
      if (pieces_.reader().leave_out(records_.data() + i * layout_.bytes())) owners_[i] = nobody;
  }

  void fill_messages() {
    const std::size_t ranges = begins_.size() + 1, parts = part_ends_.size();
    std::vector<std::uint64_t> counts(ranges * parts);  // [range][part]
    for (std::size_t i = 0, part = 0; i < owners_.size(); ++i) {
      while (i >= part_ends_[part]) ++part;
      if (owners_[i] != nobody) ++counts[owners_[i] * parts + part];
    }
    message_bytes_.assign(ranks_.size(), 0);
    std::vector<std::uint64_t> ends(ranges);  // where the next record of a range goes
    std::uint64_t bytes = 0;
    for (std::size_t range = 0; range < ranges; ++range) {
      const auto of_range = std::span(counts).subspan(range * parts, parts);
      const std::uint64_t records = std::accumulate(of_range.begin(), of_range.end(), std::uint64_t{0});
      ends[range] = bytes + of_range.size_bytes();
      message_bytes_[range] = of_range.size_bytes() + records * layout_.bytes();
      bytes += message_bytes_[range];
    }
    messages_.resize(bytes);
    for (std::size_t range = 0, at = 0; range < ranges; at += message_bytes_[range++])
      if (parts > 0) std::memcpy(messages_.data() + at, counts.data() + range * parts, parts * sizeof(std::uint64_t));
    for (std::size_t i = 0; i < owners_.size(); ++i) {
      if (owners_[i] == nobody) continue;
      std::memcpy(messages_.data() + ends[owners_[i]], records_.data() + i * layout_.bytes(), layout_.bytes());
      ends[owners_[i]] += layout_.bytes();
    }
  }

  Ranks& ranks_;
  PieceTurns& pieces_;
  const PointRecords& layout_;
  const Cube& cube_;
  const RangeBegins& begins_;
  bool leaves_out_;
  std::vector<std::byte> records_;        // of this rank's parts
  std::vector<std::uint64_t> part_ends_;  // [part of this rank]: where the records of the next begin
  std::vector<std::uint32_t> owners_;     // [record]
  Bytes messages_, received_;
  std::vector<std::uint64_t> message_bytes_;  // [rank]
};

}  // namespace

Status exchange_pieces(Ranks& ranks, PieceTurns& pieces, const PointRecords& layout, const Cube& cube,
                       const RangeBegins& begins, bool leaves_out, std::size_t memory, const VisitRecords& visit) {
  constexpr std::size_t most_memory = std::size_t{1} << 30;  // a message has less than 2 GiB
  const std::uint64_t together = std::max<std::uint64_t>(std::min(memory, most_memory) / layout.bytes(), 1);
  PartCursor cursor(pieces);
  Round round(ranks, pieces, layout, cube, begins, leaves_out);
  Status visited;
  for (std::vector<PiecePart> parts = cursor.next(together); !parts.empty(); parts = cursor.next(together)) {
    const Status packed = visited ? round.pack(parts) : visited;
    SPLATVOL_TRY(ranks.agree(packed));
    visited = round.send(parts, visit);
  }
  return ranks.agree(visited);
}

Status exchange_records(Ranks& ranks, std::size_t record_bytes, std::size_t memory,
                        const std::function<Result<OwnedRecords>()>& next, const VisitRecords& visit) {
  const std::size_t most = std::max<std::size_t>(memory / ranks.size() / record_bytes, 1);  // records in a round
  OwnedRecords held;
  std::size_t at = 0;  // record of those held
  Bytes messages, received;
  Status status;
  for (;;) {
    if (status && at == held.owners.size()) {
      auto more = next();
      status = status_of(more);
      held = more ? std::move(*more) : OwnedRecords{};
      at = 0;
    }
    SPLATVOL_TRY(ranks.agree(status));
    const std::size_t count = std::min(most, held.owners.size() - at);
    std::uint64_t left = count;
    ranks.largest({&left, 1});
    if (left == 0) return {};

    std::vector<std::uint64_t> bytes(ranks.size()), ends(ranks.size());
    for (std::size_t i = at; i < at + count; ++i) bytes[held.owners[i]] += record_bytes;
    std::exclusive_scan(bytes.begin(), bytes.end(), ends.begin(), std::uint64_t{0});
    messages.resize(count * record_bytes);
    for (std::size_t i = at; i < at + count; ++i) {
      std::memcpy(messages.data() + ends[held.owners[i]], held.records.data() + i * record_bytes, record_bytes);
      ends[held.owners[i]] += record_bytes;
    }
    at += count;
    (void)ranks.exchange(messages, bytes, received);
    if (!received.empty()) status = visit(received);
  }
}

}  // namespace splatvol
