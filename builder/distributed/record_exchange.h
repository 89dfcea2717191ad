// Records on their way to the ranks that own them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "builder/distributed/key_ranges.h"
#include "builder/distributed/piece_turns.h"
#include "builder/distributed/ranks.h"

namespace splatvol {

using VisitRecords = std::function<Status(std::span<const std::byte>)>;

/// Collective: sends the records of all pieces to the ranks that own their keys, in rounds: the records of a round take
/// at most `memory` bytes in all ranks together, so that none can get more. Calls visit(records) for those of this
/// rank. They come in the order of the input: pieces ascending, and each piece in its own order. A stable sort then
/// keeps the order of a single process among records of one key. `leaves_out`: whether PieceReader::leave_out decides
/// which are sent.
[[nodiscard]] Status exchange_pieces(Ranks& ranks, PieceTurns& pieces, const PointRecords& layout, const Cube& cube,
                                     const RangeBegins& begins, bool leaves_out, std::size_t memory,
                                     const VisitRecords& visit);

/// Some records, and the rank that each goes to. Empty: there are no more.
struct OwnedRecords {
  std::span<const std::byte> records;
  std::vector<std::uint32_t> owners;
};

/// Collective: sends records to their owners in rounds, each of about `memory` bytes in all ranks together. The order
/// of records that a rank sends stays. `next`: the next records, at most some MiB.
[[nodiscard]] Status exchange_records(Ranks& ranks, std::size_t record_bytes, std::size_t memory,
                                      const std::function<Result<OwnedRecords>()>& next, const VisitRecords& visit);

}  // namespace splatvol
